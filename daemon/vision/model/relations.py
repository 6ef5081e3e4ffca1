"""What a view of facets is to the memory: of each two facets that share an edge their types and what they measure.

Categories are the type numbers (D'Souza, section 4.4.3). Features are analogue, as Fuzzy ARTMAP was made for: lengths
and angles at the shared edge, seen from either facet. The sides that follow and precede it on its facet tell mirror
images apart. In: a solid with typed facets. Out: a RelationalView. What is made of it is
daemon/art/relation_artmap.py's.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.art import RelationalView
from daemon.vision.geometry import Measures, Polyhedron, measure
from daemon.vision.model.facet_types import FacetLibrary, type_facet, type_number
from daemon.vision.values import Facet

MATRIX_SIZE = 6
"""Rows of the relation matrices, as in section 4.4.3; they grow where a view shows more facets."""
FEATURES = 6
"""Of facet f beside the edge it shares with g: that edge's length, the lengths of the sides that follow and precede it,
the angles at its beginning and end, and the dihedral angle inside the part."""
SHORTEST_MM, LONGEST_MM = 1.0, 1000.0
"""Between these lengths lie the features 0 and 1, in proportion to the logarithm."""
SIGMAS, SIGMA_SCALE = 3.0, 1.3
"""How many predicted errors a feature may be off, and how much larger than predicted errors are."""
_SPAN = float(np.log(LONGEST_MM / SHORTEST_MM))


def types_of(facets: Iterable[Facet], library: FacetLibrary) -> tuple[tuple[str, ...], ...]:
    """Every type that each facet may have, the most particular first."""
    return tuple(
        tuple(kind.name for kind in type_facet(facet.corners_mm, facet.covariance_mm2, library)) for facet in facets
    )


def relational_view(
    seen: Polyhedron, types: Sequence[Sequence[str]], library: FacetLibrary, tolerance_mm: float
) -> RelationalView:
    """The facets of a solid and what relates them; types: those each may have. Features may be off by SIGMAS of what
    the corners' covariance and a tolerance, a standard deviation per axis, make of them."""
    count = len(seen.facets)
    most = max(map(len, types))
    numbers = [[type_number(name, library) for name in names] for names in types]
    categories = np.array([[*own, *own[:1] * (most - len(own))] for own in numbers])
    touching = np.zeros((count, count), bool)
    features, doubt = np.zeros((2, count, count, FEATURES))
    spread = seen.covariance_mm2 + tolerance_mm**2 * np.eye(3)
    measures = [measure(seen.corners_mm[ring]) for ring in seen.rings]
    sigmas = [_sigmas(one, spread[ring]) for one, ring in zip(measures, seen.rings, strict=True)]
    for (f, place), (g, _) in seen.across.items():
        if touching[f, g]:
            continue  # two facets that share several edges are related by the first
        touching[f, g] = True
        one, sides = measures[f], len(measures[f].sides)
        after, before = (place + 1) % sides, place - 1
        dihedral, tilt = _dihedral(seen, f, g, place, spread)
        lengths = one.sides[[place, after, before]]
        features[f, g] = [
            *np.log(np.clip(lengths, SHORTEST_MM, LONGEST_MM) / SHORTEST_MM) / _SPAN,
            *one.angles[[place, after]] / (2 * np.pi),
            dihedral / (2 * np.pi),
        ]
        own = sigmas[f]
        doubt[f, g] = [
            *own[sides:][[place, after, before]] / _SPAN,
            *own[:sides][[place, after]] / (2 * np.pi),
            tilt / (2 * np.pi),
        ]
    touching &= touching.T
    return RelationalView(categories, touching, features, doubt * SIGMAS * SIGMA_SCALE)


def _sigmas(one: Measures, covariance: Array) -> Array:
    """(2 N,) standard deviations of angles and of the logarithms of sides."""
    blocks = one.jacobian.reshape(len(one.jacobian), -1, 3)
    return np.asarray(np.sqrt(np.einsum("anx,nxy,any->a", blocks, covariance, blocks)))


def _dihedral(seen: Polyhedron, f: int, g: int, place: int, spread: Array) -> tuple[float, float]:
    """The angle inside the part between two facets at their shared edge, in (0, 2 pi), and its standard deviation: each
    facet is tilted about the edge by its corners' errors along its normal over their distance from the edge."""
    ring = seen.rings[f]
    start, end = seen.corners_mm[ring[place]], seen.corners_mm[ring[(place + 1) % len(ring)]]
    edge = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
    n, m = seen.normals[f], seen.normals[g]
    turn = frames.cross_matrices(n)
    angle = np.pi - float(np.arctan2((turn @ m) @ edge, n @ m))
    variance = 0.0
    for facet, normal, inward in ((f, n, turn @ edge), (g, m, frames.cross_matrices(m) @ edge)):
        own = seen.rings[facet]
        away = (seen.corners_mm[own] - start) @ inward
        off2 = float((spread[own] @ normal @ normal).sum()) / len(own)
        variance += 2 * off2 / max(float(away @ away), 1e-9)
    return angle, float(np.sqrt(variance))
