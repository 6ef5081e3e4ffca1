"""A model whose recall is taken away or misled keeps all else, so that a bench measures recall alone."""

from __future__ import annotations

import numpy as np

from tests.fakes.ablated import four_drawn, instead, misled, without_recall


def test_misled_nodes_stand_for_the_label_after_their_own_and_nothing_else_changes() -> None:
    model = four_drawn()
    wrong = misled(model)
    right_labels, wrong_labels = model.artmap.node_labels, wrong.artmap.node_labels
    assert wrong_labels == tuple(instead(model)[label] for label in right_labels)
    assert set(wrong_labels) == set(model.labels) == set(wrong.labels)
    assert not any(a == b for a, b in zip(wrong_labels, right_labels, strict=True))
    np.testing.assert_array_equal(wrong.artmap.lower, model.artmap.lower)
    assert wrong.metric is model.metric


def test_without_recall_no_node_is_left_and_every_part_is_still_known() -> None:
    model = four_drawn()
    less = without_recall(model)
    assert less.artmap.node_labels == ()
    assert less.labels == model.labels
    assert less.metric is model.metric
