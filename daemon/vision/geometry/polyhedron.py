"""Flat facets in space that share corners: what is seen of a part, what was taught of it, what a drawing says of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from daemon.vision.geometry.facet_measures import newell_normal

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Polyhedron:
    """corners_mm (K, 3), in any one frame; facets: corner indices of each, anticlockwise from outside; covariance_mm2
    (K, 3, 3) of the corners; types: the facet library's name of each facet, empty where none was typed.
    """

    corners_mm: Array
    facets: tuple[tuple[int, ...], ...]
    covariance_mm2: Array
    types: tuple[str, ...] = ()

    @cached_property
    def rings(self) -> tuple[NDArray[np.intp], ...]:
        """The facets as arrays, to index corners with."""
        return tuple(np.array(f, np.intp) for f in self.facets)

    @cached_property
    def edges(self) -> dict[tuple[int, int], tuple[int, int]]:
        """{(corner, next corner): (facet, place of the corner in it)}."""
        return {
            (a, corners[(i + 1) % len(corners)]): (f, i)
            for f, corners in enumerate(self.facets)
            for i, a in enumerate(corners)
        }

    @cached_property
    def seams(self) -> tuple[tuple[int, int], ...]:
        """Pairs of facets that share an edge (run through in opposite directions), the smaller index first."""
        pairs = {(f, self.edges[b, a][0]) for (a, b), (f, _) in self.edges.items() if (b, a) in self.edges}
        return tuple(sorted((f, g) for f, g in pairs if f < g))

    @cached_property
    def touching(self) -> NDArray[np.bool_]:
        """(F, F) which facets share an edge."""
        touching = np.zeros((len(self.facets), len(self.facets)), dtype=bool)
        for f, g in self.seams:
            touching[f, g] = touching[g, f] = True
        return touching

    @cached_property
    def normals(self) -> Array:
        """(F, 3) outward unit normals of the facets."""
        return np.array([newell_normal(self.corners_mm[ring]) for ring in self.rings]).reshape(-1, 3)

    @cached_property
    def centres_mm(self) -> Array:
        """(F, 3) means of the facets' corners."""
        return np.array([self.corners_mm[ring].mean(axis=0) for ring in self.rings]).reshape(-1, 3)


def exact(corners_mm: Array, facets: Iterable[Iterable[int]]) -> Polyhedron:
    """A polyhedron whose corners (K, 3) are known without error, its facets not typed."""
    rings = tuple(tuple(int(k) for k in ring) for ring in facets)
    return Polyhedron(corners_mm, rings, np.zeros((len(corners_mm), 3, 3)))
