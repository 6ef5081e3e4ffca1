"""Which corners of neighbouring facets are one, and so which facets share an edge. Decided here and nowhere else.

Both images together fix depth as well: what coincides in both coincides in space.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from daemon.arrays import Index
from daemon.vision.values import Facet, Group

WELD_PX = 6.0  # how far the two sightings of one corner may lie apart in an image; D'Souza has 4 px (section 5.1)
OF_SHORTEST = 1 / 3  # the same as a share of the shortest side: a narrow facet's own edges must stay two


def merge_vertices(facets: Sequence[Facet]) -> Group:
    """The facets, one or more, as a group in which the corners that neighbours have in common are one.

    Two facets share the pair of opposite edges that lies closest in both images, if that is close.
    """
    first = np.cumsum([0, *(len(f.corners_mm) for f in facets)])
    after = np.concatenate([a + (np.arange(b - a) + 1) % (b - a) for a, b in pairwise(first)])
    root = np.arange(first[-1])
    for one, other in _shared_edges(facets, after):
        for a, b in ((one, after[other]), (after[one], other)):
            low, high = sorted((root[a], root[b]))
            root[root == high] = low
    numbers = np.unique(root, return_inverse=True)[1].tolist()
    return Group(tuple(facets), tuple(tuple(numbers[start:end]) for start, end in pairwise(first.tolist())))


def _shared_edges(facets: Sequence[Facet], after: Index) -> list[tuple[int, int]]:
    """Edges that are one, run through in opposite directions: each by its first corner, counted over all facets."""
    if len(facets) < 2:
        return []
    owner = np.repeat(np.arange(len(facets)), [len(f.corners_mm) for f in facets])
    apart_px = np.zeros((len(owner), len(owner)))
    shortest_px = np.full(len(owner), np.inf)
    for corners in (np.concatenate([getattr(f, eye) for f in facets]) for eye in ("left_px", "right_px")):
        apart = np.linalg.norm(corners[:, None] - corners, axis=2)
        apart_px = np.maximum(apart_px, np.maximum(apart[:, after], apart[after]))
        shortest_px = np.minimum(shortest_px, apart[np.arange(len(owner)), after])
    shortest = np.array([shortest_px[owner == f].min() for f in range(len(facets))])[owner]
    limit = np.minimum(WELD_PX, OF_SHORTEST * np.minimum(shortest[:, None], shortest))
    found: dict[tuple[int, int], tuple[float, int, int]] = {}
    for one, other in np.argwhere((apart_px <= limit) & (owner[:, None] < owner)).tolist():
        pair = int(owner[one]), int(owner[other])
        found[pair] = min(found.get(pair, (np.inf, 0, 0)), (float(apart_px[one, other]), one, other))
    return [(one, other) for _, one, other in found.values()]
