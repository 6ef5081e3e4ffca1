"""The stereo pair as geometry: what a calibration says, and where both cameras' pixels meet, by exact rays.

In: pixels or rays. Out: rays, pixels, points in the cyclopean frame (mm). No files; which point belongs to which is
decided elsewhere.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arrays import Array

CORNER_PX = 0.15
"""Standard deviation, px, of a corner of a whole facet in one image."""


@dataclass(frozen=True, eq=False)
class Camera:
    """One camera: matrix (3, 3) px, distortion (5,) as OpenCV's k1 k2 p1 p2 k3, cyclopean_from_camera (4, 4) mm."""

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
    """Two cameras and the size (width, height) px of the images they were calibrated for."""

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
    """Return the rig that one camera at two places is, and where that is: (StereoRig, world_from_cyclopean (4, 4) mm).

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
    images = [replace(camera, cyclopean_from_camera=cyclopean_from_world @ place) for place in (left, right)]
    return StereoRig(images[0], images[1], image_size), world_from_cyclopean


def corner_covariance(rig: StereoRig, distance_mm: float) -> Array:
    """(3, 3) mm2, cyclopean, of a corner straight ahead at that distance, where either camera is off by CORNER_PX."""
    focal_px = float(rig.left.matrix[0, 0])
    across = CORNER_PX * distance_mm / focal_px
    along = np.sqrt(2) * CORNER_PX * distance_mm**2 / (focal_px * rig.baseline_mm)
    return np.diag([across**2, across**2, along**2])


@dataclass(frozen=True, eq=False)
class RectifiedCamera:
    """A camera seen from the baseline: ideal coordinates (x / z, y / z) in a frame whose x axis is the baseline.

    In these coordinates a point has the same y / z in both cameras, and lines in space are straight.
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
        that the cameras look away from; nought and less where one points along it or back, nan where lens and image do
        not go together."""
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
    """Both cameras in the baseline's frame, and how that lies in the cyclopean frame.

    cyclopean_from_baseline (3, 3): a rotation, the identity for a rig calibrated as designed. middle_mm (3,).
    """

    left: RectifiedCamera
    right: RectifiedCamera
    length_mm: float
    cyclopean_from_baseline: Array
    middle_mm: Array

    @property
    def cameras_mm(self) -> tuple[Array, Array]:
        """The optical centres (3,) mm, cyclopean, of the left and the right camera."""
        half = self.cyclopean_from_baseline[:, 0] * self.length_mm / 2
        return self.middle_mm - half, self.middle_mm + half

    def points(self, left: Array, right: Array) -> Array:
        """Meet rays exactly: ideal coordinates (N, 2) of both cameras -> (N, 3) mm, cyclopean.

        y / z is averaged: for rays that miss each other this is the point of least squares in the image, not in space.
        """
        z = self.length_mm / disparity(left, right)
        x = z * (left[:, 0] + right[:, 0]) / 2
        y = z * (left[:, 1] + right[:, 1]) / 2
        return np.stack([x, y, z], 1) @ self.cyclopean_from_baseline.T + self.middle_mm

    def project(self, points_mm: Array) -> tuple[Array, Array]:
        """(N, 3) mm cyclopean -> ideal coordinates (N, 2) in the left and the right camera."""
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
    images = [RectifiedCamera(c, frame.T @ c.cyclopean_from_camera[:3, :3]) for c in (rig.left, rig.right)]
    return Baseline(images[0], images[1], rig.baseline_mm, frame, (a + b) / 2)
