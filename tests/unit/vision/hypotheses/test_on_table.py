"""A part that lies on a table which is seen is laid flat on it; one that stands on something else stays where it is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.arrays import Array
from daemon.store.library import load_facets
from daemon.vision.facets.table_plane import TablePlane
from daemon.vision.geometry import exact
from daemon.vision.hypotheses import resting_poses
from daemon.vision.hypotheses.resting_poses import snapped_pose
from daemon.vision.look import look
from daemon.vision.model.model import Model, empty_model, learn_view
from daemon.vision.values import Part, Scene
from tests.fakes.printed import print_pair, straight_rig
from tests.fakes.solids import CUBE, KNOWN, pose, view_of

SOLID = exact(CUBE.corners_mm, CUBE.facets)
TURN = frames.rotation_from_vector(np.array([0.0, 0.0, 0.9])) @ frames.rotation_from_vector(np.array([0.6, 0.0, 0.0]))
FROM_TABLE = frames.rigid(TURN, np.array([0.0, 0.0, 340.0]))
LIES = FROM_TABLE @ frames.rigid(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
"""Its lowest side, z = 0, down in the table."""
TABLE = TablePlane(-FROM_TABLE[:3, 2], float(-FROM_TABLE[:3, 2] @ FROM_TABLE[:3, 3]))
SPREAD = np.diag([0.3**2] * 3 + [np.radians(0.4) ** 2] * 3)


def height_and_tilt(where: Array) -> tuple[float, float]:
    """Of the cube's lowest side over the table, mm, and against it, degrees."""
    low = frames.apply(where, SOLID.corners_mm[SOLID.corners_mm[:, 2] < 1.0].mean(0))
    return float(TABLE.up @ low - TABLE.level_mm), float(
        np.degrees(np.arccos(min(float(where[:3, 2] @ TABLE.up), 1.0)))
    )


@given(st.integers(0, 10_000))
def test_a_part_that_lies_about_there_is_laid_flat(seed: int) -> None:
    motion = np.random.default_rng(seed).normal(size=6) * np.sqrt(np.diag(SPREAD)) * 0.9
    off = frames.perturb(LIES, motion)
    found = snapped_pose(TABLE, SOLID, off, SPREAD)
    if found is None:  # so far up as one of hundreds
        assert height_and_tilt(off)[0] > 0
        return
    height, tilt = height_and_tilt(found[0])
    before = height_and_tilt(off)
    assert abs(height) < 0.3 * abs(before[0]) + 0.02
    assert tilt < 0.3 * before[1] + 0.02
    assert np.linalg.eigvalsh(found[1]).min() > 0
    assert np.linalg.eigvalsh(SPREAD - found[1]).min() > -1e-12


@pytest.mark.parametrize(("lifted_mm", "laid"), [(1.4, False), (0.5, True), (-1.4, True), (-3.0, False)])
def test_what_stands_on_something_stays_and_nothing_sinks_in(lifted_mm: float, laid: bool) -> None:
    there = frames.rigid(np.eye(3), lifted_mm * TABLE.up) @ LIES
    assert (snapped_pose(TABLE, SOLID, there, SPREAD) is not None) is laid


def test_a_table_moves_a_part_nowhere_along_what_no_edge_measures() -> None:
    """A cover from afar was laid a hand's breadth aside: a long way along which it was free, and which rose a little,
    cost less than to sink by two millimetres."""
    along = np.linalg.svd(TABLE.up[None])[2][1]
    free = np.concatenate([700.0 * (along + 0.03 * TABLE.up), np.zeros(3)])
    there = frames.rigid(np.eye(3), -2.0 * TABLE.up) @ LIES
    found = snapped_pose(TABLE, SOLID, there, SPREAD + np.outer(free, free))
    assert found is not None
    assert abs(frames.difference(found[0], there)[:3] @ along) < 15.0, "undamped 67 mm"
    assert abs(height_and_tilt(found[0])[0]) < 0.5, "of 2 mm"
    assert np.sqrt(along @ found[1][:3, :3] @ along) > 5.0, "the damping is no measurement"


def model() -> Model:
    taught, rng = empty_model(load_facets()), np.random.default_rng(3)
    for direction in ((1.0, 0.1, 0.8), (-0.7, -0.9, -0.6)):
        taught = learn_view(taught, view_of(KNOWN["cube"], pose(np.array(direction), 0.3), rng, 0.3), "cube")
    return taught


def cube_on_a_patterned_table(taught: Model) -> tuple[Scene, Part]:
    scene = look(*print_pair(CUBE, LIES, 1, table=FROM_TABLE, speckled=True), straight_rig(), taught)
    (part,) = (one for one in scene.parts if one.named)
    return scene, part


def too_high_mm(part: Part) -> float:
    """How far its corners are above or below where they are, on average."""
    truth = frames.apply(LIES, CUBE.corners_mm)
    seen = np.concatenate(part.fitted_mm)
    nearest = truth[np.linalg.norm(seen[:, None] - truth, axis=2).argmin(1)]
    return float(np.abs((seen - nearest) @ TABLE.up).mean())


def test_a_look_lays_what_it_names_on_the_table_it_sees(monkeypatch: pytest.MonkeyPatch) -> None:
    taught = model()
    _, laid = cube_on_a_patterned_table(taught)
    monkeypatch.setattr(resting_poses, "snapped_pose", lambda *_: None)
    _, as_seen = cube_on_a_patterned_table(taught)
    assert too_high_mm(laid) < 0.7 * too_high_mm(as_seen)
    turn = laid.cyclopean_from_part @ frames.inverse(as_seen.cyclopean_from_part)
    for before, after in zip(as_seen.fitted_mm, laid.fitted_mm, strict=True):
        np.testing.assert_allclose(after, frames.apply(turn, before), atol=1e-9)
    np.testing.assert_allclose(laid.equivalents, turn @ as_seen.equivalents, atol=1e-9)
    assert np.trace(laid.covariance) < np.trace(as_seen.covariance)
