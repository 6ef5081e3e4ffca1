"""The best numbering of a view with many facets at one node, by branch and bound: exact, without the table of all.

Facets are given slots one after the other, the best connected first. A partial numbering is dropped when what it has
gained, plus the most that each facet still to come could gain in its own best free slot, does not beat the best
complete one. Gains are those of tests/bench/networks/rotation/gains.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Index

# Partial numberings extended together.
TOGETHER = 64


@dataclass(frozen=True, eq=False)
class _Partial:
    """S partial numberings of equal length d. slots (S, d); free (S, m); gain (S,); linear (S, k - d, m): what each
    facet still to come gains in each slot from those already placed, and from itself."""

    slots: Index
    free: NDArray[np.bool_]
    gain: Array
    linear: Array

    def at(self, rows: Index) -> _Partial:
        return _Partial(self.slots[rows], self.free[rows], self.gain[rows], self.linear[rows])


def best_by_branching(pair: Array, single: Array, usable: Index, twin_before: tuple[int, ...]) -> tuple[float, Index]:
    """The greatest gain of k facets in distinct usable slots of m, and their slots, (k,).

    pair (k, k, m, m): the gain of facets p and q in slots a and b, pair[p, q, a, b] = pair[q, p, b, a]; single (k, m).
    twin_before as numberings.twins gives it: only numberings with twins in rising order are looked at.
    """
    order = np.argsort(-pair.max(axis=(2, 3)).sum(axis=1), kind="stable")
    place = np.argsort(order)
    pair, single = pair[np.ix_(order, order)], single[order]
    before = [int(place[twin_before[facet]]) if twin_before[facet] >= 0 else -1 for facet in order]
    to_come = _most_among_those_to_come(pair)
    free = np.zeros((1, single.shape[1]), dtype=bool)
    free[0, usable] = True
    waiting = [_Partial(np.empty((1, 0), dtype=np.int64), free, np.zeros(1), single[None].copy())]
    best, slots = -np.inf, np.empty(0, dtype=np.int64)
    while waiting:
        partial = waiting.pop()
        if partial.linear.shape[1] == 0:
            winner = int(partial.gain.argmax())
            if partial.gain[winner] > best:
                best, slots = float(partial.gain[winner]), partial.slots[winner]
            continue
        depth = partial.slots.shape[1]
        waiting += _extended(partial, pair[depth, depth + 1 :], to_come[depth + 1], before[depth], best)
    return best, slots[place]


def _most_among_those_to_come(pair: Array) -> list[Array]:
    """For each depth d an upper bound (k - d, m) on half of what a facet still to come gains in a slot from the others
    still to come; each pair is counted from both its ends, so halves add up to the whole."""
    k, m = pair.shape[0], pair.shape[2]
    elsewhere = np.where(np.eye(m, dtype=bool), -np.inf, pair)
    most = np.where(np.eye(k, dtype=bool)[:, :, None], 0.0, elsewhere.max(axis=3)) if m > 1 else np.zeros((k, k, m))
    return [0.5 * most[d:, d:].sum(axis=1) for d in range(k + 1)]


def _extended(partial: _Partial, with_others: Array, to_come: Array, before: int, best: float) -> list[_Partial]:
    """The extensions by one facet that can still beat best, in batches, the most promising last.

    with_others (r, m, m): the facet's gain, in each slot, with each of the r facets after it in each slot; to_come
    (r, m); before: the position of the facet's twin placed earlier, or -1.
    """
    m = partial.free.shape[1]
    allowed = partial.free.copy()
    if before >= 0:
        allowed &= np.arange(m) > partial.slots[:, before, None]
    row, slot = np.nonzero(allowed)
    free = partial.free[row]
    free[np.arange(len(row)), slot] = False
    gain = partial.gain[row] + partial.linear[row, 0, slot]
    linear = partial.linear[row, 1:] + with_others[:, slot].transpose(1, 0, 2)
    hope = np.where(free[:, None, :], linear + to_come, -np.inf).max(axis=2, initial=-np.inf)
    bound = gain + hope.sum(axis=1)
    kept = np.flatnonzero(bound > best)
    kept = kept[np.argsort(bound[kept], kind="stable")]
    slots = np.concatenate([partial.slots[row], slot[:, None]], axis=1)
    children = _Partial(slots, free, gain, linear)
    return [children.at(kept[start : start + TOGETHER]) for start in range(0, len(kept), TOGETHER)]
