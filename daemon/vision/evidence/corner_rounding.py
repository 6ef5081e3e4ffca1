"""How far the border of a facet stays from where two of its sides meet: corners that are rounded, and how much.

Where sides meet at an angle t the border of a corner of radius r stays r (1 / sin(t / 2) - 1) from there, .41 r where
it is right. A blurred picture draws the border of a sharp corner in as well, by as much as the angle and the blur say.
The sides are measured beside the corner, so that a pose that is off by a pixel or two is not taken for a rounding. In:
a solid at a pose, one image. Out: where the border of its facets' corners is, px, and where it should be.
"""

from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron, in_sight, robust_weight, with_rings
from daemon.vision.image import SMOOTHING_PX, CameraImage, levels_across, peak_places

SHORT = 0.3
"""Of a facet's longest side, what a chord of a rounding has at most; no facet is known beyond it."""
LEAST_COS = np.cos(np.radians(140.0)), np.cos(np.radians(40.0))
"""Of the angle between two sides, on the part and in the picture: others meet too far from where they end, or hardly
turn."""
LEAST_FACING, ROOM_PX, SHORTEST_PX = 0.25, 9.0, 14.0
"""Cosine at which a facet is too oblique; how far inside the picture a corner must be; and the length of its sides."""
FROM_PX, UNTIL_PX, STEP_PX = 5.0, 30.0, 1.5
"""From where on along a side, counted from the corner, its place is measured, until where at most, how often."""
REACH_PX, LEAST_SLOPE, FEWEST, ASTRAY_PX = 5, 8.0, 4, 0.6
"""How far across; the sigmas of a slope that counts; how many places do; and how far they may lie off a line."""
MOVED_PX = 4.0
"""How far from where the pose has a corner its sides may meet."""
LEVEL_PX, LEAST_STEP, ALIKE = (3.0, 7.0), 8.0, 0.5
"""Between which the levels of the facet and of what is beyond its corner are taken, the sigmas by which they differ,
and the least and inverse of the most that this is of the step at its sides: else another thing begins at the corner."""
OF_BLUR = 0.77
"""By how much blur, of one sigma, draws the border of a sharp corner in, over the cotangent of half its angle:
by integrals over wedges from 40 to 140 degrees, to 5 %."""
USUAL_BLUR_PX = 0.77
"""The blur of edges where no outline was fitted that tells it."""
_ACROSS_PX = np.arange(-REACH_PX - 0.5, REACH_PX + 1.0)
_ALONG_PX, _BESIDE_PX = np.arange(-8.0, 24.25, 0.5), np.array([-0.75, 0.0, 0.75])


class Bend(NamedTuple):
    """Where two sides of a facet meet, or would: the facet's number; corner_mm (3,); ways (2, 3), unit vectors along
    both sides away from there, and lengths_mm (2,) to their far ends; run: the facet's corners there, more than one
    where it is rounded; tangent_mm: how far from there the sides then end."""

    facet: int
    corner_mm: Array
    ways: Array
    lengths_mm: Array
    run: tuple[int, ...]
    tangent_mm: float

    @property
    def stay_mm(self) -> float:
        """Return how far, mm, the border stays from where the sides meet."""
        return float(np.linalg.norm(self.curve_mm(self.tangent_mm) - self.corner_mm, axis=1).min())

    def curve_mm(self, tangent_mm: float) -> Array:
        """(33, 3) places on the border of a corner with such a tangent: an arc, or what it is cut off by.
        Source: a circle as a rational curve of second degree."""
        weight = np.sqrt((1 - float(self.ways[0] @ self.ways[1])) / 2) if len(self.run) != 2 else 0.0
        s = np.linspace(0, 1, 33)[:, None]
        ends = tangent_mm * self.ways
        middle = 2 * weight * s * (1 - s)
        return np.asarray(self.corner_mm + ((1 - s) ** 2 * ends[0] + s**2 * ends[1]) / ((1 - s) ** 2 + middle + s**2))


@lru_cache(maxsize=1024)
def bends(solid: Polyhedron) -> tuple[Bend, ...]:
    """Return where sides of a solid's facets meet that show, at an angle that sticks out of the facet."""
    return tuple(found for facet in range(len(solid.facets)) for found in _bends_of(solid, facet))


