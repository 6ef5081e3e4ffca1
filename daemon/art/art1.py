"""ART 1: groups binary patterns (D'Souza, appendix A). On 0 and 1 it is Fuzzy ART uncoded with alpha = L - 1 and fast
learning, T being L times that of Fuzzy ART; so search and learning are those of daemon/art/presenting.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.art.coding import as_unit_samples, refuse_first
from daemon.art.errors import InputError, NotTrainedError, ParameterError
from daemon.art.fuzzy import LEAST
from daemon.art.levels import Samples
from daemon.art.nodes import Nodes
from daemon.art.presenting import present
from daemon.art.search import SearchRule, Uncommitted, iterations, within
from daemon.art.winners import answers

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class ART1:
    """ART 1 with fast learning.

    rho: vigilance in [0, 1]; L: bottom-up parameter > 1, small values preferring what is contained in the pattern;
    capacity: how many F2 nodes there are, None for as many as it takes (a pattern that finds none ends on -2);
    uncommitted: "competes" (default, the text: initial bottom-up weights at their upper limit L / (L - 1 + M)) or
    "last"; max_iter: epochs of `fit`. Patterns are (N, M) of 0 and 1, none of them empty.
    """

    def __init__(
        self,
        rho: float = 0.4,
        L: float = 2.0,
        *,
        capacity: int | None = None,
        uncommitted: Uncommitted = "competes",
        max_iter: int = 1,
    ) -> None:
        if not (np.isfinite(L) and L > 1.0):
            raise ParameterError(f"L: expected a number above 1, found {L!r}")
        if capacity is not None and capacity < 1:
            raise ParameterError(f"capacity: expected at least 1 node, found {capacity!r}")
        within("rho", rho, 0.0, 1.0)
        # (1.2): a node that shares nothing with the pattern is not chosen, so a vigilance of 0 is the least above it
        self.rule = SearchRule(rho=max(rho, LEAST), alpha=L - 1.0, uncommitted=uncommitted, capacity=capacity)
        self.L, self.max_iter = float(L), iterations(max_iter)
        self._nodes: Nodes | None = None

    @property
    def n_categories(self) -> int:
        return 0 if self._nodes is None else len(self._nodes)

    @property
    def top_down(self) -> Array:
        """z, (J, M) of 0 and 1: what each node expects."""
        return self._trained().weights.copy()

    @property
    def bottom_up(self) -> Array:
        """Z = L z / (L - 1 + |z|), (1.8), (J, M)."""
        nodes = self._trained()
        return np.asarray(self.L * nodes.weights / (self.L - 1.0 + nodes.size[:, None]))

    def fit(self, X: Any, y: object = None) -> ART1:
        """Forget everything and learn the patterns in their order, max_iter times over; y is ignored."""
        self._nodes = None
        for _ in range(self.max_iter):
            self.learn(X)
        return self

    def partial_fit(self, X: Any, y: object = None) -> ART1:
        """Learn patterns (N, M) on top of what is known."""
        self.learn(X)
        return self

    def learn(self, X: Any) -> Index:
        """As partial_fit; returns the node each pattern ended on, (N,), -2 where all were taken."""
        patterns = self._patterns(X)
        if self._nodes is None:
            self._nodes = Nodes(patterns.shape[1])
        nobody = np.zeros(len(patterns), dtype=np.int64)
        return present(self._nodes, Samples.plain(patterns), nobody, self.rule, beta=1.0, step=1.0)

    def predict(self, X: Any) -> Index:
        """The node each pattern calls up, (N,); -1 where none meets the vigilance."""
        patterns = self._patterns(X)
        return answers(Samples.plain(patterns), self._trained(), self.rule.alpha, self.rule.rho).node

    def state(self) -> dict[str, Array]:
        """What was learnt: top_down (J, M)."""
        return {"top_down": self.top_down}

    def restore(self, state: Mapping[str, Array]) -> ART1:
        """Take up what `state` of an ART1 with the same parameters gave."""
        top_down = self._patterns(state["top_down"])
        self._nodes = Nodes.from_arrays(top_down, np.ones((len(top_down), 1), dtype=np.int64))
        return self

    def _patterns(self, X: Any) -> Array:
        patterns = as_unit_samples(X, None if self._nodes is None else self._nodes.features)
        refuse_first((patterns != 0.0) & (patterns != 1.0), patterns, "0 or 1")
        empty = np.flatnonzero(~patterns.any(axis=1))
        if len(empty):
            raise InputError(f"samples: row {empty[0]} is empty: there is nothing to match")
        return patterns

    def _trained(self) -> Nodes:
        if self._nodes is None or not len(self._nodes):
            raise NotTrainedError("this ART1 has not learnt a single pattern yet")
        return self._nodes
