"""What a view of facets is to the memory: of each two facets that share an edge their types and what they measure.

Categories are the type numbers (D'Souza, section 4.4.3). Features are analogue, as Fuzzy ARTMAP was made for: lengths
and angles at the shared edge, seen from either facet. The sides that follow and precede it on its facet tell mirror
images apart. In: a solid with typed facets. Out: a RelationalView. What is made of it is
daemon/art/relation_artmap.py's.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from daemon.arrays import Array, Index
from daemon.art import RelationalView
from daemon.vision.geometry import Measures, Polyhedron, cross, measure_each
from daemon.vision.model.facet_types import FacetLibrary, type_number, types_of_each
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
    every = tuple(facets)
    corners, covariance, arcs = ([getattr(f, own) for f in every] for own in ("corners_mm", "covariance_mm2", "arcs"))
    return tuple(tuple(kind.name for kind in own) for own in types_of_each(corners, covariance, library, arcs))


def relational_view(
    observed: Polyhedron, types: Sequence[Sequence[str]], library: FacetLibrary, tolerance_mm: float
) -> RelationalView:
    """The facets of a solid and what relates them; types: those each may have. Features may be off by SIGMAS of what
    the corners' covariance and a tolerance, a standard deviation per axis, make of them."""
    count = len(observed.facets)
    most = max(map(len, types))
    numbers = [[type_number(name, library) for name in names] for names in types]
    categories = np.array([[*own, *own[:1] * (most - len(own))] for own in numbers])
    touching = np.zeros((count, count), bool)
    features, doubt = np.zeros((2, count, count, FEATURES))
    spread = observed.covariance_mm2 + tolerance_mm**2 * np.eye(3)
    places: dict[tuple[int, int], int] = {}  # two facets that share several edges are related by the first
    for (one, at), (other, _) in observed.across.items():
        places.setdefault((one, other), at)
    if places:
        measures, own = measure_each([observed.corners_mm[ring] for ring in observed.rings]), list(places)
        known = [
            (m.angles, m.sides, *_sigmas(m, spread[ring])) for m, ring in zip(measures, observed.rings, strict=True)
        ]
        angles, sides, *sigmas = (np.concatenate(each) for each in zip(*known, strict=True))
        f, g = np.array(own).T
        place, first = np.array(list(places.values())), observed.steps[2]
        count_of = np.array([len(ring) for ring in observed.rings])[f]
        side = first[f][:, None] + (place[:, None] + [0, 1, -1]) % count_of[:, None]
        dihedral, tilt = _dihedrals(observed, f, g, side[:, 0], spread)
        touching[f, g] = True
        lengths = np.log(np.clip(sides[side], SHORTEST_MM, LONGEST_MM) / SHORTEST_MM) / _SPAN
        features[f, g] = np.concatenate([lengths, np.column_stack([angles[side[:, :2]], dihedral]) / (2 * np.pi)], 1)
        turns = np.column_stack([sigmas[0][side[:, :2]], tilt]) / (2 * np.pi)
        doubt[f, g] = np.concatenate([sigmas[1][side] / _SPAN, turns], 1)
    touching &= touching.T
    return RelationalView(categories, touching, features, doubt * SIGMAS * SIGMA_SCALE)


def _sigmas(one: Measures, covariance: Array) -> tuple[Array, Array]:
    """(N,), (N,) standard deviations of angles and of the logarithms of sides."""
    blocks = one.jacobian.reshape(len(one.jacobian), -1, 3).swapaxes(0, 1)
    angles, sides = np.sqrt(((blocks @ covariance) * blocks).sum((0, 2))).reshape(2, -1)
    return angles, sides


def _dihedrals(observed: Polyhedron, f: Index, g: Index, side: Index, spread: Array) -> tuple[Array, Array]:
    """The angles (P,) inside the part between facets f and g at an edge they share, the side of f of that number, in
    (0, 2 pi), and their standard deviations: each facet is tilted about the edge by its corners' errors along its
    normal over their distance from the edge."""
    here, after, first = observed.steps
    corners, sides = observed.corners_mm[here], np.diff(first, append=len(here))
    start = corners[side]
    edge = observed.corners_mm[after[side]] - start
    edge = edge / np.maximum(np.linalg.norm(edge, axis=1, keepdims=True), 1e-9)
    n, m = observed.normals[f], observed.normals[g]
    angle = np.pi - np.arctan2((cross(n, m) * edge).sum(1), (n * m).sum(1))
    normal = observed.normals.repeat(sides, 0)
    off2 = np.add.reduceat(((spread[here] @ normal[..., None])[..., 0] * normal).sum(1), first) / sides
    variance, pairs = np.zeros(len(f)), np.arange(len(f))
    for facet, inward in ((f, cross(n, edge)), (g, cross(m, edge))):
        away = ((corners - start[:, None]) * inward[:, None]).sum(2)
        variance += 2 * off2[facet] / np.maximum(np.add.reduceat(away * away, first, 1)[pairs, facet], 1e-9)
    return angle, np.sqrt(variance)
