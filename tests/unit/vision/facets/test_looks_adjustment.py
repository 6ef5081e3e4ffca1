"""Corners, places and what all looks share are estimated together."""

from __future__ import annotations

import numpy as np
import pytest

from daemon import frames
from daemon.vision.facets.many_looks.looks_adjustment import LookCorners, adjust_looks, shared_motion
from tests.fakes.observed_around import BASELINE_MM, DOUBT, FOCAL_PX, place, solid
from tests.fakes.solids import CUBE

PART = solid(CUBE)
FLAT = list(PART.rings)


def look(at: np.ndarray, said: np.ndarray | None = None) -> LookCorners:
    """All corners as they are, seen from there."""
    points = frames.apply(frames.inverse(at), PART.corners_mm)
    count = len(points)
    spread = np.repeat(np.diag([0.03**2, 0.03**2, 0.1**2])[None], count, axis=0)
    here = at if said is None else said
    return LookCorners(points, spread, np.arange(count), here, DOUBT.arm(), FOCAL_PX, BASELINE_MM)


def test_looks_that_agree_leave_everything_where_it_is() -> None:
    found = adjust_looks([look(place(turn, 0.7)) for turn in (0.0, 2.0, 4.0)], FLAT, DOUBT.shared())
    assert np.abs(found.corners_mm - PART.corners_mm).max() < 1e-6
    assert found.misfit < 1e-3
    assert np.abs(found.error).max() < 1e-6


def test_a_place_that_the_arm_said_wrongly_is_moved_and_the_part_stays_true() -> None:
    off = np.array([0.1, -0.1, 0.1, 2e-4, 0.0, 3e-4])
    places = [place(turn, 0.7) for turn in (0.0, 1.6, 3.1, 4.7)]
    looks = [look(places[0], frames.perturb(places[0], off)), *(look(at) for at in places[1:])]
    found = adjust_looks(looks, FLAT, DOUBT.shared())
    was, now = (np.linalg.norm(p[:3, 3] - places[0][:3, 3]) for p in (looks[0].base_from_cyclopean, found.places[0]))
    assert now < 0.8 * was
    sides = np.linalg.norm(found.corners_mm[PART.lines[0][:, 0]] - found.corners_mm[PART.lines[0][:, 1]], axis=1)
    assert np.abs(sides - 50.0).max() < 0.03


def test_a_corner_far_off_in_one_look_loses_its_say() -> None:
    looks = [look(place(turn, 0.7)) for turn in (0.0, 1.6, 3.1, 4.7)]
    looks[1].points_mm[3] += [1.5, 0.0, 0.0]
    found = adjust_looks(looks, FLAT, DOUBT.shared())
    assert np.abs(found.corners_mm - PART.corners_mm).max() < 0.06


def test_a_corner_no_look_measured_is_where_its_planes_meet() -> None:
    looks = []
    for turn in (0.0, 2.0, 4.0):
        whole = look(place(turn, 0.7))
        rest = np.arange(len(whole.points_mm) - 1)
        looks.append(
            LookCorners(
                whole.points_mm[rest], whole.covariance_mm2[rest], rest, whole.base_from_cyclopean, whole.covariance,
                FOCAL_PX, BASELINE_MM,
            )
        )  # fmt: skip
    found = adjust_looks(looks, FLAT, DOUBT.shared(), PART.corners_mm[-1:] + 0.8)
    assert np.abs(found.corners_mm[-1] - PART.corners_mm[-1]).max() < 0.02
    assert found.covariance_mm2.shape == (24, 24)


def test_shared_errors_move_a_point_as_hand_eye_and_pixels_do() -> None:
    points = np.array([[10.0, -20.0, 300.0]])
    rows = shared_motion(points, FOCAL_PX, BASELINE_MM)[0]
    turn = np.array([0.0, 0.0, 0.0, 1e-4, -2e-4, 3e-4, 0.0, 0.0, 0.0])
    moved = frames.rotation_from_vector(turn[3:6]) @ points[0] - points[0]
    assert rows @ turn == pytest.approx(moved, abs=1e-5)
    assert rows[:, 8] == pytest.approx(-points[0] * 300.0 / (FOCAL_PX * BASELINE_MM))
