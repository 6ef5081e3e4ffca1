"""What a facet pair adds to |I ^ w| by sitting in a pair of slots, and how much a whole view can add at most.

|I ^ w| over all slots is a constant of the node (nothing sits anywhere) plus a gain for every element of the view that
is not 0. An element x on an element of the node whose taught values lie in [u, v] gains min(x, u), and with complement
coding loses max(0, x - v) of what the empty slot had.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.art.numberings import Numberings
from daemon.art.relations import TaughtMatrices

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Gathering all pairs at once is faster up to this many nodes, pair by pair beyond.
FEW = 16
# Nodes whose bound is worked out together, to stay in cache.
BOUND_PIECE = 2048


def empty_overlap(taught: TaughtMatrices) -> Array:
    """|I ^ w| of the empty matrix with each node, (J,)."""
    if not taught.complement:
        return np.zeros(len(taught.lower))
    return np.asarray((1.0 - taught.upper).sum(axis=(1, 2)))


def element_gain(element: Array, lower: Array, upper: Array, complement: bool) -> Array:
    """The gain of elements over empty ones; shapes broadcast. For a node of one view (lower is upper) in one step."""
    gain = np.minimum(element, lower)
    if not complement:
        return gain
    if lower is upper:
        gain += gain
        gain -= element
        return gain
    gain -= np.maximum(0.0, element - upper)
    return gain


@dataclass(frozen=True, eq=False)
class Gains:
    """Gains of a view's k facets at C nodes.

    pair (pairs, m * m, C): facets p < q, in the order of Numberings, p in slot a and q in slot b at a * m + b;
    single (k, m, C), or None where no facet touches itself; base (C,): the overlap with nothing anywhere.
    """

    pair: Array
    single: Array | None
    base: Array


def gains(view: Array, taught: TaughtMatrices, nodes: Index, base: Array, numberings: Numberings) -> Gains:
    """Gains of the stripped view (k, k) at the given nodes, (C,) indices; base as empty_overlap gives it, (J,)."""
    m, first, second = taught.slots, numberings.first, numberings.second
    lower = np.ascontiguousarray(taught.lower[nodes].reshape(len(nodes), m * m).T)
    upper = lower
    if taught.upper is not taught.lower:
        upper = np.ascontiguousarray(taught.upper[nodes].reshape(len(nodes), m * m).T)
    pair = element_gain(view[first, second, None, None], lower, upper, taught.complement)
    pair += element_gain(view[second, first, None, None], lower, upper, taught.complement)[:, numberings.swapped]
    single = None
    if view.diagonal().any():
        own = np.arange(m) * (m + 1)
        lower_own, upper_own = lower[own], upper[own] if upper is not lower else None
        single = element_gain(
            view.diagonal()[:, None, None], lower_own, lower_own if upper_own is None else upper_own, taught.complement
        )
    return Gains(pair, single, base[nodes])


def all_gains(view: Array, taught: TaughtMatrices, node: int) -> tuple[Array, Array]:
    """Gains of the stripped view (k, k) at one node for branching: of pairs (k, k, m, m) and of single facets (k, m).

    pair[p, q, a, b] is the gain of p in slot a with q in slot b, both ways; 0 where p is q.
    """
    lower = taught.lower[node]
    upper = lower if taught.upper is taught.lower else taught.upper[node]
    one_way = element_gain(view[:, :, None, None], lower, upper, taught.complement)
    pair = one_way + one_way.transpose(1, 0, 3, 2)
    pair[np.arange(len(view)), np.arange(len(view))] = 0.0
    own_lower = lower.diagonal()
    own_upper = own_lower if upper is lower else upper.diagonal()
    return pair, element_gain(view.diagonal()[:, None], own_lower, own_upper, taught.complement)


def best_of_table(gain: Gains, numberings: Numberings) -> tuple[Array, Index]:
    """|I ^ w| at the best numbering, (C,), and which it was, (C,); the first on a tie."""
    count = len(gain.base)
    flat = gain.pair.reshape(-1, count)
    if count <= FEW:
        total = np.take(flat, numberings.place, axis=0).sum(axis=0)
    else:
        total, term = (np.zeros((len(numberings.slots), count)) for _ in range(2))
        for place in numberings.place:
            total += np.take(flat, place, axis=0, out=term, mode="clip")
    if gain.single is not None:
        for facet, own in enumerate(gain.single):
            total += own[numberings.slots[:, facet]]
    by_node = np.ascontiguousarray(total.T)
    best = np.asarray(by_node.argmax(axis=1), dtype=np.int64)
    return gain.base + by_node[np.arange(count), best], best


@dataclass(frozen=True, eq=False)
class Ceilings:
    """The most a view can gain at each node, whatever its numbering, from the node's elements sorted.

    Off-diagonal elements stay off the diagonal under any numbering, and a sum of min(x, u) - max(0, x - v) over any
    pairing of elements is greatest when both are in falling order. lower, upper (m * m - m, J) and own_lower,
    own_upper (m, J): each node's elements in falling order; upper is lower where nodes have learnt one view each.
    """

    lower: Array
    upper: Array
    own_lower: Array
    own_upper: Array
    base: Array
    complement: bool

    @classmethod
    def of(cls, taught: TaughtMatrices, base: Array) -> Ceilings:
        lower, own_lower = _sorted_elements(taught.lower)
        upper, own_upper = (lower, own_lower)
        if taught.upper is not taught.lower:
            upper, own_upper = _sorted_elements(taught.upper)
        return cls(lower, upper, own_lower, own_upper, base, taught.complement)

    def overlap(self, view: Array) -> Array:
        """An upper bound on |I ^ w| of the stripped view (k, k) with each node, (J,)."""
        off = np.sort(view[~np.eye(len(view), dtype=bool)])[::-1]
        off, own = off[off > 0.0], np.sort(view.diagonal()[view.diagonal() > 0.0])[::-1]
        bound = self.base.copy()
        for start in range(0, len(bound), BOUND_PIECE):
            piece = slice(start, start + BOUND_PIECE)
            bound[piece] += self._gain(off, self.lower[: len(off), piece], self.upper[: len(off), piece])
            if len(own):
                bound[piece] += self._gain(own, self.own_lower[: len(own), piece], self.own_upper[: len(own), piece])
        return bound

    def _gain(self, elements: Array, lower: Array, upper: Array) -> Array:
        same = lower if self.upper is self.lower else upper
        return np.asarray(element_gain(elements[:, None], lower, same, self.complement).sum(axis=0))


def _sorted_elements(matrices: Array) -> tuple[Array, Array]:
    """(J, m, m) -> off-diagonal (m * m - m, J) and diagonal (m, J), each in falling order."""
    diagonal = np.eye(matrices.shape[1], dtype=bool)
    off, own = np.sort(matrices[:, ~diagonal], axis=1), np.sort(matrices[:, diagonal], axis=1)
    return np.ascontiguousarray(off[:, ::-1].T), np.ascontiguousarray(own[:, ::-1].T)
