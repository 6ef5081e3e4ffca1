"""Which taught facet each seen facet may be: every numbering under which shared edges stay shared.

In: two solids (corners only as indices). Out: correspondences of facets and corners. No lengths, no angles: those
judge afterwards (geometry/robust_least_squares.py).
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from daemon.arrays import Index
from daemon.vision.geometry import Polyhedron

FacetTurn = tuple[int, int]  # (facet, turn) or (facet, edge)


@dataclass(frozen=True, eq=False)
class Correspondence:
    """facets: for each seen facet the taught one or -1; corners (K,): for each seen corner the taught one or -1."""

    facets: tuple[int, ...]
    corners: Index

    @property
    def explained(self) -> int:
        """The number of seen facets that have a counterpart."""
        return len(self.facets) - self.facets.count(-1)


def correspondences(observed: Polyhedron, taught: Polyhedron, *, may_add: bool = False) -> tuple[Correspondence, ...]:
    """Every way to lay the seen facets onto taught ones, edge to edge, without a mirror.

    A seen facet beyond a taught edge behind which nothing was taught stays open (-1); one that meets a taught facet
    with another number of sides contradicts the numbering. may_add: also numberings that leave most facets open (for
    joining views); otherwise only those that explain the most facets are returned.
    """
    if not observed.facets:
        return ()
    places = (
        (start, (g, turn))
        for start in _starts(observed, taught, every=may_add)
        for g, corners in enumerate(taught.facets)
        if len(corners) == len(observed.facets[start])
        for turn in range(len(corners))
    )
    return correspondences_from(observed, taught, places, may_add=may_add)


def correspondences_from(
    observed: Polyhedron, taught: Polyhedron, places: Iterable[tuple[int, FacetTurn]], *, may_add: bool = False
) -> tuple[Correspondence, ...]:
    """Return the correspondences that lay one seen facet onto (taught facet, turn): places of such pairs."""
    found: dict[tuple[int, ...], Correspondence] = {}
    for start, first in places:
        placed = _walk(observed, taught, start, first)
        if placed:
            found.setdefault(tuple(placed.corners), placed)
    most = max((c.explained for c in found.values()), default=0)
    return tuple(c for c in found.values() if may_add or c.explained == most)


def _starts(observed: Polyhedron, taught: Polyhedron, *, every: bool) -> list[int]:
    """The seen facet with the fewest taught counterparts to start from (all of them when every numbering counts)."""
    sides = [len(f) for f in taught.facets]
    counts = {f: sides.count(len(corners)) * len(corners) for f, corners in enumerate(observed.facets)}
    able = [f for f, n in counts.items() if n]
    if every or len(able) < len(counts):
        return able
    return sorted(able, key=lambda f: (counts[f], f))[:1]


def _walk(observed: Polyhedron, taught: Polyhedron, start: int, first: FacetTurn) -> Correspondence | None:
    """Spread one assumption over all shared edges; None where it contradicts itself."""
    placed: dict[int, FacetTurn] = {start: first}
    queue = deque([start])
    while queue:
        f = queue.popleft()
        g, turn = placed[f]
        count = len(observed.facets[f])
        for edge in range(count):
            beyond = observed.across.get((f, edge))
            if beyond is None:
                continue
            there = taught.across.get((g, (edge + turn) % count))
            if there is None:
                continue
            sides = len(observed.facets[beyond[0]])
            if len(taught.facets[there[0]]) != sides:
                return None
            place = (there[0], (there[1] - beyond[1]) % sides)
            if beyond[0] not in placed:
                placed[beyond[0]] = place
                queue.append(beyond[0])
            elif placed[beyond[0]] != place:
                return None
    return _correspondence(observed, taught, placed)


def _correspondence(observed: Polyhedron, taught: Polyhedron, placed: dict[int, FacetTurn]) -> Correspondence | None:
    """Facets to corners; None where two seen facets claim one taught facet, or one corner two taught ones."""
    facets = [-1] * len(observed.facets)
    corners = np.full(len(observed.corners_mm), -1, dtype=np.intp)
    for f, (g, turn) in placed.items():
        if g in facets:
            return None
        facets[f] = g
        ring = taught.facets[g]
        for i, k in enumerate(observed.facets[f]):
            k_taught = ring[(i + turn) % len(ring)]
            if corners[k] not in (-1, k_taught):
                return None
            corners[k] = k_taught
    used = corners[corners >= 0]
    if len(set(used.tolist())) != len(used):
        return None
    return Correspondence(tuple(facets), corners)
