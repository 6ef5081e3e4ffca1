"""Presenting samples to Fuzzy ART nodes one after the other, with the work of many done at once.

Samples are taken in blocks. The overlaps of a block with all nodes are computed together; when a presentation changes
a node, only that node's column is renewed for the rest of the block. Stretches of samples that change nothing are
passed over together. Sums are exact (tests/bench/networks/coding.py), so the outcome is that of one presentation at a
time, to the last bit, whatever the block length."""

import numpy as np

from daemon.arrays import Index
from tests.bench.networks.fuzzy import LEAST, choice, learnt, matches, overlap_with_one, overlaps, sums
from tests.bench.networks.levels import LevelTerms, Samples
from tests.bench.networks.nodes import Nodes
from tests.bench.networks.search import SKIPPED, UNCOMMITTED, SearchRule, find_node

BLOCK = 128
# From this many uneventful samples in a row on, looking at a stretch together beats looking at each.
SHORT = 6


def present(nodes: Nodes, samples: Samples, labels: Index, rule: SearchRule, beta: float, step: float) -> Index:
    """Teach coded samples (N, F) with label numbers (N,), in order; nodes change in place.

    Returns the node each sample ended on, (N,), SKIPPED where a contradiction was left unlearnt.
    """
    chosen = np.empty(len(samples), dtype=np.int64)
    lesson = _Lesson(nodes, rule, beta, step)
    for start, block in samples.blocks(BLOCK):
        lesson.open(block, labels[start : start + BLOCK])
        lesson.run(chosen[start : start + BLOCK])
    return chosen


class _Lesson:
    """The nodes being taught, and the tables of the block at hand, kept current as nodes change.

    overlap and activation (BLOCK, room): sample by node; made once and grown with the nodes. calm: how many samples
    usually pass between two that change something.
    """

    def __init__(self, nodes: Nodes, rule: SearchRule, beta: float, step: float) -> None:
        self.nodes, self.rule, self.beta, self.step = nodes, rule, beta, step
        self.overlap = self.activation = np.empty((0, 0))
        self.terms: LevelTerms | None = None
        self.calm = 0.0

    def open(self, block: Samples, labels: Index) -> None:
        """Take up a block of samples (B, F) with labels (B,): what each calls up in the nodes as they are now."""
        known = len(self.nodes)
        if self.overlap.shape[1] < known + BLOCK:
            self.overlap = np.empty((BLOCK, 2 * (known + BLOCK)))
            self.activation = np.empty_like(self.overlap)
        self.samples, self.labels = block.coded, labels
        self.by_feature = np.ascontiguousarray(block.coded.T)
        self.size = sums(block.coded)
        self.floor = self.rule.uncommitted_activation(self.size, self.nodes.features, known)
        if block.levels is not None and self.terms is None:
            self.terms = LevelTerms(block.levels, self.nodes.features)
        overlap = overlaps(block, self.nodes.weights, self.overlap[: len(block), :known], self.terms)
        choice(overlap, self.nodes.size, self.rule.alpha, out=self.activation[: len(block), :known])

    def run(self, chosen: Index) -> None:
        """Present every sample of the block in order, filling chosen (B,) with the node each ended on."""
        row, uneventful = 0, 0
        while row < len(chosen):
            if max(self.calm, uneventful) >= SHORT:
                stop = min(row + 2 * int(max(self.calm, uneventful)), len(chosen))
                quiet = self._quiet(row, stop)
                chosen[row : row + len(quiet)] = quiet
                row += len(quiet)
                uneventful += len(quiet)
                if row == stop:
                    continue
            chosen[row], changed = self._present_one(row)
            row += 1
            uneventful += 1
            if changed:
                self.calm, uneventful = 0.5 * (self.calm + uneventful), 0

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

    def _present_one(self, row: int) -> tuple[int, bool]:
        """Present one sample: the node it ended on, and whether that changed a weight."""
        nodes, label = self.nodes, self.labels.item(row)
        count, size, floor = len(nodes), self.size.item(row), self.floor.item(row)
        overlap = self.overlap[row, :count]
        node = find_node(self.activation[row, :count], overlap, size, floor, self.rule, nodes, label)
        if node == UNCOMMITTED and self.rule.full(count):
            node = SKIPPED
        if node == SKIPPED:
            return node, False
        changed = node == UNCOMMITTED or overlap.item(node) < nodes.size.item(node)
        if changed:
            node = self._learn(row, node)
        nodes.count_one(node, label)
        return node, changed

    def _learn(self, row: int, node: int) -> int:
        """Commit a node for the sample or draw the chosen one towards it; bring its column up to date from there on."""
        weight, size = self.samples[row], self.size.item(row)
        if node == UNCOMMITTED:
            node = self.nodes.commit(weight, size)
            self.floor = self.rule.uncommitted_activation(self.size, self.nodes.features, len(self.nodes))
        else:
            weight = learnt(weight, self.nodes.weights[node], self.beta, self.step)
            size = self.overlap.item(row, node) if self.beta == 1.0 else float(weight.sum())
            self.nodes.set_weight(node, weight, size)
        if self.terms is not None:
            self.terms.changed(node)
        overlap = overlap_with_one(self.by_feature[:, row + 1 :], weight)
        after = slice(row + 1, len(self.samples))
        self.overlap[after, node] = overlap
        self.activation[after, node] = overlap / max(self.rule.alpha + size, LEAST)
        return node
