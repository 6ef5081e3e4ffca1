"""Fuzzy ARTMAP: learns which label goes with which sample (D'Souza, appendix B), one presentation at a time.

The estimator, its state and its predictions; arithmetic in fuzzy.py, search in search.py, presenting in presenting.py.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Index
from daemon.art.errors import ParameterError, within
from tests.bench.networks.coding import as_unit_samples, code, grid_step
from tests.bench.networks.errors import NotTrainedError
from tests.bench.networks.labels import Labels
from tests.bench.networks.levels import Samples
from tests.bench.networks.nodes import Nodes
from tests.bench.networks.presenting import present
from tests.bench.networks.search import Contradiction, MatchTracking, SearchRule, Uncommitted, iterations
from tests.bench.networks.winners import Answers, answers


class FuzzyARTMAP:
    """Fuzzy ARTMAP with plain labels in the place of ART-b (for coded ART-b inputs see daemon.art.ARTMAP).

    rho: baseline vigilance of ART-a in [0, 1]; alpha: choice parameter >= 0; beta: learning rate in (0, 1], 1 being
    fast learning (new nodes always commit fast); complement: code samples as (a, 1 - a), off only to reproduce the
    thesis's raw activations; map_vigilance rho_ab: 1 (default) makes every node stand for one label, less lets a node
    keep several (one-to-many), 0 switches match tracking off; match_tracking, epsilon, uncommitted, contradiction,
    capacity: see SearchRule; max_iter: epochs of `fit`, fewer once an epoch changes nothing; rho_predict: vigilance
    when predicting, None for the baseline. Where no node meets it, the prediction abstains.

    Samples are (N, M) in [0, 1], labels any hashable values. Raises InputError, ParameterError, NotTrainedError.
    """

    def __init__(
        self,
        rho: float = 0.0,
        alpha: float = 1e-3,
        beta: float = 1.0,
        *,
        complement: bool = True,
        map_vigilance: float = 1.0,
        match_tracking: MatchTracking = "MT+",
        epsilon: float = 1e-10,
        uncommitted: Uncommitted = "last",
        contradiction: Contradiction = "new_node",
        capacity: int | None = None,
        max_iter: int = 1,
        rho_predict: float | None = None,
    ) -> None:
        self.rule = SearchRule(rho, alpha, map_vigilance, match_tracking, epsilon, uncommitted, contradiction, capacity)
        within("beta", beta, np.nextafter(0.0, 1.0), 1.0)
        within("rho_predict", rho if rho_predict is None else rho_predict, 0.0, 1.0)
        self.beta, self.complement, self.max_iter = float(beta), bool(complement), iterations(max_iter)
        self.rho_predict = float(rho if rho_predict is None else rho_predict)
        self._labels = Labels()
        self._nodes: Nodes | None = None

    @property
    def n_categories(self) -> int:
        """How many ART-a nodes are committed."""
        return 0 if self._nodes is None else len(self._nodes)

    @property
    def classes(self) -> tuple[Hashable, ...]:
        """Every label learnt, in the order first seen."""
        return self._labels.all()

    @property
    def weights(self) -> Array:
        """(J, 2M) complement-coded or (J, M) raw. NotTrainedError before the first sample."""
        return self._trained().weights.copy()

    @property
    def node_labels(self) -> tuple[Hashable, ...]:
        """The label each node stands for, in node order."""
        return tuple(self._labels[int(number)] for number in self._trained().winners())

    def fit(self, X: Any, y: Any) -> FuzzyARTMAP:
        """Forget everything and learn X (N, M) with labels y (N,) in their order, up to max_iter times over."""
        self._labels, self._nodes = Labels(), None
        labels = list(y) if not isinstance(y, np.ndarray) else y
        for _ in range(self.max_iter):
            before = None if self._nodes is None else self._nodes.weights.copy()
            self.partial_fit(X, labels)
            if before is not None and np.array_equal(before, self._trained().weights):
                break
        return self

    def partial_fit(self, X: Any, y: Any) -> FuzzyARTMAP:
        """Learn X (N, M) with labels y (N,) on top of what is known. In pieces or at once: the same bytes."""
        self.learn(X, y)
        return self

    def learn(self, X: Any, y: Any) -> Index:
        """As partial_fit; returns the node each sample ended on, (N,), -2 where a contradiction was skipped."""
        coded = self._coded(X)
        numbers = self._labels.numbers(y, len(coded))
        if self._nodes is None:
            self._nodes = Nodes(coded.coded.shape[1])
        self._nodes.room_for_labels(len(self._labels))
        return present(self._nodes, coded, numbers, self.rule, self.beta, grid_step(self._nodes.features))

    def recall(self, X: Any) -> Answers:
        """The node each sample calls up at vigilance rho_predict, with activation and match."""
        nodes = self._trained()
        return answers(self._coded(X), nodes, self.rule.alpha, self.rho_predict)

    def predict(self, X: Any) -> NDArray[Any]:
        """The label of each sample, (N,). With rho_predict 0 there is always one, and the array has the labels' own
        type (int, float, bool or str where all are); otherwise it holds objects, None where no node fits."""
        return self._as_labels(self.recall(X))

    def predict_with_match(self, X: Any) -> tuple[NDArray[Any], Array]:
        """As predict, and the match |I ^ w| / |I| of the node that answered, (N,), 0 where none did."""
        recalled = self.recall(X)
        return self._as_labels(recalled), recalled.match

    def predict_proba(self, X: Any) -> Array:
        """(N, L), columns as in `classes`: the shares of the map field of the node that answered; 0 where none did."""
        counts = self._trained().map_counts[:, : len(self._labels)]
        shares = counts / counts.sum(axis=1, keepdims=True)
        recalled = self.recall(X)
        return np.asarray(np.where((recalled.node >= 0)[:, None], shares[recalled.node], 0.0))

    def score(self, X: Any, y: Iterable[Hashable]) -> float:
        """The share of samples whose label is predicted; an abstention is not right."""
        given = list(y)
        predicted = self.predict(X)
        return float(np.mean([bool(p == q) for p, q in zip(predicted.tolist(), given, strict=True)]))

    def forget(self, label: Hashable) -> FuzzyARTMAP:
        """Remove a label and the nodes that stand for it alone; every other node keeps its weights and order.

        Nodes that other labels needed only because of this one stay. ParameterError where the label is not known.
        """
        number = self._labels.known(label)
        if number is None:
            raise ParameterError(f"forget: no such label as {label!r}; known: {list(self.classes)}")
        self._labels = Labels(known for known in self._labels.all() if known != self._labels[number])
        self._nodes = self._trained().without_label(number)
        return self

    def state(self) -> dict[str, NDArray[Any]]:
        """What was learnt, as arrays: weights (J, F) float64 and map_counts (J, L) int64. Labels are in `classes`."""
        nodes = self._trained()
        return {"weights": nodes.weights.copy(), "map_counts": nodes.map_counts[:, : len(self._labels)].copy()}

    def restore(self, state: Mapping[str, NDArray[Any]], classes: Iterable[Hashable]) -> FuzzyARTMAP:
        """Take up what `state` and `classes` of an estimator with the same parameters gave.

        ParameterError where shapes, ranges or counts cannot be such a state.
        """
        labels = Labels(classes)
        weights = np.asarray(state["weights"], dtype=np.float64)
        counts = np.asarray(state["map_counts"], dtype=np.int64)
        if weights.ndim != 2 or counts.shape != (len(weights), len(labels)):
            raise ParameterError(f"state: weights {weights.shape}, map_counts {counts.shape}, {len(labels)} labels")
        if not (np.isfinite(weights).all() and (weights >= 0.0).all() and (weights <= 1.0).all()):
            raise ParameterError("state: weights outside [0, 1]")
        if (counts < 0).any() or (counts.sum(axis=1) == 0).any():
            raise ParameterError("state: map_counts negative, or a node without a label")
        self._labels, self._nodes = labels, Nodes.from_arrays(weights, counts)
        return self

    def _as_labels(self, recalled: Answers) -> NDArray[Any]:
        table = self._labels.table() if self.rho_predict == 0.0 else self._labels.object_table()
        number = np.where(recalled.node >= 0, self._trained().winners()[recalled.node], -1)
        return np.asarray(table[number])

    def _coded(self, X: Any) -> Samples:
        """Samples (N, M) checked, and coded as the nodes are."""
        known = None if self._nodes is None else self._nodes.features // (2 if self.complement else 1)
        return Samples.of(code(as_unit_samples(X, known), self.complement), self.complement)

    def _trained(self) -> Nodes:
        if self._nodes is None or not len(self._nodes):
            raise NotTrainedError("this network has not learnt a single sample yet")
        return self._nodes
