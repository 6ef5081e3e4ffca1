"""Planes through corners: found under noise, to the accuracy that the noise allows, facing the cameras."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.vision.geometry.facet_measures import fit_plane, planarity, weighted_plane

seeds = st.integers(0, 2**31)


def on_a_plane(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Points (count, 3) mm some 350 mm before the cameras, on a plane that is turned towards them: and its n and d."""
    normal = np.array([0.0, 0.0, -1.0]) + rng.uniform(-0.6, 0.6, 3)
    normal /= np.linalg.norm(normal)
    u = np.linalg.svd(normal[None])[2][1:]
    points = np.array([0.0, 0.0, 350.0]) + rng.uniform(-40, 40, (count, 2)) @ u
    return points, normal, float(normal @ points[0])


@given(seeds, st.integers(3, 12))
def test_points_on_a_plane_give_that_plane_facing_the_cameras(seed: int, count: int) -> None:
    points, normal, d = on_a_plane(np.random.default_rng(seed), count)
    found, level = fit_plane(points)
    if np.linalg.svd(points - points.mean(0))[1][1] > 1.0:  # not all on one line
        assert found == pytest.approx(normal, abs=1e-6)
        assert level == pytest.approx(d, abs=1e-6)
    assert found @ points.mean(0) < 0


@given(seeds)
def test_the_distance_from_the_plane_is_that_of_the_corner_that_was_lifted(seed: int) -> None:
    rng = np.random.default_rng(seed)
    square = 25.0 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) + [0, 0, 350]
    lift = rng.uniform(0.5, 4.0)
    square[0, 2] += lift
    # a square's corner lifted by h leaves each corner h / 4 off the best plane (to second order in h)
    assert planarity(square) == pytest.approx(lift / 4, rel=0.02)


def test_residuals_are_in_sigmas_of_the_predicted_error() -> None:
    rng = np.random.default_rng(1)
    sigma, chi2, dof = np.array([0.1, 0.1, 0.1, 0.8, 0.8, 0.8]), [], 6 - 3
    for _ in range(400):
        points, normal, _ = on_a_plane(rng, 6)
        covariance = sigma[:, None, None] ** 2 * np.eye(3)
        noisy = points + sigma[:, None] * rng.normal(size=(6, 1)) * normal
        chi2.append(float((weighted_plane(noisy, covariance)[2] ** 2).sum()))
    assert np.mean(chi2) == pytest.approx(dof, rel=0.15)


def test_a_corner_known_badly_hardly_tilts_the_plane() -> None:
    square = 25.0 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0, 0, 0]]) + [0, 0, 350]
    covariance = np.tile(0.01 * np.eye(3), (5, 1, 1))
    covariance[0] *= 10_000
    square[0, 2] += 5.0
    normal, _, off = weighted_plane(square, covariance)
    assert normal == pytest.approx([0, 0, -1], abs=1e-3)
    assert abs(fit_plane(square)[0][0]) > 0.04, "all weighed alike, it tilts"
    assert abs(off[0]) == pytest.approx(0.5, rel=0.05)
