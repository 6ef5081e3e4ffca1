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

Place = tuple[int, int]  # (facet, turn) or (facet, edge)


@dataclass(frozen=True, eq=False)
class Correspondence:
    """facets: for each seen facet the taught one or -1; corners (K,): for each seen corner the taught one or -1."""

    facets: tuple[int, ...]
    corners: Index

    @property
    def explained(self) -> int:
        """How many of the seen facets have a counterpart."""
        return len(self.facets) - self.facets.count(-1)


def correspondences(seen: Polyhedron, taught: Polyhedron, *, may_add: bool = False) -> tuple[Correspondence, ...]:
    """Every way to lay the seen facets onto taught ones, edge to edge, without a mirror.

    A seen facet beyond a taught edge behind which nothing was taught stays open (-1); one that meets a taught facet
    with another number of sides contradicts the numbering. may_add: also numberings that leave most facets open (for
    joining views); otherwise only those that explain the most facets are returned.
    """
    if not seen.facets:
        return ()
    places = (
        (start, (g, turn))
        for start in _starts(seen, taught, every=may_add)
        for g, corners in enumerate(taught.facets)
        if len(corners) == len(seen.facets[start])
        for turn in range(len(corners))
    )
    return spread_from(seen, taught, places, may_add=may_add)


def spread_from(
    seen: Polyhedron, taught: Polyhedron, places: Iterable[tuple[int, Place]], *, may_add: bool = False
) -> tuple[Correspondence, ...]:
    """As correspondences, of those that lay one seen facet onto (taught facet, turn): places of such pairs."""
    found: dict[tuple[int, ...], Correspondence] = {}
    for start, first in places:
        laid = _walk(seen, taught, start, first)
        if laid:
            found.setdefault(tuple(laid.corners), laid)
    most = max((c.explained for c in found.values()), default=0)
    return tuple(c for c in found.values() if may_add or c.explained == most)


def _starts(seen: Polyhedron, taught: Polyhedron, *, every: bool) -> list[int]:
    """The seen facet with the fewest taught counterparts to start from (all of them when every numbering counts)."""
    sides = [len(f) for f in taught.facets]
    counts = {f: sides.count(len(corners)) * len(corners) for f, corners in enumerate(seen.facets)}
    able = [f for f, n in counts.items() if n]
    if every or len(able) < len(counts):
        return able
    return sorted(able, key=lambda f: (counts[f], f))[:1]


def _walk(seen: Polyhedron, taught: Polyhedron, start: int, first: Place) -> Correspondence | None:
    """Spread one assumption over all shared edges; None where it contradicts itself."""
    laid: dict[int, Place] = {start: first}
    queue = deque([start])
    while queue:
        f = queue.popleft()
        g, turn = laid[f]
        count = len(seen.facets[f])
        for edge in range(count):
            beyond = seen.across.get((f, edge))
            if beyond is None:
                continue
            there = taught.across.get((g, (edge + turn) % count))
            if there is None:
                continue
            sides = len(seen.facets[beyond[0]])
            if len(taught.facets[there[0]]) != sides:
                return None
            place = (there[0], (there[1] - beyond[1]) % sides)
            if beyond[0] not in laid:
                laid[beyond[0]] = place
                queue.append(beyond[0])
            elif laid[beyond[0]] != place:
                return None
    return _correspondence(seen, taught, laid)


def _correspondence(seen: Polyhedron, taught: Polyhedron, laid: dict[int, Place]) -> Correspondence | None:
    """Facets to corners; None where two seen facets claim one taught facet, or one corner two taught ones."""
    facets = [-1] * len(seen.facets)
    corners = np.full(len(seen.corners_mm), -1, dtype=np.intp)
    for f, (g, turn) in laid.items():
        if g in facets:
            return None
        facets[f] = g
        ring = taught.facets[g]
        for i, k in enumerate(seen.facets[f]):
            k_taught = ring[(i + turn) % len(ring)]
            if corners[k] not in (-1, k_taught):
                return None
            corners[k] = k_taught
    used = corners[corners >= 0]
    if len(set(used.tolist())) != len(used):
        return None
    return Correspondence(tuple(facets), corners)
