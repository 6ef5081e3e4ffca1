"""The pattern rotation layer: how well a view fits each node under the best numbering of its facets, exactly.

D'Souza (section 5.5) presents all n! renumberings one after the other. Here the same maximum is found for all nodes at
once: facets that touch nothing or are twins are not permuted, and nodes that cannot win need not be looked into. The
arithmetic of a numbering is in gains.py, long searches in branch.py, element-wise comparison in match.py.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Index
from daemon.art.errors import within
from tests.bench.networks.errors import one_of
from tests.bench.networks.fuzzy import choice
from tests.bench.networks.rotation.branch import best_by_branching
from tests.bench.networks.rotation.ceilings import Ceilings
from tests.bench.networks.rotation.gains import all_gains, best_by_table, empty_overlap
from tests.bench.networks.rotation.match import matches_at
from tests.bench.networks.rotation.matrices import TaughtMatrices, as_relation, as_taught, occupied
from tests.bench.networks.rotation.numberings import has_table, table, twins

Scope = Literal["all", "occupied"]

# Numberings times nodes looked at together.
PIECE = 1 << 14
# Nodes looked into first when only the best are wanted; each further round takes twice as many.
FIRST_ROUND = 8


@dataclass(frozen=True, eq=False)
class LayerRecall:
    """One view against J nodes, each under its own best numbering.

    activation (J,): T = |I ^ w| / (alpha + |w|) at that numbering; numbering (J, n): the slot of each facet of the
    view; match (J,): equation (5.2) there; match_ratio (J,): facets matched over facets of the view or the node,
    whichever has more; exact (J,): whether the node was looked into. Where it was not, because it cannot be among the
    `top` asked for, activation is the upper bound that says so, numbering -1, match and match_ratio 0.
    """

    activation: Array
    numbering: Index
    match: Array
    match_ratio: Array
    exact: NDArray[np.bool_]

    def ranking(self) -> Index:
        """The nodes looked into by falling activation, the smaller index first on a tie."""
        nodes = np.flatnonzero(self.exact)
        return nodes[np.argsort(-self.activation[nodes], kind="stable")]


def best_numbering(
    matrix: Any,
    nodes: Any,
    alpha: float = 1e-3,
    complement: bool = True,
    scope: Scope = "all",
    top: int | None = None,
) -> LayerRecall:
    """The best numbering of a view's facets at every node, the same as trying all of them.

    matrix (n, n) in [0, 1]; nodes (J, m, m) taught matrices or, complement-coded, (J, 2, m, m) weights; n <= m <= 10.
    scope "all" (default) may put the view's facets into any of the m slots, so that a view which shows part of what was
    taught finds the right part; "occupied" permutes them among the slots they came in, as D'Souza does, where a
    partial view is only compared with the first facets taught (his figure 5.25 (c) then calls a prism a pentagon).
    top: how many of the best nodes are wanted; None looks into all. Ties between nodes go to the smaller index, ties
    between numberings to one and the same on every machine. Raises InputError, ParameterError.

    For many views against the same nodes, keep a RotationLayer.
    """
    return RotationLayer(nodes, alpha, complement, scope).recall(matrix, top)


class RotationLayer:
    """The rotation layer over fixed nodes: what does not depend on the view is worked out once."""

    def __init__(self, nodes: Any, alpha: float = 1e-3, complement: bool = True, scope: Scope = "all") -> None:
        within("alpha", alpha, 0.0, float("inf"))
        one_of("scope", scope, ("all", "occupied"))
        self.taught: TaughtMatrices = as_taught(nodes, complement)
        self.alpha, self.scope = float(alpha), scope
        self._size = self.taught.size()
        self._empty = empty_overlap(self.taught)

    @cached_property
    def _ceilings(self) -> Ceilings:
        return Ceilings.of(self.taught, self._empty)

    def recall(self, matrix: Any, top: int | None = None) -> LayerRecall:
        """The view (n, n) against every node, or as far as it takes to know the `top` best."""
        view = as_relation(matrix, self.taught.slots)
        filled = occupied(matrix)
        search = _Search(self, view[filled][:, filled], filled)
        if top is None or max(top, FIRST_ROUND) >= len(self._size):
            search.look_into(np.arange(len(self._size)))
        else:
            search.look_for_best(max(int(top), 1))
        return search.result(view)


class _Search:
    """One view on its way through the nodes: activations, exact where looked into, else bounds."""

    def __init__(self, layer: RotationLayer, stripped: Array, filled: Index) -> None:
        self.layer, self.stripped, self.filled = layer, stripped, filled
        count = len(layer._size)
        self.activation = np.zeros(count)
        self.exact = np.zeros(count, dtype=bool)
        self.slots = np.full((count, len(filled)), -1, dtype=np.int64)
        room = layer.taught.slots
        self.usable = tuple(range(room)) if layer.scope == "all" else tuple(filled.tolist())
        self.twins = twins(stripped)

    def look_into(self, nodes: Index) -> None:
        """Find the best numbering at these nodes, (C,)."""
        if has_table(len(self.filled), len(self.usable)):
            self._by_table(nodes)
        else:
            self._by_branching(nodes)
        self.exact[nodes] = True

    def _by_table(self, nodes: Index) -> None:
        taught, empty = self.layer.taught, self.layer._empty
        numberings = table(self.usable, taught.slots, self.twins)
        step = max(1, PIECE // len(numberings.slots))
        for start in range(0, len(nodes), step):
            some = nodes[start : start + step]
            overlap, best = best_by_table(self.stripped, taught, some, empty, numberings)
            self.activation[some] = choice(overlap, self.layer._size[some], self.layer.alpha)
            self.slots[some] = numberings.slots[best]

    def _by_branching(self, nodes: Index) -> None:
        layer, usable = self.layer, np.array(self.usable, dtype=np.int64)
        for node in nodes.tolist():
            pair, single = all_gains(self.stripped, layer.taught, node)
            gain, self.slots[node] = best_by_branching(pair, single, usable, self.twins)
            overlap = np.array([layer._empty[node] + gain])
            self.activation[node] = choice(overlap, layer._size[[node]], layer.alpha)[0]

    def look_for_best(self, top: int) -> None:
        """Look into nodes, the most promising first, until no other can be among the `top` best."""
        layer = self.layer
        self.activation[:] = choice(layer._ceilings.overlap(self.stripped), layer._size, layer.alpha)
        self.look_into(_most_promising(np.arange(len(self.activation)), self.activation, max(FIRST_ROUND, top)))
        length = max(FIRST_ROUND, top)
        while len(open_nodes := self._contenders(top)):
            length *= 2
            self.look_into(_most_promising(open_nodes, self.activation[open_nodes], length))

    def _contenders(self, top: int) -> Index:
        """Nodes not yet looked into whose bound, or index on a tie, may put them among the top best."""
        known = np.flatnonzero(self.exact)
        last = known[np.lexsort((known, -self.activation[known]))[top - 1]]
        nodes = np.flatnonzero((self.activation >= self.activation[last]) & ~self.exact)
        ahead = (self.activation[nodes] > self.activation[last]) | (nodes < last)
        return np.asarray(nodes[ahead], dtype=np.int64)

    def result(self, view: Array) -> LayerRecall:
        layer, known = self.layer, np.flatnonzero(self.exact)
        placed = _with_idle_facets(self.slots[known], self.filled, len(view), layer.taught.slots)
        match, ratio = matches_at(view, self.filled, layer.taught, known, placed)
        numbering = np.full((len(self.exact), len(view)), -1, dtype=np.int64)
        all_match, all_ratio = np.zeros((2, len(self.exact)))
        numbering[known], all_match[known], all_ratio[known] = placed, match, ratio
        return LayerRecall(self.activation, numbering, all_match, all_ratio, self.exact)


def _most_promising(nodes: Index, bound: Array, length: int) -> Index:
    """The `length` nodes of greatest bound, in rising order of index."""
    if len(nodes) <= length:
        return nodes
    return np.asarray(np.sort(nodes[np.argpartition(-bound, length)[:length]]))


def _with_idle_facets(slots: Index, filled: Index, facets: int, room: int) -> Index:
    """Slots (J, k) of the facets that touch something -> (J, n): the idle ones get the free slots in rising order."""
    if len(filled) == facets:
        return slots
    free = np.ones((len(slots), room), dtype=bool)
    free[np.arange(len(slots))[:, None], slots] = False
    idle = np.ones(facets, dtype=bool)
    idle[filled] = False
    numbering = np.empty((len(slots), facets), dtype=np.int64)
    numbering[:, filled] = slots
    numbering[:, idle] = np.nonzero(free)[1].reshape(len(slots), room - len(filled))[:, : facets - len(filled)]
    return numbering
