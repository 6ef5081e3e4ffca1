"""ART 1: groups binary patterns (D'Souza, appendix A).

On 0 and 1 it equals uncoded Fuzzy ART with alpha = L - 1 and fast learning, T being L times that of Fuzzy ART;
therefore it is implemented by that network.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from daemon.art.arrays import Array
from daemon.art.errors import InputError, ParameterError, within
from daemon.art.others.coding import as_unit_samples, refuse_first
from daemon.art.others.fuzzy import LEAST
from daemon.art.others.fuzzy_artmap import FuzzyARTMAP
from daemon.art.others.grouping import ANY, Grouping
from daemon.art.others.search import Uncommitted


class ART1(Grouping[FuzzyARTMAP]):
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
        within("rho", rho, 0.0, 1.0)
        self.L = float(L)
        # (1.2): a node that shares nothing with the pattern is not chosen, so a vigilance of 0 is the least above it
        self._map = FuzzyARTMAP(
            max(rho, LEAST), L - 1.0, complement=False, uncommitted=uncommitted, capacity=capacity, max_iter=max_iter
        )

    @property
    def top_down(self) -> Array:
        """z, (J, M) of 0 and 1: what each node expects."""
        return self._map.weights

    @property
    def bottom_up(self) -> Array:
        """Z = L z / (L - 1 + |z|), (1.8), (J, M)."""
        z = self.top_down
        return np.asarray(self.L * z / (self.L - 1.0 + z.sum(axis=1, keepdims=True)))

    def state(self) -> dict[str, Array]:
        """The learnt state: top_down (J, M)."""
        return {"top_down": self.top_down}

    def restore(self, state: Mapping[str, Array]) -> ART1:
        """Restore the `state` of an ART1 with the same parameters."""
        top_down = self._samples(state["top_down"])
        self._map.restore({"weights": top_down, "map_counts": np.ones((len(top_down), 1))}, [ANY])
        return self

    def _samples(self, X: Any) -> Array:
        patterns = as_unit_samples(X)
        refuse_first((patterns != 0.0) & (patterns != 1.0), patterns, "0 or 1")
        empty = np.flatnonzero(~patterns.any(axis=1))
        if len(empty):
            raise InputError(f"samples: row {empty[0]} is empty: there is nothing to match")
        return patterns
