"""Fuzzy ART: unsupervised grouping of samples (D'Souza, appendix B, first half)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from daemon.arrays import Array
from tests.bench.networks.fuzzy_artmap import FuzzyARTMAP
from tests.bench.networks.grouping import ANY, Grouping
from tests.bench.networks.search import Uncommitted


class FuzzyART(Grouping[FuzzyARTMAP]):
    """Fuzzy ART with fast commitment and slow recoding.

    rho vigilance in [0, 1]; alpha choice parameter >= 0; beta learning rate in (0, 1] (1: fast learning); complement:
    code samples as (a, 1 - a); uncommitted, capacity: see SearchRule; max_iter: epochs of `fit`, fewer once an epoch
    changes nothing. Samples are (N, M) in [0, 1].
    """

    def __init__(
        self,
        rho: float = 0.0,
        alpha: float = 1e-3,
        beta: float = 1.0,
        *,
        complement: bool = True,
        uncommitted: Uncommitted = "last",
        capacity: int | None = None,
        max_iter: int = 1,
    ) -> None:
        self.complement = bool(complement)
        self._map = FuzzyARTMAP(
            rho, alpha, beta, complement=complement, uncommitted=uncommitted, capacity=capacity, max_iter=max_iter
        )

    @property
    def weights(self) -> Array:
        """(J, 2M) complement-coded or (J, M) raw; NotTrainedError before the first sample."""
        return self._map.weights

    def state(self) -> dict[str, Array]:
        """The learnt state: weights (J, F)."""
        return {"weights": self.weights}

    def restore(self, state: Mapping[str, Array]) -> FuzzyART:
        """Restore the `state` of an estimator with the same parameters. ParameterError where it does not match."""
        self._map.restore({**state, "map_counts": np.ones((len(state["weights"]), 1))}, [ANY])
        return self
