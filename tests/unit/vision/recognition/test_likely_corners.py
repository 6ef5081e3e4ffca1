"""The most likely corners: between what was measured and what was taught, nearer to what is known better."""

from __future__ import annotations

import numpy as np
import pytest

from daemon import frames
from daemon.vision.geometry.polyhedron import Polyhedron
from daemon.vision.recognition.fits import FacetHypothesis, most_likely_corners
from tests.fakes.solids import CUBE, pose

POSE = pose(np.array([1.0, 0.5, 0.8]), 0.3)
TRUE = frames.apply(POSE, CUBE.corners_mm)
ALONG = np.array([1.0, 0.0, 0.0])
RINGS = tuple(CUBE.facets)


def solid(corners: np.ndarray, sigma_mm: float) -> Polyhedron:
    return Polyhedron(corners, RINGS, np.tile(sigma_mm**2 * np.eye(3), (8, 1, 1)))


def fit(missing: int = -1) -> FacetHypothesis:
    corners = np.where(np.arange(8) == missing, -1, np.arange(8))
    return FacetHypothesis("cube", tuple(range(6)), corners, POSE, np.eye(6), 1.0, 18, 0.1)


def test_they_are_the_mean_of_measured_and_taught_weighed_by_their_covariance() -> None:
    measured = TRUE + ALONG
    found = most_likely_corners(solid(measured, 0.3), solid(CUBE.corners_mm, 0.3), fit(), 0.0)
    assert found == pytest.approx(TRUE + 0.5 * ALONG)
    taught_well = most_likely_corners(solid(measured, 0.4), solid(CUBE.corners_mm, 0.2), fit(), 0.0)
    assert taught_well == pytest.approx(TRUE + 0.2 * ALONG)


def test_they_err_less_than_either_alone_and_as_little_as_theory_has_it() -> None:
    rng, seen_mm, taught_mm = np.random.default_rng(5), 0.4, 0.3
    off = []
    for _ in range(300):
        seen = solid(TRUE + rng.normal(0, seen_mm, (8, 3)), seen_mm)
        taught = solid(CUBE.corners_mm + rng.normal(0, taught_mm, (8, 3)), taught_mm)
        off.append(most_likely_corners(seen, taught, fit(), 0.0) - TRUE)
    best = seen_mm * taught_mm / np.hypot(seen_mm, taught_mm)
    assert np.std(off) == pytest.approx(best, rel=0.05)


def test_a_real_part_s_tolerance_gives_the_measured_ones_more_weight() -> None:
    measured = TRUE + ALONG
    seen, taught = solid(measured, 0.3), solid(CUBE.corners_mm, 0.0)
    assert most_likely_corners(seen, taught, fit(), 0.0) == pytest.approx(TRUE)
    assert most_likely_corners(seen, taught, fit(), 0.3) == pytest.approx(TRUE + 0.5 * ALONG)


def test_a_corner_never_taught_stays_where_it_was_measured() -> None:
    measured = TRUE + ALONG
    found = most_likely_corners(solid(measured, 0.3), solid(CUBE.corners_mm, 0.3), fit(missing=5), 0.0)
    assert found[2] == pytest.approx((measured[2] + TRUE[2]) / 2)
    assert found[5] == pytest.approx(measured[5])
