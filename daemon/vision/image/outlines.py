"""Outlines: polygons still being worked on. From the borders of closed regions to sides that lie on the gradient.

Several outlines of one region may live side by side (with and without a doubtful corner); which of them is true is
decided when both eyes are compared. Final corners come from fit.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.vision.geometry.polygon import Point, drop_side, is_simple, tidy
from daemon.vision.geometry.polygon_batch import Rings, areas, convex, different, met, rings
from daemon.vision.image.edge_lines import find_sides, probe_sides
from daemon.vision.image.regions import Border, Image32, Region, Scale, closed_regions, rough_polygons
from daemon.vision.settings import VisionSettings

Array = NDArray[np.float64]

_FIRST_REACH_PX, _SECOND_REACH_PX = 4.0, 1.5
_INSIDE_PX, _UNSURE_PX = 1.2, 1.2  # per px of the scale: how far inside its edges a region ends
_DOUBTFUL_SIDE, _DOUBTFUL_PX = 0.6, 12.0
_SAME_PX, _SAME_SIDE_PX = 2.0, 0.6


@dataclass(frozen=True, eq=False)
class Outline:
    """corners (N, 2) px anticlockwise as seen; border (K, 2) px it came from; per side (N,): slope across it in
    sigmas of its mean over the side, and the fraction of its length where an edge is seen; support: that fraction of
    the whole outline.
    """

    corners: Array
    border: Border
    strength: Array
    seen: Array
    support: float


def find_outlines(smooth: Image32, grain: float, scales: list[Scale], settings: VisionSettings) -> list[Outline]:
    """Outlines of the closed regions at every scale and level, without repeats, best supported first.

    smooth: unit-noise image after a Gaussian; grain: its noise over that of white noise.
    """
    largest = settings.max_area_fraction * smooth.size
    rough = [
        (corners, region)
        for scale in scales
        for level in settings.levels
        for region in closed_regions(scale, level, largest, settings)
        for corners in rough_polygons(region, settings)
    ]
    rough = _cleanest(rough, settings)
    if not rough:
        return []
    start = rings([c for c, _ in rough])
    shrink = np.repeat([float(r.shrink) for _, r in rough], start.count)
    first = snap(smooth, start, _FIRST_REACH_PX, _INSIDE_PX * shrink, _UNSURE_PX * shrink)
    variants = [
        (v, r) for corners, (_, r) in zip(first.split(), rough, strict=True) for v in _variants(corners, settings)
    ]
    variants = _distinct(variants, _SAME_PX)
    if not variants:
        return []
    shape = snap_near(smooth, rings([c for c, _ in variants]), _SECOND_REACH_PX, 1.0)
    return probe(smooth, grain, shape, [r.border for _, r in variants], settings)


def snap(smooth: Image32, shape: Rings, reach_px: float, expected_px: Array, sigma_px: Array) -> Rings:
    """Polygons with their sides moved onto the gradient, expected so far outwards (M,), and met again in corners."""
    start, end = find_sides(smooth, shape.corners, shape.corners[shape.next], reach_px, expected_px, sigma_px)
    return shape.moved(met(shape, start, end))


def snap_near(smooth: Image32, shape: Rings, reach_px: float, sigma_px: float) -> Rings:
    """The same where the gradient is expected to be where the sides are; each different side is moved once."""
    start, end = shape.corners, shape.corners[shape.next]
    kept, which, turned = different(start, end, _SAME_SIDE_PX)
    near = np.zeros(len(kept))
    one, other = find_sides(smooth, start[kept], end[kept], reach_px, near, near + sigma_px)
    one, other, back = one[which], other[which], turned[:, None]
    start, end = np.where(back, other, one), np.where(back, one, other)
    return shape.moved(met(shape, start, end))


def probe(
    smooth: Image32, grain: float, shape: Rings, borders: list[Border], settings: VisionSettings
) -> list[Outline]:
    """The polygons whose every side shows in the gradient, best supported first, without repeats."""
    start, end = shape.corners, shape.corners[shape.next]
    kept, which, turned = different(start, end, _SAME_SIDE_PX / 2)
    strength, seen = (v[which] for v in probe_sides(smooth, start[kept], end[kept], grain))
    strength = np.where(turned, -strength, strength)
    chord = end - start
    length = np.hypot(chord[:, 0], chord[:, 1])
    support = shape.sums(length * seen) / shape.sums(length)
    good = (
        np.isfinite(support)
        & (support > settings.min_support)
        & (shape.least(np.abs(strength)) > settings.min_evidence)
        & (shape.least(seen) > settings.min_seen)
        & (areas(shape) < -settings.min_area_px)
    )
    sound = convex(shape)
    polygons, strengths, seens = shape.split(), shape.split(strength), shape.split(seen)
    order = [k for k in np.argsort(-support, kind="stable") if good[k] and (sound[k] or is_simple(polygons[k]))]
    order = [order[k] for k in _first_of_each([polygons[k] for k in order], _SAME_PX)]
    return [Outline(polygons[k], borders[k], strengths[k], seens[k], float(support[k])) for k in order]


def _cleanest(rough: list[tuple[Array, Region]], settings: VisionSettings) -> list[tuple[Array, Region]]:
    """Of polygons in much the same place, which are one region at several levels and scales, the few cleanest.

    A clean border fills its polygon; noise eats into it, and a coarse scale is trusted less than a fine one.
    """
    if not rough:
        return []
    shape = rings([c for c, _ in rough])
    size = -areas(shape)
    middle = shape.sums(shape.corners) / shape.count[:, None]
    filled = np.array([r.area_px for _, r in rough]) / np.maximum(size, 1.0)
    untidy = np.abs(np.minimum(filled, 1.0) - 1.0) + 0.03 * np.array([r.shrink - 1 for _, r in rough])
    groups: list[list[float]] = []
    kept: list[int] = []
    for k in np.argsort(untidy, kind="stable").tolist():
        x, y = middle[k].tolist()
        area = float(size[k])
        for group in groups:
            apart = max(abs(x - group[0]), abs(y - group[1]))
            if apart < 0.2 * math.sqrt(group[2]) + 1 and 0.55 < area / group[2] < 1.8:
                group[3] += 1
                if group[3] <= settings.alike:
                    kept.append(k)
                break
        else:
            groups.append([x, y, area, 1])
            kept.append(k)
    kept.sort(key=lambda k: -size[k])
    return [rough[k] for k in kept[: settings.max_regions]]


def _distinct(polygons: list[tuple[Array, Region]], tolerance_px: float) -> list[tuple[Array, Region]]:
    return [polygons[k] for k in _first_of_each([c for c, _ in polygons], tolerance_px)]


def _first_of_each(polygons: list[Array], tolerance_px: float) -> list[int]:
    """Indices of the polygons that do not repeat an earlier one corner by corner."""
    kept: list[int] = []
    known: dict[int, list[tuple[float, float, list[Point]]]] = {}
    for k, p in enumerate(polygons):
        points = [(x, y) for x, y in p.tolist()]
        n = len(points)
        x, y = sum(q[0] for q in points) / n, sum(q[1] for q in points) / n
        reach = min(tolerance_px, 0.1 * max(abs(q[0] - x) + abs(q[1] - y) for q in points))
        others = known.setdefault(n, [])
        if not any(abs(x - u) < reach and abs(y - v) < reach and _same(points, q, reach) for u, v, q in others):
            others.append((x, y, points))
            kept.append(k)
    return kept


def _same(a: list[Point], b: list[Point], tolerance_px: float) -> bool:
    """Whether two polygons of as many corners agree corner by corner."""
    return all(any(abs(p[0] - q[0]) < tolerance_px and abs(p[1] - q[1]) < tolerance_px for q in b) for p in a)


def _variants(corners: Array, settings: VisionSettings) -> list[Array]:
    """The polygon with its shortest sides left out one after the other, while they are short beside the rest.

    A short side may be real, or a tip blunted by the edges' own width, or a leak where an edge fades: the image
    decides.
    """
    found: list[Array] = []
    current = tidy([(x, y) for x, y in corners.tolist()], settings.min_side_px)
    while current is not None:
        found.append(np.array(current))
        lengths = [math.dist(a, b) for a, b in zip(current, current[1:] + current[:1], strict=True)]
        shortest, median = min(lengths), sorted(lengths)[len(lengths) // 2]
        if len(current) <= 3 or shortest > max(_DOUBTFUL_SIDE * median, _DOUBTFUL_PX):
            break
        current = tidy(drop_side(current, lengths.index(shortest)), settings.min_side_px)
    return found
