"""Presenting samples to Fuzzy ART nodes one after the other, with the work of many done at once.

Samples are taken in blocks. The overlaps of a block with all nodes are computed together; when a presentation changes
a node, only that node's column is renewed for the rest of the block. Stretches of samples that change nothing are
passed over together. Sums are exact (daemon/art/coding.py), so the outcome is that of one presentation at a time, to
the last bit, whatever the block length.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daemon.art.fuzzy import choice, learnt, matches, overlap_with_one, overlaps
from daemon.art.nodes import Nodes
from daemon.art.search import SKIPPED, UNCOMMITTED, SearchRule, find_node

Array = NDArray[np.float64]
Index = NDArray[np.int64]

BLOCK = 128


def present(nodes: Nodes, samples: Array, labels: Index, rule: SearchRule, beta: float, step: float) -> Index:
    """Teach coded samples (N, F) with label numbers (N,), in order; nodes change in place.

    Returns the node each sample ended on, (N,), SKIPPED where a contradiction was left unlearnt.
    """
    chosen = np.empty(len(samples), dtype=np.int64)
    for start in range(0, len(samples), BLOCK):
        stop = min(start + BLOCK, len(samples))
        block = _Block(nodes, samples[start:stop], labels[start:stop], rule, beta, step)
        chosen[start:stop] = block.run()
    return chosen


class _Block:
    """One block of samples on its way through: overlap and activation tables (B, J), kept current as nodes change."""

    def __init__(self, nodes: Nodes, samples: Array, labels: Index, rule: SearchRule, beta: float, step: float) -> None:
        self.nodes, self.samples, self.labels = nodes, samples, labels
        self.rule, self.beta, self.step = rule, beta, step
        self.by_feature = np.ascontiguousarray(samples.T)
        self.size = samples.sum(axis=1)
        self.floor = np.array([rule.uncommitted_activation(float(size), nodes.features) for size in self.size])
        known = len(nodes)
        self.overlap = np.zeros((len(samples), known + len(samples)))
        self.overlap[:, :known] = overlaps(samples, nodes.weights)
        self.activation = np.zeros_like(self.overlap)
        self.activation[:, :known] = choice(self.overlap[:, :known], nodes.size, rule.alpha)

    def run(self) -> Index:
        """Present every sample; the stretch looked at together doubles while nothing happens."""
        chosen = np.empty(len(self.samples), dtype=np.int64)
        row, stretch = 0, 1
        while row < len(self.samples):
            stop = min(row + stretch, len(self.samples))
            quiet = self._quiet(row, stop) if stretch > 1 and len(self.nodes) else chosen[:0]
            chosen[row : row + len(quiet)] = quiet
            row += len(quiet)
            if row < stop:
                chosen[row] = self._present_one(row)
                row += 1
            stretch = min(2 * stretch, BLOCK) if row == stop else 1
        return chosen

    def _quiet(self, row: int, stop: int) -> Index:
        """The winners of the samples from row on, up to the first that would change a weight or start a search."""
        winner = self.activation[row:stop, : len(self.nodes)].argmax(axis=1)
        rows = np.arange(row, stop)
        overlap, label = self.overlap[rows, winner], self.labels[row:stop]
        quiet = self.nodes.agrees(winner, label, self.rule.map_vigilance)
        quiet &= overlap >= self.nodes.size[winner]
        quiet &= matches(overlap, self.size[row:stop]) >= self.rule.rho
        quiet &= self.activation[rows, winner] >= self.floor[row:stop]
        count = len(quiet) if quiet.all() else int(quiet.argmin())
        self.nodes.count(winner[:count], label[:count])
        return np.asarray(winner[:count], dtype=np.int64)

    def _present_one(self, row: int) -> int:
        count, label = len(self.nodes), int(self.labels[row])
        node = find_node(
            self.activation[row, :count],
            self.overlap[row, :count],
            float(self.size[row]),
            self.rule,
            float(self.floor[row]),
            lambda candidate: bool(self.nodes.agrees(candidate, label, self.rule.map_vigilance)),
        )
        if node == SKIPPED:
            return node
        if node == UNCOMMITTED:
            node = self.nodes.commit(self.samples[row])
            self._renew(node, row)
        elif self.overlap[row, node] < self.nodes.size[node]:
            weight = self.nodes.weights[node]
            self.nodes.set_weight(node, learnt(self.samples[row], weight, self.beta, self.step))
            self._renew(node, row)
        self.nodes.count(node, label)
        return node

    def _renew(self, node: int, row: int) -> None:
        """Bring a changed node's column up to date for the samples after row."""
        overlap = overlap_with_one(self.by_feature[:, row + 1 :], self.nodes.weights[node])
        self.overlap[row + 1 :, node] = overlap
        self.activation[row + 1 :, node] = choice(overlap, self.nodes.size[node], self.rule.alpha)
