"""Groups instead of labels: a network that learns labels, told the same one of every sample.

Its map field then agrees always, and vigilance alone decides which samples go together.
"""

from typing import Any, Generic, Protocol, Self, TypeVar

from daemon.arrays import Array, Index
from tests.bench.networks.coding import as_samples
from tests.bench.networks.winners import Answers

ANY = 0
"""The label of every sample."""


class Network(Protocol):
    """What a network that learns labels must offer to group."""

    @property
    def n_categories(self) -> int: ...

    def fit(self, X: Any, y: Any) -> object: ...

    def learn(self, X: Any, y: Any) -> Index: ...

    def recall(self, X: Any) -> Answers: ...


Labelling = TypeVar("Labelling", bound=Network)


class Grouping(Generic[Labelling]):
    """What Fuzzy ART and Gaussian ART share. Samples are (N, M)."""

    _map: Labelling

    @property
    def n_categories(self) -> int:
        return self._map.n_categories

    def fit(self, X: Any, y: object = None) -> Self:
        """Forget everything and learn the samples in their order, up to max_iter times over; y is ignored."""
        samples = self._samples(X)
        self._map.fit(samples, [ANY] * len(samples))
        return self

    def partial_fit(self, X: Any, y: object = None) -> Self:
        """Learn samples on top of what is known; the categories they ended on are `predict(X)`'s business."""
        self.learn(X)
        return self

    def learn(self, X: Any) -> Index:
        """As partial_fit; returns the category each sample ended on, (N,), -2 where there was no room for one."""
        samples = self._samples(X)
        return self._map.learn(samples, [ANY] * len(samples))

    def predict(self, X: Any) -> Index:
        """The category each sample calls up, (N,); -1 where none meets the vigilance."""
        return self._map.recall(self._samples(X)).node

    def _samples(self, X: Any) -> Array:
        return as_samples(X)
