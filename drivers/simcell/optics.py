"""Geometry of one simulated camera: points to pixels, pixels to rays, lens distortion."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.arrays import Array
from drivers.rigid import apply, inverse

Array32 = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class LensCamera:
    """matrix (3, 3) px; distortion (5,) k1 k2 p1 p2 k3 of OpenCV; cyclopean_from_camera (4, 4) mm."""

    matrix: Array
    distortion: Array
    cyclopean_from_camera: Array

    def project(self, points_cyclopean_mm: Array) -> Array:
        """(N, 3) mm in the cyclopean frame -> (N, 2) px in the distorted image, pixel centres at whole numbers."""
        x, y, z = apply(inverse(self.cyclopean_from_camera), points_cyclopean_mm).T
        return distort(np.column_stack([x / z, y / z]), self.distortion) @ self.matrix[:2, :2].T + self.matrix[:2, 2]

    def directions(self, width: int, height: int) -> Array32:
        """(height + 1, width + 1, 2) undistorted x / z, y / z at the corners between the pixels.

        Entry [v, u] belongs to the image point (u - 0.5, v - 0.5). Exact to 1e-7 of the focal length (float32).
        """
        return _directions(self.matrix.tobytes(), self.distortion.tobytes(), width, height)


@lru_cache(maxsize=4)
def _directions(matrix: bytes, distortion: bytes, width: int, height: int) -> Array32:
    """What LensCamera.directions gives, read-only: a cell that is built anew has the lenses of the one before."""
    inner = np.frombuffer(matrix).reshape(3, 3)
    v, u = np.mgrid[0 : height + 1, 0 : width + 1] - 0.5
    seen = np.column_stack([u.ravel(), v.ravel()]) - inner[:2, 2]
    seen = seen @ np.linalg.inv(inner[:2, :2]).T
    straight = undistort(seen, np.frombuffer(distortion))
    found = straight.reshape(height + 1, width + 1, 2).astype(np.float32)
    found.setflags(write=False)
    return found


def distort(straight: Array, coefficients: ArrayLike) -> Array:
    """(N, 2) undistorted x / z, y / z -> (N, 2) distorted. OpenCV's five-coefficient model."""
    k1, k2, p1, p2, k3 = np.asarray(coefficients, float)
    x, y = straight.T
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.column_stack(
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ]
    )


def undistort(seen: Array, coefficients: ArrayLike) -> Array:
    """(N, 2) distorted x / z, y / z -> (N, 2) undistorted, by fixed-point steps until none moves by 1e-12."""
    straight = seen.copy()
    for _ in range(60):
        step = seen - distort(straight, coefficients)
        straight += step
        if np.max(np.abs(step), initial=0.0) < 1e-12:
            break
    return straight


def turned(lens: LensCamera, rotation_vector_deg: ArrayLike) -> LensCamera:
    """The camera rotated about its optical centre by a (3,) rotation vector, degrees, camera axes."""
    rotation, _ = cv2.Rodrigues(np.radians(np.asarray(rotation_vector_deg, float)))
    pose = lens.cyclopean_from_camera.copy()
    pose[:3, :3] = pose[:3, :3] @ rotation
    return LensCamera(lens.matrix, lens.distortion, pose)
