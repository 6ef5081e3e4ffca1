"""A model whose recall is taken away or misled keeps all else, so that a bench measures recall alone."""

from __future__ import annotations

import numpy as np

from tests.worlds import rendered
from tests.worlds.ablated import four_drawn, instead, misled, without_recall


def test_misled_nodes_stand_for_the_label_after_their_own_and_nothing_else_changes() -> None:
    model = four_drawn(rendered.rig(rendered.HERE, "B"))
    wrong = misled(model)
    assert wrong.node_labels == tuple(instead(model)[label] for label in model.node_labels)
    assert set(wrong.node_labels) == set(model.labels) == set(wrong.labels)
    assert not any(a == b for a, b in zip(wrong.node_labels, model.node_labels, strict=True))
    assert wrong.artmap is not None
    assert model.artmap is not None
    np.testing.assert_array_equal(wrong.artmap.weights, model.artmap.weights)
    assert wrong.metric is model.metric


def test_without_recall_no_node_is_left_and_every_part_is_still_known() -> None:
    model = four_drawn(rendered.rig(rendered.HERE, "B"))
    less = without_recall(model)
    assert less.node_labels == ()
    assert less.labels == model.labels
    assert less.metric is model.metric
