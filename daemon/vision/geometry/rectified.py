"""Where the two eyes' pixels meet: rectified coordinates, and depth by exact rays or by D'Souza's formula (2.3).

Points and lines only; which point belongs to which is decided elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from daemon.arrays import Array
from daemon.vision.geometry.rig import Camera, StereoRig


@dataclass(frozen=True, eq=False)
class RectifiedCamera:
    """A camera seen from the baseline: ideal coordinates (x / z, y / z) in a frame whose x axis is the baseline.

    In these coordinates a point has the same y / z in both eyes, and lines in space are straight.
    baseline_from_camera (3, 3).
    """

    camera: Camera
    baseline_from_camera: Array

    def ideal(self, points_px: Array) -> Array:
        """(N, 2) distorted px -> (N, 2) ideal coordinates."""
        p = self.camera.normalised(points_px)
        rays = p @ self.baseline_from_camera[:, :2].T + self.baseline_from_camera[:, 2]
        return np.asarray(rays[:, :2] / rays[:, 2:])

    def least_aside(self, image_size: tuple[int, int]) -> float:
        """The least angle, radians, of any sight of an image (width, height) against the plane through the baseline
        that the eyes look away from; nought and less where one points along it or back, nan where lens and image do not
        go together."""
        x, y = (np.array([0.0, (size - 1) / 2, size - 1.0]) for size in image_size)
        rim = self.camera.normalised(np.stack(np.meshgrid(x, y), -1).reshape(-1, 2))
        rays = rim @ self.baseline_from_camera[:, :2].T + self.baseline_from_camera[:, 2]
        return float(np.arcsin(rays[:, 2] / np.linalg.norm(rays, axis=1)).min())

    def pixels(self, points: Array) -> Array:
        """(N, 2) ideal coordinates -> (N, 2) distorted px."""
        r = self.baseline_from_camera
        rays = np.ascontiguousarray(points @ r[:2] + r[2])
        if not len(rays):  # which OpenCV answers with nothing at all
            return np.zeros((0, 2))
        px, _ = cv2.projectPoints(rays[:, None], np.zeros(3), np.zeros(3), self.camera.matrix, self.camera.distortion)
        return np.asarray(px[:, 0], float)

    @property
    def focal_px(self) -> float:
        """Pixels per unit of the ideal coordinates, near the middle."""
        return float(np.sqrt(self.camera.matrix[0, 0] * self.camera.matrix[1, 1]))


@dataclass(frozen=True, eq=False)
class Baseline:
    """Both eyes in the baseline's frame, and how that lies in the cyclopean frame.

    cyclopean_from_baseline (3, 3): a rotation, the identity for a rig calibrated as designed. middle_mm (3,).
    """

    left: RectifiedCamera
    right: RectifiedCamera
    length_mm: float
    cyclopean_from_baseline: Array
    middle_mm: Array

    @property
    def eyes_mm(self) -> tuple[Array, Array]:
        """The optical centres (3,) mm, cyclopean, of the left and the right camera."""
        half = self.cyclopean_from_baseline[:, 0] * self.length_mm / 2
        return self.middle_mm - half, self.middle_mm + half

    def points(self, left: Array, right: Array) -> Array:
        """Meet rays exactly: ideal coordinates (N, 2) of both eyes -> (N, 3) mm, cyclopean.

        y / z is averaged: for rays that miss each other this is the point of least squares in the image, not in space.
        """
        z = self.length_mm / disparity(left, right)
        x = z * (left[:, 0] + right[:, 0]) / 2
        y = z * (left[:, 1] + right[:, 1]) / 2
        return np.stack([x, y, z], 1) @ self.cyclopean_from_baseline.T + self.middle_mm

    def project(self, points_mm: Array) -> tuple[Array, Array]:
        """(N, 3) mm cyclopean -> ideal coordinates (N, 2) in the left and the right eye."""
        p = (points_mm - self.middle_mm) @ self.cyclopean_from_baseline
        half = np.array([self.length_mm / 2, 0.0])
        return (p[:, :2] + half) / p[:, 2:], (p[:, :2] - half) / p[:, 2:]


def disparity(left: Array, right: Array) -> Array:
    """Left minus right x / z, kept away from zero (a point at infinity is put very far away)."""
    d = left[:, 0] - right[:, 0]
    return np.asarray(np.where(np.abs(d) < 1e-6, 1e-6, d))


@lru_cache(maxsize=4)
def baseline(rig: StereoRig) -> Baseline:
    """The rig as Baseline: the frame's x axis joins the optical centres, its z axis is the cyclopean z made
    normal to it.
    """
    a, b = (c.cyclopean_from_camera[:3, 3] for c in (rig.left, rig.right))
    x = (b - a) / rig.baseline_mm
    y = np.cross([0.0, 0.0, 1.0], x)
    y /= np.linalg.norm(y)
    frame = np.stack([x, y, np.cross(x, y)], 1)
    eyes = [RectifiedCamera(c, frame.T @ c.cyclopean_from_camera[:3, :3]) for c in (rig.left, rig.right)]
    return Baseline(eyes[0], eyes[1], rig.baseline_mm, frame, (a + b) / 2)
