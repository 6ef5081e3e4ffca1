"""Facets that share edges become parts; facets that lie under them are shadows. Geometry of several facets together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daemon.vision.data import Facet, Group

Array = NDArray[np.float64]


def shared_edge(a: Facet, b: Facet, tolerance_px: float) -> tuple[int, int] | None:
    """(i, j) when side i -> i+1 of a is side j+1 <- j of b, run the other way, in both eyes; else None."""
    for i in range(len(a.left_px)):
        for j in range(len(b.left_px)):
            if same_edge(a.left_px, b.left_px, i, j, tolerance_px) and same_edge(
                a.right_px, b.right_px, i, j, tolerance_px
            ):
                return i, j
    return None


def same_edge(a: Array, b: Array, i: int, j: int, tolerance_px: float) -> bool:
    """Whether side i of corners a (N, 2) px is side j of b run the other way."""
    one = np.abs(a[i] - b[(j + 1) % len(b)]).max()
    other = np.abs(a[(i + 1) % len(a)] - b[j]).max()
    return bool(max(one, other) < tolerance_px)


def touching_table(facets: tuple[Facet, ...], tolerance_px: float = 4.0) -> NDArray[np.bool_]:
    """(n, n) which facets share an edge. D'Souza's tolerance is 4 px (section 5.1)."""
    n = len(facets)
    touch = np.zeros((n, n), bool)
    for i in range(n):
        for j in range(i + 1, n):
            touch[i, j] = touch[j, i] = shared_edge(facets[i], facets[j], tolerance_px) is not None
    return touch


def connected(touch: NDArray[np.bool_]) -> list[list[int]]:
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
                todo.extend(int(m) for m in np.flatnonzero(touch[k]))
        sets.append(sorted(members))
    return sets


def split_groups(facets: tuple[Facet, ...], touch: NDArray[np.bool_]) -> tuple[Group, ...]:
    """Connected sets of touching facets as groups, nearest first."""
    groups = [Group(tuple(facets[k] for k in m), touch[np.ix_(m, m)]) for m in connected(touch)]
    return tuple(sorted(groups, key=lambda g: float(np.mean([f.corners_mm[:, 2].mean() for f in g.facets]))))
