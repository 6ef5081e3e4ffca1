"""Rings of straight sides and arcs that bound facets, fitted whole to both images.

In: closed regions of a stereo pair. Out: rings in their planes. An arc of 90 degrees is too short for an ellipse of its
own; as an element of a ring, between two sides that it touches, it has one free number. A plane makes the right image
of a region out of the left one by a shear and a stretch along the rows, which their second moments give. Then plane,
sides and radii are fitted to the edges of both images at once. Arcs that bend inwards are not looked for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from daemon.arrays import Array, Flags, Real
from daemon.vision.facets.one_look.circles import FARTHEST_MM, NEAREST_MM
from daemon.vision.geometry import Baseline, RectifiedCamera, axes_in, fit_circle, fit_plane, robust_weight, solve
from daemon.vision.image import RoughPolygon, StereoImages, levels_across, peak_places, peaks, slopes_across

ROW_PX, STRETCH = 5.0, 2.0
"""Largest distance, px, between the first, and between the last, rows of one region in both images; and largest ratio
of its widths."""
SAMPLE_PX, STRAIGHT_PX, SHORTEST_PX = 1.5, 0.5, 16.0
"""Distance, px, between places on a border; largest rms distance of those of a side from its line; shortest side."""
ON_ARC_PX, ON_ARC = 34.0, np.radians(125.0)
"""Largest length, px, and turn from the side before it to the one behind, of what may be a chord of an arc."""
GAP_PX = 7.0
"""Distance, px, from where their lines meet, of the ends of two sides between which there is an arc."""
MAX_SIDES, MIN_TURN, MIN_RADIUS_MM = 10, np.radians(12.0), 2.5
"""Largest number of sides of a ring; least turn at a corner; least radius, mm, of an arc."""
SAME_MM, SHORTER = 2.0, 0.97
"""Regions whose middles are so near are one; and how much shorter a stretch is tried next for a side."""
HALF_ROUND, ROUND = np.radians(140.0), np.radians(50.0)
"""An arc behind which the next side is turned by more has a centre of its own; such an arc sweeps more than a corner
turns at least, by so much."""
ON_SIDE, ON_ARCS = 14, 24
"""Places that are measured on a side and on an arc."""
REACHES_PX, EDGE_SIGMAS, NEAR_PX, EDGE_PX = (8, 6, 5, 4, 3, 3), 5.0, 3.0, 0.3
"""Distances, px, to which the edge of an element is searched for, round after round; least slope of it, sigmas;
preference of the nearer of two, px; usual distance of an edge, px."""
ON_PX, MIN_VISIBLE, MIN_ELEMENT = 0.8, 0.9, 0.5
"""An edge on its element is no farther off; the share of places, and of those of each element, in either image, that
have one."""
MIN_AT_FIRST, PER_SIDE = 0.5, 0.03
"""Share of places that have an edge near enough in each round; and of them what a further side must bring."""
TILT, MOVE_MM, STEP = 1e-3, 0.02, 1e-3
"""Steps by which planes and sides are tilted, rad, and moved, mm, to see how edges move; and STEP, mm, along them to
see which way they run."""
HELD, MAX_CONDITION = 1e-9, 1e12
"""Information that holds each number where the edges say nothing of it; and the condition number of what they say, at
most."""
_ROWS_PX = np.array([-1.5, 0.0, 1.5])


@dataclass(frozen=True, eq=False)
class FittedRing:
    """In a plane, origin (3,) mm and axes (2, 3), cyclopean, its normal towards the cameras: straight sides (N,)
    anticlockwise, by their direction, rad, and how far out of the origin they lie, mm; radius_mm (N,) of the arc behind
    each, 0 where it meets the next in a corner. An arc that touches both sides has no other number; centre_mm (N, 2) of
    those that need not, nan of the others; at (N, 2) -1 or 1: at the first or the second of the points that its circle
    has on the side before it, and on the one behind, it begins and ends."""

    origin: Array
    axes: Array
    direction: Array
    out_mm: Array
    radius_mm: Array
    centre_mm: Array
    at: Array

    def moved(self, steps: Real) -> FittedRing:
        """Its plane moved along its normal, mm, and tilted; its sides turned and moved; its arcs' radii changed, and
        the centres of those that have one moved: (unknowns,), or (V, unknowns) of V rings side by side, of which every
        array has V first."""
        count, arcs, free = len(self.direction), self.radius_mm > 0, self.free
        normal = np.cross(*self.axes)
        first, second = np.moveaxis(self.axes + steps[..., 1:3, None] * normal, -2, 0)
        first = first / _length(first)
        second = second - (second * first).sum(-1, keepdims=True) * first
        turn, out, radii, centres = np.split(
            steps[..., 3:], np.cumsum([count, count, int(np.count_nonzero(arcs))]), axis=-1
        )
        radius = np.broadcast_to(self.radius_mm, turn.shape).copy()
        centre = np.broadcast_to(self.centre_mm, (*turn.shape, 2)).copy()
        radius[..., arcs] = np.maximum(radius[..., arcs] + radii, MIN_RADIUS_MM / 2)
        centre[..., free, :] += centres.reshape(*centres.shape[:-1], -1, 2)
        return FittedRing(
            self.origin + steps[..., :1] * normal,
            np.stack([first, second / _length(second)], -2),
            self.direction + turn,
            self.out_mm + out,
            radius,
            centre,
            self.at,
        )

    @property
    def free(self) -> Flags:
        """(N,) which arcs have a centre of their own: the same of rings side by side."""
        return np.asarray(np.isfinite(self.centre_mm.reshape(-1, self.at.shape[0], 2)[0, :, 0]))

    @property
    def rounded(self) -> Flags:
        """(N,) behind which sides there is an arc: the same of rings side by side."""
        return np.asarray(self.radius_mm.reshape(-1, self.at.shape[0])[0] > 0)

    @property
    def unknowns(self) -> int:
        """Return how many numbers move it."""
        return int(3 + 2 * len(self.at) + np.count_nonzero(self.rounded) + 2 * np.count_nonzero(self.free))

    @cached_property
    def directions(self) -> Array:
        """(N, 2) unit, along its sides."""
        return np.stack([np.cos(self.direction), np.sin(self.direction)], -1)

    @cached_property
    def turns(self) -> Array:
        """(N,) by how much the next side is turned from each, rad."""
        return np.asarray((np.roll(self.direction, -1, axis=-1) - self.direction + np.pi) % (2 * np.pi) - np.pi)

    @cached_property
    def corners(self) -> Array:
        """(N, 2) mm where the line of each side meets that of the next."""
        way, out, sine = self.directions, self.out_mm[..., None], np.sin(self.turns)[..., None]
        sine = np.where(np.abs(sine) < 1e-6, 1e-6, sine)
        return np.asarray((np.roll(out, -1, axis=-2) * way - out * np.roll(way, -1, axis=-2)) / sine)

    @cached_property
    def ends(self) -> tuple[Array, Array]:
        """(N, 2) mm each, where its sides begin and end."""
        way, after = self.directions, np.roll(self.directions, -1, axis=-2)
        tangent = (self.radius_mm * np.tan(np.abs(self.turns) / 2))[..., None]
        found = []
        for own, out, touch, at in (
            (after, np.roll(self.out_mm, -1, axis=-1), self.corners + tangent * after, self.at[:, 1]),
            (way, self.out_mm, self.corners - tangent * way, self.at[:, 0]),
        ):
            normal = np.stack([own[..., 1], -own[..., 0]], -1)
            off = out - (normal * self.centre_mm).sum(-1)
            half = np.sqrt(np.maximum(self.radius_mm**2 - off**2, 0.0))
            on_circle = self.centre_mm + off[..., None] * normal + (at * half)[..., None] * own
            found.append(np.where(self.free[:, None], on_circle, touch))
        return np.roll(found[0], 1, axis=-2), found[1]

    @cached_property
    def arcs(self) -> tuple[Array, Array, Array]:
        """Return the R arcs of the ring: centre (R, 2), and begin and sweep (R,), rad, anticlockwise."""
        (begin, end), arcs = self.ends, self.rounded
        begin = np.roll(begin, -1, axis=-2)
        inward = np.stack([-self.directions[..., 1], self.directions[..., 0]], -1)
        touching = end + self.radius_mm[..., None] * inward
        centre = np.where(self.free[:, None], self.centre_mm, touching)[..., arcs, :]
        first, last = (
            np.arctan2(off[..., 1], off[..., 0]) for off in (own[..., arcs, :] - centre for own in (end, begin))
        )
        return centre, first, (last - first) % (2 * np.pi)

    def is_sound(self) -> bool:
        """Whether it turns behind each side, and something is left of it between its arcs."""
        begin, end = self.ends
        turned = np.where(self.free, np.inf, np.abs(self.turns))
        turned[self.free] = self.arcs[2][self.free[self.rounded]] - ROUND
        return bool((((end - begin) * self.directions).sum(1) > 0).all() and (turned > MIN_TURN).all())

    def places(self) -> tuple[Array, Array]:
        """(P, 3) mm, cyclopean, all along it; and (P, 3) a little farther on each. Those of the sides come first."""
        begin, end = self.ends
        share = (np.arange(ON_SIDE) + 0.5)[:, None] / ON_SIDE
        sides = begin[..., None, :] + share * (end - begin)[..., None, :]
        centre, first, sweep = self.arcs
        angle = first[..., None] + sweep[..., None] * ((np.arange(ON_ARCS) + 0.5) / ON_ARCS)
        out = np.stack([np.cos(angle), np.sin(angle)], -1)
        round_ = centre[..., None, :] + self.radius_mm[..., self.rounded, None, None] * out
        along = np.stack([-out[..., 1], out[..., 0]], -1)
        ways = np.repeat(self.directions, ON_SIDE, axis=-2)
        lead = ways.shape[:-2]
        at = np.concatenate([sides.reshape(*lead, -1, 2), round_.reshape(*lead, -1, 2)], -2)
        way = np.concatenate([ways, along.reshape(*lead, -1, 2)], -2)
        origin = self.origin[..., None, :]
        return origin + at @ self.axes, origin + (at + STEP * way) @ self.axes


def _length(of: Array) -> Array:
    return np.asarray(np.linalg.norm(of, axis=-1, keepdims=True))


def fitted_rings(images: StereoImages, rough: Sequence[Sequence[RoughPolygon]]) -> list[FittedRing]:
    """Fit a ring of sides and arcs to closed regions of the left and the right image."""
    found = list[FittedRing]()
    left, right = (
        [_Region.of(one, view.rectified) for one in own] for own, view in zip(rough, images.views, strict=True)
    )
    for one in left:
        planes = [_plane(one, other, images.geometry) for other in sorted(right, key=one.apart)[:1]]
        for origin, axes, ring in filter(None, planes):
            if any(np.linalg.norm(origin - known.origin) < SAME_MM for known in found):
                continue
            px_mm = float(np.linalg.norm(origin - images.geometry.middle_mm)) / images.geometry.left.focal_px
            fits = [_fitted(sketch, images) for sketch in _sketches(origin, axes, ring, px_mm)]
            found += [max(fits, key=lambda fit: fit[1])[0]] if any(score > 0 for _, score in fits) else []
    return found


@dataclass(frozen=True, eq=False)
class _Region:
    """A region in ideal coordinates: its border (K, 2), its middle (2,), second moments about it, of x, x y and y, and
    its first and last row (2,)."""

    border: Array
    middle: Array
    second: tuple[float, float, float]
    rows: Array

    @classmethod
    def of(cls, rough: RoughPolygon, camera: RectifiedCamera) -> _Region:
        border = camera.ideal(rough.border.astype(float))
        unit = (border - border.mean(0)) * camera.focal_px
        sums = cv2.moments(unit.astype(np.float32)[:, None])
        area = sums["m00"] or 1.0
        second = tuple(sums[name] / area / camera.focal_px**2 for name in ("mu20", "mu11", "mu02"))
        middle = border.mean(0) + np.array([sums["m10"], sums["m01"]]) / area / camera.focal_px
        return cls(
            border, middle, (second[0], second[1], second[2]), np.array([border[:, 1].min(), border[:, 1].max()])
        )

    def apart(self, other: _Region) -> float:
        """Return how unlike its rows are to another's."""
        return float(np.abs(self.rows - other.rows).max())


