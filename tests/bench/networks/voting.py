"""Voting: several networks taught the same samples in different orders, and what most of them say.

ART networks depend on the order of presentation; Carpenter et al. (1992) let several vote. Works with any network of
this package that has fit, partial_fit and predict.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from daemon.art.errors import InputError, ParameterError
from tests.bench.networks.errors import NotTrainedError
from tests.bench.networks.labels import Labels


class Voter(Protocol):
    """What a network must offer to vote."""

    def partial_fit(self, X: Any, y: Any) -> Any: ...

    def predict(self, X: Any) -> NDArray[Any]: ...


class Voting:
    """`voters` networks from `make()`, each taught in an order of its own drawn from `seed`.

    Most votes win; on a tie the label of the earliest voter among those tied. Abstentions do not count; where all
    abstain, so does the vote (None).
    """

    def __init__(self, make: Callable[[], Voter], voters: int = 5, seed: int = 0) -> None:
        if voters < 1:
            raise ParameterError(f"voters: expected at least 1, found {voters!r}")
        self.make, self.voters, self.seed = make, voters, seed
        self.networks: tuple[Voter, ...] = ()

    def fit(self, X: Any, y: Any) -> Voting:
        """Teach every voter X (N, M) with labels y (N,) in its own order."""
        self.networks = tuple(self.make() for _ in range(self.voters))
        self._orders = np.random.default_rng(self.seed)
        return self.partial_fit(X, y)

    def partial_fit(self, X: Any, y: Any) -> Voting:
        """Teach every voter more, again each in an order of its own."""
        if not self.networks:
            return self.fit(X, y)
        samples, labels = np.asarray(X), list(y)
        if len(samples) != len(labels):
            raise InputError(f"labels: expected one a sample ({len(samples)}), found {len(labels)}")
        for network in self.networks:
            order = self._orders.permutation(len(labels))
            network.partial_fit(samples[order], [labels[k] for k in order])
        return self

    def votes(self, X: Any) -> NDArray[Any]:
        """What each voter says of each sample, (voters, N) objects, None for an abstention."""
        if not self.networks:
            raise NotTrainedError("this vote has not been taught a single sample yet")
        said = [network.predict(X).tolist() for network in self.networks]
        votes = np.empty((len(said), len(said[0])), dtype=object)
        for voter, labels in enumerate(said):
            for sample, label in enumerate(labels):
                votes[voter, sample] = label
        return votes

    def predict(self, X: Any) -> NDArray[Any]:
        """The label most voters give each sample, (N,) objects, None where all abstain."""
        votes = self.votes(X)
        winners = np.empty(votes.shape[1], dtype=object)
        for sample, said in enumerate(votes.T.tolist()):
            winners[sample] = _most_common(said)
        return winners


def _most_common(said: list[Hashable]) -> Hashable:
    """The label said most often, the one said first on a tie, None where nothing was said."""
    labels = Labels(label for label in said if label is not None)
    counts = [said.count(label) for label in labels.all()]
    return labels[int(np.argmax(counts))] if counts else None
