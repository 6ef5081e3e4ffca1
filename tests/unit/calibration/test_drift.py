"""A knocked camera is noticed, named and timed; a camera that has not moved never is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.drift import Drift, initial_state, observe
from daemon.vision.geometry.rig import StereoRig
from daemon.vision.health.clues import Clue, clue
from tests.fakes.rigs import turned, unlike_rig

CUBE = 25.0 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
EDGES = [(i, j) for i in range(8) for j in range(i) if np.abs(CUBE[i] - CUBE[j]).sum() == 50.0]


def met(rig: StereoRig, left_px: Array, right_px: Array) -> Array:
    """Points midway between the two rays, as the calibration (not the truth) has them."""
    a, b = rig.left.cyclopean_from_camera, rig.right.cyclopean_from_camera
    d, e = (
        np.column_stack([camera.normalised(px), np.ones(len(px))]) @ camera.cyclopean_from_camera[:3, :3].T
        for camera, px in ((rig.left, left_px), (rig.right, right_px))
    )
    apart = b[:3, 3] - a[:3, 3]
    dd, ee, de, dw, ew = (d * d).sum(1), (e * e).sum(1), (d * e).sum(1), d @ apart, e @ apart
    s, t = np.array([dw * ee - ew * de, dw * de - ew * dd]) / (dd * ee - de**2)
    return np.asarray((a[:3, 3] + s[:, None] * d + b[:3, 3] + t[:, None] * e) / 2)


def look(truth: StereoRig, rng: np.random.Generator, at: str, believed: StereoRig | None = None) -> Clue:
    """What a cube somewhere in view says, seen with corners good to 0.1 px, three of its corners hidden."""
    believed = believed or unlike_rig()
    turn = frames.rotation_from_vector(rng.normal(0, 1, 3))
    cube = CUBE @ turn.T + np.array([*rng.uniform(-40, 40, 2), rng.uniform(250, 450)])
    seen = rng.permutation(8)[:7]
    left, right = (camera.project(cube[seen]) + rng.normal(0, 0.1, (7, 2)) for camera in (truth.left, truth.right))
    points = dict(zip(seen.tolist(), met(believed, left, right), strict=True))
    edges = [
        (float(np.linalg.norm(points[i] - points[j])), 50.0, float((points[i] + points[j])[2] / 2))
        for i, j in EDGES
        if i in points and j in points
    ]
    return clue(believed, left, right, edges, at)


def run(rig_at: Callable[[int], StereoRig], count: int, seed: int = 0) -> tuple[int, Drift] | None:
    """The first look with an alarm, and the alarm."""
    rng, watch = np.random.default_rng(seed), initial_state()
    for k in range(count):
        watch, drift = observe(watch, look(rig_at(k), rng, f"look {k}"))
        if drift is not None:
            return k, drift
    return None


@pytest.mark.parametrize(("axis", "name"), [(0, "pitched"), (1, "turned in"), (2, "rolled")])
def test_a_knock_of_a_fifth_of_a_degree_is_noticed_within_twenty_looks_and_named(axis: int, name: str) -> None:
    before, after = unlike_rig(), turned(unlike_rig(), axis, 0.2)
    found = run(lambda k: before if k < 50 else after, 90)
    assert found is not None
    at, drift = found
    assert 50 <= at < 70
    assert f" {name} by " in drift.text
    assert f" since look {at}: " in drift.text


@pytest.mark.parametrize("seed", range(3))
def test_a_single_misread_look_is_no_knock(seed: int) -> None:
    def rig_at(k: int) -> StereoRig:
        return turned(unlike_rig(), 0, 0.5) if k in (60, 90) else unlike_rig()

    assert run(rig_at, 150, seed) is None


def test_the_size_of_a_knock_is_told_once_it_is_known() -> None:
    rng, watch, drift = np.random.default_rng(3), initial_state(), None
    for k in range(120):
        rig = unlike_rig() if k < 50 else turned(unlike_rig(), 0, 0.2)
        watch, drift = observe(watch, look(rig, rng, f"look {k}"))
    assert drift is not None
    assert abs(drift.degrees) == pytest.approx(0.2, abs=0.03)
    assert drift.stops


def test_two_thousand_looks_of_a_camera_at_rest_raise_no_alarm() -> None:
    assert run(lambda _: unlike_rig(), 2000, seed=5) is None


def test_a_knock_in_the_first_hour_is_not_learnt_as_usual() -> None:
    before, after = unlike_rig(), turned(unlike_rig(), 0, 0.2)
    found = run(lambda k: before if k < 10 else after, 30)
    assert found is not None
    assert found[0] < 15


def test_the_first_looks_after_calibrating_raise_no_alarm() -> None:
    assert [run(lambda _: unlike_rig(), 40, seed) for seed in range(15)] == [None] * 15


def test_a_calibration_that_was_a_little_off_from_the_start_is_not_taken_for_a_drift() -> None:
    believed_wrong = turned(unlike_rig(), 0, 0.05)
    assert run(lambda _: believed_wrong, 300, seed=6) is None


def test_a_look_that_says_nothing_changes_nothing() -> None:
    watch = initial_state()
    after, drift = observe(watch, clue(unlike_rig(), np.zeros((0, 2)), np.zeros((0, 2)), [], "09:12"))
    assert drift is None
    assert not after.learnt_count.any()