def _plane(left: _Region, right: _Region, geometry: Baseline) -> tuple[Array, Array, Array] | None:
    """origin (3,), axes (2, 3) of the plane in which the border of a region of both images lies, and the border in it
    (K, 2), mm, anticlockwise; None where they are no two images of one."""
    (xx, xy, yy), (other_xx, other_xy, other_yy) = left.second, right.second
    wide, other_wide = xx - xy**2 / max(yy, 1e-12), other_xx - other_xy**2 / max(other_yy, 1e-12)
    if left.apart(right) * geometry.left.focal_px > ROW_PX or min(wide, other_wide) <= 0:
        return None
    stretch = float(np.sqrt(other_wide / wide))
    shear = (other_xy - stretch * xy) / yy
    shift = right.middle[0] - np.array([stretch, shear]) @ left.middle
    x = left.border @ [stretch, shear] + shift
    apart = left.border[:, 0] - x
    if not 1 / STRETCH < stretch < STRETCH or (apart * FARTHEST_MM < geometry.length_mm).any():
        return None
    if (apart * NEAREST_MM > geometry.length_mm).any():
        return None
    points = geometry.points(left.border, np.column_stack([x, left.border[:, 1]]))
    origin, normal = points.mean(0), fit_plane(points)[0]
    first, second = axes_in(normal)
    axes = np.stack([first, second] if np.cross(first, second) @ normal > 0 else [second, first])
    ring = (points - origin) @ axes.T
    return origin, axes, ring if cv2.contourArea(ring.astype(np.float32), True) > 0 else ring[::-1]