def _bends_of(solid: Polyhedron, facet: int) -> list[Bend]:
    ring, count = solid.facets[facet], len(solid.facets[facet])
    points = solid.corners_mm[list(ring)]
    way = np.roll(points, -1, 0) - points
    lengths = np.linalg.norm(way, axis=1)
    open_ = np.array([(facet, k) not in solid.across for k in range(count)])
    sides = np.flatnonzero(~(open_ & (lengths < SHORT * lengths.max()))).tolist()
    smooth = [(min(pair), max(pair)) in solid.smooth for pair in zip(ring, (*ring[1:], ring[0]), strict=True)]
    found = []
    for one, other in pairwise([*sides, sides[0]]):
        if one == other or smooth[one] or smooth[other]:
            continue
        back, on = -way[one] / lengths[one], way[other] / lengths[other]
        begin, end = points[(one + 1) % count], points[other]
        cosine = float(back @ on)
        if np.cross(on, back) @ solid.normals[facet] <= 0 or not LEAST_COS[0] < cosine < LEAST_COS[1]:
            continue
        run = tuple(ring[(one + 1 + step) % count] for step in range((other - one - 1) % count + 1))
        before, after = (0.0, 0.0)
        if len(run) > 1:
            before, after = np.linalg.lstsq(np.column_stack([-back, on]), end - begin, rcond=None)[0].tolist()
            if min(before, after) <= 0:
                continue
        both = np.array([lengths[one] + before, lengths[other] + after])
        found.append(Bend(facet, begin - before * back, np.array([back, on]), both, run, float(before + after) / 2))
    return found


@lru_cache(maxsize=4096)
def squared(solid: Polyhedron) -> Polyhedron:
    """A solid with its rounded corners sharp; the same where it has none."""
    if not solid.open_edges:
        return solid
    onto, points = dict[int, int](), list(solid.corners_mm)
    for bend in bends(solid):
        if len(bend.run) > 1:
            onto |= dict.fromkeys(bend.run, len(points))
            points.append(bend.corner_mm)
    if not onto:
        return solid
    rings = [[onto.get(k, k) for k in ring] for ring in solid.facets]
    rings = [[k for place, k in enumerate(ring) if k != ring[place - 1]] for ring in rings]
    return with_rings(np.array(points), [ring for ring in rings if len(ring) > 2])


class Stay(NamedTuple):
    """Where one camera has the border at a bend: seen_px from where the sides meet; blur_px, where a sharp corner has
    it; corner, sides (2, 2): where the sides meet, px, and which way they go."""

    seen_px: float
    blur_px: float
    corner: Array
    sides: Array

    def expected_px(self, curve: Array) -> float:
        """Return where a border shows that goes along a curve (N, 2) px from its own corner."""
        middle = self.sides.sum(0)
        middle = middle / np.linalg.norm(middle)
        aside = curve @ [-middle[1], middle[0]]
        crossed = np.flatnonzero(np.diff(np.sign(aside)))
        if not len(crossed):
            return self.blur_px
        k = int(crossed[0])
        share = aside[k] / (aside[k] - aside[k + 1])
        return float(np.hypot(self.blur_px, (curve[k] + share * (curve[k + 1] - curve[k])) @ middle))


