"""Surface of a part from a drawing, as cameras see it: triangles, with normals that turn evenly where it is curved."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from drivers.arrays import Array


@dataclass(frozen=True, eq=False)
class DrawnSurface:
    """A closed surface. corners_mm (K, 3) and triangles (T, 3), anticlockwise from outside; normals (T, 3, 3), unit, at
    their corners; part_of (T,): the number of the flat face or curved surface of each; flat (T,): which are of a flat
    face."""

    corners_mm: Array
    triangles: NDArray[np.intp]
    normals: Array
    part_of: NDArray[np.intp]
    flat: NDArray[np.bool_]

    def moved(self, by_mm: Array) -> DrawnSurface:
        """The same, shifted by (3,) mm."""
        return replace(self, corners_mm=self.corners_mm + by_mm)

    @cached_property
    def volume_and_centre(self) -> tuple[float, Array]:
        """Volume in mm^3 and centre of mass (3,) mm."""
        a, b, c = np.moveaxis(self.corners_mm[self.triangles], 1, 0)
        parts = np.sum(a * np.cross(b, c), axis=1) / 6.0
        return float(parts.sum()), np.asarray(parts @ (a + b + c) / 4.0 / parts.sum())

    @cached_property
    def plates(self) -> dict[int, Array]:
        """{number of a flat face: (4, 3) corners of a rectangle round it in its plane, anticlockwise from outside}."""
        found = {}
        for number in np.unique(self.part_of[self.flat]).tolist():
            own = np.flatnonzero(self.part_of == number)
            points, z = self.corners_mm[np.unique(self.triangles[own])], self.normals[own[0], 0]
            x = np.linalg.svd(z[None])[2][1]
            axes = np.array([x, np.cross(z, x)])
            low, high = (points @ axes.T).min(axis=0), (points @ axes.T).max(axis=0)
            ring = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
            found[number] = ring @ axes + (points @ z).mean() * z
        return found

    def beyond(self, normal: Array) -> float:
        """The largest offset (normal @ x) of the surface."""
        return float((self.corners_mm[np.unique(self.triangles)] @ normal).max())
