"""Outlines: from the borders of closed regions to sides that lie on the gradient, and to polygons fitted to the grey
levels, with corners to sub-pixel and their covariance.

Several outlines of one region may live side by side (with and without a doubtful corner); which of them is true is
decided when both cameras are compared. Nothing here knows of the other camera.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from daemon.arrays import Array, Flags, Index
from daemon.vision.geometry import (
    PlanarShape,
    Point,
    Rings,
    areas,
    convex,
    different,
    drop_side,
    is_simple,
    met,
    outward,
    rings,
    tidy,
)
from daemon.vision.image.calipers import Images
from daemon.vision.image.edge_lines import MeasuredImage, Sides, find_sides, fit_sides, strengths
from daemon.vision.image.grey import Fine
from daemon.vision.image.regions import Border, Region, RoughPolygon
from daemon.vision.settings import VisionSettings
from daemon.vision.values import Polygon

# All set by eye on the rendered scenes; tests/bench/facets.py shows what each does to facets found and missed.
_FIRST_REACH_PX, _SECOND_REACH_PX = 4.0, 1.5
"""Distance, px, from a rough side, and from a side once moved, to which the gradient is searched."""
_INSIDE_PX, _UNSURE_PX = 1.2, 1.2
"""Distance by which a region ends inside its edges, and its standard deviation, px per px of the scale."""
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
    visible: Array
    support: float

    @cached_property
    def shape(self) -> PlanarShape:
        """Its corners made ready for many comparisons."""
        return PlanarShape.of(self.corners)


@dataclass(frozen=True, eq=False)
class OutlineRequest:
    """One image in which outlines of rough polygons are wanted: smooth, of unit noise, after a Gaussian; grain: its
    noise over that of white noise.
    """

    smooth: Fine
    grain: float
    rough: Sequence[RoughPolygon]


def find_outlines(requests: Sequence[OutlineRequest], settings: VisionSettings) -> list[list[Outline]]:
    """Outlines near each rough polygon, image after image; what several would give, the first of an image gives."""
    flat = [p for request in requests for p in request.rough]
    if not flat:
        return []
    start = rings([p.corners for p in flat])
    shrink = np.repeat([float(p.shrink) for p in flat], start.count)
    images = [(request.smooth, sum(len(p.corners) for p in request.rough)) for request in requests]
    moved = iter(snap(images, start, _FIRST_REACH_PX, _INSIDE_PX * shrink, _UNSURE_PX * shrink).split())
    variants, count = list[tuple[Array, int]](), 0
    images = []
    for request in requests:
        own = [(v, k) for k in range(count, count + len(request.rough)) for v in _variants(next(moved), settings)]
        own = [own[k] for k in first_of_each([v for v, _ in own], _SAME_PX)]
        images.append((request.smooth, sum(len(v) for v, _ in own)))
        variants += own
        count += len(request.rough)
    found: list[list[Outline]] = [[] for _ in flat]
    if variants:
        borders = [flat[k].border for _, k in variants]
        made = _outlined(images, [one.grain for one in requests], rings([v for v, _ in variants]), borders, settings)
        for outline, (_, k) in zip(made, variants, strict=True):
            if outline is not None:
                found[k].append(outline)
    return found


def best_first(outlines: Sequence[Outline]) -> tuple[Outline, ...]:
    """Outlines of one image without repeats, best supported first."""
    ranked = sorted(outlines, key=lambda o: -o.support)
    return tuple(ranked[k] for k in first_of_each([o.corners for o in ranked], _SAME_PX))


def snap(images: Images, shape: Rings, reach_px: float, expected_px: Array, sigma_px: Array) -> Rings:
    """Polygons with their sides moved onto the gradient, expected so far outwards (M,), and met again in corners."""
    start, end, _ = find_sides(images, shape.corners, shape.corners[shape.next], reach_px, expected_px, sigma_px)
    return shape.moved(met(shape, start, end))


def _outlined(
    images: Images,
    grains: Sequence[float],
    shape: Rings,
    borders: Sequence[Border],
    settings: VisionSettings,
) -> list[Outline | None]:
    """Polygons near the gradient as outlines, their sides moved onto it, each different side once; None for one of
    which a side does not show in it."""
    own, start, end, which, turned = _once(images, shape)
    expected = np.zeros(len(start))
    one, other, slopes = find_sides(own, start, end, _SECOND_REACH_PX, expected, expected + 1.0)
    length = np.hypot(*(other - one).T)
    strength, seen = (v[which] for v in strengths(slopes, length, np.repeat(grains, [count for _, count in own])))
    one, other, length, back = one[which], other[which], length[which], turned[:, None]
    shape = shape.moved(met(shape, np.where(back, other, one), np.where(back, one, other)))
    strength = np.where(turned, -strength, strength)
    support = shape.sums(length * seen) / shape.sums(length)
    good = (
        np.isfinite(support)
        & (support > settings.min_support)
        & (shape.least(np.abs(strength)) > settings.min_evidence)
        & (shape.least(seen) > settings.min_seen)
        & (areas(shape) < -settings.min_area_px)
    )
    sound = convex(shape)
    polygons, shown, seens = shape.split(), shape.split(strength), shape.split(seen)
    return [
        Outline(polygons[k], border, shown[k], seens[k], float(support[k]))
        if good[k] and (sound[k] or is_simple(polygons[k]))
        else None
        for k, border in enumerate(borders)
    ]


def _once(images: Images, shape: Rings) -> tuple[Images, Array, Array, Index, Flags]:
    """The different sides of polygons in several images: how many are in each, their ends; for each side of the
    polygons which of them it is, and whether it runs the other way.
    """
    start, end = shape.corners, shape.corners[shape.next]
    own, every, first, known = [], [], 0, 0
    for image, count in images:
        here = slice(first, first + count)
        kept, which, turned = different(start[here], end[here], _SAME_SIDE_PX)
        own.append((image, len(kept)))
        every.append((kept + first, which + known, turned))
        first, known = first + count, known + len(kept)
    kept, which, turned = (np.concatenate(values) for values in zip(*every, strict=True))
    return own, start[kept], end[kept], which, turned


def rough_polygons(regions: Sequence[Region], settings: VisionSettings) -> list[RoughPolygon]:
    """Keep the few cleanest of closed regions in much the same place, which are one at several levels and scales.

    A clean border fills its polygon; noise eats into it, and a coarse scale is trusted less than a fine one.
    """
    rough = [p for r in regions for p in r.rough if len(p.corners) <= settings.max_corners]
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
    kept = list[int]()
    known = dict[int, list[tuple[float, float, list[Point]]]]()
    for k, p in enumerate(polygons):
        points: list[Point] = p.tolist()
        x = y = size = 0.0
        for u, v in points:
            x, y = x + u / len(points), y + v / len(points)
        for u, v in points:
            size = max(size, abs(u - x) + abs(v - y))
        reach = min(tolerance_px, 0.1 * size)
        others = known.setdefault(len(points), [])
        for u, v, q in others:
            if abs(x - u) < reach and abs(y - v) < reach and _same(points, q, reach):
                break
        else:
            others.append((x, y, points))
            kept.append(k)
    return kept


def _same(a: list[Point], b: list[Point], tolerance_px: float) -> bool:
    """Whether two polygons of as many corners agree corner by corner."""
    for x, y in a:
        for u, v in b:
            if abs(x - u) < tolerance_px and abs(y - v) < tolerance_px:
                break
        else:
            return False
    return True


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


# Set by eye on the rendered scenes.
_FARTHEST_PX = 6.0  # from its outline a fitted corner may be
_SHORTEST_PX = 4.0
_FITTED_ONCE_PX = 1.0  # sides whose ends are this near are fitted once
MODEL_PX = 0.04  # how far a real side is from a blurred step between even faces


@dataclass(frozen=True, eq=False)
class Fitted:
    """A polygon and the sides it was met from; side i goes from corner i to the next."""

    polygon: Polygon
    sides: Sides

    def rolled(self, shift: int) -> Fitted:
        """Return the same polygon with corner `shift` first."""
        p, n = self.polygon, len(self.polygon.corners_px)
        order = (np.arange(n) + shift) % n
        polygon = Polygon(p.corners_px[order], p.covariance_px2[order], p.contrast[order], p.border_px)
        return Fitted(polygon, self.sides.chosen(order))


def fit_polygons(of_images: Sequence[tuple[MeasuredImage, Sequence[Outline]]]) -> list[Fitted | None]:
    """Fit every side of every outline, image after image, to the grey levels; None where the fit strays from the
    outline. The images are fitted side by side and have nothing to do with each other."""
    outlines = [o for _, own in of_images for o in own]
    if not outlines:
        return []
    shape = rings([o.corners for o in outlines])
    starts, ends, chosen, turns = list[Array](), list[Array](), list[Index](), list[Flags]()
    counts, first = list[tuple[MeasuredImage, int]](), 0
    for exposure, own in of_images:
        here = slice(first, first + sum(len(o.corners) for o in own))
        if here.start < here.stop:
            start, end = shape.corners[here], shape.corners[shape.next[here]]
            kept, which, turned = different(start, end, _FITTED_ONCE_PX)
            chosen.append(which + sum(count for _, count in counts))
            starts.append(start[kept])
            ends.append(end[kept])
            turns.append(turned)
            counts.append((exposure, len(kept)))
        first = here.stop
    sides = fit_sides(counts, np.concatenate(starts), np.concatenate(ends))
    every = sides.chosen(np.concatenate(chosen), np.concatenate(turns))
    rough, shape = shape.corners, shape.moved(met(shape, every.start, every.end))
    covariance = met_covariance(shape, every)
    astray = np.maximum.reduceat(np.abs(shape.corners - rough).max(1), shape.first)
    shortest = shape.least(np.hypot(*(shape.corners - shape.corners[shape.next]).T))
    good, sound = (astray < _FARTHEST_PX) & (shortest > _SHORTEST_PX), convex(shape)
    fitted: list[Fitted | None] = []
    for k, (o, corners) in enumerate(zip(outlines, shape.split(), strict=True)):
        if good[k] and (sound[k] or is_simple(corners)):
            part = shape.first[k] + np.arange(shape.count[k])
            sides = every.chosen(part)
            polygon = Polygon(corners, covariance[part], np.abs(sides.step), o.border.astype(float))
            fitted.append(Fitted(polygon, sides))
        else:
            fitted.append(None)
    return fitted


def met_covariance(shape: Rings, sides: Sides) -> Array:
    """Covariance (M, 2, 2) px^2 of corners where the side before ends and the corner's own side starts."""
    chord = sides.end - sides.start
    normal = outward(-chord, np.hypot(chord[:, 0], chord[:, 1]))
    before = normal[shape.before]
    sine = before[:, 0] * normal[:, 1] - before[:, 1] * normal[:, 0]
    sine = np.where(np.abs(sine) < 0.02, 0.02, sine)
    along = np.stack([normal[:, 1], -normal[:, 0]], 1) / sine[:, None]
    across = np.stack([-before[:, 1], before[:, 0]], 1) / sine[:, None]
    ends, starts = sides.covariance[shape.before, 1, 1] + MODEL_PX**2, sides.covariance[:, 0, 0] + MODEL_PX**2
    one = along[:, :, None] * along[:, None, :] * ends[:, None, None]
    return np.asarray(one + across[:, :, None] * across[:, None, :] * starts[:, None, None])
