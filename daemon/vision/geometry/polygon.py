"""Plane polygons as arrays of corners (N, 2), anticlockwise as seen with v down, one by one and many in one array.

Plain geometry, no pixels are looked at.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Flags, Index

_STRAIGHT = math.radians(9.0)
_FAR_PX = 2000.0
_MEET_PX = 25.0
_OUTWARD = np.array([-1.0, 1.0])


def signed_area(corners: Array) -> float:
    """Shoelace area in px^2; negative for corners that run anticlockwise as seen (v points down)."""
    return float(cv2.contourArea(corners.astype(np.float32), True))


def outward(chord: Array, length: Array) -> Array:
    """(S, 2) unit vectors square to chords (S, 2) of lengths (S,): out of a polygon of which they are sides."""
    return np.asarray(chord[:, ::-1] * _OUTWARD / length[:, None])


@dataclass(frozen=True, eq=False)
class PlanarShape:
    """A polygon made ready for many comparisons: its corners, its box (left, top, right, bottom), its area."""

    corners: NDArray[np.float32]
    box: tuple[float, float, float, float]
    area: float

    @classmethod
    def of(cls, corners: Array) -> PlanarShape:
        """corners (N, 2) px."""
        points = corners.astype(np.float32)
        left, top = corners.min(0).tolist()
        right, bottom = corners.max(0).tolist()
        return cls(points, (left, top, right, bottom), cv2.contourArea(points))

    @classmethod
    def hull(cls, points: Array) -> PlanarShape:
        """The convex hull of points (N, 2) px."""
        return cls.of(cv2.convexHull(points.astype(np.float32))[:, 0].astype(float))

    def common(self, other: PlanarShape) -> float:
        """Area in both; exact when both are convex."""
        a, b = self.box, other.box
        if a[0] >= b[2] or b[0] >= a[2] or a[1] >= b[3] or b[1] >= a[3]:
            return 0.0
        return float(cv2.intersectConvexConvex(self.corners, other.corners)[0])

    def depth(self, points: Array) -> Array:
        """(N,) how far inside a convex one points (N, 2) lie, from its nearest side; outside negative."""
        way = np.roll(self.corners, -1, axis=0) - self.corners
        to = points[:, None] - self.corners
        inward = np.sign(cv2.contourArea(self.corners, True)) / np.maximum(np.linalg.norm(way, axis=1), 1e-9)
        return np.asarray(((way[:, 0] * to[..., 1] - way[:, 1] * to[..., 0]) * inward).min(1))

    def union(self, other: PlanarShape) -> float:
        """Common area over that of both together."""
        common = self.common(other)
        return common / max(self.area + other.area - common, 1e-9)

    def covers(self, other: PlanarShape) -> float:
        """Common area over that of the smaller."""
        return self.common(other) / max(min(self.area, other.area), 1e-9)


Point = tuple[float, float]


def tidy(corners: list[Point], min_side_px: float) -> list[Point] | None:
    """Take out corners that hardly turn, and sides too short to measure; None when fewer than three corners
    are left.
    """
    while len(corners) >= 3:
        chords, lengths = list[Point](), list[float]()
        x, y = corners[0]
        for u, v in (*corners[1:], corners[0]):
            chords.append((u - x, v - y))
            lengths.append(math.hypot(u - x, v - y))
            x, y = u, v
        if not max(lengths) < _FAR_PX:
            return None
        shortest = min(lengths)
        if shortest < min_side_px:
            corners = drop_side(corners, lengths.index(shortest))
            continue
        turns = list[float]()
        x, y = chords[-1]
        for u, v in chords:
            turns.append(abs(math.atan2(x * v - y * u, x * u + y * v)))
            x, y = u, v
        straightest = min(turns)
        if straightest > _STRAIGHT:
            return corners
        k = turns.index(straightest)
        corners = corners[:k] + corners[k + 1 :]
    return None


def drop_side(corners: list[Point], k: int) -> list[Point]:
    """Replace side k by the corner where its neighbours' lines meet, or by its middle where they meet far away."""
    n = len(corners)
    a, b, c, d = corners[k - 1], corners[k], corners[(k + 1) % n], corners[(k + 2) % n]
    middle = (b[0] + c[0]) / 2, (b[1] + c[1]) / 2
    meet = meeting(a, b, c, d) if n > 3 else None
    if meet is None or math.hypot(meet[0] - middle[0], meet[1] - middle[1]) > _MEET_PX:
        meet = middle
    out = [*corners]
    out[k] = meet
    del out[(k + 1) % n]
    return out


