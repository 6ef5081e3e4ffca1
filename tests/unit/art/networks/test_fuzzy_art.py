"""Fuzzy ART: vigilance keeps apart what it should."""

from __future__ import annotations

from tests.bench.networks import FuzzyART


def test_fuzzy_art_keeps_apart_what_vigilance_keeps_apart():
    samples = [[0.1, 0.1], [0.12, 0.1], [0.9, 0.9]]
    assert FuzzyART(0.9).fit(samples).predict(samples).tolist() == [0, 0, 1]
    assert FuzzyART(0.0).fit(samples).n_categories == 1
    assert FuzzyART(0.9).fit(samples).predict([[0.5, 0.5]]).tolist() == [-1]
