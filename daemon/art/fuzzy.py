"""The arithmetic of Fuzzy ART on arrays (D'Souza, appendix B): overlap, choice, learning. No state, no search.

Samples and weights are on the grid of daemon/art/coding.py, so every sum here is exact and has no order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Intermediate (samples, nodes) tables are worked through in pieces of about this many elements, to stay in cache.
PIECE = 16384


def overlaps(samples: Array, weights: Array) -> Array:
    """|I ^ w| of every sample with every node, (1.11) and (1.12): (B, F), (J, F) -> (B, J)."""
    result = np.zeros((len(samples), len(weights)))
    if result.size == 0:
        return result
    by_feature = np.ascontiguousarray(weights.T)
    rows = max(1, PIECE // len(weights))
    for start in range(0, len(samples), rows):
        block = samples[start : start + rows]
        total = result[start : start + rows]
        smaller = np.empty_like(total)
        for feature, weight in enumerate(by_feature):
            np.minimum(block[:, feature, None], weight, out=smaller)
            total += smaller
    return result


def overlap_with_one(samples_by_feature: Array, weight: Array) -> Array:
    """|I ^ w| of every sample with one node: (F, B), (F,) -> (B,)."""
    return np.asarray(np.minimum(samples_by_feature, weight[:, None]).sum(axis=0))


def choice(overlap: Array, size: Array, alpha: float) -> Array:
    """T = |I ^ w| / (alpha + |w|), (1.10): overlap (..., J), size (J,) = |w| -> (..., J).

    With alpha = 0 an empty node (|w| = 0) would be 0 / 0; it gets 0, the least there is.
    """
    return np.divide(overlap, alpha + size, out=np.zeros_like(overlap), where=(alpha + size) > 0.0)


def matches(overlap: Array, size: Array) -> Array:
    """|I ^ w| / |I|, (1.15): overlap and size = |I| of one shape. An empty sample (only uncoded) matches entirely."""
    return np.divide(overlap, size, out=np.ones_like(overlap), where=size > 0.0)


def learnt(sample: Array, weight: Array, beta: float, step: float) -> Array:
    """beta (I ^ w) + (1 - beta) w, (1.19), kept on the grid; never above w, so learning only ever shrinks a node."""
    smaller = np.minimum(sample, weight)
    if beta == 1.0:
        return smaller
    return np.asarray(np.rint((beta * smaller + (1.0 - beta) * weight) / step) * step)
