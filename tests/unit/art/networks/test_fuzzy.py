"""The arithmetic of Fuzzy ART: every way of computing an overlap gives the same."""

from __future__ import annotations

import numpy as np

from tests.bench.networks import FuzzyARTMAP


def test_tables_of_levels_give_what_plain_sums_give():
    rng = np.random.default_rng(7)
    samples, labels = rng.integers(0, 16, (600, 5)) / 15.0, rng.integers(0, 4, 600)
    levelled = FuzzyARTMAP().fit(samples, labels)
    plain = FuzzyARTMAP()
    for start in range(0, 600, 50):
        plain.partial_fit(samples[start : start + 50], labels[start : start + 50])
    assert levelled.weights.tobytes() == plain.weights.tobytes()
