"""Closed regions of one image, and their borders as rough polygons (whole pixels). Nothing finer is decided here.

D'Souza's way (sections 4.5.2, 4.5.3): gradient, threshold, closed regions, border following; thresholds here are in
units of the gradient's own noise, and several are tried, because a faint edge closes at a low one and a shaded face
at a high one.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.vision.image import Grey, Noise
from daemon.vision.settings import VisionSettings
from daemon.vision.shapes import signed_area

Array = NDArray[np.float64]
Image32 = NDArray[np.float32]

_SOBEL_SCALE = 1 / 8
_LEAST_SOLIDITY, _CONVEX_SOLIDITY = 0.55, 0.88


@dataclass(frozen=True, eq=False)
class Scale:
    """An image smoothed by a Gaussian of sigma_px, its gradient in sigmas of its noise, and the levels to
    threshold it at.
    """

    sigma_px: float
    levels: tuple[float, ...]
    smoothed: Image32
    strength: Image32


def scale_space(image: Grey, noise: Noise, settings: VisionSettings) -> tuple[Scale, ...]:
    """The image, stretched to unit noise, at every scale of the settings, finest first."""
    stretched = np.asarray(cv2.LUT(image, noise.stretch), np.float32)
    scales = []
    for sigma_px, levels in settings.scales:
        smoothed = np.asarray(cv2.GaussianBlur(stretched, (0, 0), sigma_px), np.float32)
        scales.append(Scale(sigma_px, levels, smoothed, gradient(smoothed, sigma_px)))
    return tuple(scales)


def gradient(smoothed: Image32, sigma_px: float) -> Image32:
    """Sobel gradient magnitude of a smoothed unit-noise image, in sigmas of the noise left in either component."""
    gx = cv2.Sobel(smoothed, cv2.CV_32F, 1, 0, scale=_SOBEL_SCALE)
    gy = cv2.Sobel(smoothed, cv2.CV_32F, 0, 1, scale=_SOBEL_SCALE)
    return np.asarray(cv2.magnitude(gx, gy) * np.float32(1 / gradient_noise(sigma_px)), np.float32)


def gradient_noise(sigma_px: float) -> float:
    """Standard deviation of one Sobel component of white unit noise smoothed by a Gaussian."""
    radius = int(np.ceil(4 * sigma_px))
    g = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma_px) ** 2)
    g /= g.sum()
    along, across = np.convolve(g, [0.25, 0.5, 0.25]), np.convolve(g, [0.5, 0.0, -0.5])
    return float(np.sqrt(np.sum(along**2) * np.sum(across**2)))


def laplacian_of_gaussian(image: Grey, sigma_px: float) -> Image32:
    """Laplacian of the Gaussian-smoothed image, (H, W) float32: crosses zero on an edge (D'Souza (4.19), sign
    mended).
    """
    smoothed = cv2.GaussianBlur(image, (0, 0), sigma_px).astype(np.float32)
    return np.asarray(cv2.Laplacian(smoothed, cv2.CV_32F, ksize=3), np.float32)


def closed_regions(strength: Image32, level: float, settings: VisionSettings) -> list[NDArray[np.int32]]:
    """Borders (K, 2) px of the regions that edges stronger than `level` close off, leaving out those at the
    image's rim.
    """
    edges = (strength >= level).astype(np.uint8)
    borders, tree = cv2.findContours(edges, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if len(borders) == 0:
        return []
    parent = np.asarray(tree)[0, :, 3]
    largest = settings.max_area_fraction * strength.size
    found = []
    for k in map(int, np.flatnonzero(parent >= 0)):
        border = np.asarray(borders[k], np.int32)
        if len(border) >= 2 * settings.min_side_px and settings.min_area_px <= cv2.contourArea(border) <= largest:
            found.append(border[:, 0, :])
    return found


def rough_polygons(border: NDArray[np.int32], settings: VisionSettings) -> list[Array]:
    """Coarse polygons (N, 2) px of one border, anticlockwise as seen, most trusted first; none where it has no body.

    Noise eats into a region but seldom bulges out of it, so the convex hull comes first; the border itself is tried
    as well where it leaves a good part of the hull open, as a concave facet does.
    """
    contour = border[:, None, :]
    hull = cv2.convexHull(contour)
    area, full = cv2.contourArea(contour), cv2.contourArea(hull)
    if full <= 0 or area < _LEAST_SOLIDITY * full:
        return []
    outlines = [hull] if area > _CONVEX_SOLIDITY * full else [contour, hull]
    tolerance = 1.4 + 0.01 * float(np.sqrt(full))
    polygons = [cv2.approxPolyDP(o, tolerance, True)[:, 0, :].astype(float) for o in outlines]
    return [p if signed_area(p) < 0 else p[::-1] for p in polygons if 3 <= len(p) <= settings.max_corners]
