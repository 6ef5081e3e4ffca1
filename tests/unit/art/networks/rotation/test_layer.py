"""The rotation layer against brute force: values, ties, scopes, many facets. Not here: the thesis's own figures."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from daemon.art import InputError, ParameterError
from tests.bench.networks import RotationLayer, best_numbering
from tests.bench.networks.coding import code
from tests.bench.networks.rotation import numberings


def turned(matrix, place, slots):
    """The matrix with facet p in slot place[p]."""
    result = np.zeros((slots, slots))
    result[np.ix_(place, place)] = matrix
    return result


def presented(matrix, node, place, alpha, complement):
    """The activation of one numbering, by the textbook."""
    weight = code(node.reshape(1, -1), complement)[0]
    overlap = np.minimum(code(turned(matrix, place, len(node)).reshape(1, -1), complement)[0], weight).sum()
    return overlap / (alpha + weight.sum()) if alpha + weight.sum() else 0.0


def brute_force(matrix, node, alpha, complement, scope="all"):
    """Present every renumbering of the padded matrix, as the thesis does; the greatest activation."""
    slots = len(node)
    padded = turned(matrix, np.arange(len(matrix)), slots)
    filled = np.flatnonzero((padded > 0).any(0) | (padded > 0).any(1))
    moving = np.arange(slots) if scope == "all" else filled
    best = 0.0
    for order in permutations(moving.tolist()):
        place = np.arange(slots)
        place[moving] = order
        best = max(best, presented(padded, node, place, alpha, complement))
    return best


def matrices(size, tied):
    values = st.sampled_from([0.0, 0.0, 0.3, 0.5, 0.75]) if tied else st.floats(0.0, 1.0)
    return arrays(np.float64, (size, size), elements=values)


@st.composite
def views_and_nodes(draw, nodes=2):
    tied = draw(st.booleans())
    slots = draw(st.integers(1, 6))
    view = draw(matrices(draw(st.integers(1, slots)), tied))
    count = draw(st.integers(1, nodes))
    return view, np.stack([draw(matrices(slots, tied)) for _ in range(count)])


def relation(rng, facets, slots, types=(0.3, 0.5, 0.75), share=0.6):
    """A relation matrix as views give them: the type of facet r in row r, where r and c touch."""
    touching = np.triu(rng.random((facets, facets)) < share, 1)
    types = rng.choice(types, facets)
    return turned(np.where(touching | touching.T, types[:, None], 0.0), np.arange(facets), slots)


@settings(deadline=None, max_examples=60)
@given(views_and_nodes(), st.booleans(), st.sampled_from(["all", "occupied"]), st.booleans())
def test_the_best_numbering_is_the_best_of_all_presented_one_by_one(pair, complement, scope, branching):
    view, nodes = pair
    with pytest.MonkeyPatch.context() as patch:
        if branching:
            patch.setattr(numberings, "LONGEST_TABLE", 0)
        recall = best_numbering(view, nodes, 0.01, complement, scope)
    for node, activation, place in zip(nodes, recall.activation, recall.numbering, strict=True):
        assert activation == brute_force(view, node, 0.01, complement, scope)
        assert activation == presented(view, node, place, 0.01, complement)
        assert len(set(place.tolist())) == len(view)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6), st.booleans(), st.integers(1, 3), st.booleans())
def test_the_best_nodes_are_the_same_whether_all_are_looked_into_or_not(seed, complement, top, wide):
    rng = np.random.default_rng(seed)
    nodes = np.stack([relation(rng, int(rng.integers(1, 7)), 6) for _ in range(60)])
    if wide and complement:
        other = np.stack([relation(rng, int(rng.integers(1, 7)), 6) for _ in range(60)])
        nodes = np.stack([np.minimum(nodes, other), 1.0 - np.maximum(nodes, other)], axis=1)
    layer = RotationLayer(nodes, 0.01, complement)
    view = relation(rng, int(rng.integers(1, 7)), 6)
    everywhere, best = layer.recall(view), layer.recall(view, top)
    assert best.ranking()[:top].tolist() == everywhere.ranking()[:top].tolist()
    assert (best.activation >= everywhere.activation).all()
    assert (best.activation[best.exact] == everywhere.activation[best.exact]).all()


@pytest.mark.parametrize("facets", [7, 8, 9, 10])
def test_a_renumbered_view_of_up_to_ten_facets_finds_itself(facets):
    rng = np.random.default_rng(facets)
    nodes = np.stack([relation(rng, facets, facets) for _ in range(5)])
    order = rng.permutation(facets)
    recall = best_numbering(turned(nodes[3], order, facets), nodes, 0.01)
    assert int(recall.ranking()[0]) == 3
    assert recall.match[3] == 1.0
    assert recall.match_ratio[3] == 1.0


def test_seven_facets_without_a_perfect_fit_agree_with_brute_force():
    rng = np.random.default_rng(0)
    view, node = relation(rng, 7, 7), relation(rng, 7, 7)
    recall = best_numbering(view, node[None], 0.01)
    assert recall.activation[0] == brute_force(view, node, 0.01, True)


@pytest.mark.parametrize("kind", ["as they come", "dense"])
def test_branching_and_the_table_of_all_agree(kind):
    rng = np.random.default_rng(1)
    for _ in range(80):
        if kind == "dense":
            nodes, view = rng.random((4, 6, 6)), rng.random((6, 6))
        else:
            nodes = np.stack([relation(rng, 6, 6) for _ in range(4)])
            view = rng.choice([turned(nodes[0], rng.permutation(6), 6), relation(rng, int(rng.integers(2, 7)), 6)])
        by_table = best_numbering(view, nodes, 0.01).activation
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(numberings, "LONGEST_TABLE", 0)
            assert best_numbering(view, nodes, 0.01).activation.tolist() == by_table.tolist()


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        (np.zeros((2, 3)), "expected (n, n)"),
        (np.full((2, 2), np.nan), "in [0, 1]"),
        (np.full((2, 2), 1.5), "in [0, 1]"),
        (np.zeros((7, 7)), "room for 6"),
        ("nonsense", "expected numbers"),
    ],
)
def test_an_unusable_relation_matrix_is_refused_with_the_reason(matrix, words):
    with pytest.raises(InputError) as refusal:
        best_numbering(matrix, np.zeros((1, 6, 6)))
    assert words in str(refusal.value)


@pytest.mark.parametrize("top", [None, 1])
def test_without_nodes_or_without_touching_facets_there_is_still_an_answer(top):
    assert best_numbering(np.zeros((2, 2)), np.zeros((0, 6, 6)), top=top).ranking().tolist() == []
    recall = best_numbering(np.zeros((3, 3)), np.random.default_rng(0).random((20, 6, 6)), top=top)
    best = recall.ranking()[0]
    assert recall.numbering[best].tolist() == [0, 1, 2]
    assert recall.match_ratio[best] == 0.0


def test_an_unknown_scope_is_refused_by_name():
    with pytest.raises(ParameterError, match="scope: expected one of all, occupied"):
        best_numbering(np.zeros((2, 2)), np.zeros((1, 6, 6)), scope="some")  # type: ignore[arg-type]  # what it refuses