def _sketches(origin: Array, axes: Array, ring: Array, px_mm: float) -> Iterator[FittedRing]:
    """The rounded polygons that a border (K, 2) mm may be, to a few pixels."""
    lengths = np.hypot(*(np.roll(ring, -1, axis=0) - ring).T)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    count = int(along[-1] / (SAMPLE_PX * px_mm))
    at = along[-1] * np.arange(count) / max(count, 1)
    closed = np.concatenate([ring, ring[:1]])
    even = np.column_stack([np.interp(at, along, closed[:, k]) for k in (0, 1)])
    sides = _straight(even, STRAIGHT_PX * px_mm)
    if not sides:
        return
    short = [side for side in sides if side[1] - side[0] < ON_ARC_PX / SAMPLE_PX]
    every = _sketch(origin, axes, even, sides, px_mm)
    turns = every.turns
    chords = [
        side
        for k, side in enumerate(sides)
        if side in short and min(turns[k - 1], turns[k]) > 0 and turns[k - 1] + turns[k] < ON_ARC
    ]
    for kept in ([side for side in sides if side not in chords], *([sides] if chords else [])):
        if 1 <= len(kept) <= MAX_SIDES:
            sketch = every if kept == sides else _sketch(origin, axes, even, kept, px_mm)
            hollow = (sketch.turns < 0) & (sketch.radius_mm > 0) & ~sketch.free
            if sketch.radius_mm.any() and not hollow.any() and sketch.is_sound():
                yield sketch


