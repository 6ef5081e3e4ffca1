"""Corners from region borders: gradient, filling, Laplacian of Gaussian, border tracing, change of slope.

Source: D'Souza, sections 4.5.2 and 4.5.3. OpenCV follows the borders (with 8 neighbours, as algorithm 4.5.3 does) and
convolves; what is threshold by experiment there is in units of the picture's own noise here.
"""

import cv2
import numpy as np

from daemon.arrays import Array, Image32

LOG_SIGMA_PX = 1.0
NOISE_SIGMAS = 6.0
"""Gradients below so many sigmas of their noise are 0 before filling: the threshold that is set by hand in 4.1."""
MIN_PERIMETER_PX = 40.0
"""Regions with a shorter border are left-over noise (section 4.5.2)."""
STEP_PX, SHARP_RAD = 7, np.deg2rad(25.0)
"""Border pixels over which the slope is taken, and the change of slope that is a corner (section 4.5.3)."""


def slope_corners(image: Image32, noise_sigma: float) -> Array:
    """Corners (N, 2) px of all closed regions of one image (H, W) grey levels; noise_sigma: grey levels."""
    found = [_sharp_turns(border) for border in _region_borders(image, noise_sigma)]
    return np.concatenate(found) if found else np.zeros((0, 2))


def _region_borders(image: Image32, noise_sigma: float) -> list[Array]:
    """Inner borders, each (K, 2) px in order, of the regions that the thickened gradient closes off."""
    gx, gy = (cv2.Sobel(image, cv2.CV_32F, x, 1 - x, scale=0.125) for x in (1, 0))
    gradient = np.asarray(cv2.magnitude(gx, gy))
    # One Sobel component of white noise has sqrt(12) / 8 of its sigma.
    gradient[gradient < NOISE_SIGMAS * noise_sigma * np.sqrt(12) / 8] = 0.0
    filled = cv2.dilate(gradient, np.ones((3, 3), np.uint8))
    log = cv2.Laplacian(cv2.GaussianBlur(filled, (0, 0), LOG_SIGMA_PX), cv2.CV_32F)
    edges = ((log < 0) & (filled > 0)).astype(np.uint8)
    borders, tree = cv2.findContours(edges, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if tree is None:
        return []
    inner = [b[:, 0].astype(float) for b, (*_, parent) in zip(borders, np.asarray(tree)[0], strict=True) if parent >= 0]
    return [b for b in inner if len(b) >= MIN_PERIMETER_PX]


def _sharp_turns(border: Array) -> Array:
    """Points (N, 2) of a closed border (K, 2) where its slope changes sharply, the sharpest of each neighbourhood."""
    before, after = border - np.roll(border, STEP_PX, 0), np.roll(border, -STEP_PX, 0) - border
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    turn = np.abs(np.arctan2(cross, (before * after).sum(1)))
    nearby = np.stack([np.roll(turn, k) for k in range(-STEP_PX, STEP_PX + 1)])
    return np.asarray(border[(turn > SHARP_RAD) & (turn >= nearby.max(0))])
