"""Outlines: polygons still being worked on. From the borders of closed regions to sides that lie on the gradient.

Several outlines of one region may live side by side (with and without a doubtful corner); which of them is true is
decided when both eyes are compared. Final corners come from polygon_fit.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from daemon.arrays import Array
from daemon.vision.geometry import Point, Rings, Shape, areas, convex, different, drop_side, is_simple, met, rings, tidy
from daemon.vision.image.edge_lines import find_sides, probe_sides
from daemon.vision.image.regions import Border, Image32, Region, RoughPolygon
from daemon.vision.settings import VisionSettings

# All set by eye on the rendered scenes; tests/bench/facets.py shows what each does to facets found and missed.
_FIRST_REACH_PX, _SECOND_REACH_PX = 4.0, 1.5
"""How far from a rough side, and from a side once moved, the gradient is looked for."""
_INSIDE_PX, _UNSURE_PX = 1.2, 1.2
"""How far inside its edges a region ends, and how sure that is: per px of the scale."""
_DOUBTFUL_SIDE, _DOUBTFUL_PX = 0.6, 12.0
"""A side shorter than this share of the median side, or than this, may be none."""
_SAME_PX, _SAME_SIDE_PX = 2.0, 0.6
"""Corners, and ends of sides, this near are one."""
_PER_SHRINK = 0.03
"""Share of its area that a region may be eaten into before the next coarser scale is taken for cleaner."""
_ALIKE_APART, _ALIKE_RATIO = 0.2, (0.55, 1.8)
"""Readings of one region: middles this near, in roots of their area, and areas in this ratio."""


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

    @cached_property
    def shape(self) -> Shape:
        """Its corners made ready for many comparisons."""
        return Shape.of(self.corners)


@dataclass(frozen=True, eq=False)
class Search:
    """One effort: the rough polygons that were worked on, and the outlines that came of them, best supported first."""

    rough: tuple[RoughPolygon, ...] = ()
    outlines: tuple[Outline, ...] = ()


def find_outlines(
    smooth: Image32, grain: float, regions: list[Region], before: Search, settings: VisionSettings
) -> Search:
    """Outlines of closed regions, without repeats, best supported first; what was found before is kept as it is.

    smooth: unit-noise image after a Gaussian; grain: its noise over that of white noise.
    """
    rough = [p for r in regions for p in r.rough if len(p.corners) <= settings.max_corners]
    rough = _cleanest(rough, settings)
    new = [p for p in rough if p not in before.rough]
    if not new:
        return before
    start = rings([p.corners for p in new])
    shrink = np.repeat([float(p.shrink) for p in new], start.count)
    first = snap(smooth, start, _FIRST_REACH_PX, _INSIDE_PX * shrink, _UNSURE_PX * shrink)
    variants = [(v, p.border) for c, p in zip(first.split(), new, strict=True) for v in _variants(c, settings)]
    variants = [variants[k] for k in first_of_each([v for v, _ in variants], _SAME_PX)]
    found = list[Outline]()
    if variants:
        shape = snap_near(smooth, rings([c for c, _ in variants]), _SECOND_REACH_PX, 1.0)
        found = probe(smooth, grain, shape, [border for _, border in variants], settings)
    every = [*before.outlines, *found]
    every = [every[k] for k in first_of_each([o.corners for o in every], _SAME_PX)]
    return Search((*before.rough, *new), tuple(sorted(every, key=lambda o: -o.support)))


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
    order = [order[k] for k in first_of_each([polygons[k] for k in order], _SAME_PX)]
    return [Outline(polygons[k], borders[k], strengths[k], seens[k], float(support[k])) for k in order]


def _cleanest(rough: list[RoughPolygon], settings: VisionSettings) -> list[RoughPolygon]:
    """Of polygons in much the same place, which are one region at several levels and scales, the few cleanest.

    A clean border fills its polygon; noise eats into it, and a coarse scale is trusted less than a fine one.
    """
    if not rough:
        return []
    shape = rings([p.corners for p in rough])
    size = -areas(shape)
    middle = shape.sums(shape.corners) / shape.count[:, None]
    filled = np.array([p.area_px for p in rough]) / np.maximum(size, 1.0)
    untidy = np.abs(np.minimum(filled, 1.0) - 1.0) + _PER_SHRINK * np.array([p.shrink - 1 for p in rough])
    left = np.argsort(untidy, kind="stable")
    kept = list[int]()
    while len(left):
        first = left[0]
        apart = np.abs(middle[left] - middle[first]).max(1)
        ratio = size[left] / size[first]
        alike = (
            (apart < _ALIKE_APART * np.sqrt(size[first]) + 1) & (ratio > _ALIKE_RATIO[0]) & (ratio < _ALIKE_RATIO[1])
        )
        alike[0] = True
        kept += left[alike][: settings.alike].tolist()
        left = left[~alike]
    kept.sort(key=lambda k: -size[k])
    return [rough[k] for k in kept[: settings.max_regions]]


def first_of_each(polygons: list[Array], tolerance_px: float) -> list[int]:
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
