"""Plane polygons as arrays of corners (N, 2), anticlockwise as seen with v down. Plain geometry, no pixels are
looked at.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Flags

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
    """Where the line a-b meets the line c-d; None where they are parallel."""
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
    ax, ay = np.moveaxis(outlines, -1, 0)[..., None]
    bx, by = np.moveaxis(np.roll(outlines, -1, axis=1), -1, 0)[..., None]
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
