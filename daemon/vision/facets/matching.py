"""Which polygon of the left eye is which of the right, corner by corner: epipolar, ordered, facet-wise.

D'Souza matches corner by corner inside an epipolar band (section 4.2.3) and loses its way where sides are short; whole
facets, taken round their border in order, leave far fewer ways to be wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.vision.geometry.rectified import Baseline, Eye
from daemon.vision.settings import VisionSettings

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Match:
    """Left polygon `left` may be right polygon `right`; its corner i is the right's corner (i + shift) mod N.

    cost: px, rms distance of the corners from their epipolar lines and of their disparities from a plane's.
    """

    left: int
    right: int
    shift: int
    cost: float


def match_polygons(left: list[Array], right: list[Array], geometry: Baseline, settings: VisionSettings) -> list[Match]:
    """Every match that epipolar lines, depth range and planarity allow, cheapest first.

    left, right: corners (N, 2) px of each polygon, anticlockwise as seen.
    """
    if not left or not right:
        return []
    ideal_left, ideal_right = _ideal(left, geometry.left), _ideal(right, geometry.right)
    one, other = _summary(ideal_left), _summary(ideal_right)
    band = settings.search_epipolar_px / geometry.left.focal_px
    gap = np.abs(one[:, None, 1:] - other[None, :, 1:]).max(2)
    same = one[:, None, 0] == other[None, :, 0]
    found = []
    for i, j in np.argwhere(same & (gap < band)):
        best = _best_shift(ideal_left[i], ideal_right[j], geometry, settings)
        if best is not None:
            found.append(Match(int(i), int(j), *best))
    return sorted(found, key=lambda m: m.cost)


def _ideal(polygons: list[Array], eye: Eye) -> list[Array]:
    every = eye.ideal(np.concatenate(polygons))
    return list(np.split(every, np.cumsum([len(p) for p in polygons])[:-1]))


def _summary(polygons: list[Array]) -> Array:
    """Per polygon its number of corners and the epipolar band it spans, (P, 3)."""
    return np.array([(len(p), p[:, 1].min(), p[:, 1].max()) for p in polygons])


def _best_shift(a: Array, b: Array, geometry: Baseline, settings: VisionSettings) -> tuple[int, float] | None:
    nearest, farthest = settings.depth_range_mm
    n = len(a)
    order = (np.arange(n)[:, None] + np.arange(n)) % n
    off = (a[None, :, 1] - b[order, 1]) * geometry.left.focal_px
    disparity = a[None, :, 0] - b[order, 0]
    possible = (
        (np.abs(off).max(1) < settings.search_epipolar_px)
        & (disparity.min(1) > geometry.length_mm / farthest)
        & (disparity.max(1) < geometry.length_mm / nearest)
    )
    shifts = np.flatnonzero(possible)
    warp = _plane_residuals(a, disparity[shifts]) * geometry.left.focal_px
    cost = np.sqrt((off[shifts] ** 2).mean(1) + (warp**2).mean(1))
    cost[warp.max(1) >= settings.search_epipolar_px] = np.inf
    best = int(np.argmin(cost)) if len(cost) else 0
    return (int(shifts[best]), float(cost[best])) if len(cost) and np.isfinite(cost[best]) else None


def _plane_residuals(points: Array, disparities: Array) -> Array:
    """How far each of the disparities (K, N) of points (N, 2) is off the best plane: over a plane in space disparity is
    affine in the image."""
    if len(points) < 4 or not len(disparities):
        return np.zeros(disparities.shape)
    design = np.concatenate([points, np.ones((len(points), 1))], 1)
    plane = np.linalg.qr(design)[0]
    return np.asarray(np.abs(disparities @ plane @ plane.T - disparities))
