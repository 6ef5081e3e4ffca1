"""What a facet pair adds to |I ^ w| by sitting in a pair of slots, and the best of all tabled numberings.

|I ^ w| over all slots is a constant of the node (nothing sits anywhere) plus a gain for every element of the view that
is not 0. An element x on an element of the node whose taught values lie in [u, v] gains min(x, u), and with complement
coding loses max(0, x - v) of what the empty slot had.
"""

import numpy as np

from daemon.arrays import Array, Index
from tests.bench.networks.rotation.matrices import Ends, TaughtMatrices, both
from tests.bench.networks.rotation.numberings import Numberings


def empty_overlap(taught: TaughtMatrices) -> Array:
    """|I ^ w| of the empty matrix with each node, (J,)."""
    if not taught.complement:
        return np.zeros(len(taught.lower))
    return np.asarray((1.0 - taught.upper).sum(axis=(1, 2)))


def element_gain(element: Array, ends: Ends, complement: bool) -> Array:
    """The gain of elements over empty ones; shapes broadcast. For a node of one view (lower is upper) in one step."""
    lower, upper = ends
    gain = np.minimum(element, lower)
    if not complement:
        return gain
    if lower is upper:
        gain += gain
        gain -= element
        return gain
    gain -= np.maximum(0.0, element - upper)
    return gain


def best_by_table(
    view: Array, taught: TaughtMatrices, nodes: Index, base: Array, numberings: Numberings
) -> tuple[Array, Index]:
    """|I ^ w| of the stripped view (k, k) at the best numbering for each of the given nodes, (C,) indices, and which it
    was, (C,), the first on a tie; base as empty_overlap gives it, (J,)."""
    m = taught.slots
    there, back = view[numberings.first, numberings.second], view[numberings.second, numberings.first]
    pairs = np.flatnonzero((there > 0.0) | (back > 0.0))
    ends = both(taught.by_element, lambda end: np.take(end, nodes, axis=1))
    # (pairs, m * m, C): the first of the pair in slot a and the second in slot b at a * m + b
    gains = element_gain(there[pairs, None, None], ends, taught.complement)
    gains += element_gain(back[pairs, None, None], ends, taught.complement)[:, numberings.swapped]
    total, term = (np.zeros((len(numberings.slots), len(nodes))) for _ in range(2))
    for number, gain in zip(pairs, gains, strict=True):
        total += np.take(gain, numberings.place[number], axis=0, out=term, mode="clip")
    if view.diagonal().any():
        own = both(ends, lambda end: end[:: m + 1])
        for facet, gain in enumerate(element_gain(view.diagonal()[:, None, None], own, taught.complement)):
            total += gain[numberings.slots[:, facet]]
    by_node = np.ascontiguousarray(total.T)
    best = np.asarray(by_node.argmax(axis=1), dtype=np.int64)
    return base[nodes] + by_node[np.arange(len(nodes)), best], best


def all_gains(view: Array, taught: TaughtMatrices, node: int) -> tuple[Array, Array]:
    """Gains of the stripped view (k, k) at one node for branching: of pairs (k, k, m, m) and of single facets (k, m).

    pair[p, q, a, b] is the gain of p in slot a with q in slot b, both ways; 0 where p is q.
    """
    ends = both(taught.ends, lambda end: end[node])
    one_way = element_gain(view[:, :, None, None], ends, taught.complement)
    pair = one_way + one_way.transpose(1, 0, 3, 2)
    pair[np.arange(len(view)), np.arange(len(view))] = 0.0
    return pair, element_gain(view.diagonal()[:, None], both(ends, np.diagonal), taught.complement)
