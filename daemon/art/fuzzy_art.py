"""Fuzzy ART: groups samples without being told what they are (D'Souza, appendix B, first half).

The estimator and its state only; arithmetic in fuzzy.py, search in search.py, presenting in presenting.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.art.coding import as_unit_samples, code, grid_step
from daemon.art.errors import NotTrainedError
from daemon.art.levels import Samples
from daemon.art.nodes import Nodes
from daemon.art.presenting import present
from daemon.art.search import SearchRule, Uncommitted, iterations, within
from daemon.art.winners import answers

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class FuzzyART:
    """Fuzzy ART with fast commitment and slow recoding.

    rho vigilance in [0, 1]; alpha choice parameter >= 0; beta learning rate in (0, 1] (1: fast learning); complement:
    code samples as (a, 1 - a); uncommitted: see SearchRule; max_iter: epochs of `fit`, fewer once an epoch changes
    nothing. Samples are (N, M) in [0, 1].
    """

    def __init__(
        self,
        rho: float = 0.0,
        alpha: float = 1e-3,
        beta: float = 1.0,
        *,
        complement: bool = True,
        uncommitted: Uncommitted = "last",
        max_iter: int = 1,
    ) -> None:
        self.rule = SearchRule(rho=rho, alpha=alpha, uncommitted=uncommitted)
        within("beta", beta, np.nextafter(0.0, 1.0), 1.0)
        self.beta, self.complement, self.max_iter = float(beta), bool(complement), iterations(max_iter)
        self._nodes: Nodes | None = None

    @property
    def n_categories(self) -> int:
        return 0 if self._nodes is None else len(self._nodes)

    @property
    def weights(self) -> Array:
        """(J, 2M) complement-coded or (J, M) raw; NotTrainedError before the first sample."""
        return self._trained().weights.copy()

    def fit(self, X: Any, y: object = None) -> FuzzyART:
        """Forget everything and learn X (N, M) in its order, max_iter times over; y is ignored."""
        self._nodes = None
        for _ in range(self.max_iter):
            before = None if self._nodes is None else self._nodes.weights.copy()
            self.partial_fit(X)
            if before is not None and np.array_equal(before, self._trained().weights):
                break
        return self

    def partial_fit(self, X: Any, y: object = None) -> FuzzyART:
        """Learn X (N, M) on top of what is known; the categories the samples ended on are `predict(X)`'s business."""
        self.learn(X)
        return self

    def learn(self, X: Any) -> Index:
        """As partial_fit; returns the category each sample resonated with while it was learnt, (N,)."""
        samples = as_unit_samples(X, self._features())
        coded = Samples.of(code(samples, self.complement), self.complement)
        if self._nodes is None:
            self._nodes = Nodes(coded.coded.shape[1])
        nobody = np.zeros(len(coded), dtype=np.int64)
        return present(self._nodes, coded, nobody, self.rule, self.beta, grid_step(self._nodes.features))

    def predict(self, X: Any) -> Index:
        """The category of each sample, (N,); -1 where none meets the vigilance."""
        nodes = self._trained()
        coded = Samples.of(code(as_unit_samples(X, self._features()), self.complement), self.complement)
        return answers(coded, nodes, self.rule.alpha, self.rule.rho).node

    def state(self) -> dict[str, Array]:
        """What was learnt, as arrays: weights (J, F)."""
        return {"weights": self.weights}

    def restore(self, state: Mapping[str, Array]) -> FuzzyART:
        """Take up what `state` of an estimator with the same parameters gave; nothing else is checked here."""
        weights = np.asarray(state["weights"], dtype=np.float64)
        self._nodes = Nodes.from_arrays(weights, np.ones((len(weights), 1), dtype=np.int64))
        return self

    def _features(self) -> int | None:
        if self._nodes is None:
            return None
        return self._nodes.features // 2 if self.complement else self._nodes.features

    def _trained(self) -> Nodes:
        if self._nodes is None or not len(self._nodes):
            raise NotTrainedError("this FuzzyART has not learnt a single sample yet")
        return self._nodes
