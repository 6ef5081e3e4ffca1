"""All the ways of putting k facets into m slots, as tables: which slot each facet gets. Combinatorics only.

Facets that can be swapped without changing the matrix (twins) are put in one order only: the canonical form.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import permutations
from math import perm

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Longest table kept; beyond it numberings are searched by branch and bound.
LONGEST_TABLE = 5040


def twins(matrix: Array) -> tuple[int, ...]:
    """For each facet the facet before it that it can be swapped with, unnoticed, or -1: (k,) as a tuple.

    Being twins is transitive, so following the chain gives the whole class.
    """
    before = []
    for facet in range(len(matrix)):
        candidates = [other for other in range(facet) if _can_swap(matrix, other, facet)]
        before.append(candidates[-1] if candidates else -1)
    return tuple(before)


def _can_swap(matrix: Array, one: int, other: int) -> bool:
    order = np.arange(len(matrix))
    order[[one, other]] = other, one
    return bool(np.array_equal(matrix, matrix[np.ix_(order, order)]))


def has_table(facets: int, slots: int) -> bool:
    """Whether the table of all numberings is short enough to be made."""
    return perm(slots, facets) <= LONGEST_TABLE


@lru_cache(maxsize=64)
def table(facets: int, slots: int, twin_before: tuple[int, ...]) -> Index:
    """(P, facets): every way of giving facets distinct slots, in lexicographic order, twins in rising order only."""
    every = np.array(list(permutations(range(slots), facets)), dtype=np.int64)
    every = every.reshape(perm(slots, facets), facets)
    kept = np.ones(len(every), dtype=bool)
    for facet, before in enumerate(twin_before):
        if before >= 0:
            kept &= every[:, before] < every[:, facet]
    result = every[kept]
    result.flags.writeable = False
    return result
