"""Relation matrices as the rotation layer sees them: checked, on the grid, stripped to the facets that touch something.

A relation matrix (D'Souza, section 4.4.3) has one row and one column a facet; entry (r, c) is the type number of facet
r where r and c touch, else 0. Any numbers in [0, 1] are served. Numberings are searched in layer.py.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from daemon.arrays import Array, Index
from daemon.art.errors import InputError
from tests.bench.networks.coding import grid_step, on_grid

Ends = tuple[Array, Array]
"""The lower and the upper ends of what nodes were taught; one and the same array where each has learnt one view."""


def both(ends: Ends, pick: Callable[[Array], Array]) -> Ends:
    """The same of both ends; where they are one array, so are the results."""
    lower = pick(ends[0])
    return lower, lower if ends[1] is ends[0] else pick(ends[1])


@dataclass(frozen=True, eq=False)
class TaughtMatrices:
    """What the nodes of a network stand for: each element of each matrix lies between lower and upper, (J, m, m).

    A node that has learnt a single view has lower = upper = that view; learning another widens it (complement coding)
    or pulls lower down (raw, where upper is not kept and everything above lower counts as seen: upper = lower).
    """

    lower: Array
    upper: Array
    complement: bool

    @property
    def slots(self) -> int:
        return int(self.lower.shape[1])

    def size(self) -> Array:
        """|w|, (J,)."""
        size = self.lower.sum(axis=(1, 2))
        return np.asarray(size + (1.0 - self.upper).sum(axis=(1, 2)) if self.complement else size)

    @property
    def ends(self) -> Ends:
        """lower and upper."""
        return self.lower, self.upper

    @cached_property
    def by_element(self) -> Ends:
        """lower and upper laid out element by element, (m * m, J) each."""
        return both(self.ends, lambda end: np.ascontiguousarray(end.reshape(len(end), -1).T))

    @cached_property
    def facets(self) -> Index:
        """How many facets each node has that touch another (or themselves), (J,)."""
        touching = self.upper > 0.0
        filled = touching.any(axis=1) | touching.any(axis=2)
        return np.asarray(filled.sum(axis=1), dtype=np.int64)


def as_taught(nodes: Any, complement: bool) -> TaughtMatrices:
    """nodes (J, m, m) taught matrices, or (J, 2, m, m) complement-coded weights as a network keeps them.

    InputError for other shapes, numbers outside [0, 1], or weights with lower above upper.
    """
    array = _unit_array(nodes, "nodes")
    if array.ndim == 3 and array.shape[1] == array.shape[2]:
        gridded = on_grid(array, matrix_grid(array.shape[1]))
        return TaughtMatrices(gridded, gridded, complement)
    if array.ndim == 4 and array.shape[1] == 2 and array.shape[2] == array.shape[3] and complement:
        gridded = on_grid(array, matrix_grid(array.shape[2]))
        lower, upper = gridded[:, 0], 1.0 - gridded[:, 1]
        if (lower > upper).any():
            raise InputError("nodes: complement-coded weights with a lower end above their upper end")
        return TaughtMatrices(np.ascontiguousarray(lower), np.ascontiguousarray(upper), complement)
    wanted = "(J, m, m) or (J, 2, m, m)" if complement else "(J, m, m)"
    raise InputError(f"nodes: expected {wanted}, found {array.shape}")


def as_relation(matrix: Any, slots: int) -> Array:
    """matrix (n, n) with n at most slots, in [0, 1], on the grid; InputError otherwise."""
    array = _unit_array(matrix, "relation matrix")
    if array.ndim != 2 or array.shape[0] != array.shape[1]:
        raise InputError(f"relation matrix: expected (n, n), found {array.shape}")
    if len(array) > slots:
        raise InputError(f"relation matrix: {len(array)} facets, but the nodes have room for {slots}")
    return on_grid(array, matrix_grid(slots))


def occupied(matrix: Any) -> Index:
    """The facets that touch something: indices of rows or columns with an entry, however small."""
    matrix = np.asarray(matrix)
    filled = (matrix > 0.0).any(axis=0) | (matrix > 0.0).any(axis=1)
    return np.flatnonzero(filled)


def padded(matrices: Array, slots: int) -> Array:
    """Matrices (..., n, n) in the upper left of (..., slots, slots), the rest 0: room for bigger parts."""
    missing = slots - matrices.shape[-1]
    if missing < 0:
        raise InputError(f"relation matrix: {matrices.shape[-1]} facets do not fit {slots} slots")
    return np.pad(matrices, [(0, 0)] * (matrices.ndim - 2) + [(0, missing), (0, missing)])


def padded_weights(weights: Array, slots_before: int, slots: int) -> Array:
    """Complement-coded weights (J, 2 slots_before^2) of a network with fewer slots -> (J, 2 slots^2).

    The new elements are what was seen there: nothing, so 0, complement 1.
    """
    halves = weights.reshape(len(weights), 2, slots_before, slots_before)
    lower = padded(halves[:, 0], slots)
    upper = padded(1.0 - halves[:, 1], slots)
    return np.concatenate([lower, 1.0 - upper], axis=1).reshape(len(weights), 2 * slots * slots)


def matrix_grid(slots: int) -> float:
    """The grid of a network whose samples are matrices of this many slots, complement-coded."""
    return grid_step(2 * slots * slots)


def _unit_array(values: Any, name: str) -> Array:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: expected numbers ({error})") from error
    if not (np.isfinite(array).all() and (array >= 0.0).all() and (array <= 1.0).all()):
        raise InputError(f"{name}: expected numbers in [0, 1]")
    return array
