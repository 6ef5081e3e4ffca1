"""ARTMAP as the thesis draws it: ART-a on the samples, ART-b on coded objects, a map field between (D'Souza, app. B).

Composition only: ART-a with its map field is FuzzyARTMAP with ART-b's categories as labels. With plain labels
FuzzyARTMAP alone is sufficient.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from daemon.arrays import Array
from daemon.art.errors import InputError
from tests.bench.networks.fuzzy_art import FuzzyART
from tests.bench.networks.fuzzy_artmap import FuzzyARTMAP


class ARTMAP:
    """art_a learns which category of art_b goes with each sample.

    art_b is usually vigilant (rho = 1): every binary object code is then a category of its own.
    """

    def __init__(self, art_a: FuzzyARTMAP, art_b: FuzzyART) -> None:
        self.art_a, self.art_b = art_a, art_b

    def partial_fit(self, X: Any, Y: Any) -> ARTMAP:
        """Learn samples X (N, M) with object codes Y (N, K), both in [0, 1], in addition to those learnt."""
        codes = np.asarray(Y, dtype=np.float64)
        if codes.ndim != 2 or len(codes) != len(X):
            raise InputError(f"codes: expected one row a sample ({len(X)}), found shape {codes.shape}")
        self.art_a.partial_fit(X, self.art_b.learn(codes))
        return self

    def predict(self, X: Any) -> Array:
        """The code (N, K) predicted for each sample: the weights of its ART-b category; a row of nan where it
        abstains."""
        weights = self.art_b.weights
        codes = weights[:, : weights.shape[1] // 2] if self.art_b.complement else weights
        nothing = np.full((1, codes.shape[1]), np.nan)
        category = [-1 if label is None else int(label) for label in self.art_a.predict(X)]
        return np.vstack([codes, nothing])[category]
