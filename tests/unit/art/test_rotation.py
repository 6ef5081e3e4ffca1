"""The rotation layer against brute force, and against the thesis's own numbers. Not here: the networks themselves."""

from __future__ import annotations

from itertools import permutations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from daemon.art import best_numbering
from daemon.art.coding import code


def brute_force(matrix, node, alpha, complement, scope="all"):
    """Present every renumbering of the padded matrix, as the thesis does; the greatest activation."""
    slots = len(node)
    padded = np.zeros((slots, slots))
    padded[: len(matrix), : len(matrix)] = matrix
    filled = np.flatnonzero((padded > 0).any(0) | (padded > 0).any(1))
    moving = np.arange(slots) if scope == "all" else filled
    weight = code(node.reshape(1, -1), complement)[0]
    best = 0.0
    for order in permutations(moving.tolist()):
        place = np.arange(slots)
        place[moving] = order
        turned = np.zeros_like(padded)
        turned[np.ix_(place, place)] = padded
        overlap = np.minimum(code(turned.reshape(1, -1), complement)[0], weight).sum()
        best = max(best, overlap / (alpha + weight.sum()) if alpha + weight.sum() else 0.0)
    return best


def matrices(size, tied):
    values = st.sampled_from([0.0, 0.0, 0.3, 0.5, 0.75]) if tied else st.floats(0.0, 1.0)
    return arrays(np.float64, (size, size), elements=values)


@st.composite
def views_and_nodes(draw):
    tied = draw(st.booleans())
    slots = draw(st.integers(1, 6))
    view = draw(matrices(draw(st.integers(1, slots)), tied))
    count = draw(st.integers(1, 2))
    return view, np.stack([draw(matrices(slots, tied)) for _ in range(count)])


@given(views_and_nodes(), st.booleans(), st.sampled_from(["all", "occupied"]))
def test_the_best_numbering_is_the_best_of_all_presented_one_by_one(pair, complement, scope):
    view, nodes = pair
    recall = best_numbering(view, nodes, 0.01, complement, scope)
    for node, activation in zip(nodes, recall.activation, strict=True):
        assert activation == brute_force(view, node, 0.01, complement, scope)
