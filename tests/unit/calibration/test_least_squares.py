"""The least squares of a stereo calibration."""

from __future__ import annotations

import numpy as np

from daemon.calibration.least_squares import INTRINSICS, MatchedCorners, stereo_problem
from tests.fakes.boards import BOARD


def test_the_jacobian_is_the_slope_of_the_residuals() -> None:
    rng = np.random.default_rng(0)
    matches = [
        MatchedCorners(BOARD.points_mm(), rng.normal(300, 50, (54, 2)), rng.normal(300, 50, (54, 2))) for _ in range(2)
    ]
    eye = [700, 705, 320, 240, -0.1, 0.02, 0.001, 0.002, 0.01]
    x = np.array([*eye, *eye, 0.01, 0.15, 0.02, -60, 1, 2, 0.3, 0.2, 0.1, -50, -40, 400, -0.3, 0.2, 0.1, -30, -40, 350])
    problem = stereo_problem(matches)
    jacobian = problem(x)[1]
    for k in (0, 4, INTRINSICS + 8, 2 * INTRINSICS + 1, 2 * INTRINSICS + 4, 2 * INTRINSICS + 7, len(x) - 1):
        step = np.zeros(len(x))
        step[k] = 1e-6 * max(1.0, abs(x[k]))
        slope = (problem(x + step)[0] - problem(x - step)[0]) / (2 * step[k])
        np.testing.assert_allclose(jacobian[:, k], slope, atol=1e-4 * max(1.0, np.abs(slope).max()))
