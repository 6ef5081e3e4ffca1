"""Gaussian ART and Gaussian ARTMAP: the estimators (D'Souza, appendix C; Williamson 1996).

Arithmetic and choice are in gaussian.py. Samples may be any numbers up to 1e100; bring features to like scales, since
a new category is equally wide in each.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Index
from daemon.art.errors import ParameterError
from tests.bench.networks.coding import as_samples, refuse_first
from tests.bench.networks.errors import NotTrainedError, one_of
from tests.bench.networks.gaussian import Categories, GaussianRule, resonating
from tests.bench.networks.grouping import ANY, Grouping
from tests.bench.networks.labels import Labels
from tests.bench.networks.search import UNCOMMITTED, iterations
from tests.bench.networks.winners import Answers

Prediction = Literal["sum", "winner"]

# Beyond this, squares of distances in standard deviations leave the range of float64.
FARTHEST = 1e100


class GaussianARTMAP:
    """Learns which label goes with which sample, every category being a Gaussian that stands for one label.

    rule: see GaussianRule; max_iter: epochs of `fit`; prediction: "sum" (default) takes the label whose categories are
    together the most probable, "winner" that of the single most probable category. Abstains where no category reaches
    the vigilance of the rule. Raises InputError, ParameterError, NotTrainedError.
    """

    def __init__(self, rule: GaussianRule | None = None, *, prediction: Prediction = "sum", max_iter: int = 1) -> None:
        one_of("prediction", prediction, ("sum", "winner"))
        self.rule, self.prediction, self.max_iter = rule or GaussianRule(), prediction, iterations(max_iter)
        self._labels, self._stands_for = Labels(), np.empty(0, dtype=np.int64)
        self._categories: Categories | None = None

    @property
    def n_categories(self) -> int:
        return 0 if self._categories is None else len(self._categories)

    @property
    def classes(self) -> tuple[Hashable, ...]:
        """Every label learnt, in the order first seen."""
        return self._labels.all()

    def fit(self, X: Any, y: Any) -> GaussianARTMAP:
        """Forget everything and learn X (N, M) with labels y (N,) in their order, max_iter times over."""
        self._labels, self._stands_for, self._categories = Labels(), np.empty(0, dtype=np.int64), None
        labels = y if isinstance(y, np.ndarray) else list(y)
        for _ in range(self.max_iter):
            self.partial_fit(X, labels)
        return self

    def partial_fit(self, X: Any, y: Any) -> GaussianARTMAP:
        """Learn X (N, M) with labels y (N,) on top of what is known."""
        self.learn(X, y)
        return self

    def learn(self, X: Any, y: Any) -> Index:
        """As partial_fit; returns the category each sample ended on, (N,)."""
        samples = _finite_samples(X, self._categories)
        labels = self._labels.numbers(y, len(samples))
        if self._categories is None:
            self._categories = Categories.none(samples.shape[1])
        ended = [self._present(self._categories, s, label) for s, label in zip(samples, labels.tolist(), strict=True)]
        return np.array(ended, dtype=np.int64)

    def _present(self, categories: Categories, sample: Array, label: int) -> int:
        node = resonating(categories, sample, self.rule, lambda node: self._stands_for.item(node) == label)
        if node == UNCOMMITTED:
            self._stands_for = np.append(self._stands_for, label)
            return categories.commit(sample, self.rule)
        categories.learn(node, sample, self.rule)
        return node

    def recall(self, X: Any) -> Answers:
        """The most probable category of each sample among those that match, its log probability and match."""
        score, match = self._scores(X)
        node, greatest = score.argmax(axis=1), score.max(axis=1)
        return Answers(np.where(greatest > -np.inf, node, -1), greatest, match[np.arange(len(node)), node])

    def predict(self, X: Any) -> NDArray[Any]:
        """The label of each sample, (N,): of the labels' own type where the rule has no vigilance, else objects with
        None where no category reaches it."""
        return self.predict_with_match(X)[0]

    def predict_with_match(self, X: Any) -> tuple[NDArray[Any], Array]:
        """As predict, and the best match, as the rule has it, of the categories of that label, (N,); -inf for none."""
        score, match = self._scores(X)
        number = self._label_of(score)
        table = self._labels.table() if self.rule.rho is None else self._labels.object_table()
        own = np.where(self._stands_for == number[:, None], match, -np.inf)
        return np.asarray(table[number]), np.asarray(own.max(axis=1))

    def predict_proba(self, X: Any) -> Array:
        """P(label | sample), (N, L), columns as in `classes`; 0 where no category reaches the vigilance."""
        summed = self._summed(self._scores(X)[0])
        total = summed.sum(axis=1, keepdims=True)
        return np.asarray(np.divide(summed, total, out=np.zeros_like(summed), where=total > 0.0))

    def forget(self, label: Hashable) -> GaussianARTMAP:
        """Remove a label and its categories; every other category stays as it is. ParameterError if it is not known."""
        number = self._labels.known(label)
        if number is None:
            raise ParameterError(f"forget: no such label as {label!r}; known: {list(self.classes)}")
        kept = self._stands_for != number
        self._categories = self._trained().at(kept)
        self._labels = Labels(known for known in self._labels.all() if known != self._labels[number])
        self._stands_for = self._stands_for[kept] - (self._stands_for[kept] > number)
        return self

    def state(self) -> dict[str, NDArray[Any]]:
        """What was learnt: mean, variance (J, M), samples (J,), stands_for (J,), the index of a label in `classes`."""
        known = self._trained()
        named = {
            "mean": known.mean,
            "variance": known.variance,
            "samples": known.samples,
            "stands_for": self._stands_for,
        }
        return {name: array.copy() for name, array in named.items()}

    def restore(self, state: Mapping[str, NDArray[Any]], classes: Iterable[Hashable]) -> GaussianARTMAP:
        """Take up what `state` and `classes` of an estimator with the same parameters gave."""
        labels, stands_for = Labels(classes), np.array(state["stands_for"], dtype=np.int64)
        categories = _restored(state)
        if stands_for.shape != (len(categories),) or ((stands_for < 0) | (stands_for >= len(labels))).any():
            raise ParameterError(f"state: stands_for {stands_for.shape} does not fit {len(labels)} labels")
        self._labels, self._stands_for, self._categories = labels, stands_for, categories
        return self

    def _trained(self) -> Categories:
        if self._categories is None or not len(self._categories):
            raise NotTrainedError("this Gaussian network has not learnt a single sample yet")
        return self._categories

    def _scores(self, X: Any) -> tuple[Array, Array]:
        """g, (1.29), of samples at categories, (N, J), -inf where the match is under the vigilance; and the match."""
        categories = self._trained()
        density = categories.log_densities(_finite_samples(X, categories))
        match = self.rule.match(density, categories.log_peak)
        return np.where(match >= self.rule.baseline, density + categories.log_prior(), -np.inf), match

    def _label_of(self, score: Array) -> Index:
        """The label number of each row of log probabilities (N, J), -1 where all are -inf."""
        if self.prediction == "sum":
            number = self._summed(score).argmax(axis=1)
        else:
            number = self._stands_for[score.argmax(axis=1)]
        return np.where(score.max(axis=1) > -np.inf, number, -1)

    def _summed(self, score: Array) -> Array:
        """The labels' summed probabilities (N, L), each row relative to its most probable category, which keeps the
        greatest from underflowing however far the sample lies from everything."""
        greatest = score.max(axis=1, keepdims=True)
        relative = np.exp(score - np.where(greatest > -np.inf, greatest, 0.0))
        return np.asarray(relative @ (self._stands_for[:, None] == np.arange(len(self._labels))).astype(np.float64))


def _finite_samples(X: Any, categories: Categories | None) -> Array:
    samples = as_samples(X, None if categories is None else categories.features)
    refuse_first(~(np.abs(samples) <= FARTHEST), samples, f"a number of at most {FARTHEST:g}")
    return samples


def _restored(state: Mapping[str, NDArray[Any]]) -> Categories:
    mean, variance = (np.array(state[name], dtype=np.float64) for name in ("mean", "variance"))
    samples = np.array(state["samples"], dtype=np.int64)
    if mean.ndim != 2 or variance.shape != mean.shape or samples.shape != (len(mean),):
        raise ParameterError(f"state: mean {mean.shape}, variance {variance.shape}, samples {samples.shape}")
    if not (np.isfinite(mean).all() and np.isfinite(variance).all() and (variance > 0).all() and (samples > 0).all()):
        raise ParameterError("state: a mean or variance is not finite, or a variance or count not positive")
    return Categories(mean, variance, samples)


class GaussianART(Grouping[GaussianARTMAP]):
    """Groups samples (N, M) into Gaussians. rule: see GaussianRule; max_iter: epochs of `fit`."""

    def __init__(self, rule: GaussianRule | None = None, *, max_iter: int = 1) -> None:
        self._map = GaussianARTMAP(rule, max_iter=max_iter)

    def state(self) -> dict[str, NDArray[Any]]:
        """What was learnt: mean, variance (J, M), samples (J,)."""
        return {name: array for name, array in self._map.state().items() if name != "stands_for"}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> GaussianART:
        """Take up what `state` of an estimator with the same parameters gave."""
        self._map.restore({**state, "stands_for": np.zeros(len(state["mean"]))}, [ANY])
        return self