def _straight(ring: Array, off_mm: float) -> list[tuple[int, int]]:
    """First, and last + 1, places of the straight stretches of a ring (M, 2), the longest taken first; in order."""
    count, least = len(ring), int(SHORTEST_PX / SAMPLE_PX)
    twice = np.concatenate([ring, ring]).T
    sums = np.zeros((5, 2 * count + 1))
    np.cumsum([*twice, *twice**2, twice[0] * twice[1]], axis=1, out=sums[:, 1:])
    found, size = list[tuple[int, int]](), count // 2
    taken = np.zeros(2 * count + 1, np.intp)  # of the places before each
    while size >= least:
        x, y, xx, yy, xy = (sums[:, size : size + count] - sums[:, :count]) / size
        a, b, c = xx - x * x, yy - y * y, xy - x * y
        off2 = (a + b) / 2 - np.sqrt(((a - b) / 2) ** 2 + c * c)
        if found:
            off2[taken[size : size + count] > taken[:count]] = np.inf
        first = int(off2.argmin())
        if off2[first] < off_mm**2:
            found.append((first, first + size))
            used = np.zeros(count, bool)
            used[np.arange(first, first + size) % count] = True
            taken[1:] += np.cumsum(np.concatenate([used, used]))
        else:
            size = min(size - 1, int(SHORTER * size))
    return sorted(found)