def meeting(a: Point, b: Point, c: Point, d: Point) -> Point | None:
    """Return the point where the line a-b meets the line c-d; None where they are parallel."""
    ux, uy, vx, vy = b[0] - a[0], b[1] - a[1], d[0] - c[0], d[1] - c[1]
    cross = ux * vy - uy * vx
    if abs(cross) < 1e-9:
        return None
    t = ((c[0] - a[0]) * vy - (c[1] - a[1]) * vx) / cross
    return a[0] + t * ux, a[1] + t * uy


def is_simple(corners: Array) -> bool:
    """Whether the polygon runs anticlockwise as seen and no two sides cross."""
    if not np.all(np.isfinite(corners)) or signed_area(corners) >= 0:
        return False
    n = len(corners)
    side = np.concatenate([corners[1:], corners[:1]]) - corners
    rel = corners - corners[:, None]
    cross = side[:, None, 0] * side[None, :, 1] - side[:, None, 1] * side[None, :, 0]
    safe = np.where(np.abs(cross) < 1e-12, np.inf, cross)
    s = (rel[..., 0] * side[None, :, 1] - rel[..., 1] * side[None, :, 0]) / safe
    t = (rel[..., 0] * side[:, None, 1] - rel[..., 1] * side[:, None, 0]) / safe
    i, j = np.indices((n, n))
    apart = (i != j) & ((i + 1) % n != j) & ((j + 1) % n != i)
    return not bool(np.any(apart & (s > 0) & (s < 1) & (t > 0) & (t < 1)))


def inside(points: Array, outlines: Array) -> Flags:
    """(F, P) which points (P, 2) lie inside each of the rings of corners (F, K, 2), convex or not, corners repeated or
    not: a line to the right crosses the border an odd number of times. Of two rings with a side in common, a point on
    it lies in one."""
    after = np.concatenate([outlines[:, 1:], outlines[:, :1]], axis=1)
    ax, ay, bx, by = (ends[..., k, None] for ends in (outlines, after) for k in (0, 1))
    px, py = points.T
    with np.errstate(divide="ignore", invalid="ignore"):
        left = px < ax + (py - ay) * ((bx - ax) / (by - ay))
    return np.asarray((((ay > py) != (by > py)) & left).sum(axis=1) % 2 == 1)