def stay_of(
    solid: Polyhedron, bend: Bend, tangent_mm: float, pose: Array, view: CameraImage, viewpoint_mm: Array
) -> Stay | None:
    """Measure where a camera has the border at a bend of a solid at cyclopean_from_part (4, 4), whose sides are
    straight from tangent_mm on; None where it does not show that."""
    camera = view.rectified.camera
    way_mm = bend.ways * bend.lengths_mm[:, None]
    px = camera.project(frames.apply(pose, np.vstack([bend.corner_mm, bend.corner_mm + way_mm,
                                                      bend.corner_mm + tangent_mm * bend.ways])))  # fmt: skip
    if ((px < ROOM_PX) | (px > np.array(view.grey.shape[::-1]) - 1 - ROOM_PX)).any():
        return None
    if not in_sight(solid, bend.corner_mm + 0.02 * way_mm.sum(0), pose, viewpoint_mm):
        return None
    way = px[1:3] - px[0]
    long = np.linalg.norm(way, axis=1)
    way = way / np.maximum(long, 1e-9)[:, None]
    if long.min() < SHORTEST_PX or not LEAST_COS[0] < way[0] @ way[1] < LEAST_COS[1]:
        return None
    begin = np.linalg.norm(px[3:5] - px[0], axis=1)
    lines = [_line(view, px[0], way[k], way[1 - k], begin[k] + 2, long[k] - FROM_PX) for k in (0, 1)]
    if lines[0] is None or lines[1] is None:
        return None
    starts, ways, steps = zip(*lines, strict=True)
    met = np.linalg.solve(np.column_stack([ways[0], -ways[1]]), starts[1] - starts[0])
    corner, sides = starts[0] + met[0] * ways[0], np.array(ways)
    if np.linalg.norm(corner - px[0]) > MOVED_PX:
        return None
    tangent = np.sqrt((1 + sides[0] @ sides[1]) / np.maximum(1 - sides[0] @ sides[1], 1e-9))  # cotangent of half
    blur_px = OF_BLUR * np.hypot(view.blur_px or USUAL_BLUR_PX, SMOOTHING_PX) * tangent
    curve = camera.project(frames.apply(pose, bend.curve_mm(tangent_mm))) - px[0]
    seen = Stay(0.0, blur_px, corner, sides)
    place = _border(view, seen, seen.expected_px(curve), np.array(steps))
    return None if place is None else seen._replace(seen_px=place)


def _line(
    view: CameraImage, corner: Array, way: Array, other: Array, first: float, last: float
) -> tuple[Array, Array, float] | None:
    """A point (2,) and the way (2,) of the edge beside a side from a corner on, and the median step across it towards
    the facet; None where there is no straight one. other: the way of the other side."""
    along = np.arange(max(first, FROM_PX), min(last, max(first, FROM_PX) + UNTIL_PX), STEP_PX)
    if len(along) < FEWEST:
        return None
    normal = np.array([-way[1], way[0]])
    normal = normal if normal @ other < 0 else -normal
    at = corner + along[:, None] * way
    levels = levels_across(view.smooth, at, np.tile(normal, (len(at), 1)), _ACROSS_PX)
    slopes = np.diff(levels, axis=1)
    size = np.abs(slopes)
    best = size[:, 1:-1].argmax(1) + 1
    top, between = peak_places(size, best)
    place = best - REACH_PX + between
    use = top > LEAST_SLOPE
    if use.sum() < max(FEWEST, 0.6 * len(along)):
        return None
    design = np.column_stack([np.ones(use.sum()), along[use]])
    weight = np.ones(len(design))
    for _ in range(4):
        root = np.sqrt(weight)
        answer = np.linalg.lstsq(design * root[:, None], place[use] * root, rcond=None)[0]
        off = place[use] - design @ answer
        spread = max(1.5 * float(np.median(np.abs(off))), 0.1)
        weight = robust_weight(off**2, 1.5 * spread)
    if spread > ASTRAY_PX:
        return None
    line = way + answer[1] * normal
    inside = float(np.median(levels[use, :2].mean(1) - levels[use, -2:].mean(1)))
    return corner + answer[0] * normal, line / np.linalg.norm(line), inside


def _border(view: CameraImage, seen: Stay, expected_px: float, steps: Array) -> float | None:
    """Return how far from the corner the border is, half way between the levels of the facet and of what is beyond."""
    middle = seen.sides.sum(0)
    middle = middle / np.linalg.norm(middle)
    levels = levels_across(view.smooth, seen.corner[None], middle[None], _ALONG_PX, _BESIDE_PX)[0]
    low, high = LEVEL_PX
    from_px = max(seen.blur_px, expected_px)
    own = float(np.median(levels[(from_px + low < _ALONG_PX) & (from_px + high > _ALONG_PX)]))
    beyond = float(np.median(levels[(-low > _ALONG_PX) & (-high < _ALONG_PX)]))
    step = own - beyond
    if abs(step) < LEAST_STEP or not (steps / step > ALIKE).all() or not (steps / step < 1 / ALIKE).all():
        return None
    share = (levels - beyond) / step
    crossed = np.flatnonzero((share[:-1] < 0.5) & (share[1:] >= 0.5) & (_ALONG_PX[1:] < from_px + high))
    if not len(crossed):
        return None
    k = int(crossed[-1])
    return float(_ALONG_PX[k] + 0.5 * (0.5 - share[k]) / (share[k + 1] - share[k]))
