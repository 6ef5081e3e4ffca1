"""The lens of the simulated cameras."""

from __future__ import annotations

import cv2
import numpy as np

from drivers.simcell.optics import distort, undistort


def test_distortion_is_opencvs_and_undoes_itself() -> None:
    straight = np.random.default_rng(0).uniform(-0.5, 0.5, (200, 2))
    coefficients = [-0.08, 0.03, 0.0004, -0.0003, 0.01]
    rays = np.column_stack([straight, np.ones(200)])
    theirs, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), np.eye(3), np.array(coefficients))
    assert np.allclose(distort(straight, coefficients), theirs[:, 0, :], atol=1e-12)
    assert np.allclose(undistort(distort(straight, coefficients), coefficients), straight, atol=1e-10)
