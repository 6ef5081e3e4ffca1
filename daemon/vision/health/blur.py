"""How blurred an image's edges are, in px, and whether the blur has a direction. Pure; arrays in, numbers out.

A step edge blurred by sigma keeps its place when it is blurred on purpose, and its slope falls from
1 / sqrt(sigma^2 + a^2) to 1 / sqrt(sigma^2 + b^2). The ratio of the slopes after two known blurs a < b therefore gives
sigma, whatever the contrast.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.vision.image import BLOCK_PX, block_means

A_PX, B_PX = 1.0, 2.0
SOBEL_VAR, PIXEL_VAR = 0.5, 1.0 / 12.0
"""Blur (px^2) that a 3x3 Sobel mask adds along the gradient, and that a square pixel has anyway."""
DIRECTIONS = 6
MIN_EDGES = 40
MIN_CHANGE = 1.2
"""Least difference, grey levels a block, of the means of neighbouring blocks for a clear edge to be there."""
MAX_PX = 12.0
"""Blur beyond which the two slopes are too alike to tell more."""


@dataclass(frozen=True)
class Blur:
    """Sigma in px of the sharpest and the most blurred edge direction; edges: how many edge pixels were measured.

    An image out of focus is blurred in all directions, one taken in motion along the motion only. nan: too few edges.
    """

    least_px: float
    most_px: float
    edges: int

    @property
    def motion_px(self) -> float:
        """Length of a uniform motion that would explain the difference between the directions."""
        return float(np.sqrt(12.0 * max(self.most_px**2 - self.least_px**2, 0.0)))


def _slopes(image: NDArray[np.float32], sigma: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Gradient (gx, gy) after a Gaussian blur, grey levels per px."""
    smooth = cv2.GaussianBlur(image, (0, 0), sigma)
    gx, gy = (cv2.Sobel(smooth, cv2.CV_32F, dx, 1 - dx, ksize=3, scale=0.125) for dx in (1, 0))
    return np.asarray(gx, np.float32), np.asarray(gy, np.float32)


def _busy(image: NDArray[np.uint8]) -> NDArray[np.uint8] | None:
    """The part of an image in which grey levels change at all, with room for the blurs; None where none does."""
    blocks = block_means(image)
    across, down = (np.abs(cv2.Sobel(blocks, cv2.CV_64F, dx, 1 - dx, ksize=3, scale=0.125)) for dx in (1, 0))
    rows, columns = (np.flatnonzero((np.maximum(across, down) > MIN_CHANGE).any(axis)) for axis in (1, 0))
    if not len(rows):
        return None
    top, left = (max(0, int(first[0] - 2) * BLOCK_PX) for first in (rows, columns))
    return np.ascontiguousarray(image[top : (rows[-1] + 3) * BLOCK_PX, left : (columns[-1] + 3) * BLOCK_PX])


def measure_blur(image: NDArray[np.uint8]) -> Blur:
    """Blur of the clearest edges of a grey image (H, W)."""
    busy = _busy(image)
    if busy is None:
        return Blur(float("nan"), float("nan"), 0)
    grey = busy.astype(np.float32)
    gx, gy = _slopes(grey, A_PX)
    slope = cv2.magnitude(gx, gy)
    edge = (slope >= 0.98 * cv2.dilate(slope, np.ones((3, 3)))) & (slope > _clear_slope(slope[::4, ::4]))
    if int(edge.sum()) < MIN_EDGES:
        return Blur(float("nan"), float("nan"), int(edge.sum()))
    direction = np.floor(np.arctan2(gy[edge], gx[edge]) % np.pi / (np.pi / DIRECTIONS)).astype(int) % DIRECTIONS
    sigma = _sigma(slope[edge] / np.maximum(cv2.magnitude(*_slopes(grey, B_PX))[edge], 1e-6))
    per_direction = [
        float(np.quantile(sigma[direction == k], 0.3))
        for k in range(DIRECTIONS)
        if np.count_nonzero(direction == k) >= MIN_EDGES
    ] or [float(np.quantile(sigma, 0.3))]
    return Blur(min(per_direction), max(per_direction), int(edge.sum()))


def _clear_slope(slope: NDArray[Any]) -> float:
    """A slope that noise alone does not reach, and at least 3 grey levels a px; from a sample of the slopes."""
    middle = float(np.median(slope))
    return max(3.0, middle + 6.0 * 1.4826 * float(np.median(np.abs(slope - middle))))


def _sigma(ratio: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Blur px from the ratio (> 1) of the slopes after A_PX and B_PX."""
    a, b = A_PX**2 + SOBEL_VAR + PIXEL_VAR, B_PX**2 + SOBEL_VAR + PIXEL_VAR
    squared = np.clip(ratio.astype(float) ** 2, 1.0 + (b - a) / (MAX_PX**2 + a), b / a)
    return np.asarray(np.sqrt(np.maximum((b - squared * a) / (squared - 1.0), 0.0)))
