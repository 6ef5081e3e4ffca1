"""Which corners of neighbouring facets are one, so which facets share an edge and are one part; and which facets lie
under a part: shadows. Decided here and nowhere else.

Both images together fix depth as well: what coincides in both coincides in space.
"""

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from daemon.arrays import Flags, Index
from daemon.vision.geometry import fit_plane
from daemon.vision.values import Facet, Group

WELD_PX = 6.0  # how far the two sightings of one corner may lie apart in an image; D'Souza has 4 px (section 5.1)
OF_SHORTEST = 1 / 3  # the same as a share of the shortest side: a narrow facet's own edges must stay two
_APART_MM = 6.0
_FLUSH_MM, _RISE_MM = 2.0, 6.0


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
    for corners in (np.concatenate([getattr(f, camera) for f in facets]) for camera in ("left_px", "right_px")):
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


def connected(touch: Flags) -> list[list[int]]:
    """Connected sets of a symmetric (n, n) table, each in rising order."""
    left = set(range(len(touch)))
    sets = []
    while left:
        todo, members = [min(left)], list[int]()
        while todo:
            k = todo.pop()
            if k in left:
                left.discard(k)
                members.append(k)
                todo.extend(touch[k].nonzero()[0].tolist())
        sets.append(sorted(members))
    return sets


def nearest_first(groups: Iterable[Group]) -> tuple[Group, ...]:
    """Groups by the mean depth of their facets."""
    return tuple(sorted(groups, key=lambda g: float(np.mean([f.corners_mm[:, 2].mean() for f in g.facets]))))


def lying_under(facets: Sequence[Facet]) -> tuple[int, ...]:
    """The facets of a group that the part stands on: shadows (or marks) on the table that meet the part's lower edges.

    They lie in one plane, from which each other facet rises towards the cameras. Of a solid's own faces that is true
    only for two that meet in a hollow, so a group of fewer than three facets is left alone.
    """
    if len(facets) < 3:
        return ()
    for facet in facets:
        normal, d = fit_plane(facet.corners_mm)
        heights = [other.corners_mm @ normal - d for other in facets]
        doubt = [2 * np.sqrt(np.einsum("i,nij,j->n", normal, f.covariance_mm2, normal)) for f in facets]
        apart = [np.linalg.norm(f.corners_mm[:, None] - facet.corners_mm, axis=2).min(1) > _APART_MM for f in facets]
        none_below = all(np.all((h > -_FLUSH_MM - s)[far]) for h, s, far in zip(heights, doubt, apart, strict=True))
        flush = tuple(k for k, (h, s) in enumerate(zip(heights, doubt, strict=True)) if np.all(h < _FLUSH_MM + s))
        if (
            none_below
            and len(flush) < len(facets)
            and all(h.max() > _RISE_MM for k, h in enumerate(heights) if k not in flush)
        ):
            return flush
    return ()
