"""The committed nodes of a Fuzzy ART field: weights, their norms, and the map field that ties nodes to labels.

The map field counts how often each node resonated with each label, (J, L). With map vigilance 1 (fast learning, as the
thesis has it) a row has one entry; a lower one lets a node stand for several labels, the counts being their odds.
Nothing here chooses a node: that is tests/bench/networks/search.py and tests/bench/networks/presenting.py.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Index

Scalar = TypeVar("Scalar", np.float64, np.int64)


class Nodes:
    """A growing table of nodes. `features` is the coded length F; rows beyond `len(self)` are spare room."""

    def __init__(self, features: int, labels: int = 1) -> None:
        self.features = features
        self._count = 0
        self._weights = np.zeros((8, features))
        self._size = np.zeros(8)
        self._map = np.zeros((8, max(labels, 1)), dtype=np.int64)
        self._total = np.zeros(8, dtype=np.int64)

    @classmethod
    def from_arrays(cls, weights: Array, map_counts: Index) -> Nodes:
        """The nodes whose `weights` (J, F) and `map_counts` (J, L) were read from another such table."""
        nodes = cls(weights.shape[1], map_counts.shape[1])
        nodes._count = len(weights)
        nodes._weights = np.array(weights, dtype=np.float64)
        nodes._size = nodes._weights.sum(axis=1)
        nodes._map = np.array(map_counts, dtype=np.int64)
        nodes._total = nodes._map.sum(axis=1)
        return nodes

    def __len__(self) -> int:
        return self._count

    @property
    def weights(self) -> Array:
        """(J, F), a view."""
        return self._weights[: self._count]

    @property
    def size(self) -> Array:
        """|w| of each node, (J,), a view."""
        return self._size[: self._count]

    @property
    def map_counts(self) -> Index:
        """(J, L), a view: how often node j resonated with label k."""
        return self._map[: self._count]

    def winners(self) -> Index:
        """The label each node stands for, (J,): its most frequent one, the earlier-seen on a tie."""
        return np.asarray(self.map_counts.argmax(axis=1), dtype=np.int64)

    def room_for_labels(self, labels: int) -> None:
        """Make the map field wide enough for this many labels."""
        missing = labels - self._map.shape[1]
        if missing > 0:
            self._map = np.hstack([self._map, np.zeros((len(self._map), missing), dtype=np.int64)])

    def agrees_one(self, node: int, label: int, vigilance: float) -> bool:
        """Whether |x_ab| >= rho_ab |y_b|, (1.24): the label's share of what the node resonated with is enough."""
        return self._map.item(node, label) >= vigilance * self._total.item(node)

    def agrees(self, node: Index, label: Index, vigilance: float) -> NDArray[np.bool_]:
        """As agrees_one, pair by pair."""
        return np.asarray(self._map[node, label] >= vigilance * self._total[node])

    def commit(self, weight: Array, size: float) -> int:
        """Add a node with this weight, |w| = size; its index. Nodes are committed in order and never move."""
        if self._count == len(self._weights):
            self._weights = _with_as_much_again(self._weights)
            self._size = _with_as_much_again(self._size)
            self._map = _with_as_much_again(self._map)
            self._total = _with_as_much_again(self._total)
        node = self._count
        self._count += 1
        self.set_weight(node, weight, size)
        return node

    def set_weight(self, node: int, weight: Array, size: float) -> None:
        self._weights[node] = weight
        self._size[node] = size

    def count_one(self, node: int, label: int) -> None:
        """Note that node resonated with label."""
        self._map[node, label] += 1
        self._total[node] += 1

    def count(self, node: Index, label: Index) -> None:
        """Note that nodes resonated with labels, pair by pair."""
        np.add.at(self._map, (node, label), 1)
        np.add.at(self._total, node, 1)

    def without_label(self, label: int) -> Nodes:
        """These nodes with one label forgotten: its column gone, and the nodes that stood for nothing else."""
        remaining = np.delete(self.map_counts, label, axis=1)
        kept = remaining.sum(axis=1) > 0
        if remaining.shape[1] == 0:
            return Nodes(self.features)
        return Nodes.from_arrays(self.weights[kept], remaining[kept])


def _with_as_much_again(rows: NDArray[Scalar]) -> NDArray[Scalar]:
    """The rows, followed by room for as many more (eight at least)."""
    room = np.zeros((max(len(rows), 8), *rows.shape[1:]), dtype=rows.dtype)
    return np.concatenate([rows, room])
