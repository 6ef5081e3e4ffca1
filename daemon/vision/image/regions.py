"""Closed regions of one image, and their borders as rough polygons (whole pixels). Nothing finer is decided here.

D'Souza's way (sections 4.5.2, 4.5.3): gradient, threshold, closed regions, border following; thresholds here are in
units of the gradient's own noise. Several are tried, because a shaded or grainy face needs a high one and a faint
edge closes only at a low one; and several sizes of pixel, because noise averages out and edges do not. His second
step, the Laplacian of Gaussian of the gradient, is left out: its zero crossings open where three edges meet, and
with them the regions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Image32, Index
from daemon.vision.image.grey import FINE, Fine, Grey, Noise

Border = NDArray[np.int32]
Stretched = NDArray[np.int16]
"""An image (H, W) of unit noise, in steps of 1 / FINE of its sigma."""
Window = tuple[Index, Index]
"""Corners (left, top), (right, bottom) px of a part of an image."""

SMOOTHING_PX = 1.0
_KERNEL = (7, 7)
# Set by eye on the rendered scenes, where no source is named.
_MIN_SOLIDITY, _CONVEX_SOLIDITY = 0.55, 0.88
"""Share of its hull that a region must fill, and that one fills whose border is convex but for noise."""
_MIN_AREA, _MIN_BORDER = 12.0, 10
"""Pixels of its scale in a region, and in its border."""
_SPECKLED = 0.3
"""Share of pixels on edges that is more than parts have: grain, print, a rough table."""
_FOLLOWED = 2
"""Regions followed among specks, of each that is wanted: the largest inside need not have the largest borders."""
_MIN_EXTENT, _WINDOW_RIM_PX = 12, 12
"""Width and height together of edges that are more than noise; room left about them, px."""
_TILES, _QUIET = 8, 20
"""The noise is read off the tiles, so many each way, whose gradient is in the lowest so many hundredths."""
_RAYLEIGH_MEDIAN, _MAX_GRAIN = 1.177, 1.7
"""Median size of a gradient whose components are unit noise; more grain than this is texture."""


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
    """A closed region: its border (K, 1, 2) in the pixels of the scale it was found at, its area in full-size px."""

    contour: Border
    area_px: float
    scale: Scale

    @cached_property
    def border(self) -> Border:
        """The border (K, 2) in full-size px."""
        return (self.contour[:, 0] * self.scale.shrink + self.scale.origin_px).astype(np.int32)

    @cached_property
    def rough(self) -> list[RoughPolygon]:
        """Coarse polygons of the border, most trusted first; none where it has no body.

        Noise eats into a region but seldom bulges out of it, so the convex hull comes first; the border itself is tried
        as well where it leaves a good part of the hull open, as a concave facet does.
        """
        hull = cv2.convexHull(self.border)
        full = cv2.contourArea(hull)
        if full <= 0 or self.area_px < _MIN_SOLIDITY * full:
            return []
        outlines = [hull] if self.area_px > _CONVEX_SOLIDITY * full else [self.border, hull]
        tolerance = 1.0 + 0.4 * self.scale.shrink + 0.01 * float(np.sqrt(full))
        rough = list[RoughPolygon]()
        for outline in outlines:
            corners = cv2.approxPolyDP(outline, tolerance, True)[:, 0, :]
            if len(corners) > 2:
                turned = corners if cv2.contourArea(corners, True) < 0 else corners[::-1]
                rough.append(RoughPolygon(turned.astype(float), self.border, self.area_px, self.scale.shrink))
        return rough


@dataclass(frozen=True, eq=False)
class RoughPolygon:
    """corners (N, 2) px, anticlockwise as seen, to a pixel or two of the scale of the region they were taken from; that
    region's border (K, 2) and area in full-size px, and its scale's shrink. Not the region, which keeps its polygons: a
    circle would keep a look's images until the collector finds it.
    """

    corners: Array
    border: Border
    area_px: float
    shrink: int


def unit_noise(image: Grey, noise: Noise) -> Stretched:
    """The image stretched to a noise of sigma 1 at every grey level."""
    return np.asarray(cv2.LUT(image, np.rint(FINE * noise.stretch).astype(np.int16)))


def smoothed(unit: Stretched) -> Fine:
    """An image of unit noise after a Gaussian of SMOOTHING_PX."""
    # OpenCV's Gaussian of uint16 takes three times as long as that of int16, which has room for these values.
    return np.asarray(cv2.GaussianBlur(unit, _KERNEL, SMOOTHING_PX)).view(np.uint16)


def shrunk(unit: Stretched, shrink: int) -> Scale:
    """The gradient of all of an image of unit noise, at pixels of shrink x shrink."""
    small = np.asarray(cv2.resize(unit, None, fx=1 / shrink, fy=1 / shrink, interpolation=cv2.INTER_AREA), np.int16)
    strength = _gradient(smoothed(small), shrink)
    return Scale(shrink, np.full(2, (shrink - 1) / 2), strength, _grain(strength))


def full_size(smooth: Fine, window: Window, grain: float) -> Scale:
    """Return the scale at full size of a part of the smoothed image; grain: its noise over that of white noise."""
    (left, top), (right, bottom) = window
    return Scale(1, np.array([left, top], float), _gradient(smooth[top:bottom, left:right]), grain)


def _grain(strength: Image32) -> float:
    """Return how much coarser-grained than white the noise is: the gradient of the quieter tiles over what white noise
    gives; 1 where there is not a pixel for each tile."""
    height, width = (n // _TILES for n in strength.shape)
    if not (height and width):
        return 1.0
    step = max(1, min(height, width) // 12)
    tiles = strength[: height * _TILES, : width * _TILES].reshape(_TILES, height, _TILES, width)[:, ::step, :, ::step]
    each = np.sort(tiles.swapaxes(1, 2).reshape(_TILES * _TILES, -1), axis=1)
    medians = np.sort(each[:, each.shape[1] // 2])
    excess = float(medians[_QUIET * len(medians) // 100]) / _RAYLEIGH_MEDIAN
    return min(max(excess, 1.0), _MAX_GRAIN)


def _gradient(smooth: Fine, shrink: int = 1) -> Image32:
    """Its size in sigmas of white noise, of a smoothed image in which one pixel is the mean of shrink x shrink."""
    scale = 0.125 * shrink / gradient_noise(SMOOTHING_PX) / FINE
    gx, gy = (cv2.Sobel(smooth.view(np.int16), cv2.CV_32F, x, 1 - x, scale=scale) for x in (1, 0))
    return np.asarray(cv2.magnitude(gx, gy), np.float32)


def edge_window(scale: Scale, level: float, shape: tuple[int, ...]) -> Window | None:
    """The part of an image (H, W) in which a scale shows edges, or None."""
    edges = (scale.strength >= level * scale.sigma).astype(np.uint8)
    if _speckled(edges):
        return np.zeros(2, np.intp), np.array([shape[1], shape[0]])
    borders = cv2.findContours(edges, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]
    boxes = np.array([cv2.boundingRect(b) for b in borders], np.intp).reshape(-1, 4)
    boxes = boxes[boxes[:, 2] + boxes[:, 3] >= _MIN_EXTENT] * scale.shrink
    if not len(boxes):
        return None
    size = np.array([shape[1], shape[0]])
    low, high = boxes[:, :2].min(0), (boxes[:, :2] + boxes[:, 2:]).max(0)
    return np.maximum(low - _WINDOW_RIM_PX, 0), np.minimum(high + _WINDOW_RIM_PX, size)


def is_uncluttered(scale: Scale, level: float) -> bool:
    """Whether no more of an image lies on edges stronger than `level` than parts and their shadows show."""
    return not _speckled((scale.strength >= level * scale.sigma).astype(np.uint8))


def _speckled(edges: NDArray[np.uint8]) -> bool:
    return cv2.countNonZero(edges) > _SPECKLED * edges.size


@cache
def gradient_noise(sigma_px: float) -> float:
    """Standard deviation of one Sobel component (scaled to grey levels a px) of white unit noise, Gaussian-smoothed."""
    radius = _KERNEL[0] // 2
    g = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma_px) ** 2)
    g /= g.sum()
    along, across = np.convolve(g, [0.25, 0.5, 0.25]), np.convolve(g, [0.5, 0.0, -0.5])
    return float(np.sqrt(np.sum(along**2) * np.sum(across**2)))


def closed_regions(
    scale: Scale, window: Window, level: float, least_px: float, largest_px: float, most: int
) -> list[Region]:
    """Regions of so many full-size px, in a part of the image, that edges stronger than `level` close off, so many of
    the largest, the largest first; those at its rim are left out.
    """
    edges = (scale.strength >= level * scale.sigma).astype(np.uint8)
    size = scale.shrink**2
    least = max(_MIN_AREA, least_px / size)
    (left, top), (right, bottom) = ((corner - scale.origin_px) / scale.shrink for corner in window)
    first = max(int(left), 0), max(int(top), 0)
    seen = edges[first[1] : int(bottom) + 1, first[0] : int(right) + 1]
    holes = (
        largest_hole_borders(seen, first, least, _FOLLOWED * most) if _speckled(edges) else hole_borders(seen, first)
    )
    sized = [(cv2.contourArea(h), h) for h in holes if len(h) >= _MIN_BORDER]
    sized = sorted((s for s in sized if least <= s[0] <= largest_px / size), key=lambda s: -s[0])
    return [Region(border, area * size, scale) for area, border in sized[:most]]


def hole_borders(edges: NDArray[np.uint8], first: tuple[int, int]) -> list[Border]:
    """Borders (K, 1, 2) of everything that edges (H, W), 0 or 1, close off; first: the place of their first pixel."""
    borders, tree = cv2.findContours(edges, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE, offset=first)
    if not borders:
        return []
    around = np.asarray(tree)[0, :, 3].tolist()
    return [np.asarray(border, np.int32) for border, outer in zip(borders, around, strict=True) if outer >= 0]


def largest_hole_borders(edges: NDArray[np.uint8], first: tuple[int, int], least: float, most: int) -> list[Border]:
    """Return the borders of so many of the largest holes only, found by their areas first: following the borders of ten
    thousand specks costs more than all else."""
    closed = cv2.copyMakeBorder(1 - edges, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=1)
    labels, stats = cv2.connectedComponentsWithStats(closed, connectivity=4)[1:3]
    area = stats[:, cv2.CC_STAT_AREA]
    area[[0, labels[0, 0]]] = 0  # the edges, and what is open to the rim
    found = []
    for k in np.argsort(-area, kind="stable")[:most]:
        if area[k] < least / 2:  # inside a border that itself takes up as much again
            break
        x, y, width, height = stats[k, :4].tolist()
        outside = (labels[y - 1 : y + height + 1, x - 1 : x + width + 1] != k).astype(np.uint8)
        offset = first[0] + x - 2, first[1] + y - 2
        borders, tree = cv2.findContours(outside, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE, offset=offset)
        found.append(np.asarray(borders[int(np.argmax(np.asarray(tree)[0, :, 3] >= 0))], np.int32))
    return found
