"""On which sides a part can rest, whether a pose is such a rest, and guesses that are laid down beside one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.arrays import Array
from daemon.vision.facets.table_plane import TablePlane
from daemon.vision.geometry import Polyhedron, baseline, exact
from daemon.vision.geometry.polyhedron import SolidBatch
from daemon.vision.hypotheses import resting_poses
from daemon.vision.hypotheses.pose_batch import PoseBatch
from daemon.vision.hypotheses.resting_poses import (
    SupportPlane,
    lies_on_support,
    nearest_resting_plane,
    resting_planes,
    snapped_poses,
)
from tests.fakes.printed import straight_rig
from tests.fakes.solids import KNOWN

UP = np.array([0.1, -0.6, -0.8]) / np.linalg.norm([0.1, -0.6, -0.8])
TABLE = TablePlane(UP, -290.0)
SOLIDS = {name: exact(body.corners_mm, body.facets) for name, body in KNOWN.items()}
LABELS = st.sampled_from(sorted(SOLIDS))
GEOMETRY = baseline(straight_rig())


def resting_pose(solid: Polyhedron, which: int, spin: float, x: float = 0.0, lifted_mm: float = 0.0) -> Array:
    """cyclopean_from_part of a solid on a side of it, turned about the table's normal."""
    normal = resting_planes(solid)[which % len(resting_planes(solid)), :3]
    turn = resting_poses.smallest_turns(normal[None], -UP)[0]
    turn = frames.rotation_from_vector(spin * UP) @ turn
    lowest = (solid.corners_mm @ turn.T @ UP).min()
    foot = np.array([x, 0.0, 0.0])
    foot[2] = (TABLE.level_mm - UP[:2] @ foot[:2]) / UP[2]
    return frames.rigid(turn, foot - turn @ solid.corners_mm.mean(0) + (lifted_mm - lowest + _height(solid, turn)) * UP)


def _height(solid: Polyhedron, turn: Array) -> float:
    return float(turn @ solid.corners_mm.mean(0) @ UP)


@pytest.mark.parametrize(
    ("name", "sides"), [("cube", 6), ("pyramid", 5), ("triangular_prism", 5), ("pentagonal_prism", 7)]
)
def test_a_convex_part_rests_on_each_of_its_sides(name: str, sides: int) -> None:
    solid = SOLIDS[name]
    found = resting_planes(solid)
    assert len(found) == sides
    assert (solid.corners_mm @ found[:, :3].T <= found[:, 3] + 1e-9).all()
    assert all((solid.normals @ one[:3]).max() > 1 - 1e-9 for one in found)


@given(LABELS, st.integers(0, 6), st.integers(0, 10_000))
def test_the_side_that_faces_most_down_is_where_its_corners_have_it(name: str, which: int, seed: int) -> None:
    """A solid as measured: its corners are not quite in one plane."""
    rng, solid = np.random.default_rng(seed), SOLIDS[name]
    measured = exact(solid.corners_mm + rng.normal(0, 0.1, solid.corners_mm.shape), solid.facets)
    side = resting_planes(solid)[which % len(resting_planes(solid))]
    normal, middle = nearest_resting_plane(measured, side[:3] + rng.normal(0, 0.02, 3))
    assert np.degrees(np.arccos(min(normal @ side[:3], 1.0))) < 1.0
    assert abs(middle @ side[:3] - side[3]) < 0.3


def test_a_side_that_was_not_taught_is_one_to_rest_on() -> None:
    body = KNOWN["cube"]
    shown = exact(body.corners_mm, body.facets[1:])
    assert len(resting_planes(shown)) == 6


def test_a_hollow_part_rests_across_its_hollow() -> None:
    angle = np.array([[0.0, 0], [40, 0], [40, 12], [12, 12], [12, 40], [0, 40]])
    corners = np.concatenate([np.column_stack([angle, np.full(6, z)]) for z in (0.0, 20.0)])
    sides = [(k, (k + 1) % 6, (k + 1) % 6 + 6, k + 6) for k in range(6)]
    solid = exact(corners, (tuple(range(5, -1, -1)), tuple(range(6, 12)), *sides))
    bridge = np.array([28.0, 28.0, 0]) / np.hypot(28, 28)
    assert max(resting_planes(solid)[:, :3] @ bridge) > 1 - 1e-9
    assert len(resting_planes(solid)) == 7  # two ends, four outer sides, and the bridge; neither side of the hollow


def test_a_part_of_very_many_corners_rests_on_its_facets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resting_poses, "MOST_CORNERS", 4)
    pyramid = KNOWN["pyramid"]
    assert len(resting_planes(exact(pyramid.corners_mm, pyramid.facets))) == 5


@given(LABELS, st.integers(0, 6), st.floats(-3, 3), st.floats(-60, 60))
def test_a_part_that_lies_on_the_table_rests(name: str, which: int, spin: float, x: float) -> None:
    pose = resting_pose(SOLIDS[name], which, spin, x)
    for seen in (True, False):
        assert lies_on_support(SupportPlane(TABLE, seen), SOLIDS[name], pose) is True


@given(LABELS, st.integers(0, 6), st.floats(-3, 3), st.sampled_from([8.0, 35.0]))
def test_one_that_hangs_in_the_air_does_not(name: str, which: int, spin: float, lifted_mm: float) -> None:
    pose = resting_pose(SOLIDS[name], which, spin, lifted_mm=lifted_mm)
    assert lies_on_support(SupportPlane(TABLE, True), SOLIDS[name], pose) is False
    assert lies_on_support(SupportPlane(TABLE, False), SOLIDS[name], pose) is None, "it may lie on something else"


