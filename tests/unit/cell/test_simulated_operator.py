"""The person at a simulated cell: what they show goes away again, and the table is as it was."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from daemon.cell.simulated_operator import SimulatedOperator
from drivers.simcell.cell import SimulatedCell

TRUTH = Path(__file__).resolve().parents[3] / "etc" / "simcell.yaml"
Lie = list[tuple[str, str, list[float]]]


@pytest.fixture
def hand() -> Iterator[SimulatedOperator]:
    with SimulatedCell(TRUTH, seed=3) as cell:
        yield SimulatedOperator(cell)


def lie(hand: SimulatedOperator) -> Lie:
    return [(part.name, part.where.value, np.asarray(part.pose).ravel().tolist()) for part in hand.cell.world.parts]


def test_after_a_part_or_a_board_was_shown_every_part_lies_where_it_lay(hand: SimulatedOperator) -> None:
    hand.scatter(("cube", "pyramid"))
    before = lie(hand)
    hand.show("pyramid", 3)
    assert [(name.split("-")[0], where) for name, where, _ in lie(hand)] == [("pyramid", "stand")]
    hand.show("cube", 0)
    hand.put_back()
    assert lie(hand) == before
    for held in (False, True):
        hand.show_board(9, 6, 16.0, False, held)
        assert lie(hand) == []
        hand.put_back()
        assert lie(hand) == before


def test_what_was_strewn_or_cleared_meanwhile_is_not_undone(hand: SimulatedOperator) -> None:
    hand.scatter(("cube",))
    hand.show("pyramid", 0)
    hand.clear()
    hand.show("pyramid", 0)
    hand.put_back()
    assert lie(hand) == []
