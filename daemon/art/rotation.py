"""The pattern rotation layer: how well a view fits each node under the best numbering of its facets, exactly.

D'Souza (section 5.5) presents all n! renumberings one after the other. Here the same maximum is found for all nodes at
once: facets that touch nothing or are twins are not permuted, and nodes that cannot win are never looked into. The
arithmetic of a numbering is in gains.py, element-wise comparison in match.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from daemon.art.fuzzy import choice
from daemon.art.gains import best_of_table, empty_overlap, gains
from daemon.art.match import matches_at
from daemon.art.numberings import table, twins
from daemon.art.relations import TaughtMatrices, as_relation, as_taught, occupied
from daemon.art.search import one_of, within

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Scope = Literal["all", "occupied"]

# Numberings times nodes looked at together.
PIECE = 1 << 16


@dataclass(frozen=True, eq=False)
class Recall:
    """One view against J nodes, each under its own best numbering.

    activation (J,): T = |I ^ w| / (alpha + |w|) at that numbering; numbering (J, n): the slot of each facet of the
    view; match (J,): equation (5.2) there; match_ratio (J,): facets matched over facets of the view or the node,
    whichever has more.
    """

    activation: Array
    numbering: Index
    match: Array
    match_ratio: Array

    def ranking(self) -> Index:
        """Nodes by falling activation, the smaller index first on a tie."""
        return np.argsort(-self.activation, kind="stable")


def best_numbering(
    matrix: Any, nodes: Any, alpha: float = 1e-3, complement: bool = True, scope: Scope = "all"
) -> Recall:
    """The best numbering of a view's facets at every node, the same as trying all of them.

    matrix (n, n) in [0, 1]; nodes (J, m, m) taught matrices or, complement-coded, (J, 2, m, m) weights; n <= m <= 10.
    scope "all" (default) may put the view's facets into any of the m slots, so that a view which shows part of what was
    taught finds the right part; "occupied" permutes them among the slots they came in, as D'Souza does, where a
    partial view is only compared with the first facets taught (his figure 5.25 (c) then calls a prism a pentagon).
    Ties between numberings go to the lexicographically smallest. Raises InputError, ParameterError.
    """
    return RotationLayer(nodes, alpha, complement, scope).recall(matrix)


class RotationLayer:
    """The rotation layer over fixed nodes: what does not depend on the view is worked out once."""

    def __init__(self, nodes: Any, alpha: float = 1e-3, complement: bool = True, scope: Scope = "all") -> None:
        within("alpha", alpha, 0.0, float("inf"))
        one_of("scope", scope, ("all", "occupied"))
        self.taught: TaughtMatrices = as_taught(nodes, complement)
        self.alpha, self.scope = float(alpha), scope
        self._size = self.taught.size()
        self._empty = empty_overlap(self.taught)

    def recall(self, matrix: Any) -> Recall:
        """The view against every node."""
        view = as_relation(matrix, self.taught.slots)
        filled = occupied(view)
        overlap, slots = self._best(view[np.ix_(filled, filled)], filled)
        numbering = _with_idle_facets(slots, filled, len(view), self.taught.slots)
        everyone = np.arange(len(self._size))
        match, ratio = matches_at(view, self.taught, everyone, numbering)
        return Recall(choice(overlap, self._size, self.alpha), numbering, match, ratio)

    def _best(self, stripped: Array, filled: Index) -> tuple[Array, Index]:
        """|I ^ w| at the best numbering of the stripped view (k, k), (J,), and the slots of its facets, (J, k)."""
        usable = np.arange(self.taught.slots) if self.scope == "all" else filled
        tabled = usable[table(len(stripped), len(usable), twins(stripped))]
        overlap, slots = np.empty(len(self._size)), np.empty((len(self._size), len(stripped)), dtype=np.int64)
        step = max(1, PIECE // len(tabled))
        for start in range(0, len(self._size), step):
            nodes = np.arange(start, min(start + step, len(self._size)))
            gain = gains(stripped, self.taught, nodes, self._empty)
            overlap[nodes], best = best_of_table(gain, tabled, self.taught.slots)
            slots[nodes] = tabled[best]
        return overlap, slots


def _with_idle_facets(slots: Index, filled: Index, facets: int, room: int) -> Index:
    """Slots (J, k) of the facets that touch something -> (J, n): the idle ones get the free slots in rising order."""
    numbering = np.empty((len(slots), facets), dtype=np.int64)
    numbering[:, filled] = slots
    idle = np.setdiff1d(np.arange(facets), filled)
    if len(idle):
        free = np.ones((len(slots), room), dtype=bool)
        np.put_along_axis(free, slots, False, axis=1)
        numbering[:, idle] = np.argsort(~free, axis=1, kind="stable")[:, : len(idle)]
    return numbering
