"""The least squares of calibrations: the minimum and its covariance against closed forms, the Jacobian its slope."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.arrays import Array
from daemon.calibration.least_squares import (
    INTRINSICS,
    MatchedCorners,
    Problem,
    UndeterminedError,
    minimise,
    solve,
    stereo_problem,
)
from tests.fakes.boards import BOARD


def linear(matrix: Array, seen: Array) -> Problem:
    return lambda x: (matrix @ x - seen, matrix)


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.integers(1, 5), st.integers(1, 9))
def test_a_linear_fit_is_the_closed_form_and_so_is_its_covariance(seed: int, count: int, spare: int) -> None:
    rng = np.random.default_rng(seed)
    units = 10.0 ** rng.uniform(-3, 3, count)  # parameters of unlike units, as of px and radians
    matrix = rng.normal(size=(count + spare, count)) / units
    found = solve(linear(matrix, seen := rng.normal(size=count + spare)), np.zeros(count))
    exact = np.linalg.lstsq(matrix, seen, rcond=None)[0]
    variance = np.sum((matrix @ exact - seen) ** 2) / spare
    covariance = np.linalg.inv(matrix.T @ matrix) * variance
    sigma = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(found.parameters - exact) < 1e-2 * sigma)
    np.testing.assert_allclose(
        found.covariance / np.outer(sigma, sigma), covariance / np.outer(sigma, sigma), atol=1e-3
    )
    assert np.sum(found.residuals**2) / spare == pytest.approx(variance, rel=1e-3)


@settings(max_examples=20)
@given(st.integers(0, 10**6), st.integers(2, 6), st.integers(1, 3))
def test_directions_that_nothing_determines_are_counted(seed: int, count: int, missing: int) -> None:
    rng = np.random.default_rng(seed)
    missing = min(missing, count - 1)
    matrix = rng.normal(size=(20, count - missing)) @ rng.normal(size=(count - missing, count))
    with pytest.raises(UndeterminedError, match=f"{missing} directions of {count} are undetermined"):
        solve(linear(matrix, rng.normal(size=20)), np.zeros(count))
    matrix[:, :missing] = 0.0
    with pytest.raises(UndeterminedError, match=f"{missing} of {count} parameters affect no observation"):
        solve(linear(matrix, rng.normal(size=20)), np.zeros(count))


def test_a_curved_valley_is_followed_to_its_end_and_a_step_that_makes_it_worse_is_not_taken() -> None:
    def valley(x: Array) -> tuple[Array, Array]:
        return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]]), np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])

    costs = [24.2]
    for passes in (*range(12), 60):
        x, residuals, jacobian = minimise(valley, np.array([-1.2, 1.0]), passes)
        np.testing.assert_array_equal(residuals, valley(x)[0])
        np.testing.assert_array_equal(jacobian, valley(x)[1])
        costs.append(float(residuals @ residuals))
        assert costs[-1] <= costs[-2]
    np.testing.assert_allclose(x, [1.0, 1.0], atol=1e-6)


def test_the_jacobian_is_the_slope_of_the_residuals() -> None:
    rng = np.random.default_rng(0)
    matches = [
        MatchedCorners(BOARD.points_mm(), rng.normal(300, 50, (54, 2)), rng.normal(300, 50, (54, 2))) for _ in range(2)
    ]
    camera = [700, 705, 320, 240, -0.1, 0.02, 0.001, 0.002, 0.01]
    x = np.array(
        [*camera, *camera, 0.01, 0.15, 0.02, -60, 1, 2, 0.3, 0.2, 0.1, -50, -40, 400, -0.3, 0.2, 0.1, -30, -40, 350]
    )
    problem = stereo_problem(matches)
    jacobian = problem(x)[1]
    for k in (0, 4, INTRINSICS + 8, 2 * INTRINSICS + 1, 2 * INTRINSICS + 4, 2 * INTRINSICS + 7, len(x) - 1):
        step = np.zeros(len(x))
        step[k] = 1e-6 * max(1.0, abs(x[k]))
        slope = (problem(x + step)[0] - problem(x - step)[0]) / (2 * step[k])
        np.testing.assert_allclose(jacobian[:, k], slope, atol=1e-4 * max(1.0, np.abs(slope).max()))
