"""The arithmetic of Fuzzy ART on arrays (D'Souza, appendix B): overlap, choice, match, learning. No state, no search.

Samples and weights are on the grid of daemon/art/coding.py, so every sum here is exact and has no order: the ways of
computing an overlap below differ in speed alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Intermediate (samples, nodes) tables are worked through in pieces of about this many elements, to stay in cache.
PIECE = 16384
# A feature of more distinct values than this is not worth a table of them.
MOST_LEVELS = 32
# Stands in for a denominator of 0.
LEAST = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True, eq=False)
class Samples:
    """Coded samples (N, F), and where every feature takes few values, which (levels) and where (place, (N,) each).

    With complement coding a feature and its complement share their places: there are F / 2 of either, else F.
    """

    coded: Array
    levels: tuple[Array, ...] = ()
    place: tuple[Index, ...] = ()

    @classmethod
    def of(cls, coded: Array, complement: bool) -> Samples:
        """Look for few values in each feature; type numbers and digitised measures have them, measured ones do not."""
        features = coded[:, : coded.shape[1] // 2] if complement else coded
        if len(coded) < 4 * MOST_LEVELS or _most_levels(features[: 4 * MOST_LEVELS]) > MOST_LEVELS:
            return cls(coded)
        levels = tuple(np.unique(feature) for feature in features.T)
        if max(len(level) for level in levels) > MOST_LEVELS:
            return cls(coded)
        return cls(coded, levels, tuple(np.searchsorted(lv, f) for lv, f in zip(levels, features.T, strict=True)))

    def __len__(self) -> int:
        return len(self.coded)

    def cut(self, start: int, stop: int) -> Samples:
        """Samples start to stop."""
        return Samples(self.coded[start:stop], self.levels, tuple(place[start:stop] for place in self.place))

    def at(self, rows: Index) -> Samples:
        """The samples in these rows."""
        return Samples(self.coded[rows], self.levels, tuple(place[rows] for place in self.place))

    def blocks(self, length: int) -> Iterator[tuple[int, Samples]]:
        """Where each block of at most `length` samples starts, and the block."""
        for start in range(0, len(self), length):
            yield start, self.cut(start, start + length)


def _most_levels(features: Array) -> int:
    return int((np.diff(np.sort(features, axis=0), axis=0) > 0.0).sum(axis=0).max()) + 1


def overlaps(samples: Samples, weights: Array, out: Array | None = None) -> Array:
    """|I ^ w| of every sample with every node, (1.11) and (1.12): (B, F), (J, F) -> (B, J), written to out if given."""
    result = np.empty((len(samples), len(weights))) if out is None else out
    if samples.levels and len(samples) > 2 * MOST_LEVELS:
        terms = _terms_by_level(samples.levels, weights)
        for rows in _pieces(result):
            _sum_of_levels(terms, [place[rows] for place in samples.place], result[rows])
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


def _terms_by_level(levels: tuple[Array, ...], weights: Array) -> list[Array]:
    """What each level of each feature, with its complement if coded so, overlaps with each node: (levels, J) each."""
    terms = [np.minimum(level[:, None], weights[:, i]) for i, level in enumerate(levels)]
    if weights.shape[1] == 2 * len(levels):
        for i, level in enumerate(levels):
            terms[i] += np.minimum(1.0 - level[:, None], weights[:, len(levels) + i])
    return terms


def _sum_of_levels(terms: list[Array], places: list[Index], out: Array) -> None:
    total, term = np.zeros(out.shape), np.empty(out.shape)
    for of_feature, place in zip(terms, places, strict=True):
        total += np.take(of_feature, place, axis=0, out=term, mode="clip")
    out[:] = total


def sums(rows: Array) -> Array:
    """|p| of each row, (1.12): (B, F) on the grid -> (B,). As a product, which is faster and, on the grid, as exact."""
    return np.asarray(rows @ np.ones(rows.shape[1]))


def overlap_with_one(samples_by_feature: Array, weight: Array) -> Array:
    """|I ^ w| of every sample with one node: (F, B), (F,) -> (B,)."""
    return np.asarray(np.minimum(samples_by_feature, weight[:, None]).sum(axis=0))


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