def sides_of(ring: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Each corner of a ring with the next."""
    return zip(ring, (*ring[1:], *ring[:1]), strict=True)


def border_loops(edges: Iterable[tuple[int, int]]) -> list[list[int]]:
    """Edges from corner to corner, in order, as the rings they make; what does not close is a ring up to where it
    ends."""
    after: dict[int, list[int]] = {}
    for a, b in edges:
        after.setdefault(a, []).append(b)
    loops = list[list[int]]()
    while after:
        first = here = next(iter(after))
        loop = list[int]()
        while here in after:
            loop.append(here)
            follows = after[here]
            here = follows.pop()
            if not follows:
                del after[loop[-1]]
            if here == first:
                break
        loops.append(loop)
    return loops


@dataclass(frozen=True, eq=False)
class Rings:
    """Corners (M, 2), or (M, 3) in space, of P polygons one after the other; first, count (P,); next, before (M,)
    neighbours round each.
    """

    corners: Array
    first: Index
    count: Index
    next: Index
    before: Index

    def moved(self, corners: Array) -> Rings:
        """Return the same polygons with other corners (M, 2)."""
        return Rings(corners, self.first, self.count, self.next, self.before)

    def split(self, values: Array | None = None) -> list[Array]:
        """(M, ...) values, or the corners, polygon by polygon."""
        every = self.corners if values is None else values
        return [every[s : s + n] for s, n in zip(self.first.tolist(), self.count.tolist(), strict=True)]

    def sums(self, values: Array) -> Array:
        """Sums (P, ...) of (M, ...) values over each polygon."""
        return np.asarray(np.add.reduceat(values, self.first, axis=0))

    def least(self, values: Array) -> Array:
        """Least (P,) of (M,) values over each polygon."""
        return np.asarray(np.minimum.reduceat(values, self.first))


def rings(polygons: Sequence[Array]) -> Rings:
    """Put polygons, at least one, into one array."""
    count = np.array([len(p) for p in polygons], dtype=np.intp)
    first = count.cumsum() - count
    index = np.arange(count.sum())
    owner = np.arange(len(count)).repeat(count)
    last = (first + count - 1)[owner]
    following = np.where(index == last, first[owner], index + 1)
    before = np.where(index == first[owner], last, index - 1)
    return Rings(np.concatenate(polygons), first, count, following, before)


def met(shape: Rings, start: Array, end: Array) -> Array:
    """Meeting points (M, 2) of each side's line, start -> end (M, 2), with that of the side before it."""
    a = start[:, 1] - end[:, 1]
    b = end[:, 0] - start[:, 0]
    c = -(a * start[:, 0] + b * start[:, 1])
    p = shape.before
    w = a[p] * b - a * b[p]
    w = np.where(np.abs(w) < 1e-9, 1e-9, w)
    return np.stack([(b[p] * c - b * c[p]) / w, (c[p] * a - c * a[p]) / w], 1)


def areas(shape: Rings) -> Array:
    """Shoelace areas (P,) px^2; negative for corners that run anticlockwise as seen (v points down)."""
    x, y = shape.corners.T
    return 0.5 * shape.sums(x * y[shape.next] - x[shape.next] * y)


def convex(shape: Rings) -> Flags:
    """Whether each polygon is convex and runs once round, anticlockwise as seen (P,)."""
    chord = shape.corners[shape.next] - shape.corners
    old = chord[shape.before]
    turn = np.arctan2(old[:, 0] * chord[:, 1] - old[:, 1] * chord[:, 0], (old * chord).sum(1))
    return (shape.least(-turn) > 0) & (np.abs(shape.sums(turn) + 2 * np.pi) < 1e-3)


def different(start: Array, end: Array, tolerance_px: float) -> tuple[Index, Index, Flags]:
    """Find which of M sides (M, 2), (M, 2) px differ: (D,) indices of those, for each side which of them it is (M,),
    and whether it runs the other way (M,).

    Neighbouring polygons share sides, and so do several readings of one region; what is done for all sides alike need
    be done once for those that lie within the tolerance.
    """
    one, other = (np.ascontiguousarray(p.T, np.float32) for p in (start, end))
    same = _near(one, one, tolerance_px) & _near(other, other, tolerance_px)
    crossed = _near(one, other, tolerance_px)
    back = crossed & crossed.T
    here = np.arange(len(start))
    first = (same | back).argmax(1) if len(start) else here
    first = np.where(first[first] == first, first, here)
    own = first == here
    return here[own], (own.cumsum() - 1)[first], ~same[here, first]


def _near(a: NDArray[np.float32], b: NDArray[np.float32], tolerance_px: float) -> Flags:
    """(M, M) whether points (2, M) and (2, M) px are the same."""
    near: Flags = np.abs(a[0, :, None] - b[0]) < tolerance_px
    near &= np.abs(a[1, :, None] - b[1]) < tolerance_px
    return near


def off_segments(points: Array, start: Array, end: Array) -> Array:
    """(...,) how far points (..., 2) are from the straight segments between start and end (..., 2)."""
    way, there = end - start, points - start
    share = np.clip((there * way).sum(-1) / np.maximum((way * way).sum(-1), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(there - share[..., None] * way, axis=-1))
