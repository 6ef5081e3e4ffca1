"""Gaussian ART and Gaussian ARTMAP: the estimators (D'Souza, appendix C; Williamson 1996).

Arithmetic and choice are in gaussian.py. Samples may be any numbers up to 1e100; bring features to like scales, since
a new category is equally wide in each.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from daemon.art.coding import as_samples, refuse_first
from daemon.art.errors import NotTrainedError, ParameterError
from daemon.art.gaussian import Categories, GaussianRule, resonating
from daemon.art.labels import Labels
from daemon.art.search import UNCOMMITTED, iterations, one_of

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Prediction = Literal["sum", "winner"]

# Beyond this, squares of distances in standard deviations leave the range of float64.
FARTHEST = 1e100


class GaussianART:
    """Groups samples (N, M) into Gaussians. rule: see GaussianRule; max_iter: epochs of `fit`."""

    def __init__(self, rule: GaussianRule | None = None, *, max_iter: int = 1) -> None:
        self.rule, self.max_iter = rule or GaussianRule(), iterations(max_iter)
        self._categories: Categories | None = None

    @property
    def n_categories(self) -> int:
        return 0 if self._categories is None else len(self._categories)

    def fit(self, X: Any, y: object = None) -> GaussianART:
        """Forget everything and learn X (N, M) in its order, max_iter times over; y is ignored."""
        self._categories = None
        for _ in range(self.max_iter):
            self.learn(X)
        return self

    def partial_fit(self, X: Any, y: object = None) -> GaussianART:
        """Learn X (N, M) on top of what is known."""
        self.learn(X)
        return self

    def learn(self, X: Any) -> Index:
        """As partial_fit; returns the category each sample resonated with while it was learnt, (N,)."""
        samples = _finite_samples(X, self._categories)
        if self._categories is None:
            self._categories = Categories.none(samples.shape[1])
        categories, rule = self._categories, self.rule
        chosen = np.empty(len(samples), dtype=np.int64)
        for number, sample in enumerate(samples):
            node = resonating(categories, sample, rule, lambda _: True)
            chosen[number] = _learnt(categories, node, sample, rule)
        return chosen

    def predict(self, X: Any) -> Index:
        """The most probable category of each sample among those that match, (N,); -1 where none does."""
        categories = _trained(self._categories)
        score, _ = _scores(categories, _finite_samples(X, categories), self.rule)
        node = np.asarray(score.argmax(axis=1), dtype=np.int64)
        node[score.max(axis=1) == -np.inf] = -1
        return node

    def state(self) -> dict[str, NDArray[Any]]:
        """What was learnt: mean, variance (J, M), samples (J,)."""
        return _state(_trained(self._categories))

    def restore(self, state: Mapping[str, NDArray[Any]]) -> GaussianART:
        """Take up what `state` of an estimator with the same parameters gave."""
        self._categories = _restored(state)
        return self


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
        samples = _finite_samples(X, self._categories)
        labels = self._labels.numbers(y, len(samples))
        if self._categories is None:
            self._categories = Categories.none(samples.shape[1])
        for sample, label in zip(samples, labels.tolist(), strict=True):
            self._present(self._categories, sample, label)
        return self

    def _present(self, categories: Categories, sample: Array, label: int) -> None:
        node = resonating(categories, sample, self.rule, lambda node: self._stands_for.item(node) == label)
        if node == UNCOMMITTED:
            self._stands_for = np.append(self._stands_for, label)
        _learnt(categories, node, sample, self.rule)

    def predict(self, X: Any) -> NDArray[Any]:
        """The label of each sample, (N,): of the labels' own type where the rule has no vigilance, else objects with
        None where no category reaches it."""
        return self.predict_with_match(X)[0]

    def predict_with_match(self, X: Any) -> tuple[NDArray[Any], Array]:
        """As predict, and the best match, as the rule has it, of the categories of that label, (N,); -inf for none."""
        categories = _trained(self._categories)
        score, match = _scores(categories, _finite_samples(X, categories), self.rule)
        number = self._label_of(score)
        table = self._labels.table() if self.rule.rho is None else self._labels.object_table()
        own = np.where(self._stands_for == number[:, None], match, -np.inf)
        return np.asarray(table[number]), np.asarray(own.max(axis=1))

    def predict_proba(self, X: Any) -> Array:
        """P(label | sample), (N, L), columns as in `classes`; 0 where no category reaches the vigilance."""
        categories = _trained(self._categories)
        score, _ = _scores(categories, _finite_samples(X, categories), self.rule)
        summed = self._summed(score)
        total = summed.sum(axis=1, keepdims=True)
        return np.asarray(np.divide(summed, total, out=np.zeros_like(summed), where=total > 0.0))

    def forget(self, label: Hashable) -> GaussianARTMAP:
        """Remove a label and its categories; every other category stays as it is. ParameterError if it is not known."""
        number = self._labels.known(label)
        if number is None:
            raise ParameterError(f"forget: no such label as {label!r}; known: {list(self.classes)}")
        kept = self._stands_for != number
        self._categories = _trained(self._categories).at(kept)
        self._labels = Labels(known for known in self._labels.all() if known != self._labels[number])
        self._stands_for = self._stands_for[kept] - (self._stands_for[kept] > number)
        return self

    def state(self) -> dict[str, NDArray[Any]]:
        """What was learnt: mean, variance (J, M), samples (J,), stands_for (J,), the index of a label in `classes`."""
        return {**_state(_trained(self._categories)), "stands_for": self._stands_for.copy()}

    def restore(self, state: Mapping[str, NDArray[Any]], classes: Iterable[Hashable]) -> GaussianARTMAP:
        """Take up what `state` and `classes` of an estimator with the same parameters gave."""
        labels, stands_for = Labels(classes), np.array(state["stands_for"], dtype=np.int64)
        categories = _restored(state)
        if stands_for.shape != (len(categories),) or ((stands_for < 0) | (stands_for >= len(labels))).any():
            raise ParameterError(f"state: stands_for {stands_for.shape} does not fit {len(labels)} labels")
        self._labels, self._stands_for, self._categories = labels, stands_for, categories
        return self

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


def _scores(categories: Categories, samples: Array, rule: GaussianRule) -> tuple[Array, Array]:
    """g, (1.29), of each sample at each category, (N, J), -inf where the match is under the vigilance; the match."""
    density = categories.log_densities(samples)
    match = rule.match(density, categories.log_peak)
    return np.where(match >= rule.baseline, density + categories.log_prior(), -np.inf), match


def _learnt(categories: Categories, node: int, sample: Array, rule: GaussianRule) -> int:
    if node == UNCOMMITTED:
        return categories.commit(sample, rule)
    categories.learn(node, sample, rule)
    return node


def _finite_samples(X: Any, categories: Categories | None) -> Array:
    samples = as_samples(X, None if categories is None else categories.features)
    refuse_first(~(np.abs(samples) <= FARTHEST), samples, f"a number of at most {FARTHEST:g}")
    return samples


def _trained(categories: Categories | None) -> Categories:
    if categories is None or not len(categories):
        raise NotTrainedError("this Gaussian network has not learnt a single sample yet")
    return categories


def _state(categories: Categories) -> dict[str, NDArray[Any]]:
    return {
        "mean": categories.mean.copy(),
        "variance": categories.variance.copy(),
        "samples": categories.samples.copy(),
    }


def _restored(state: Mapping[str, NDArray[Any]]) -> Categories:
    mean, variance = (np.array(state[name], dtype=np.float64) for name in ("mean", "variance"))
    samples = np.array(state["samples"], dtype=np.int64)
    if mean.ndim != 2 or variance.shape != mean.shape or samples.shape != (len(mean),):
        raise ParameterError(f"state: mean {mean.shape}, variance {variance.shape}, samples {samples.shape}")
    if not (np.isfinite(mean).all() and np.isfinite(variance).all() and (variance > 0).all() and (samples > 0).all()):
        raise ParameterError("state: a mean or variance is not finite, or a variance or count not positive")
    return Categories(mean, variance, samples)
