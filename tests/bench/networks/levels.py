"""Coded samples, and the shortcut for those whose features take few values: type numbers, digitised measures.

What a level of a feature overlaps with a node's weight is then looked up instead of worked out for every sample. The
sums themselves are in tests/bench/networks/fuzzy.py; being exact, they are the same either way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from daemon.arrays import Array, Index

# A feature of more distinct values than this is not worth a table of them.
MOST_LEVELS = 32
# Tables are made wider by so many nodes at a time.
SPARE = 64


@dataclass(frozen=True, eq=False)
class Samples:
    """Coded samples (N, F), and where every feature takes few values, which: levels (M, L), rows filled up with their
    last value, and place (M, N), where in its row each sample is. With complement coding M is F / 2, a feature and its
    complement sharing their places; else F. levels is None where a feature takes many values."""

    coded: Array
    levels: Array | None
    place: Index

    @classmethod
    def of(cls, coded: Array, complement: bool) -> Samples:
        """Look for few values in each feature."""
        features = coded[:, : coded.shape[1] // 2] if complement else coded
        perhaps = len(coded) >= 4 * MOST_LEVELS and _most_levels(features[: 4 * MOST_LEVELS]) <= MOST_LEVELS
        found = [np.unique(feature) for feature in features.T] if perhaps else []
        longest = max(map(len, found), default=MOST_LEVELS + 1)
        if longest > MOST_LEVELS:
            return cls(coded, None, np.empty((0, len(coded)), dtype=np.int64))
        levels = np.stack([np.pad(row, (0, longest - len(row)), mode="edge") for row in found])
        place = np.stack([np.searchsorted(row, feature) for row, feature in zip(found, features.T, strict=True)])
        return cls(coded, levels, place.astype(np.int64))

    def __len__(self) -> int:
        return len(self.coded)

    def cut(self, start: int, stop: int) -> Samples:
        """Samples start to stop."""
        return Samples(self.coded[start:stop], self.levels, self.place[:, start:stop])

    def at(self, rows: Index) -> Samples:
        """The samples in these rows."""
        return Samples(self.coded[rows], self.levels, self.place[:, rows])

    def blocks(self, length: int) -> Iterator[tuple[int, Samples]]:
        """Where each block of at most `length` samples starts, and the block."""
        for start in range(0, len(self), length):
            yield start, self.cut(start, start + length)


def _most_levels(features: Array) -> int:
    return int((np.diff(np.sort(features, axis=0), axis=0) > 0.0).sum(axis=0).max()) + 1


class LevelTerms:
    """What each level of each feature (with its complement, if coded so) overlaps with each node; kept up to date."""

    def __init__(self, levels: Array, features: int) -> None:
        self.levels, self.complement = levels[:, :, None], features == 2 * len(levels)
        self._tables = np.zeros((*levels.shape, 0))
        self._stale: set[int] = set()

    def changed(self, node: int) -> None:
        """Note that a node's weight is new."""
        self._stale.add(node)

    def renewed(self, weights: Array) -> Array:
        """The terms with weights (J, F), (M, L, J or more): worked out for the nodes that are new or have changed."""
        if len(weights) > self._tables.shape[2]:
            self._tables = np.zeros((*self._tables.shape[:2], len(weights) + SPARE))
            self._tables[:, :, : len(weights)] = self._terms(weights)
        elif self._stale:
            nodes = np.array(sorted(self._stale), dtype=np.int64)
            self._tables[:, :, nodes] = self._terms(weights[nodes])
        self._stale.clear()
        return self._tables

    def _terms(self, weights: Array) -> Array:
        of_features = np.ascontiguousarray(weights.T)[:, None, :]
        terms = np.minimum(self.levels, of_features[: len(self.levels)])
        if self.complement:
            terms += np.minimum(1.0 - self.levels, of_features[len(self.levels) :])
        return terms
