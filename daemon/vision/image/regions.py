"""Closed regions of one image, and their borders as rough polygons (whole pixels). Nothing finer is decided here.

D'Souza's way (sections 4.5.2, 4.5.3): gradient, threshold, closed regions, border following; thresholds here are in
units of the gradient's own noise. Several are tried, because a shaded or grainy face needs a high one and a faint
edge closes only at a low one; and several sizes of pixel, because noise averages out and edges do not. His second
step, the Laplacian of Gaussian of the gradient, is left out: its zero crossings open where three edges meet, and
with them the regions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.vision.image.grey import Grey, Noise
from daemon.vision.settings import VisionSettings

Array = NDArray[np.float64]
Image32 = NDArray[np.float32]
Border = NDArray[np.int32]

SMOOTHING_PX = 1.0
_LEAST_SOLIDITY, _CONVEX_SOLIDITY = 0.55, 0.88
_KERNEL = (7, 7)
_LEAST_AREA = 12.0
_LEAST_EXTENT = 12
_WINDOW_RIM_PX = 12
_TILES, _QUIET = 8, 20
_RAYLEIGH_MEDIAN, _MOST_GRAIN = 1.177, 1.7


@dataclass(frozen=True, eq=False)
class Scale:
    """How strong the gradient is where pixels are `shrink` full-size ones wide; its noise has `sigma` (1 if white).

    origin_px (2,): where the first pixel's centre lies in the full image, px.
    """

    shrink: int
    origin_px: Array
    strength: Image32
    sigma: float


@dataclass(frozen=True, eq=False)
class Region:
    """The border (K, 2) of a closed region, in full-size px, its area, and the shrink of the scale it was found at."""

    border: Border
    area_px: float
    shrink: int


def unit_noise(image: Grey, noise: Noise) -> Image32:
    """The image stretched to a noise of sigma 1 at every grey level."""
    return np.asarray(cv2.LUT(image, noise.stretch), np.float32)


def smoothed(unit: Image32) -> Image32:
    """After a Gaussian of SMOOTHING_PX."""
    return np.asarray(cv2.GaussianBlur(unit, _KERNEL, SMOOTHING_PX), np.float32)


def shrunk(unit: Image32, shrink: int) -> Scale:
    """The gradient of all of an image of unit noise, at pixels of shrink x shrink."""
    small = cv2.resize(unit, None, fx=1 / shrink, fy=1 / shrink, interpolation=cv2.INTER_AREA)
    strength = _gradient(smoothed(np.asarray(small, np.float32)), shrink)
    return Scale(shrink, np.full(2, (shrink - 1) / 2), strength, _grain(strength))


def full_size(smooth: Image32, window: tuple[Array, Array], grain: float) -> Scale:
    """The gradient of a part of a smoothed image, full size; grain: its noise over that of white noise."""
    (left, top), (right, bottom) = window
    return Scale(1, np.array([left, top], float), _gradient(smooth[top:bottom, left:right]), grain)


def _grain(strength: Image32) -> float:
    """How much coarser-grained than white the noise is: the gradient of the quieter tiles over what white
    noise gives.
    """
    height, width = (n // _TILES for n in strength.shape)
    step = max(1, min(height, width) // 12)
    tiles = strength[: height * _TILES, : width * _TILES].reshape(_TILES, height, _TILES, width)[:, ::step, :, ::step]
    each = np.sort(tiles.swapaxes(1, 2).reshape(_TILES * _TILES, -1), axis=1)
    medians = np.sort(each[:, each.shape[1] // 2])
    excess = float(medians[_QUIET * len(medians) // 100]) / _RAYLEIGH_MEDIAN
    return min(max(excess, 1.0), _MOST_GRAIN)


def _gradient(smoothed: Image32, shrink: int = 1) -> Image32:
    """Its size in sigmas of white noise, of an image in which one pixel is the mean of shrink x shrink."""
    scale = 0.125 * shrink / gradient_noise(SMOOTHING_PX)
    gx, gy = (cv2.Sobel(smoothed, cv2.CV_32F, x, 1 - x, scale=scale) for x in (1, 0))
    return np.asarray(cv2.magnitude(gx, gy), np.float32)


def edge_window(scale: Scale, level: float, shape: tuple[int, ...]) -> tuple[Array, Array] | None:
    """Corners (left, top), (right, bottom) px of the part of an image (H, W) in which a scale shows edges, or None."""
    edges = (scale.strength >= level * scale.sigma).astype(np.uint8)
    borders = cv2.findContours(edges, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]
    boxes = np.array([cv2.boundingRect(b) for b in borders], np.intp).reshape(-1, 4)
    boxes = boxes[boxes[:, 2] + boxes[:, 3] >= _LEAST_EXTENT] * scale.shrink
    if not len(boxes):
        return None
    size = np.array([shape[1], shape[0]])
    low, high = boxes[:, :2].min(0), (boxes[:, :2] + boxes[:, 2:]).max(0)
    return np.maximum(low - _WINDOW_RIM_PX, 0), np.minimum(high + _WINDOW_RIM_PX, size)


@cache
def gradient_noise(sigma_px: float) -> float:
    """Standard deviation of one Sobel component (scaled to grey levels a px) of white unit noise, Gaussian-smoothed."""
    radius = _KERNEL[0] // 2
    g = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma_px) ** 2)
    g /= g.sum()
    along, across = np.convolve(g, [0.25, 0.5, 0.25]), np.convolve(g, [0.5, 0.0, -0.5])
    return float(np.sqrt(np.sum(along**2) * np.sum(across**2)))


def closed_regions(scale: Scale, level: float, largest_px: float, settings: VisionSettings) -> list[Region]:
    """Regions that edges stronger than `level` close off; those at the image's rim are left out."""
    edges = (scale.strength >= level * scale.sigma).astype(np.uint8)
    borders, tree = cv2.findContours(edges, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if len(borders) == 0:
        return []
    size = scale.shrink**2
    holes = [borders[k] for k in map(int, np.flatnonzero(np.asarray(tree)[0, :, 3] >= 0)) if len(borders[k]) >= 10]
    sized = [(cv2.contourArea(b), b) for b in holes]
    smallest, largest = max(_LEAST_AREA, settings.min_area_px / size), largest_px / size
    sized = sorted((s for s in sized if smallest <= s[0] <= largest), key=lambda s: -s[0])
    return [
        Region((b[:, 0, :] * scale.shrink + scale.origin_px).astype(np.int32), area * size, scale.shrink)
        for area, b in sized[: settings.max_regions]
    ]


def rough_polygons(region: Region, settings: VisionSettings) -> list[Array]:
    """Coarse polygons (N, 2) px of one border, anticlockwise as seen, most trusted first; none where it has no body.

    Noise eats into a region but seldom bulges out of it, so the convex hull comes first; the border itself is tried as
    well where it leaves a good part of the hull open, as a concave facet does.
    """
    contour = region.border[:, None, :]
    hull = cv2.convexHull(contour)
    area, full = region.area_px, cv2.contourArea(hull)
    if full <= 0 or area < _LEAST_SOLIDITY * full:
        return []
    outlines = [hull] if area > _CONVEX_SOLIDITY * full else [contour, hull]
    tolerance = 1.0 + 0.4 * region.shrink + 0.01 * float(np.sqrt(full))
    polygons = [cv2.approxPolyDP(o, tolerance, True)[:, 0, :].astype(float) for o in outlines]
    fit = [p for p in polygons if 3 <= len(p) <= settings.max_corners]
    return [p if cv2.contourArea(p.astype(np.float32), True) < 0 else p[::-1] for p in fit]
