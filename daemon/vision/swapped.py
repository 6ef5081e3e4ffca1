"""Are left and right the right way round? Told by where the same points lie in the two images. Pure.

Every point of the left image has its partner on its epipolar line in the right one. Swapped eyes put it elsewhere:
above or below the line by twice what the cameras differ in height and tilt, and behind the cameras or absurdly far.
"""

from __future__ import annotations

from enum import Enum

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.vision.rig import StereoRig

Array = NDArray[np.float64]
PATCH_PX, BAND_PX = 10, 16
MOST_POINTS, LEAST_POINTS = 60, 8
LEAST_ALIKE = 0.8
NEAR_MM, FAR_MM = 80.0, 3000.0
CLEAR_PX = 1.0
"""How much nearer to the lines one way round must be before it is believed."""


class Assignment(Enum):
    """Which way round the eyes are, as far as the images tell."""

    RIGHT = "right"
    SWAPPED = "swapped"
    UNKNOWN = "unknown"


def assignment(left: NDArray[np.uint8], right: NDArray[np.uint8], rig: StereoRig) -> Assignment:
    """Compare grey images (H, W) with the rig both ways round. UNKNOWN where there is too little to compare."""
    a, b = matched_points(left, right)
    if len(a) < LEAST_POINTS:
        return Assignment.UNKNOWN
    turned = StereoRig(rig.right, rig.left, rig.image_size)
    (off, plausible), (off_turned, plausible_turned) = (_fit(a, b, way) for way in (rig, turned))
    if off + CLEAR_PX < off_turned and plausible >= 0.5:
        return Assignment.RIGHT
    if off_turned + CLEAR_PX < off and plausible_turned >= 0.5:
        return Assignment.SWAPPED
    return Assignment.UNKNOWN


def matched_points(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> tuple[Array, Array]:
    """The same points in both images, (N, 2) px each: corners of the left, found by patch in a band of the right."""
    corners = cv2.goodFeaturesToTrack(left, MOST_POINTS, 0.02, 8)
    height, width = left.shape
    pairs = []
    for x, y in [] if corners is None else np.rint(corners[:, 0]).astype(int):
        top = y - PATCH_PX - BAND_PX
        if not (PATCH_PX <= x < width - PATCH_PX and top >= 0 and y + PATCH_PX + BAND_PX < height):
            continue
        patch = left[y - PATCH_PX : y + PATCH_PX + 1, x - PATCH_PX : x + PATCH_PX + 1]
        alike = cv2.matchTemplate(right[top : y + PATCH_PX + BAND_PX + 1], patch, cv2.TM_CCOEFF_NORMED)
        _, best, _, (u, v) = cv2.minMaxLoc(alike)
        if best >= LEAST_ALIKE:
            pairs.append((x, y, u + PATCH_PX, top + v + PATCH_PX))
    points = np.array(pairs, float).reshape(-1, 4)
    return points[:, :2], points[:, 2:]


def _fit(left_px: Array, right_px: Array, rig: StereoRig) -> tuple[float, float]:
    """Median distance (px) of the points from their epipolar lines, and the share that lies at a plausible distance."""
    ours = np.stack([_rays(camera.normalised(px), camera.cyclopean_from_camera[:3, :3]) for camera, px in
                     ((rig.left, left_px), (rig.right, right_px))])  # fmt: skip
    ends = [camera.cyclopean_from_camera[:3, 3] for camera in (rig.left, rig.right)]
    baseline = ends[1] - ends[0]
    normal = np.cross(ours[0], baseline)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    off_px = np.abs(np.einsum("ij,ij->i", normal, ours[1])) * float(rig.right.matrix[1, 1])
    # t: how far along the left ray the right one passes nearest.
    across = np.einsum("ij,ij->i", ours[0], ours[1])
    t = (ours[0] @ baseline - across * (ours[1] @ baseline)) / np.maximum(1.0 - across**2, 1e-12)
    return float(np.median(off_px)), float(np.mean((t > NEAR_MM) & (t < FAR_MM)))


def _rays(normalised: Array, cyclopean_from_camera: Array) -> Array:
    """(N, 2) on the plane z = 1 -> (N, 3) unit directions in the cyclopean frame."""
    rays = np.column_stack([normalised, np.ones(len(normalised))])
    return np.asarray((rays / np.linalg.norm(rays, axis=1, keepdims=True)) @ cyclopean_from_camera.T)