def _sketch(origin: Array, axes: Array, ring: Array, sides: Sequence[tuple[int, int]], px_mm: float) -> FittedRing:
    """Return the ring with these stretches of a ring (M, 2) as its sides; the farther from where they meet they end,
    the rounder its corners."""
    direction, out, ends = list[float](), list[float](), list[Array]()
    for first, last in sides:
        points = ring[np.arange(first, last) % len(ring)]
        middle = points.mean(0)
        x, y = (points - middle).T
        turn = np.arctan2(2 * (x @ y), x @ x - y @ y) / 2
        way = np.array([np.cos(turn), np.sin(turn)])
        way = way * (np.sign(way @ (points[-1] - points[0])) or 1.0)
        direction.append(float(np.arctan2(way[1], way[0])))
        out.append(float(middle @ [way[1], -way[0]]))
        ends.append(points[[0, -1]])
    count = len(sides)
    sharp = FittedRing(
        origin, axes, np.array(direction), np.array(out), np.zeros(count), np.full((count, 2), np.nan),
        np.ones((count, 2)),
    )  # fmt: skip
    both, way, after = np.stack(ends), sharp.directions, np.roll(sharp.directions, -1, axis=0)
    begins = np.roll(both[:, 0], -1, axis=0)
    before = ((sharp.corners - both[:, 1]) * way).sum(1)
    behind = ((begins - sharp.corners) * after).sum(1)
    least, gap_mm = np.minimum(before, behind), GAP_PX * px_mm
    gaps = [(sides[(k + 1) % count][0] - last) % len(ring) for k, (_, last) in enumerate(sides)]
    free = (np.array(gaps) * SAMPLE_PX > GAP_PX) & ((least < -gap_mm) | (np.abs(sharp.turns) > HALF_ROUND))
    radius = np.where(least > gap_mm, (before + behind) / 2, 0.0) / np.maximum(np.tan(np.abs(sharp.turns) / 2), 0.05)
    centre, at = sharp.centre_mm.copy(), sharp.at.copy()
    for k in np.flatnonzero(free).tolist():
        centre[k], radius[k], _ = fit_circle(ring[np.arange(sides[k][1], sides[k][1] + gaps[k]) % len(ring)])
        for side, (place, own) in enumerate(((both[k, 1], way[k]), (begins[k], after[k]))):
            at[k, side] = np.sign((place - centre[k]) @ own) or 1.0
    return replace(sharp, radius_mm=radius, centre_mm=centre, at=at)


def _fitted(sketch: FittedRing, images: StereoImages) -> tuple[FittedRing, float]:
    """It as the edges of both images have it; and what it is worth, 0 where they show none such."""
    now, size = sketch, sketch.unknowns
    sides = np.repeat([TILT, MOVE_MM], len(sketch.direction))
    steps = np.concatenate([[MOVE_MM, TILT, TILT], sides, np.full(size, MOVE_MM)])[:size]
    for reach in REACHES_PX:
        if not now.is_sound():
            return now, 0.0
        misses, counts, shown, across = list[Array](), list[Array](), list[Array](), list[Array]()
        at, on = now.places()
        for view, ideal in zip(images.views, images.geometry.project(np.concatenate([on, at])), strict=True):
            on_px, px = view.rectified.pixels(ideal).reshape(2, len(at), 2)
            along = on_px - px
            normal = np.stack([along[:, 1], -along[:, 0]], 1) / np.maximum(np.hypot(*along.T), 1e-12)[:, None]
            offsets = np.arange(-reach - 0.5, reach + 1.0)
            slopes = np.abs(slopes_across(levels_across(view.smooth, px, normal, offsets, _ROWS_PX))) / view.grain
            edge = np.where(peaks(slopes, EDGE_SIGMAS), slopes[:, 1:-1], 0.0)
            best = (np.sqrt(edge) * np.exp(-0.5 * (np.arange(1.0 - reach, reach) / NEAR_PX) ** 2)).argmax(1) + 1
            off = best - reach + peak_places(slopes, best)[1]
            there = edge.max(1) > 0
            shown.append(there & (np.abs(off) < max(ON_PX, reach - 3)))
            misses, across = [*misses, off], [*across, np.stack([px, normal])]
            counts.append(there * robust_weight(off**2 / EDGE_PX**2))
        if np.mean(shown) < MIN_AT_FIRST:
            return now, 0.0
        moved = now.moved(np.diag(steps)).places()[0].reshape(-1, 3)
        moves = [
            ((view.rectified.pixels(ideal).reshape(size, len(at), 2) - px) * normal).sum(2).T / steps
            for view, ideal, (px, normal) in zip(images.views, images.geometry.project(moved), across, strict=True)
        ]
        blocks = (
            np.concatenate(moves)[None, :, None],
            np.concatenate(misses)[None, :, None],
            np.concatenate(counts)[None],
        )
        fit = solve(*blocks, HELD * np.eye(size))
        if np.linalg.cond(fit.held[0]) > MAX_CONDITION:
            return now, 0.0
        now = now.moved(fit.unknowns[0])
    on_sides, on_arcs = np.split(np.array(shown), [ON_SIDE * len(sketch.direction)], axis=1)
    each = [on_sides.reshape(2, -1, ON_SIDE).mean(2), on_arcs.reshape(2, -1, ON_ARCS).mean(2)]
    least, mean = min(one.min() for one in each), np.array(shown).mean(1).min()
    good = least > MIN_ELEMENT and mean > MIN_VISIBLE and now.is_sound()
    return now, (mean - PER_SIDE * len(now.direction)) * (good and (now.radius_mm > MIN_RADIUS_MM).any())
