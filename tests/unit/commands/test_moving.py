"""What an operator reads of a pick that has ended."""

from __future__ import annotations

from daemon.commands.moving import describe_end
from daemon.pick.outcome import CycleEnd, Outcome


def end(outcome: Outcome, label: str | None, why: str, stops: int) -> CycleEnd:
    return CycleEnd(1, outcome, label, why, stops, 18.0, None, None, None, (), None)


def test_a_pick_that_approached_nothing_does_not_count_the_looks_of_its_approach() -> None:
    nothing = end(Outcome.EMPTY, None, "nothing on the table that can be picked", 0)
    assert describe_end(nothing) == "empty: no part, 18.0 s (nothing on the table that can be picked)"
    assert describe_end(end(Outcome.LOST, "cube", "gone", 1)) == "lost: cube, 1 look, 18.0 s (gone)"
    held = end(Outcome.EMPTIED, None, "put down what was in the hand", 0)
    assert describe_end(held) == "emptied: put down what was in the hand, 18.0 s"
