"""Many polygons in one array, so that what is done to each is done to all at once. Plain geometry, no pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Flags, Index


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
        """The same polygons with other corners (M, 2)."""
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


def rings(polygons: list[Array]) -> Rings:
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
    """Which of M sides (M, 2), (M, 2) px differ: (D,) indices of those, for each side which of them it is (M,), and
    whether it runs the other way (M,).

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
