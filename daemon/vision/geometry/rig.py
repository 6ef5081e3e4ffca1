"""The stereo pair as geometry: what a calibration says, nothing of where it was read from.

In: pixels or rays. Out: rays, pixels, points in the cyclopean frame (mm). No files, no detection.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arrays import Array

CORNER_PX = 0.15
"""By how much a corner of a whole facet is found off in one image."""


@dataclass(frozen=True, eq=False)
class Camera:
    """One eye: matrix (3, 3) px, distortion (5,) as OpenCV's k1 k2 p1 p2 k3, cyclopean_from_camera (4, 4) mm."""

    matrix: Array
    distortion: Array
    cyclopean_from_camera: Array

    def project(self, points_mm: Array) -> Array:
        """(N, 3) points in the cyclopean frame, mm -> (N, 2) px in the distorted image."""
        px, _ = self._projected(points_mm)
        return np.asarray(px[:, 0, :], float)

    def project_with_slope(self, points_mm: Array) -> tuple[Array, Array]:
        """project, and how each pixel (2) moves with its point (3) in the cyclopean frame: (N, 2), (N, 2, 3)."""
        px, jacobian = self._projected(points_mm)
        # Columns of OpenCV's jacobian: rotation (3), translation (3), and the camera's own; all points share the
        # translation, so that its columns are each point's own slope.
        slope = np.asarray(jacobian[:, 3:6], float).reshape(-1, 2, 3)
        return np.asarray(px[:, 0, :], float), slope @ self.cyclopean_from_camera[:3, :3].T

    def _projected(self, points_mm: Array) -> tuple[NDArray[Any], NDArray[Any]]:
        r = self.cyclopean_from_camera[:3, :3]
        in_camera = (np.asarray(points_mm, float).reshape(-1, 3) - self.cyclopean_from_camera[:3, 3]) @ r
        return cv2.projectPoints(in_camera[:, None, :], np.zeros(3), np.zeros(3), self.matrix, self.distortion)

    def normalised(self, points_px: Array) -> Array:
        """(N, 2) px in the distorted image -> (N, 2) undistorted coordinates on the plane z = 1 of this camera."""
        points = np.ascontiguousarray(np.asarray(points_px, float).reshape(-1, 1, 2))
        if not len(points):  # which OpenCV answers with nothing at all
            return points[:, 0]
        return np.asarray(cv2.undistortPoints(points, self.matrix, self.distortion)[:, 0, :], float)


@dataclass(frozen=True, eq=False)
class StereoRig:
    """Two eyes and the size (width, height) px of the images they were calibrated for."""

    left: Camera
    right: Camera
    image_size: tuple[int, int]

    @property
    def baseline_mm(self) -> float:
        """Distance between the optical centres."""
        ends = [c.cyclopean_from_camera[:3, 3] for c in (self.left, self.right)]
        return float(np.linalg.norm(ends[1] - ends[0]))


def moved_rig(
    camera: Camera, image_size: tuple[int, int], world_from_cameras: tuple[Array, Array]
) -> tuple[StereoRig, Array]:
    """One camera at two places as a rig, and where that is: (StereoRig, world_from_cyclopean (4, 4) mm).

    world_from_cameras: (4, 4) mm each, in either order: left is whichever lies to the left as the camera sees it. The
    cyclopean frame is midway, its x axis the way from left to right, its z axis the mean view made normal to that.
    Raises ValueError where the places are one.
    """
    first, second = world_from_cameras
    way = second[:3, 3] - first[:3, 3]
    if float(np.linalg.norm(way)) < 1.0:
        raise ValueError("the camera did not move between the two pictures")
    left, right = (first, second) if float(way @ first[:3, 0]) > 0 else (second, first)
    x = right[:3, 3] - left[:3, 3]
    x /= np.linalg.norm(x)
    y = np.cross(left[:3, 2] + right[:3, 2], x)
    y /= np.linalg.norm(y)
    world_from_cyclopean = frames.rigid(np.stack([x, y, np.cross(x, y)], 1), (left[:3, 3] + right[:3, 3]) / 2)
    cyclopean_from_world = frames.inverse(world_from_cyclopean)
    eyes = [replace(camera, cyclopean_from_camera=cyclopean_from_world @ place) for place in (left, right)]
    return StereoRig(eyes[0], eyes[1], image_size), world_from_cyclopean


def corner_covariance(rig: StereoRig, distance_mm: float) -> Array:
    """(3, 3) mm2, cyclopean, of a corner straight ahead at that distance, where either eye is off by CORNER_PX."""
    focal_px = float(rig.left.matrix[0, 0])
    across = CORNER_PX * distance_mm / focal_px
    along = np.sqrt(2) * CORNER_PX * distance_mm**2 / (focal_px * rig.baseline_mm)
    return np.diag([across**2, across**2, along**2])
