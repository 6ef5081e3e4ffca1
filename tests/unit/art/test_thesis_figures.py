"""The worked examples of the thesis, as figures: sections 4.1, 5.5 and 5.6. The silhouettes of 4.1 are drawn here.

Source: D'Souza, sections 4.1, 4.3, 5.5, 5.6, figures 5.20, 5.25, 5.26. Type numbers 0.3, 0.5, 0.75 and alpha 0.01 are
not printed there; they are what makes the printed activations come out.
"""

from __future__ import annotations

import numpy as np
import pytest

from daemon.art import ART1, FuzzyARTMAP, RotationLayer, best_numbering, choose, modified_match

TRIANGLE, RECTANGLE, PENTAGON = 0.3, 0.5, 0.75
ALPHA = 0.01


def matrix(types, touching):
    """Row r holds the type of facet r where it touches; in six slots."""
    result = np.zeros((6, 6))
    for p, q in touching:
        result[p, q], result[q, p] = types[p], types[q]
    return result


PRISM = matrix([TRIANGLE, RECTANGLE, RECTANGLE], [(0, 1), (0, 2), (1, 2)])
PENTAGONAL_PRISM_TWO_SIDES = matrix([RECTANGLE, RECTANGLE, PENTAGON], [(0, 1), (0, 2), (1, 2)])
PENTAGONAL_PRISM_THREE_SIDES = matrix(
    [PENTAGON, RECTANGLE, RECTANGLE, RECTANGLE], [(0, 1), (0, 2), (0, 3), (1, 2), (2, 3)]
)
NODES = np.stack([PRISM, PENTAGONAL_PRISM_THREE_SIDES, PENTAGONAL_PRISM_TWO_SIDES])
LABELS = ("triangular prism", "pentagonal prism", "pentagonal prism")

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
    two_rectangles = matrix([RECTANGLE, RECTANGLE], [(0, 1)])
    thesis = choose(best_numbering(two_rectangles, NODES, ALPHA, complement=False, scope="occupied"), LABELS, rho=0.98)
    assert thesis.label == "pentagonal prism"
    assert thesis.activation == pytest.approx(0.28490, abs=5e-6)
    assert round(thesis.activation, 3) == 0.285
    assert thesis.match_ratio == pytest.approx(2 / 3)


def test_figure_5_25_c_is_right_when_all_six_slots_are_tried():
    two_rectangles = matrix([RECTANGLE, RECTANGLE], [(0, 1)])
    verdict = choose(best_numbering(two_rectangles, NODES, ALPHA, complement=False), LABELS)
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


def silhouettes():
    """A floppy disk, a round of cork, a pen and a screwdriver, as edges on 20 x 20 (section 4.1)."""
    grid = np.zeros((4, 20, 20))
    floppy, cork, pen, driver = grid
    floppy[[0, 19], :] = floppy[:, [0, 19]] = 1
    floppy[13, 4:16] = floppy[13:, [4, 15]] = floppy[1:6, [6, 13]] = floppy[6, 6:14] = 1
    rows, columns = np.mgrid[:20, :20]
    radius = np.hypot(rows - 9.5, columns - 9.5)
    cork[(radius > 8.6) & (radius < 9.9)] = 1
    pen[:17, [9, 11]] = 1
    pen[[0, 17, 18, 19], 10] = pen[4, 9:12] = 1
    driver[:9, [7, 12]] = driver[[0, 8], 7:13] = 1
    driver[9:19, [9, 10]] = driver[19, 8:12] = 1
    return grid.reshape(4, 400)


def test_vigilance_0_4_keeps_four_silhouettes_apart():
    assert ART1(rho=0.4, capacity=4).learn(silhouettes()).tolist() == [0, 1, 2, 3]


def test_a_silhouette_shown_again_calls_up_its_own_node():
    shapes = silhouettes()
    network = ART1(rho=0.4, capacity=4)
    assert network.learn(shapes[[0, 1, 3, 0]]).tolist() == [0, 1, 2, 0]


def test_below_that_the_floppy_and_the_cork_share_a_node():
    assert ART1(rho=0.35, capacity=4).learn(silhouettes()).tolist() == [0, 0, 1, 2]
