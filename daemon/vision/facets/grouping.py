"""Facets that share edges become parts; facets that lie under them are shadows. Geometry of several facets together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from daemon.arrays import Flags
from daemon.vision.geometry import fit_plane
from daemon.vision.values import Facet, Group

_APART_MM = 6.0
_FLUSH_MM, _RISE_MM = 2.0, 6.0


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
