"""Which polygon of the left eye is which of the right, corner by corner: epipolar, ordered, facet-wise.

D'Souza matches corner by corner inside an epipolar band (section 4.2.3) and loses its way where sides are short; whole
facets, taken round their border in order, leave far fewer ways to be wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daemon.arrays import Array, Flags, Index
from daemon.vision.geometry import Baseline, RectifiedCamera
from daemon.vision.settings import VisionSettings

_ROUGH_PX = 2.0
"""How much farther than an outline's the ends of a rough polygon may be from their epipolar lines; set by eye."""


@dataclass(frozen=True, eq=False)
class PolygonMatch:
    """Left polygon `left` may be right polygon `right`; its corner i is the right's corner (i + shift) mod N.

    cost: px, rms distance of the corners from their epipolar lines and of their disparities from a plane's.
    """

    left: int
    right: int
    shift: int
    cost: float


def match_polygons(
    left: list[Array], right: list[Array], geometry: Baseline, settings: VisionSettings
) -> list[PolygonMatch]:
    """Every match that epipolar lines, depth range and planarity allow, cheapest first.

    left, right: corners (N, 2) px of each polygon, anticlockwise as seen.
    """
    if not left or not right:
        return []
    one, other = _Ideal.of(left, geometry.left), _Ideal.of(right, geometry.right)
    band = settings.search_epipolar_px / geometry.left.focal_px
    gap = np.abs(one.boxes[:, None, 1::2] - other.boxes[:, 1::2]).max(2)
    pairs = np.argwhere((one.count[:, None] == other.count) & (gap < band))
    corners = one.count[pairs[:, 0]]
    found = list[PolygonMatch]()
    for count in sorted(set(corners.tolist())):
        i, j = pairs[corners == count].T
        a, b = (eye.corners[eye.first[own, None] + np.arange(count)] for eye, own in ((one, i), (other, j)))
        shift, cost = _best_shifts(a, b, geometry, settings)
        good = np.isfinite(cost)
        found += map(PolygonMatch, *(column[good].tolist() for column in (i, j, shift, cost)))
    return sorted(found, key=lambda m: (m.cost, m.left, m.right))


def in_both(left: list[Array], right: list[Array], geometry: Baseline, settings: VisionSettings) -> tuple[Flags, Flags]:
    """Which rough polygons of the left (P,) and of the right eye (Q,) the other eye may have outlined as well: along
    the epipolar lines one of its own spans as much, at a depth where parts may be.

    left, right: corners (N, 2) px of each polygon.
    """
    if not left or not right:
        return np.zeros(len(left), bool), np.zeros(len(right), bool)
    nearest, farthest = settings.depth_range_mm
    one, other = _Ideal.of(left, geometry.left), _Ideal.of(right, geometry.right)
    apart = one.boxes[:, None] - other.boxes  # of the least x, y, of the greatest x, y
    near = np.abs(apart[:, :, 1::2]).max(2) < (settings.search_epipolar_px + _ROUGH_PX) / geometry.left.focal_px
    shift = apart[:, :, ::2]
    near &= (shift.max(2) > geometry.length_mm / farthest) & (shift.min(2) < geometry.length_mm / nearest)
    return near.any(1), near.any(0)


@dataclass(frozen=True, eq=False)
class _Ideal:
    """P polygons of one eye in ideal coordinates: corners (M, 2), one's after the other's; first, count (P,); boxes
    (P, 4): the least x and y of each, the greatest x and y."""

    corners: Array
    first: Index
    count: Index
    boxes: Array

    @classmethod
    def of(cls, polygons: list[Array], eye: RectifiedCamera) -> _Ideal:
        """polygons: corners (N, 2) px of each."""
        corners, count = eye.ideal(np.concatenate(polygons)), np.array([len(p) for p in polygons])
        first = count.cumsum() - count
        boxes = np.concatenate([extreme.reduceat(corners, first) for extreme in (np.minimum, np.maximum)], 1)
        return cls(corners, first, count, boxes)


def _best_shifts(a: Array, b: Array, geometry: Baseline, settings: VisionSettings) -> tuple[Index, Array]:
    """For P pairs of polygons with as many corners, ideal coordinates (P, N, 2) in the left and the right eye: the
    shift of the cheapest match (P,) and its cost in px (P,), infinite where none is possible."""
    nearest, farthest = settings.depth_range_mm
    pairs, n = a.shape[:2]
    order = (np.arange(n)[:, None] + np.arange(n)) % n
    off = (a[:, None, :, 1] - b[:, order, 1]) * geometry.left.focal_px
    disparity = a[:, None, :, 0] - b[:, order, 0]
    warp = _plane_residuals(a, disparity) * geometry.left.focal_px
    possible = (
        (np.abs(off).max(2) < settings.search_epipolar_px)
        & (disparity.min(2) > geometry.length_mm / farthest)
        & (disparity.max(2) < geometry.length_mm / nearest)
        & (warp.max(2) < settings.search_epipolar_px)
    )
    cost = np.where(possible, np.sqrt((off**2).mean(2) + (warp**2).mean(2)), np.inf)
    best = np.argmin(cost, 1)
    return best, cost[np.arange(pairs), best]


def _plane_residuals(points: Array, disparities: Array) -> Array:
    """How far each of the disparities (P, K, N) of points (P, N, 2) is off the best plane: over a plane in space
    disparity is affine in the image."""
    pairs, n = points.shape[:2]
    if n < 4:
        return np.zeros(disparities.shape)
    plane = np.linalg.qr(np.concatenate([points, np.ones((pairs, n, 1))], 2))[0]
    return np.asarray(np.abs(disparities @ plane @ np.swapaxes(plane, 1, 2) - disparities))
