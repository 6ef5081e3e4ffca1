"""The worked examples of the thesis, as figures (tests/fakes/thesis.py): sections 4.1, 4.3, 5.5 and 5.6."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.arrays import Array
from daemon.art import ART1
from daemon.vision.thesis import silhouette
from tests.bench.networks import FuzzyARTMAP, RotationLayer, best_numbering, choose, modified_match
from tests.fakes.thesis import (
    ALPHA,
    NODE_LABELS,
    NODES,
    PENTAGON,
    PRINTED,
    PRISM,
    RECTANGLE,
    RHO,
    TRIANGLE,
    Printed,
    matrix,
)
from tests.fakes.thesis_scenes import OUTLINES, silhouette_picture

# Section 5.6 prints 35 of the 36 numbers: the first, the 0 of the diagonal, is missing.
Z = [0, 0.3, 0.3, 0, 0, 0, 0.5, 0, 0.5, 0, 0, 0, 0.5, 0.5, *[0] * 22]
I = [0, 0.5, 0.5, 0, 0, 0, 0.3, 0, 0.3, 0, 0, 0, 0.5, 0.5, *[0] * 22]  # noqa: E741


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
    assert recall.match_ratio[5] == pytest.approx(2 / 3)


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


def test_type_numbers_that_lie_close_are_told_apart_by_the_modified_match():
    close = (0.15, 0.15 + 1e-9)
    nodes = np.stack([matrix([t, RECTANGLE], [(0, 1)]) for t in close])
    for number, t in enumerate(close):
        verdict = choose(best_numbering(matrix([t, RECTANGLE], [(0, 1)]), nodes, ALPHA), ["one", "other"], rho=0.99)
        assert verdict.node == number
        assert verdict.match == 1.0


def test_a_network_s_weights_serve_as_nodes_of_the_rotation_layer():
    views, labels = NODES.reshape(-1, 36), list(NODE_LABELS)
    network = FuzzyARTMAP(rho=0.9, alpha=0.1).fit(views, labels)
    layer = RotationLayer(network.weights.reshape(-1, 2, 6, 6), alpha=0.1)
    for view, label in zip(NODES, labels, strict=True):
        verdict = choose(layer.recall(view[::-1, ::-1]), network.node_labels)
        assert (verdict.label, verdict.match, verdict.match_ratio) == (label, 1.0, 1.0)


def test_vigilance_0_4_keeps_four_silhouettes_apart() -> None:
    assert ART1(rho=0.4, capacity=4).learn(shapes()).tolist() == [0, 1, 2, 3]


def test_a_silhouette_shown_again_calls_up_its_own_node() -> None:
    network = ART1(rho=0.4, capacity=4)
    assert network.learn(shapes()[[0, 1, 3, 0]]).tolist() == [0, 1, 2, 0]


def test_below_that_two_of_them_share_a_node() -> None:
    assert len(set(ART1(rho=0.35, capacity=4).learn(shapes()).tolist())) == 3


def shapes() -> Array:
    return np.stack([silhouette(silhouette_picture(name)) for name in OUTLINES])


@pytest.mark.parametrize("printed", PRINTED, ids=lambda printed: printed.figure)
def test_all_14_printed_views_come_out_as_printed(printed: Printed) -> None:
    recall = best_numbering(printed.view, NODES, ALPHA, complement=False, scope="occupied")
    verdict = choose(recall, NODE_LABELS, RHO)
    assert verdict.label == printed.said
    assert verdict.match_ratio == pytest.approx(printed.ratio, abs=0.005)
    if printed.activation is not None:
        assert verdict.activation == pytest.approx(printed.activation, abs=0.005)


def test_every_numbering_exchanges_the_error_of_5_25_c_for_one_in_5_26_c() -> None:
    same = [p for p in PRINTED if p.figure in ("5.25 (c)", "5.26 (c)")]
    assert np.array_equal(same[0].view, same[1].view)
    label = choose(best_numbering(same[0].view, NODES, ALPHA, complement=False), NODE_LABELS, RHO).label
    assert [label == p.truth for p in same] == [True, False]
