"""What a facet pair adds to |I ^ w| by sitting in a pair of slots, and how much it can add at most.

|I ^ w| over all slots is a constant of the node (nothing sits anywhere) plus a gain for every touching pair. An element
x of the view on an element of the node whose taught values lie in [u, v] gains min(x, u), and with complement coding
loses max(0, x - v) of what the empty slot had.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.art.relations import TaughtMatrices

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def empty_overlap(taught: TaughtMatrices) -> Array:
    """|I ^ w| of the empty matrix with each node, (J,)."""
    if not taught.complement:
        return np.zeros(len(taught.lower))
    return np.asarray((1.0 - taught.upper).sum(axis=(1, 2)))


def element_gain(element: Array | float, lower: Array, upper: Array, complement: bool) -> Array:
    """The gain of an element over an empty one, elementwise."""
    gain = np.minimum(element, lower)
    return np.asarray(gain - np.maximum(0.0, element - upper)) if complement else gain


@dataclass(frozen=True, eq=False)
class Gains:
    """Gains of the facets of one view at C nodes.

    pairs: the facets (p, q), p < q, that touch; pair_gain (E, m * m, C): p in slot a and q in slot b, at a * m + b;
    single (k, m, C): what a facet gains by itself (the diagonal); base (C,): nothing anywhere.
    """

    pairs: tuple[tuple[int, int], ...]
    pair_gain: Array
    single: Array
    base: Array


def gains(matrix: Array, taught: TaughtMatrices, nodes: Index, base: Array) -> Gains:
    """Gains of the stripped matrix (k, k) at the given nodes, (C,) indices; base as empty_overlap gives it, (J,)."""
    k, m = len(matrix), taught.slots
    # (m * m, C), element (a, b) and its transpose, nodes last so that a numbering's gains lie together
    lower, upper = (np.ascontiguousarray(a[nodes].reshape(len(nodes), m * m).T) for a in (taught.lower, taught.upper))
    swap = np.arange(m * m).reshape(m, m).T.ravel()
    pairs = tuple((p, q) for p in range(k) for q in range(p + 1, k) if matrix[p, q] or matrix[q, p])
    pair_gain = np.zeros((len(pairs), m * m, len(nodes)))
    for number, (p, q) in enumerate(pairs):
        pair_gain[number] = element_gain(matrix[p, q], lower, upper, taught.complement)
        pair_gain[number] += element_gain(matrix[q, p], lower, upper, taught.complement)[swap]
    own = np.arange(m) * (m + 1)
    diagonal = np.diagonal(matrix)[:, None, None]
    single = element_gain(diagonal, lower[own][None], upper[own][None], taught.complement)
    return Gains(pairs, pair_gain, single, base[nodes])


def best_of_table(gain: Gains, numbering: Index, slots: int) -> tuple[Array, Index]:
    """|I ^ w| at the best of the tabled numberings (P, k), (C,), and which it was, (C,); the first on a tie."""
    total = np.zeros((len(numbering), len(gain.base)))
    for number, (p, q) in enumerate(gain.pairs):
        total += gain.pair_gain[number][numbering[:, p] * slots + numbering[:, q]]
    for facet in np.flatnonzero(gain.single.any(axis=(1, 2))):
        total += gain.single[facet][numbering[:, facet]]
    by_node = np.ascontiguousarray(total.T)
    best = np.asarray(by_node.argmax(axis=1), dtype=np.int64)
    return gain.base + by_node[np.arange(len(by_node)), best], best
