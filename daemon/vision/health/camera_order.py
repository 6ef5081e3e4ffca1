"""Do the cameras stand as the calibration says, left and right the right way round? Decided by where the same points
lie in the two images. Pure.

Every point of the left image has its partner on its epipolar line in the right one. Swapped cameras put it elsewhere:
above or below the line by twice what the cameras differ in height and tilt, and behind the cameras or absurdly far. A
camera that was knocked up or down puts it off the line both ways round.
"""

from dataclasses import dataclass
from enum import Enum

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.vision.geometry import StereoRig

PATCH_PX, BAND_PX = 10, 16
MAX_POINTS, MIN_POINTS = 60, 5
MIN_SIMILARITY = 0.8
MIN_LEAD = 0.03
"""Least lead in similarity of the best place over any other a patch away: one row of dots is as good as the next."""
NEAR_MM, FAR_MM = 80.0, 3000.0
CLEAR_PX = 1.0
"""Least difference, px, of the distances from the lines one way round and the other for a decision."""
ALIKE_PX = 1.2
"""Points this much alike in their distance from the lines are together: a patch is placed to a pixel."""
MIN_TOGETHER, MAX_TOGETHER = 0.4, 0.7
"""Share of the points that must be together on their lines to be believed, and together off them: grain and repeated
patterns match anywhere."""
NEAR_ENOUGH = 0.5
"""Share of the points that must lie at a plausible distance."""


class Assignment(Enum):
    """Which way round the cameras are, as far as the images tell."""

    RIGHT = "right"
    SWAPPED = "swapped"
    NEITHER = "neither"
    UNKNOWN = "unknown"


def assignment(left: NDArray[np.uint8], right: NDArray[np.uint8], rig: StereoRig) -> tuple[Assignment, float]:
    """Compare grey images (H, W) with the rig both ways round; and how far (px) the points are from their epipolar
    lines as the rig has them, where RIGHT or NEITHER was decided, else nan.

    NEITHER: most points are the same distance off their lines, whichever way round. UNKNOWN: too little to compare.
    """
    unknown = Assignment.UNKNOWN, float("nan")
    a, b = matched_points(left, right)
    if len(a) < MIN_POINTS:
        return unknown
    here, turned = _fit(a, b, rig), _fit(a, b, StereoRig(rig.right, rig.left, rig.image_size))
    if abs(here.off_px - turned.off_px) < CLEAR_PX:
        return unknown
    if here.on_line and here.off_px < turned.off_px:
        return Assignment.RIGHT, here.off_px
    if turned.on_line and turned.off_px < here.off_px:
        return Assignment.SWAPPED, float("nan")
    return (Assignment.NEITHER, here.off_px) if here.together > MAX_TOGETHER else unknown


def matched_points(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> tuple[Array, Array]:
    """Match points of both images, (N, 2) px each: corners of the left, found by patch in a band of the right; at half
    size first, then to the pixel."""
    half = [np.asarray(cv2.resize(i, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.uint8)
            for i in (left, right)]  # fmt: skip
    corners = cv2.goodFeaturesToTrack(half[0], MAX_POINTS, 0.02, 4)
    pairs = []
    for x, y in [] if corners is None else np.rint(corners[:, 0]).astype(int):
        coarse = _found(half[0], half[1], (x, y), PATCH_PX // 2, (0, half[1].shape[1]), (y, BAND_PX // 2))
        if coarse is None:
            continue
        u, v = 2 * coarse[0], 2 * coarse[1]
        fine = _found(left, right, (2 * x, 2 * y), PATCH_PX, (u - PATCH_PX - 3, u + PATCH_PX + 4), (v, 3))
        if fine is not None:
            pairs.append((2 * x, 2 * y, *fine))
    points = np.array(pairs, float).reshape(-1, 4)
    return points[:, :2], points[:, 2:]


def _found(
    image: NDArray[np.uint8],
    other: NDArray[np.uint8],
    at: tuple[int, int],
    patch: int,
    columns: tuple[int, int],
    rows: tuple[int, int],
) -> tuple[int, int] | None:
    """Find the patch round `at` (x, y) of one image in the other, between columns (first, end) and within some rows
    (middle, reach); None where it is not, or the image ends."""
    x, y = at
    top, bottom = rows[0] - rows[1] - patch, rows[0] + rows[1] + patch + 1
    first, end = max(columns[0], 0), min(columns[1], other.shape[1])
    height, width = image.shape
    if not (patch <= x < width - patch and patch <= y < height - patch) or top < 0 or bottom > height:
        return None
    if end - first < 2 * patch + 1:
        return None
    alike = cv2.matchTemplate(
        other[top:bottom, first:end], image[y - patch : y + patch + 1, x - patch : x + patch + 1], cv2.TM_CCOEFF_NORMED
    )
    _, best, _, (u, v) = cv2.minMaxLoc(alike)
    if best < MIN_SIMILARITY:
        return None
    alike[max(v - patch, 0) : v + patch + 1, max(u - patch, 0) : u + patch + 1] = -1.0
    return None if float(alike.max()) > best - MIN_LEAD else (first + u + patch, top + v + patch)


@dataclass(frozen=True)
class _Fit:
    """off_px: from their epipolar lines, of the largest set of points that agree in it; together: its share of all
    points; plausible: the share of all points that lies at a plausible distance."""

    off_px: float
    together: float
    plausible: float

    @property
    def on_line(self) -> bool:
        return self.off_px < ALIKE_PX and self.together > MIN_TOGETHER and self.plausible > NEAR_ENOUGH


def _fit(left_px: Array, right_px: Array, rig: StereoRig) -> _Fit:
    """Points (N, 2) px each against the rig."""
    ours = np.stack([_rays(camera.normalised(px), camera.cyclopean_from_camera[:3, :3]) for camera, px in
                     ((rig.left, left_px), (rig.right, right_px))])  # fmt: skip
    ends = [camera.cyclopean_from_camera[:3, 3] for camera in (rig.left, rig.right)]
    baseline = ends[1] - ends[0]
    normal = np.cross(ours[0], baseline)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    off_px = np.einsum("ij,ij->i", normal, ours[1]) * float(rig.right.matrix[1, 1])
    # t: how far along the left ray the right one passes nearest.
    across = np.einsum("ij,ij->i", ours[0], ours[1])
    t = (ours[0] @ baseline - across * (ours[1] @ baseline)) / np.maximum(1.0 - across**2, 1e-12)
    alike = np.abs(off_px[:, None] - off_px) < ALIKE_PX
    most = alike[np.argmax(alike.sum(1))]
    plausible = (t > NEAR_MM) & (t < FAR_MM)
    return _Fit(abs(float(np.median(off_px[most]))), float(most.mean()), float(plausible.mean()))


def _rays(normalised: Array, cyclopean_from_camera: Array) -> Array:
    """(N, 2) on the plane z = 1 -> (N, 3) unit directions in the cyclopean frame."""
    rays = np.column_stack([normalised, np.ones(len(normalised))])
    return np.asarray((rays / np.linalg.norm(rays, axis=1, keepdims=True)) @ cyclopean_from_camera.T)