@pytest.mark.parametrize("lifted_mm", [45.0, -8.0, -30.0])
def test_one_high_above_the_table_may_be_held_and_one_sunk_in_it_shows_that_it_is_none(lifted_mm: float) -> None:
    pose = resting_pose(SOLIDS["cube"], 0, 0.5, lifted_mm=lifted_mm)
    assert lies_on_support(SupportPlane(TABLE, True), SOLIDS["cube"], pose) is None


def tilted(pose: Array, solid: Polyhedron, degrees: float) -> Array:
    """Turned about a line in the table through its own origin, and set down again."""
    turn, about = frames.rotation_from_vector(np.radians(degrees) * np.cross(UP, [1.0, 0.0, 0.0])), pose[:3, 3]
    found = frames.rigid(turn, about - turn @ about) @ pose
    lowest = (frames.apply(found, solid.corners_mm) @ UP).min() - TABLE.level_mm
    return frames.rigid(np.eye(3), -lowest * UP) @ found


@given(LABELS, st.integers(0, 6), st.floats(-3, 3))
def test_one_that_stands_on_an_edge_does_not(name: str, which: int, spin: float) -> None:
    pose = tilted(resting_pose(SOLIDS[name], which, spin), SOLIDS[name], 12.0)
    assert lies_on_support(SupportPlane(TABLE, True), SOLIDS[name], pose) is False


@given(LABELS, st.integers(0, 6), st.floats(-3, 3), st.sampled_from([(4.5, 0.0), (0.0, 4.5), (0.0, -4.5)]))
def test_one_that_nearly_lies_speaks_neither_way(name: str, which: int, spin: float, off: tuple[float, float]) -> None:
    pose = resting_pose(SOLIDS[name], which, spin, lifted_mm=off[1])
    if off[0]:
        pose = tilted(pose, SOLIDS[name], off[0])
    assert lies_on_support(SupportPlane(TABLE, True), SOLIDS[name], pose) is None


def test_of_a_part_with_two_known_sides_nobody_knows_what_it_rests_on() -> None:
    body = KNOWN["cube"]
    two = exact(body.corners_mm, body.facets[:1] + body.facets[2:3])
    assert lies_on_support(SupportPlane(TABLE, True), two, resting_pose(two, 0, 0.0, lifted_mm=30.0)) is None


def guesses(name: str, *poses: Array) -> PoseBatch:
    solids = SolidBatch.of((SOLIDS[name],))
    return PoseBatch(solids, np.zeros(len(poses), np.intp), np.stack(poses))


def moved(point: Array, way: Array, by: float, farther_mm: float) -> Array:
    """The motion that turns about a point, and then moves along the left camera's sight of it."""
    turn = frames.rotation_from_vector(by * way / np.linalg.norm(way))
    sight = point - np.array([-straight_rig().baseline_mm / 2, 0.0, 0.0])
    return frames.rigid(turn, point - turn @ point + farther_mm * sight / np.linalg.norm(sight))


@given(LABELS, st.integers(0, 6), st.floats(-3, 3), st.floats(0.02, 0.25), st.floats(-5, 5), st.integers(0, 2**31))
def test_a_guess_beside_a_rest_is_laid_down_where_the_left_camera_sees_its_corner(
    name: str, which: int, spin: float, by: float, farther_mm: float, seed: int
) -> None:
    true = resting_pose(SOLIDS[name], which, spin)
    corner = frames.apply(true, SOLIDS[name].corners_mm)[seed % len(SOLIDS[name].corners_mm)]
    way = np.cross(UP, np.random.default_rng(seed).normal(size=3))  # tilted, not turned about the table's normal
    guess = moved(corner, way, by, farther_mm) @ true
    at = frames.apply(guess @ frames.inverse(true), corner)
    found, still = snapped_poses(guesses(name, guess), np.array([[at, [1.0, 0.0, 0.0]]]), TABLE, GEOMETRY)
    assert not still[0, 1].any(), "it turns about nothing any more"
    assert found.poses[0][:3, 3] == pytest.approx(true[:3, 3], abs=1e-4)
    assert frames.angle_between(found.poses[0], true) < 1e-5


@pytest.mark.parametrize("lifted_mm", [40.0, -60.0])
def test_what_is_far_from_any_rest_stays_as_it_is(lifted_mm: float) -> None:
    guess = resting_pose(SOLIDS["cube"], 0, 0.4, lifted_mm=lifted_mm)
    hinges = np.array([[guess[:3, 3], [1.0, 0.0, 0.0]]])
    found, still = snapped_poses(guesses("cube", guess), hinges, TABLE, GEOMETRY)
    assert found.poses == pytest.approx(guess[None])
    assert still == pytest.approx(hinges)


def test_what_both_cameras_see_comes_before_what_is_known() -> None:
    other = TablePlane(UP, -300.0)
    assert SupportPlane.of(None, None) is None
    assert (SupportPlane.of(TABLE, other).table, SupportPlane.of(TABLE, other).seen) == (TABLE, True)
    assert (SupportPlane.of(None, other).table, SupportPlane.of(None, other).seen) == (other, False)
