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
_TILES, _QUIET = 8, 20
_RAYLEIGH_MEDIAN, _MOST_GRAIN = 1.177, 1.7


@dataclass(frozen=True, eq=False)
class Fine:
    """The part of an image that shows edges: full size, of unit noise, smoothed. origin_px (2,): its first pixel."""

    origin_px: Array
    smoothed: Image32


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


def scale_space(image: Grey, noise: Noise, settings: VisionSettings) -> tuple[Fine | None, tuple[Scale, ...]]:
    """The image stretched to unit noise, and its scales, finest first; the finest only cover where coarser ones show
    edges.

    None and nothing where no scale shows any edge.
    """
    whole = np.asarray(cv2.LUT(image, noise.stretch), np.float32)
    coarse: list[Scale] = []
    for shrink in settings.shrinks:
        if shrink > 1:
            small = cv2.resize(whole, None, fx=1 / shrink, fy=1 / shrink, interpolation=cv2.INTER_AREA)
            coarse.append(_scale(np.asarray(small, np.float32), shrink))
    window = _window(coarse, image.shape, settings.faintest)
    if window is None:
        return None, ()
    (left, top), (right, bottom) = window
    smoothed = cv2.GaussianBlur(whole[top:bottom, left:right], _KERNEL, SMOOTHING_PX) * np.float32(1 / coarse[0].sigma)
    fine = Fine(np.array([left, top], float), np.asarray(smoothed, np.float32))
    if 1 not in settings.shrinks:
        return fine, tuple(coarse)
    return fine, (Scale(1, fine.origin_px, _gradient(fine.smoothed), 1.0), *coarse)


def whole(image: Grey, noise: Noise) -> tuple[Fine, Scale]:
    """All of an image as scale_space has the part that shows edges, its noise taken for white; and its half scale."""
    unit = np.asarray(cv2.LUT(image, noise.stretch), np.float32)
    small = cv2.resize(unit, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    fine = Fine(np.zeros(2), np.asarray(cv2.GaussianBlur(unit, _KERNEL, SMOOTHING_PX), np.float32))
    return fine, _scale(np.asarray(small, np.float32), 2)


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


def _scale(unit_noise: Image32, shrink: int) -> Scale:
    smoothed = np.asarray(cv2.GaussianBlur(unit_noise, _KERNEL, SMOOTHING_PX), np.float32)
    strength = _gradient(smoothed, shrink)
    return Scale(shrink, np.full(2, (shrink - 1) / 2), strength, _grain(strength))


def _gradient(smoothed: Image32, shrink: int = 1) -> Image32:
    """Its size in sigmas of white noise, of an image in which one pixel is the mean of shrink x shrink."""
    scale = 0.125 * shrink / gradient_noise(SMOOTHING_PX)
    gx, gy = (cv2.Sobel(smoothed, cv2.CV_32F, x, 1 - x, scale=scale) for x in (1, 0))
    return np.asarray(cv2.magnitude(gx, gy), np.float32)


def _window(scales: list[Scale], shape: tuple[int, ...], level: float) -> tuple[Array, Array] | None:
    """Corners (left, top), (right, bottom) px of the part of the image in which the scales show edges, or None."""
    low, high = np.array([np.inf, np.inf]), np.array([-np.inf, -np.inf])
    for scale in scales:
        edges = (scale.strength >= level * scale.sigma).astype(np.uint8)
        for border in cv2.findContours(edges, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]:
            x, y, width, height = cv2.boundingRect(border)
            if width + height >= _LEAST_EXTENT:
                low = np.minimum(low, np.array([x, y]) * scale.shrink)
                high = np.maximum(high, np.array([x + width, y + height]) * scale.shrink)
    if not np.all(np.isfinite(low)):
        return None
    size = np.array([shape[1], shape[0]])
    margin = 12
    return np.maximum(low - margin, 0).astype(np.intp), np.minimum(high + margin, size).astype(np.intp)


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
