"""The rigid fit: a known pose comes back, its scatter is what the covariance says, and chi-square is one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.vision.geometry import robust_least_squares
from daemon.vision.geometry.robust_least_squares import Fits, fit_poses, rough_fit

CUBE = np.array([[x, y, z] for x in (-25.0, 25) for y in (-25.0, 25) for z in (-25.0, 25)])
SEEN = CUBE[[0, 1, 2, 3, 4, 5, 6]]
ALL = np.ones((1, len(SEEN)), bool)
TAUGHT_MM2 = 0.02 * np.eye(3)

poses = st.builds(
    lambda turn, place: frames.rigid(frames.rotation_from_vector(np.array(turn)), np.array(place)),
    st.tuples(*[st.floats(-3, 3)] * 3),
    st.tuples(st.floats(-60, 60), st.floats(-60, 60), st.floats(250, 500)),
)


def doubt_at(points: np.ndarray) -> np.ndarray:
    """(K, 3, 3) mm^2 as two cameras have it: 0.4 mm along the ray, 0.08 mm across."""
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    along = rays[:, :, None] * rays[:, None, :]
    return 0.16 * along + 0.0064 * (np.eye(3) - along)


def fit(seen: np.ndarray, covariance: np.ndarray, used: np.ndarray = ALL, tau_mm: float = 0.0) -> Fits:
    model_covariance = np.tile(TAUGHT_MM2, (1, len(SEEN), 1, 1))
    return fit_poses(seen, covariance, SEEN[None], model_covariance, used, tau_mm)


def noisy(pose: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Corners as seen, and their covariance; the taught corners' own error is in them too."""
    true = frames.apply(pose, SEEN)
    covariance = doubt_at(true)
    drawn = np.stack([rng.multivariate_normal(np.zeros(3), c + TAUGHT_MM2) for c in covariance])
    return true + drawn, covariance


@given(poses)
@settings(deadline=None)
def test_corners_without_noise_give_the_pose_itself(pose: np.ndarray) -> None:
    true = frames.apply(pose, SEEN)
    found = fit(true, doubt_at(true))
    assert found.poses[0] == pytest.approx(pose, abs=1e-7)
    assert found.chi2[0] == pytest.approx(0.0, abs=1e-9)
    assert found.dof[0] == 3 * len(SEEN) - 6


def test_under_noise_the_pose_errs_as_its_covariance_says_and_chi_square_is_its_degrees_of_freedom() -> None:
    rng, errors, chi2 = np.random.default_rng(2), [], []
    pose = frames.rigid(frames.rotation_from_vector(np.array([2.1, 0.4, -0.8])), np.array([12.0, -8.0, 340.0]))
    for _ in range(250):
        found = fit(*noisy(pose, rng))
        motion = frames.difference(found.poses[0], pose)
        errors.append(motion @ np.linalg.solve(found.covariance[0], motion))
        chi2.append(found.chi2[0])
    assert np.mean(errors) == pytest.approx(6.0, rel=0.1)
    assert np.mean(chi2) == pytest.approx(3 * len(SEEN) - 6, rel=0.1)


def test_another_step_would_move_no_corner_by_a_micrometre(monkeypatch: pytest.MonkeyPatch) -> None:
    """With noise three times as great as usual."""
    there, rng = [], np.random.default_rng(4)
    pose = frames.rigid(frames.rotation_from_vector(np.array([2.1, 0.4, -0.8])), np.array([12.0, -8.0, 340.0]))
    looks = [noisy(pose, rng) for _ in range(40)]
    true = frames.apply(pose, SEEN)
    for more in (0, 3):
        monkeypatch.setattr(robust_least_squares, "STEPS", robust_least_squares.STEPS + more)
        there.append([frames.apply(fit(true + 3 * (seen - true), doubt).poses[0], SEEN) for seen, doubt in looks])
    assert np.abs(np.array(there[0]) - np.array(there[1])).max() < 1e-3


def test_a_corner_that_is_not_used_may_lie_anywhere() -> None:
    pose = frames.rigid(np.eye(3), np.array([0.0, 0.0, 350.0]))
    true = frames.apply(pose, SEEN)
    seen, used = true.copy(), ALL.copy()
    seen[3] += 30.0
    used[0, 3] = False
    found = fit(seen, doubt_at(true), used)
    assert found.poses[0] == pytest.approx(pose, abs=1e-7)
    assert found.dof[0] == 3 * (len(SEEN) - 1) - 6


@given(poses)
@settings(deadline=None)
def test_a_mirrored_part_is_another_part(pose: np.ndarray) -> None:
    """The best proper rotation is found, and it does not fit."""
    odd = SEEN + np.array([[0, 0, 0], [6.0, 2, 0], [0, 9, 4], [3, 0, 0], [0, 0, 8], [1, 0, 0], [0, 5, 0]])
    true = frames.apply(pose, odd * [-1, 1, 1])
    model_covariance = np.tile(TAUGHT_MM2, (1, len(SEEN), 1, 1))
    found = fit_poses(true, doubt_at(true), odd[None], model_covariance, ALL, 0.0)
    assert np.linalg.det(found.poses[0, :3, :3]) == pytest.approx(1.0)
    assert found.rms_mm[0] > 2.0


def test_a_tolerance_for_the_part_lowers_the_chi_square_and_widens_the_covariance() -> None:
    pose = frames.rigid(np.eye(3), np.array([0.0, 0.0, 350.0]))
    seen, covariance = noisy(pose, np.random.default_rng(3))
    strict, lenient = fit(seen, covariance), fit(seen, covariance, tau_mm=0.5)
    assert lenient.chi2[0] < strict.chi2[0]
    assert np.trace(lenient.covariance[0]) > np.trace(strict.covariance[0])


def test_the_closed_form_alone_tells_a_fit_from_a_misfit() -> None:
    pose = frames.rigid(frames.rotation_from_vector(np.array([0.3, 0.2, 0.1])), np.array([0.0, 0.0, 350.0]))
    true = frames.apply(pose, SEEN)
    models = np.stack([SEEN, SEEN * 1.2])
    rms = rough_fit(true, doubt_at(true), models, np.repeat(ALL, 2, axis=0))[2]
    assert rms[0] < 1e-9
    assert rms[1] > 5.0
