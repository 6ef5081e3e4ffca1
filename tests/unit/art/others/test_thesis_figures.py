"""The worked examples of the thesis, as figures (tests/fakes/thesis.py): sections 4.1, 4.3, 5.5 and 5.6."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.art.others import ART1, FuzzyARTMAP, RotationLayer, best_numbering, choose, modified_match
from tests.fakes.thesis import (
    ALPHA,
    LABELS,
    NODES,
    PENTAGON,
    PENTAGONAL_PRISM_THREE_SIDES,
    PRISM,
    RECTANGLE,
    TRIANGLE,
    TWO_RECTANGLES,
    matrix,
    silhouettes,
)

# section 5.6: 34 of the 36 numbers are printed, the rest being empty
Z = [0.3, 0.3, 0, 0, 0, 0.5, 0, 0.5, 0, 0, 0, 0.5, 0.5, *[0] * 23]
I = [0.5, 0.5, 0, 0, 0, 0.3, 0, 0.3, 0, 0, 0, 0.5, 0.5, *[0] * 23]  # noqa: E741


def test_section_5_6_four_elements_differ_of_thirty_six():
    match = modified_match(np.reshape(I, (6, 6)), np.reshape(Z, (6, 6)))
    assert match.difference == 32 / 36


def test_equation_5_2_is_one_for_an_exact_match_and_sees_the_smallest_difference():
    assert modified_match(PRISM, PRISM).difference == 1.0
    close = np.where(PRISM == TRIANGLE, TRIANGLE + 1e-12, PRISM)
    assert modified_match(close, PRISM).difference == 34 / 36


def test_two_of_three_facets_give_a_match_ratio_of_two_thirds():
    two = matrix([RECTANGLE, RECTANGLE], [(0, 1)])
    recall = best_numbering(two, NODES, ALPHA, complement=False)
    assert recall.match_ratio[0] == pytest.approx(2 / 3)


def test_a_facet_that_touches_one_facet_too_few_is_not_matched():
    open_prism = matrix([TRIANGLE, RECTANGLE, RECTANGLE], [(0, 1), (0, 2)])
    match = modified_match(open_prism, PRISM)
    assert match.difference == 34 / 36
    assert match.ratio == pytest.approx(1 / 3)


def test_figure_5_20_swapping_rows_then_columns_keeps_who_touches_whom():
    before = matrix([RECTANGLE, PENTAGON, RECTANGLE, RECTANGLE], [(0, 1), (1, 2), (1, 3), (0, 2)])
    after = before.copy()
    after[[1, 3]] = after[[3, 1]]
    after[:, [1, 3]] = after[:, [3, 1]]
    recall = best_numbering(after, before[None], ALPHA)
    assert recall.match[0] == 1.0
    assert sorted(recall.numbering[0].tolist()) == list(range(6))
    turned = np.zeros((6, 6))
    turned[np.ix_(recall.numbering[0], recall.numbering[0])] = after
    assert np.array_equal(turned, before)


@pytest.mark.parametrize(
    ("figure", "view", "printed", "places", "exact", "ratio"),
    [
        ("5.25 (a)", PRISM, 0.996, 3, 0.99617, 1.0),
        ("5.25 (b)", matrix([TRIANGLE, RECTANGLE], [(0, 1)]), 0.31, 2, 0.30651, 2 / 3),
        ("5.26 (d)", PENTAGONAL_PRISM_THREE_SIDES, 0.998, 3, 0.99826, 1.0),
    ],
)
def test_the_printed_activations_come_from_raw_inputs(figure, view, printed, places, exact, ratio):
    turned = view[::-1, ::-1]
    verdict = choose(best_numbering(turned, NODES, ALPHA, complement=False), LABELS)
    assert verdict.activation == pytest.approx(exact, abs=5e-6)
    assert round(verdict.activation, places) == printed
    assert verdict.match_ratio == pytest.approx(ratio)


def test_figure_5_25_c_calls_a_prism_a_pentagon_when_only_the_first_slots_are_tried():
    thesis = choose(best_numbering(TWO_RECTANGLES, NODES, ALPHA, complement=False, scope="occupied"), LABELS, rho=0.98)
    assert thesis.label == "pentagonal prism"
    assert thesis.activation == pytest.approx(0.28490, abs=5e-6)
    assert round(thesis.activation, 3) == 0.285
    assert thesis.match_ratio == pytest.approx(2 / 3)


def test_figure_5_25_c_is_right_when_all_six_slots_are_tried():
    verdict = choose(best_numbering(TWO_RECTANGLES, NODES, ALPHA, complement=False), LABELS)
    assert verdict.label == "triangular prism"
    assert verdict.runner_up_label == "pentagonal prism"
    assert verdict.activation > verdict.runner_up_activation


def test_type_numbers_that_lie_close_are_told_apart_by_the_modified_match():
    close = (0.15, 0.15 + 1e-9)
    nodes = np.stack([matrix([t, RECTANGLE], [(0, 1)]) for t in close])
    for number, t in enumerate(close):
        verdict = choose(best_numbering(matrix([t, RECTANGLE], [(0, 1)]), nodes, ALPHA), ["one", "other"], rho=0.99)
        assert verdict.node == number
        assert verdict.match == 1.0


def test_a_network_s_weights_serve_as_nodes_of_the_rotation_layer():
    views, labels = NODES.reshape(3, 36), list(LABELS)
    network = FuzzyARTMAP(rho=0.9, alpha=0.1).fit(views, labels)
    layer = RotationLayer(network.weights.reshape(-1, 2, 6, 6), alpha=0.1)
    for view, label in zip(NODES, labels, strict=True):
        verdict = choose(layer.recall(view[::-1, ::-1]), network.node_labels)
        assert (verdict.label, verdict.match, verdict.match_ratio) == (label, 1.0, 1.0)


def test_vigilance_0_4_keeps_four_silhouettes_apart():
    assert ART1(rho=0.4, capacity=4).learn(silhouettes()).tolist() == [0, 1, 2, 3]


def test_a_silhouette_shown_again_calls_up_its_own_node():
    shapes = silhouettes()
    network = ART1(rho=0.4, capacity=4)
    assert network.learn(shapes[[0, 1, 3, 0]]).tolist() == [0, 1, 2, 0]


def test_below_that_the_floppy_and_the_cork_share_a_node():
    assert ART1(rho=0.35, capacity=4).learn(silhouettes()).tolist() == [0, 0, 1, 2]
