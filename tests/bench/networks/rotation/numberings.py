"""All the ways of putting k facets into m slots, as tables: which slot each facet gets. Combinatorics only.

Facets that can be swapped without changing the matrix (twins) are put in one order only: the canonical form.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations
from math import perm

import numpy as np

from daemon.arrays import Array, Index

# Longest table kept; beyond it numberings are searched by branch and bound.
LONGEST_TABLE = 5040


@dataclass(frozen=True, eq=False)
class Numberings:
    """slots (P, k): every way of giving k facets distinct slots, in lexicographic order, twins in rising order only.

    first, second (pairs,): the pairs of facets, first < second; place (pairs, P): the slots a, b each numbering puts
    each pair in, as a * m + b; swapped (m * m,): b * m + a for each a * m + b.
    """

    slots: Index
    first: Index
    second: Index
    swapped: Index
    place: Index


def twins(matrix: Array) -> tuple[int, ...]:
    """For each facet the last one before it that it can be swapped with, unnoticed, or -1: (k,) as a tuple.

    Being twins is transitive, so following the chain gives the whole class.
    """
    alike = list(zip(matrix.sum(axis=0).tolist(), matrix.sum(axis=1).tolist(), matrix.diagonal().tolist(), strict=True))
    before = []
    for facet in range(len(matrix)):
        others = (other for other in reversed(range(facet)) if alike[other] == alike[facet])
        before.append(next((other for other in others if _can_swap(matrix, other, facet)), -1))
    return tuple(before)


def _can_swap(matrix: Array, one: int, other: int) -> bool:
    order = np.arange(len(matrix))
    order[[one, other]] = other, one
    return bool(np.array_equal(matrix, matrix[order][:, order]))


def has_table(facets: int, slots: int) -> bool:
    """Whether the table of all numberings is short enough to be made."""
    return perm(slots, facets) <= LONGEST_TABLE


@lru_cache(maxsize=64)
def table(usable: tuple[int, ...], room: int, twin_before: tuple[int, ...]) -> Numberings:
    """The numberings of len(twin_before) facets that use only the usable ones of `room` slots."""
    facets = len(twin_before)
    every = np.array(list(permutations(usable, facets)), dtype=np.int64).reshape(perm(len(usable), facets), facets)
    kept = np.ones(len(every), dtype=bool)
    for facet, before in enumerate(twin_before):
        if before >= 0:
            kept &= every[:, before] < every[:, facet]
    slots = every[kept]
    first, second = np.triu_indices(facets, 1)
    swapped = np.arange(room * room).reshape(room, room).T.ravel()
    place = (slots[:, first] * room + slots[:, second]).T
    return Numberings(slots, first, second, swapped, np.ascontiguousarray(place))
