"""Which node each of many samples calls up, when nothing is learnt on the way.

The greatest activation is found in single precision, four times cheaper than exactly; where that leaves more than one
node in the running, and for the activation itself, the exact sums of tests/bench/networks/fuzzy.py decide. The
answer is always the exact one."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Index
from tests.bench.networks.fuzzy import choice, matches, overlaps, sums
from tests.bench.networks.levels import Samples
from tests.bench.networks.nodes import Nodes

Single = NDArray[np.float32]

# Samples looked at together, and (samples, nodes) elements looked at together in single precision.
BLOCK = 1024
PIECE = 32768
# Above this many nodes an index no longer survives the single-precision product that finds it.
MOST_NODES = 1 << 20


@dataclass(frozen=True, eq=False)
class Answers:
    """What N samples called up: node (N,) or -1 for no answer, its activation (N,) and match (N,), both 0 then."""

    node: Index
    activation: Array
    match: Array


def answers(samples: Samples, nodes: Nodes, alpha: float, rho: float) -> Answers:
    """For each sample the node of greatest activation among those whose match is at least rho, the smallest index on
    a tie; none where no node matches."""
    size = sums(samples.coded)
    if samples.levels is not None or len(nodes) > MOST_NODES:
        node = _exactly(samples, nodes, alpha)
    else:
        node = _by_screening(samples, nodes, alpha)
    overlap = _overlap_at(samples.coded, nodes, node)
    wanting = np.flatnonzero(matches(overlap, size) < rho)
    if len(wanting):
        node[wanting] = _exactly(samples.at(wanting), nodes, alpha, rho)
        overlap[wanting] = _overlap_at(samples.coded[wanting], nodes, node[wanting])
    found = node >= 0
    activation = np.where(found, choice(overlap, nodes.size[node], alpha), 0.0)
    return Answers(node, activation, np.where(found, matches(overlap, size), 0.0))


def _overlap_at(coded: Array, nodes: Nodes, node: Index) -> Array:
    return sums(np.minimum(coded, np.take(nodes.weights, node, axis=0)))


def _exactly(samples: Samples, nodes: Nodes, alpha: float, rho: float = 0.0) -> Index:
    """The winner of each sample among the nodes that match, -1 where none does, (B,)."""
    winner = np.empty(len(samples), dtype=np.int64)
    for start, block in samples.blocks(BLOCK):
        overlap = overlaps(block, nodes.weights)
        activation = choice(overlap, nodes.size, alpha)
        if rho > 0.0:
            size = sums(block.coded)
            activation[matches(overlap, np.broadcast_to(size[:, None], overlap.shape)) < rho] = -1.0
        best = activation.argmax(axis=1)
        best[activation[np.arange(len(best)), best] < 0.0] = -1
        winner[start : start + len(best)] = best
    return winner


def _by_screening(samples: Samples, nodes: Nodes, alpha: float) -> Index:
    """As _exactly at rho 0, in single precision as far as that suffices."""
    count, features = nodes.weights.shape
    width = max(1, min(len(samples), PIECE // count))
    coded = np.ascontiguousarray(samples.coded.T, dtype=np.float32)
    # weights and 1 / (alpha + |w|) repeated along the samples: an operand that is not stretched is twice as fast
    weights = np.repeat(nodes.weights.T.astype(np.float32)[:, :, None], width, axis=2)
    scale = choice(np.ones(count), nodes.size, alpha).astype(np.float32)
    scales = np.repeat(scale[:, None], width, axis=1)
    picker = np.stack([np.ones(count), np.arange(count)]).astype(np.float32)
    # every term, sum and product is right to 2^-24 of itself: this much of the greatest covers two activations' errors
    doubt = np.float32(1.0 - 2.0 * (features + 6) * 2.0**-24)
    chosen = np.empty((2, len(samples)), dtype=np.float32)
    for start in range(0, len(samples), width):
        piece = coded[:, start : start + width]
        length = piece.shape[1]
        activation = _activation_in_single(piece, weights[:, :, :length])
        activation *= scales[:, :length]
        running = activation >= activation.max(axis=0) * doubt
        np.matmul(picker, running.astype(np.float32), out=chosen[:, start : start + length])
    winner = np.asarray(chosen[1], dtype=np.int64)
    unclear = np.flatnonzero(chosen[0] != 1.0)
    winner[unclear] = _exactly(samples.at(unclear), nodes, alpha)
    return winner


def _activation_in_single(piece: Single, weights: Single) -> Single:
    total: Single = np.minimum(piece[0], weights[0])
    term = np.empty_like(total)
    for sample, weight in zip(piece[1:], weights[1:], strict=True):
        total += np.minimum(sample, weight, out=term)
    return total
