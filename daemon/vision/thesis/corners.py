"""D'Souza's corner detectors: minimum intensity change (4.5.1), median difference (4.2.2), slope of borders (4.5.3).

Each looks for a corner near where one is expected, and gives it to a pixel or, by averaging, to a fraction of one. The
lines of daemon/vision/image/edge_lines.py are the better way; these are kept so that they can be compared.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.vision.thesis.borders import slope_corners

WINDOW_PX = 20
_SIGMAS = 5.0
_KEPT = 0.8


def mic_response(image: Array) -> Array:
    """Least change of intensity over all lines through each pixel, (H, W), grey levels squared; the rim is 0.

    Equations (4.3) to (4.18): the four neighbours, and by linear interpolation every direction between them.
    """
    c = image[1:-1, 1:-1]
    a, a2 = image[1:-1, 2:] - c, image[1:-1, :-2] - c
    b, b2 = image[:-2, 1:-1] - c, image[2:, 1:-1] - c
    r_a, r_b = a**2 + a2**2, b**2 + b2**2
    b_least = np.minimum((b - a) * a + (b2 - a2) * a2, (b - a2) * a2 + (b2 - a) * a)
    a_least = r_b - r_a - 2 * b_least
    between = (b_least < 0) & (a_least + b_least > 0)
    inner = np.where(between, r_a - b_least**2 / np.where(between, a_least, 1.0), np.minimum(r_a, r_b))
    return np.pad(inner, 1)


def median_response(image: Array) -> Array:
    """Difference between each pixel and the median of its 3x3 neighbourhood, (H, W), grey levels squared."""
    grey = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    return np.asarray((cv2.medianBlur(grey, 3).astype(float) - grey) ** 2)


def find_corners(image: NDArray[np.float32], near_px: Array, detector: str, noise_sigma: float) -> Array:
    """The detector's corner in a 20 x 20 window about each expected one; (N, 2) px, nan where it finds none.

    image: (H, W) grey levels. Weaker responses than 0.8 of the window's strongest are suppressed, and what is left is
    averaged, as D'Souza does.
    """
    if detector == "slope":
        return _averaged(slope_corners(image, noise_sigma), near_px)
    respond = mic_response if detector == "mic" else median_response
    height, width = image.shape
    half = WINDOW_PX // 2
    found = np.full((len(near_px), 2), np.nan)
    for k, (u, v) in enumerate(np.rint(near_px).astype(int)):
        left, top = max(u - half, 0), max(v - half, 0)
        patch = image[top : min(v + half, height), left : min(u + half, width)]
        if min(patch.shape) < 5:
            continue
        smooth = cv2.GaussianBlur(patch, (3, 3), 0.8).astype(float)
        response = respond(smooth)[2:-2, 2:-2]
        peak = response.max()
        if peak > (_SIGMAS * noise_sigma / 2) ** 2:
            rows, columns = np.nonzero(response >= _KEPT * peak)
            found[k] = left + 2 + columns.mean(), top + 2 + rows.mean()
    return found


def _averaged(corners: Array, near_px: Array) -> Array:
    """The mean of the corners (M, 2) in the window about each expected one (N, 2); nan where there is none."""
    inside = (np.abs(corners[None] - near_px[:, None]) <= WINDOW_PX / 2).all(2)
    count = inside.sum(1)
    with np.errstate(invalid="ignore"):
        return np.asarray(inside.astype(float) @ corners / count[:, None])
