"""Calibration of a single camera: views of a board -> matrix and distortion, with their standard deviations. Pure.

hand_eye.py measures where the camera is mounted on the tool.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from daemon import frames
from daemon.calibration.board import Board, DetectedBoard
from daemon.calibration.stereo import MIN_PAIRS, WORST_SHARE, StereoError
from daemon.pick.moved_pair import USUAL_BASELINE_MM
from daemon.vision.geometry import Camera

OUTLIER = 2.5
"""A view is dropped where its residual exceeds the median residual by this factor."""


@dataclass(frozen=True, eq=False)
class CameraResult:
    """camera: USUAL_MM / 2 to the left of the cyclopean frame; rms_px: reprojection error per point; focal_sigma_px:
    one standard deviation of the focal length; used: names of the views; dropped: reason by name."""

    camera: Camera
    rms_px: float
    focal_sigma_px: float
    used: tuple[str, ...]
    dropped: dict[str, str]


def calibrate_camera(
    boards: Sequence[tuple[str, DetectedBoard]], board: Board, image_size: tuple[int, int]
) -> CameraResult:
    """Calibrate one camera from named views of a board; drop the views that fit badly.

    Raises StereoError: too few views, or views too similar. Source: Zhang's method (OpenCV), without the third radial
    term, which such views hardly determine.
    """
    kept, dropped = list(boards), dict[str, str]()
    while True:
        if len(kept) < MIN_PAIRS:
            raise StereoError(f"{len(kept)} usable views, {MIN_PAIRS} are needed; take more, tilted different ways")
        points = [board.points_mm()[one.corner_ids].astype(np.float32) for _, one in kept]
        corners = [one.corners_px.astype(np.float32).reshape(-1, 1, 2) for _, one in kept]
        rms, matrix, distortion, _, _, sigmas, _, each = cv2.calibrateCameraExtended(
            points, corners, image_size, np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K3
        )
        worst = int(np.argmax(each))
        usual = float(np.median(each))
        if each[worst, 0] <= OUTLIER * usual or len(kept) - 1 < max(MIN_PAIRS, 0.7 * len(boards)):
            break
        dropped[kept[worst][0]] = f"its corners are {each[worst, 0]:.2f} px off, {usual:.2f} px is usual"
        del kept[worst]
    sigma_px = float(np.ravel(sigmas)[0])
    if not sigma_px <= WORST_SHARE * matrix[0, 0]:
        raise StereoError(
            f"the views are too similar: they give the focal length to {100 * sigma_px / matrix[0, 0]:.1f} % only; "
            "tilt the board about both of its axes, near and far"
        )
    place = frames.rigid(np.eye(3), np.array([-USUAL_BASELINE_MM / 2, 0.0, 0.0]))
    camera = Camera(np.asarray(matrix, float), np.asarray(distortion, float).ravel()[:5], place)
    return CameraResult(camera, float(rms), sigma_px, tuple(name for name, _ in kept), dropped)
