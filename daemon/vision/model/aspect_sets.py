"""The characteristic views of a solid: which of its facets can be in view together. Geometry only."""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron, visible_from
from daemon.vision.model.relations import MATRIX_SIZE

DIRECTIONS = 400
OBLIQUE = 0.15  # cosine below which a facet is not seen: less than what a look can be trusted with, as parts turn


class Aspect(NamedTuple):
    """Facets of a solid that are in view together, and from which direction (3,) they are seen most clearly."""

    facets: tuple[int, ...]
    towards: Array


def aspects(solid: Polyhedron) -> tuple[Aspect, ...]:
    """The characteristic views: every set of facets that is in view from somewhere and part of no larger one, the
    richest first. What shows less is recalled by what shows more.

    Of facets in view those count that hang together with the one turned most to the cameras, and of these at most as
    many as the relation matrix has rows. Views of a single facet prove nothing and are none.
    """
    touching = solid.touching
    found: dict[tuple[int, ...], tuple[float, Array]] = {}
    directions = spread(DIRECTIONS)
    for towards, seen in zip(directions, visible_from(solid, directions, OBLIQUE), strict=True):
        facing = solid.normals @ towards
        shown = _connected_aspect(tuple(np.flatnonzero(seen).tolist()), facing, touching)
        if len(shown) < 2:
            continue
        clearness = float(facing[list(shown)].min())
        if shown not in found or clearness > found[shown][0]:
            found[shown] = (clearness, towards)
    sets = {shown: set(shown) for shown in found}
    largest = [one for one in found if not any(sets[one] < other for other in sets.values())]
    largest.sort(key=lambda one: (-len(one), -found[one][0]))
    return tuple(Aspect(one, found[one][1]) for one in largest)


def spread(count: int) -> Array:
    """(count, 3) unit vectors spread evenly over the sphere (Fibonacci's spiral)."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    radius = np.sqrt(1 - z * z)
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn), z])


def _connected_aspect(visible: tuple[int, ...], facing: Array, touching: NDArray[np.bool_]) -> tuple[int, ...]:
    """The facets that hang together with the one that faces the cameras most, nearest first, not too many."""
    if not visible:
        return ()
    kept = [max(visible, key=lambda k: facing[k])]
    queue = deque(kept)
    while queue:
        here = queue.popleft()
        for k in sorted(visible, key=lambda k: -facing[k]):
            if touching[here, k] and k not in kept and len(kept) < MATRIX_SIZE:
                kept.append(k)
                queue.append(k)
    return tuple(sorted(kept))
