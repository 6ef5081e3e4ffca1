"""Polyhedra side by side in arrays, so that what is done to each is done to all at once.

They differ in how many corners, facets and edges they have; what one has less of than another is filled up with its
first corner, with facets of no area that are turned to nobody, and with edges beside none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Flags, Image32, Index
from daemon.vision.geometry.polyhedron import Polyhedron


@dataclass(frozen=True, eq=False)
class SolidBatch:
    """P solids: corners_mm (P, K, 3), and own (P, K), which of these are a solid's; middles_mm (P, 3); planes
    (P, 2 F, 3): outward unit normals of the facets, then their middles; rings (P, F, S), the corners of each facet;
    ends (P, E, 2), the corners of each edge, beside (P, E, 2), the facets that it bounds, F where there is none, and
    bisectors (P, E, 3), circles (P, E, 4) and walls (P, E, 3) as Polyhedron has them.
    """

    shapes: tuple[Polyhedron, ...]
    corners_mm: Array
    own: Flags
    middles_mm: Array
    planes: Image32
    rings: Index
    ends: Index
    beside: Index
    bisectors: Array
    circles: Array
    walls: Array

    @classmethod
    def of(cls, shapes: Sequence[Polyhedron]) -> SolidBatch:
        """Solids side by side; made once of the same ones."""
        return _side_by_side(tuple(shapes))

    @property
    def first_corners(self) -> Index:
        """(P,) the number of each solid's first corner among all."""
        return np.asarray(np.arange(len(self.shapes)) * self.corners_mm.shape[1], np.intp)

    def corners_of(self, number: int) -> slice:
        """The corners of one solid among all."""
        first = number * self.corners_mm.shape[1]
        return slice(first, first + len(self.shapes[number].corners_mm))


@lru_cache(maxsize=64)
def _side_by_side(shapes: tuple[Polyhedron, ...]) -> SolidBatch:
    corners = _filled([s.corners_mm for s in shapes], 3, 0.0)
    own = np.arange(corners.shape[1]) < np.array([len(s.corners_mm) for s in shapes], np.intp)[:, None]
    normals = _filled([s.normals for s in shapes], 3, np.float32(0))
    centres = _filled([s.centres_mm for s in shapes], 3, np.float32(0))
    facets, sides = normals.shape[1], max((s.ring_table.shape[1] for s in shapes), default=1)
    tables = [s.ring_table[:, np.arange(sides).clip(max=s.ring_table.shape[1] - 1)] for s in shapes]
    return SolidBatch(
        shapes,
        np.where(own[..., None], corners, corners[:, :1]),
        own,
        np.array([s.corners_mm.mean(0) for s in shapes]).reshape(-1, 3),
        np.concatenate([normals, centres], 1),
        _filled(tables, sides, 0),
        _filled([s.lines[0] for s in shapes], 2, 0),
        _filled([np.where(s.beside < 0, facets, s.beside) for s in shapes], 2, facets),
        _filled([s.bisectors for s in shapes], 3, 0.0),
        _filled([s.circles for s in shapes], 4, 0.0),
        _filled([s.walls for s in shapes], 3, 0.0),
    )


def _filled(rows: Sequence[NDArray[Any]], width: int, fill: Any) -> NDArray[Any]:
    """(P, M, width) arrays (m, width) one beside the other, filled up."""
    found = np.full((len(rows), max(map(len, rows), default=0), width), fill)
    for own, row in zip(found, rows, strict=True):
        own[: len(row)] = row
    return found


def thickness(rings_px: Array) -> Array:
    """(...,) area of facets by length of their border, both halved round, of which the corners are seen at (..., S, 2)
    px, the last as often as needed: the width of a long one; negative where it is seen from behind (it then runs
    clockwise)."""
    after = rings_px.take(np.arange(1, rings_px.shape[-2] + 1), -2, mode="wrap")  # numpy's roll is several times slower
    x, y, u, v = rings_px[..., 0], rings_px[..., 1], after[..., 0], after[..., 1]
    return np.asarray((y * u - x * v).sum(-1) / np.maximum(np.hypot(u - x, v - y).sum(-1), 1e-9))
