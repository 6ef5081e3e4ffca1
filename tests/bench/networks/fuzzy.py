"""The arithmetic of Fuzzy ART on arrays (D'Souza, appendix B): overlap, choice, match, learning. No state, no search.

Samples and weights are on the grid of tests/bench/networks/coding.py, so every sum here is exact and has no order: the
ways of computing an overlap below differ in speed alone."""

from collections.abc import Iterator

import numpy as np

from daemon.arrays import Array, Index
from tests.bench.networks.levels import MOST_LEVELS, LevelTerms, Samples

# Intermediate (samples, nodes) tables are worked through in pieces of about this many elements, to stay in cache.
PIECE = 16384
# Stands in for a denominator of 0.
LEAST = float(np.finfo(np.float64).tiny)


def overlaps(samples: Samples, weights: Array, out: Array | None = None, terms: LevelTerms | None = None) -> Array:
    """|I ^ w| of every sample with every node, (1.11) and (1.12): (B, F), (J, F) -> (B, J), written to out if given.

    terms: for samples of few levels, their terms with these weights where the caller keeps them.
    """
    result = np.empty((len(samples), len(weights))) if out is None else out
    if samples.levels is not None and (terms is not None or len(samples) > 2 * MOST_LEVELS):
        tables = (terms or LevelTerms(samples.levels, samples.coded.shape[1])).renewed(weights)
        for rows in _pieces(result):
            _sum_of_levels(tables, samples.place[:, rows], result[rows])
    else:
        by_feature = np.ascontiguousarray(weights.T)
        for rows in _pieces(result):
            _sum_of_minima(samples.coded[rows], by_feature, result[rows])
    return result


def _pieces(table: Array) -> Iterator[slice]:
    rows = max(1, PIECE // max(table.shape[1], 1))
    return (slice(start, start + rows) for start in range(0, len(table), rows))


def _sum_of_minima(coded: Array, weights_by_feature: Array, out: Array) -> None:
    total, term = np.zeros(out.shape), np.empty(out.shape)
    for feature, weight in enumerate(weights_by_feature):
        total += np.minimum(coded[:, feature, None], weight, out=term)
    out[:] = total


def _sum_of_levels(tables: Array, places: Index, out: Array) -> None:
    total, term = (np.zeros((len(out), tables.shape[2])) for _ in range(2))
    for table, place in zip(tables, places, strict=True):
        total += np.take(table, place, axis=0, out=term, mode="clip")
    out[:] = total[:, : out.shape[1]]


def sums(rows: Array) -> Array:
    """|p| of each row, (1.12): (B, F) on the grid -> (B,). As a product, which is faster and, on the grid, as exact."""
    return np.asarray(rows @ np.ones(rows.shape[1]))


def overlap_with_one(samples_by_feature: Array, weight: Array) -> Array:
    """|I ^ w| of every sample with one node: (F, B), (F,) -> (B,)."""
    return np.asarray(np.ones(len(weight)) @ np.minimum(samples_by_feature, weight[:, None]))


def choice(overlap: Array, size: Array | float, alpha: float, out: Array | None = None) -> Array:
    """T = |I ^ w| / (alpha + |w|), (1.10): overlap (..., J), size (J,) = |w| -> (..., J), written to out if given.

    With alpha = 0 an empty node (|w| = 0) would be 0 / 0; it gets 0, the least there is.
    """
    return np.divide(overlap, np.maximum(alpha + size, LEAST), out=out)


def matches(overlap: Array, size: Array) -> Array:
    """|I ^ w| / |I|, (1.15): overlap and size = |I| of one shape. An empty sample (only uncoded) matches entirely."""
    return np.divide(overlap, size, out=np.ones_like(overlap), where=size > 0.0)


def learnt(sample: Array, weight: Array, beta: float, step: float) -> Array:
    """beta (I ^ w) + (1 - beta) w, (1.19), kept on the grid; never above w, so learning only ever shrinks a node."""
    smaller = np.minimum(sample, weight)
    if beta == 1.0:
        return smaller
    return np.asarray(np.rint((beta * smaller + (1.0 - beta) * weight) / step) * step)
