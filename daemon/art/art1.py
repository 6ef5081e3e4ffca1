"""ART 1: groups binary patterns (D'Souza, appendix A). Used by `facetctl thesis silhouettes` alone."""

from __future__ import annotations

from typing import Any

import numpy as np

from daemon.arrays import Array, Index
from daemon.art.errors import InputError, ParameterError, within


class ART1:
    """ART 1 with fast learning; an uncommitted node competes with initial weights of L / (L - 1 + M), the upper limit.

    rho: vigilance in [0, 1]; L: bottom-up parameter > 1, a small one prefers what is contained in the pattern;
    capacity: most F2 nodes, None: no limit. Patterns are (N, M) of 0 and 1, none of them empty. top_down z (J, M):
    what each node expects. Raises InputError, ParameterError.
    """

    def __init__(self, rho: float = 0.4, L: float = 2.0, capacity: int | None = None) -> None:
        if not (np.isfinite(L) and L > 1.0):
            raise ParameterError(f"L: expected a number above 1, found {L!r}")
        if capacity is not None and capacity < 1:
            raise ParameterError(f"capacity: expected at least 1 node, found {capacity!r}")
        within("rho", rho, 0.0, 1.0)
        self.rho, self.L, self.capacity = rho, L, capacity
        self.top_down: Array = np.empty((0, 0))

    def learn(self, X: Any) -> Index:
        """Learn the patterns in their order; the node of each, (N,), -2 where none fits and all are committed."""
        return np.array([self._present(pattern) for pattern in self._patterns(X)], dtype=np.int64)

    def predict(self, X: Any) -> Index:
        """The node of each pattern, (N,), -1 where none meets the vigilance."""
        return np.array([self._resonating(pattern)[0] for pattern in self._patterns(X)], dtype=np.int64)

    def _present(self, pattern: Array) -> int:
        node, activation = self._resonating(pattern)
        if self.capacity is None or len(self.top_down) < self.capacity:
            if node < 0 or activation < pattern.sum() / (self.L - 1.0 + len(pattern)):
                self.top_down = np.vstack([self.top_down.reshape(-1, len(pattern)), pattern])
                return len(self.top_down) - 1
        elif node < 0:
            return -2
        self.top_down[node] = np.minimum(self.top_down[node], pattern)
        return node

    def _resonating(self, pattern: Array) -> tuple[int, float]:
        """The node of greatest activation T / L, (1.2), that meets the vigilance, and T / L; -1 where none does."""
        if not len(self.top_down):
            return -1, 0.0
        overlap = self.top_down @ pattern
        fits = (overlap > 0.0) & (overlap / pattern.sum() >= self.rho)
        activation = np.where(fits, overlap / (self.L - 1.0 + self.top_down.sum(axis=1)), -1.0)
        node = int(activation.argmax())
        return (node, float(activation[node])) if fits[node] else (-1, 0.0)

    def _patterns(self, X: Any) -> Array:
        patterns = np.asarray(X, dtype=np.float64)
        if patterns.ndim != 2 or (len(self.top_down) and patterns.shape[1] != self.top_down.shape[1]):
            raise InputError(f"samples: expected (N, M), as wide as those learnt, found shape {patterns.shape}")
        if not np.isin(patterns, (0.0, 1.0)).all():
            raise InputError("samples: expected 0 or 1 in each place")
        if not patterns.any(axis=1).all():
            raise InputError(f"samples: row {int(patterns.any(axis=1).argmin())} is empty: there is nothing to match")
        return patterns
