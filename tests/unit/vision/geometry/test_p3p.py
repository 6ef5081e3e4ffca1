"""Poses from three corners in one image: the true one is among the solutions, and each solution shows what was seen."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.vision.geometry.p3p import p3p_poses

seeds = st.integers(0, 2**31)


def three_corners(rng: np.random.Generator) -> np.ndarray:
    """(3, 3) mm, of a part some 50 mm wide, well off one line."""
    while True:
        points = rng.uniform(-30, 30, (3, 3))
        if np.linalg.norm(np.cross(points[1] - points[0], points[2] - points[0])) > 600:
            return points


def seen_at(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    there = frames.apply(pose, points)
    return there[:, :2] / there[:, 2:]


def a_pose(rng: np.random.Generator) -> np.ndarray:
    turn = frames.rotation_from_vector(rng.uniform(-2, 2, 3))
    return frames.rigid(turn, np.array([*rng.uniform(-40, 40, 2), rng.uniform(300, 600)]))


def facing(pose: np.ndarray, points: np.ndarray) -> float:
    """Cosine between the triangle's plane and the ray to it: 0 seen edge-on, 1 squarely."""
    there = frames.apply(pose, points)
    normal = np.cross(there[1] - there[0], there[2] - there[0])
    middle = there.mean(0)
    return float(abs(normal @ middle) / np.linalg.norm(normal) / np.linalg.norm(middle))


@given(seeds)
@settings(deadline=None)
def test_the_true_pose_is_among_the_solutions(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, pose = three_corners(rng), a_pose(rng)
    assume(facing(pose, points) < 0.75)  # seen squarely, two solutions meet, and rounding decides which is found
    found, solved = p3p_poses(points[None], seen_at(pose, points)[None])
    assert found.shape == (2, 4, 4)
    off = [np.abs(frames.apply(p, points) - frames.apply(pose, points)).max() for p in found[solved]]
    assert min(off) < 0.01


@given(seeds)
@settings(deadline=None)
def test_every_solution_is_a_rigid_motion_that_shows_the_corners_where_they_were_seen(seed: int) -> None:
    rng = np.random.default_rng(seed)
    many = [(three_corners(rng), a_pose(rng)) for _ in range(20)]
    points, seen = np.stack([p for p, _ in many]), np.stack([seen_at(pose, p) for p, pose in many])
    found, solved = p3p_poses(points, seen)
    assert solved.any()
    for k in np.flatnonzero(solved):
        turn = found[k, :3, :3]
        assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-9)
        assert np.linalg.det(turn) == pytest.approx(1.0)
        shown = seen_at(found[k], points[k % 20])
        assert np.abs(shown - seen[k % 20]).max() < 2e-2 * np.ptp(seen[k % 20], axis=0).max()


def test_guesses_that_do_not_show_what_was_seen_are_called_no_solutions() -> None:
    rng = np.random.default_rng(6)
    points, seen = np.stack([three_corners(rng) for _ in range(500)]), rng.uniform(-0.3, 0.3, (500, 3, 2))
    found, solved = p3p_poses(points, seen)
    assert not solved.all()
    shown = np.stack([seen_at(pose, points[k % 500]) for k, pose in enumerate(found)])
    off = np.abs(shown - np.concatenate([seen, seen])).max((1, 2))
    assert off[solved].max() < 0.05
    assert off[~solved].max() > 0.15


def test_what_no_three_corners_can_show_is_called_no_solution() -> None:
    flat = np.array([[0.0, 0, 0], [1e-9, 0, 0], [0, 1e-9, 0]])
    found, solved = p3p_poses(flat[None], np.array([[[0.0, 0], [0.1, 0], [0, 0.1]]]))
    assert not solved.any()
    assert np.isfinite(found).all()
