"""Where parts could be that rest on a table: at corners that one camera sees, turned as their edges have it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.arrays import Array
from daemon.vision.facets.table_plane import TablePlane
from daemon.vision.geometry import Polyhedron, baseline, basis, exact
from daemon.vision.geometry.polyhedron import SolidBatch
from daemon.vision.hypotheses import resting_junctions
from daemon.vision.hypotheses.directional_edge_map import edge_distances
from daemon.vision.hypotheses.junctions import CameraJunctions
from daemon.vision.hypotheses.pose_batch import PoseBatch
from daemon.vision.hypotheses.resting_junctions import poses_on_support, resting_junctions_of
from daemon.vision.hypotheses.resting_poses import resting_planes
from daemon.vision.image import SegmentCorners, StereoImages, join_segments, open_stereo, segment_corners
from tests.fakes.printed import print_pair, straight_rig
from tests.fakes.solids import KNOWN, pose

SOLIDS = {name: exact(body.corners_mm, body.facets) for name, body in KNOWN.items()}
NAMES = tuple(sorted(SOLIDS))
GEOMETRY = baseline(straight_rig())
WHERE = pose(np.array([0.75, 0.35, 0.6]), 0.3, 330.0)
NO_CORNERS = SegmentCorners(np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros((0, 2), int))


@cache
def images_of(name: str) -> StereoImages:
    return open_stereo(*print_pair(KNOWN[name], WHERE, 3), straight_rig())


@cache
def corners_of(name: str) -> tuple[SegmentCorners, SegmentCorners]:
    left, right = (segment_corners(join_segments(view.segments)) for view in images_of(name).views)
    return left, right


def below(solid: Polyhedron, where: Array) -> TablePlane:
    """A table on which a solid at a pose rests."""
    planes = resting_planes(solid) @ np.diag([1.0, 1.0, 1.0, -1.0])
    down = planes[:, :3] @ where[:3, :3].T
    side = down[:, 2].argmax()
    return TablePlane(-down[side], float(planes[side, 3] - down[side] @ where[:3, 3]))


def guessed(name: str, *seen: SegmentCorners, by: float = 1.0) -> tuple[PoseBatch, int]:
    images = images_of(name)
    taught = SolidBatch.of([exact(SOLIDS[n].corners_mm * by, SOLIDS[n].facets) for n in NAMES])
    maps = edge_distances(images.left), edge_distances(images.right)
    return poses_on_support((seen[0], seen[1]), images.geometry, maps, below(SOLIDS[name], WHERE), taught)


def off_mm(name: str, found: PoseBatch) -> Array:
    """How far each guess has the corners of a part of this name from where they are; infinite for other parts."""
    there = frames.apply(WHERE, KNOWN[name].corners_mm)
    off = np.full(len(found.part), np.inf)
    for k in np.flatnonzero(found.part == NAMES.index(name)):
        corners = frames.apply(found.poses[k], KNOWN[name].corners_mm)
        off[k] = np.linalg.norm(corners[:, None] - there, axis=2).min(1).max()
    return off


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("camera", [0, 1])
def test_a_part_is_guessed_where_it_is_by_corners_that_one_camera_alone_sees(name: str, camera: int) -> None:
    seen = [NO_CORNERS, NO_CORNERS]
    seen[camera] = corners_of(name)[camera]
    found, could = guessed(name, *seen)
    assert off_mm(name, found).min() < 2.0
    assert len(found.part) < could


@pytest.mark.parametrize("name", NAMES)
def test_every_guess_rests_on_the_table(name: str) -> None:
    found, _ = guessed(name, *corners_of(name))
    table = below(SOLIDS[name], WHERE)
    for part, one in zip(found.part, found.poses, strict=True):
        heights = frames.apply(one, SOLIDS[NAMES[part]].corners_mm) @ table.up - table.level_mm
        assert heights.min() == pytest.approx(0.0, abs=1e-6)
        assert (heights < 1e-6).sum() >= 3
        assert np.linalg.det(one[:3, :3]) == pytest.approx(1.0)


@given(
    st.sampled_from(NAMES), st.integers(0, 6), st.floats(-np.pi, np.pi), st.floats(-60, 60), st.integers(0, 10**6),
    st.sampled_from([0, 1]),
)  # fmt: skip
def test_a_corner_and_its_longer_edge_say_how_a_resting_part_lies(
    name: str, side: int, spin: float, x: float, seed: int, camera: int
) -> None:
    """Corners as they would show: where the part lies is among what they could be, to what a kind of angle leaves."""
    rng, solid = np.random.default_rng(seed), SOLIDS[name]
    up = np.array([0.1, -0.6, -0.8]) + rng.normal(0, 0.15, 3)
    up /= np.linalg.norm(up)
    plane = resting_planes(solid)[side % len(resting_planes(solid))]
    turn = frames.rotation_from_vector(spin * up) @ taking(plane[:3], -up)
    middle = np.array([x, rng.uniform(-40, 40), rng.uniform(280, 430)])
    where = frames.rigid(turn, middle - turn @ solid.corners_mm.mean(0))
    level = float(up @ where[:3, 3] - plane[3])
    corners = shown(solid, where, camera)
    turned = GEOMETRY.cyclopean_from_baseline
    viewpoint_mm = GEOMETRY.middle_mm + (camera - 0.5) * GEOMETRY.length_mm * turned[:, 0]
    taught = resting_junctions_of((solid,))
    which, at, ways = resting_junctions.possible_places(
        corners, taught, turned.T @ up, float(up @ viewpoint_mm) - level
    )
    best = np.inf
    for k, place, one, other in zip(which, at, *ways, strict=True):
        from_corner = frames.rigid(turned @ basis(one[None], other[None])[0], turned @ place + viewpoint_mm)
        off = frames.apply(from_corner @ taught.taught.corner_from_part[taught.corner[k]], solid.corners_mm)
        best = min(best, np.linalg.norm(off[:, None] - frames.apply(where, solid.corners_mm), axis=2).min(1).max())
    assert best < 2.5  # a degree of slope or bearing over the length of a part, and which of two sides it is


def taking(one: Array, to: Array) -> Array:
    """A rotation that takes a unit direction to another."""
    axis, angle = np.cross(one, to), np.arccos(np.clip(one @ to, -1, 1))
    if np.linalg.norm(axis) < 1e-9:
        axis = np.cross(one, np.eye(3)[np.abs(one).argmin()])
    return frames.rotation_from_vector(angle * axis / np.linalg.norm(axis))


def shown(solid: Polyhedron, where: Array, camera: int) -> CameraJunctions:
    """Every corner of a solid with every two of its edges, as one camera would see them were it of glass."""
    points = (GEOMETRY.left, GEOMETRY.right)[camera].pixels(
        GEOMETRY.project(frames.apply(where, solid.corners_mm))[camera]
    )
    ends = np.concatenate([solid.lines[0], solid.lines[0][:, ::-1]])
    both = [(a, b) for a in ends for b in ends if a[0] == b[0] and a[1] < b[1]]
    at = np.array([points[a[0]] for a, _ in both])
    arms = np.array([[points[a[1]], points[b[1]]] for a, b in both])
    found = SegmentCorners(at, arms, np.ones((len(both), 2), int))
    return CameraJunctions.of(found, (GEOMETRY.left, GEOMETRY.right)[camera]).longer_first()


def test_an_edge_that_shows_longer_than_it_is_is_another_parts() -> None:
    found, _ = guessed("cube", *corners_of("cube"), by=0.6)
    small = found.poses[found.part == NAMES.index("cube")]
    there = frames.apply(WHERE, KNOWN["cube"].corners_mm)
    at = [frames.apply(one, 0.6 * KNOWN["cube"].corners_mm) for one in small]
    on_it = sum(bool(np.linalg.norm(one[:, None] - there, axis=2).min() < 1.0) for one in at)
    whole, _ = guessed("cube", *corners_of("cube"))
    assert on_it < 0.3 * (off_mm("cube", whole) < 2.0).sum()


def test_what_the_other_camera_does_not_bear_out_is_not_guessed() -> None:
    images = images_of("cube")
    there = edge_distances(images.left), edge_distances(images.right)
    nothing = type(there[1])(np.zeros_like(there[1].hit), there[1].chance, there[1].scale, there[1].origin)
    table, taught = below(SOLIDS["cube"], WHERE), SolidBatch.of([SOLIDS[name] for name in NAMES])
    left = corners_of("cube")[0]
    for maps, some in ((there, True), ((there[0], nothing), False)):
        found, could = poses_on_support((left, NO_CORNERS), images.geometry, maps, table, taught)
        assert could
        assert bool(len(found.part)) is some


def test_guesses_are_few_however_many_corners_show(monkeypatch: pytest.MonkeyPatch) -> None:
    every, could = guessed("cube", *corners_of("cube"))
    monkeypatch.setattr(resting_junctions, "MOST_GUESSES", 20)
    assert len(guessed("cube", *corners_of("cube"))[0].part) == 40 < len(every.part)
    monkeypatch.setattr(
        resting_junctions, "MOST_ASKED", 10 * len(resting_junctions_of(tuple(SOLIDS[n] for n in NAMES)).kinds)
    )
    assert guessed("cube", *corners_of("cube"))[1] < could / 2


def test_nothing_seen_or_nothing_taught_is_nothing_guessed() -> None:
    assert len(guessed("cube", NO_CORNERS, NO_CORNERS)[0].part) == 0
    images = images_of("cube")
    maps = edge_distances(images.left), edge_distances(images.right)
    found, could = poses_on_support(
        corners_of("cube"), images.geometry, maps, below(SOLIDS["cube"], WHERE), SolidBatch.of(())
    )
    assert len(found.poses) == could == 0


def test_from_below_a_table_nothing_is_guessed() -> None:
    """A table that somebody told wrongly."""
    assert len(guessed_over(TablePlane(np.array([0.0, 0.0, -1.0]), 100.0))[0].part) == 0


def test_where_the_sight_grazes_the_table_nothing_is_guessed() -> None:
    """There a little height is a long way."""
    up, least = np.array([0.0, -0.985, -0.17]) / np.linalg.norm([0.0, -0.985, -0.17]), resting_junctions.LEAST_SLOPE
    where, above_mm = cube_on_a_table(up, np.array([20.0, -6.0, 330.0]))
    corners = shown(SOLIDS["cube"], where, 0)
    slope = -np.concatenate([corners.at, np.ones((len(corners.at), 1))], 1) @ up
    assert slope.min() < 0.9 * least < 1.1 * least < slope.max()
    axes = GEOMETRY.cyclopean_from_baseline
    _, at, _ = resting_junctions.possible_places(
        corners, resting_junctions_of((SOLIDS["cube"],)), axes.T @ up, above_mm
    )
    assert len(at)
    assert (-at @ axes.T @ up > least * at[:, 2]).all()


def cube_on_a_table(up: Array, middle_mm: Array) -> tuple[Array, float]:
    """Its pose (4, 4), and how high the left camera is over the table."""
    solid = SOLIDS["cube"]
    turn = frames.rotation_from_vector(0.3 * up) @ taking(resting_planes(solid)[0, :3], -up)
    where = frames.rigid(turn, middle_mm - turn @ solid.corners_mm.mean(0))
    viewpoint_mm = GEOMETRY.middle_mm - 0.5 * GEOMETRY.length_mm * GEOMETRY.cyclopean_from_baseline[:, 0]
    return where, float(up @ viewpoint_mm - (frames.apply(where, solid.corners_mm) @ up).min())


def guessed_over(table: TablePlane) -> tuple[PoseBatch, int]:
    images = images_of("cube")
    maps = edge_distances(images.left), edge_distances(images.right)
    taught = SolidBatch.of([SOLIDS[name] for name in NAMES])
    return poses_on_support(corners_of("cube"), images.geometry, maps, table, taught)


def test_an_edge_that_stands_up_steep_says_nothing_of_how_a_part_is_turned() -> None:
    angles = resting_junctions_of((SOLIDS["cube"],)).angles
    assert np.abs(angles[:, 0]).max() < 1e-6
    assert np.abs(angles[:, 1]).max() == pytest.approx(np.pi / 2)


@pytest.mark.parametrize(("by", "fewest"), [(0.8, 2), (1.0, 20)])
def test_how_long_an_edge_may_show_is_seen_in_perspective(by: float, fewest: int) -> None:
    """A cube that is near and lies aslant, so that the far ends of its edges are much farther than the near ones; it
    has 24 corners of two edges, and a smaller one could be at few of them."""
    solid, up = SOLIDS["cube"], np.array([0.0, -0.8, -0.6])
    where, above_mm = cube_on_a_table(up, np.array([-90.0, 60.0, 190.0]))
    taught, corners = resting_junctions_of((exact(by * solid.corners_mm, solid.facets),)), shown(solid, where, 0)
    kept = 0
    for k in range(len(corners.at)):
        one = corners.chosen(np.array([k]))
        which, at, ways = resting_junctions.possible_places(
            one, taught, GEOMETRY.cyclopean_from_baseline.T @ up, above_mm
        )
        ends = at[:, None] + taught.taught.lengths_mm[taught.corner[which]][..., None] * ways.transpose(1, 0, 2)
        reach = np.linalg.norm(ends[..., :2] / ends[..., 2:] - one.at, axis=2)
        longest = 1.02 * resting_junctions.TOO_LONG * reach + resting_junctions.ROOM  # angles are a degree off
        assert (np.linalg.norm(one.arms, axis=2) < longest).all()
        kept += len(which) > 0
    assert kept >= fewest
