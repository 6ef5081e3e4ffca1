"""One camera's calibration: a board seen from many places -> how it sees, and how well that is known. Pure.

Where it sits on the hand is hand_eye.py's, as for two eyes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from daemon import frames
from daemon.calibration.board import Board, SeenBoard
from daemon.calibration.stereo import FEWEST_PAIRS, WORST_SHARE, StereoError
from daemon.pick.moved_pair import USUAL_MM
from daemon.vision.geometry import Camera

OUTLIER = 2.5
"""How many times worse than is usual a view may be explained and still count."""


@dataclass(frozen=True, eq=False)
class CameraResult:
    """camera: half a usual pair's baseline to the left of the cyclopean frame; rms_px of the reprojection, per point;
    focal_sigma_px: one standard deviation of the focal length; used: names of the views; dropped, with the reason."""

    camera: Camera
    rms_px: float
    focal_sigma_px: float
    used: tuple[str, ...]
    dropped: dict[str, str]


def calibrate_camera(seen: Sequence[tuple[str, SeenBoard]], board: Board, image_size: tuple[int, int]) -> CameraResult:
    """Calibrate one eye by views of a board, each with its name; views that fit badly are named and dropped.

    Raises StereoError: too few views, or too like each other. Source: Zhang's method (OpenCV), without the third radial
    term, which such views hardly tell from the others.
    """
    kept, dropped = list(seen), dict[str, str]()
    while True:
        if len(kept) < FEWEST_PAIRS:
            raise StereoError(f"{len(kept)} usable views, {FEWEST_PAIRS} are needed; take more, tilted different ways")
        points = [board.points_mm()[one.corner_ids].astype(np.float32) for _, one in kept]
        corners = [one.corners_px.astype(np.float32).reshape(-1, 1, 2) for _, one in kept]
        rms, matrix, distortion, _, _, sigmas, _, each = cv2.calibrateCameraExtended(
            points, corners, image_size, np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K3
        )
        worst = int(np.argmax(each))
        usual = float(np.median(each))
        if each[worst, 0] <= OUTLIER * usual or len(kept) - 1 < max(FEWEST_PAIRS, 0.7 * len(seen)):
            break
        dropped[kept[worst][0]] = f"its corners are {each[worst, 0]:.2f} px off, {usual:.2f} px is usual"
        del kept[worst]
    sigma_px = float(np.ravel(sigmas)[0])
    if not sigma_px <= WORST_SHARE * matrix[0, 0]:
        raise StereoError(
            f"the views are too like each other: focal length known to {100 * sigma_px / matrix[0, 0]:.1f} % only; "
            "tilt the board about both of its axes, near and far"
        )
    place = frames.rigid(np.eye(3), np.array([-USUAL_MM / 2, 0.0, 0.0]))
    camera = Camera(np.asarray(matrix, float), np.asarray(distortion, float).ravel()[:5], place)
    return CameraResult(camera, float(rms), sigma_px, tuple(name for name, _ in kept), dropped)
