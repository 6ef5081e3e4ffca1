"""What an operator reads of a pick that has ended."""

from __future__ import annotations

from dataclasses import replace

from daemon.arm import JobEvent
from daemon.commands.moving import describe_end, end_json
from daemon.events.outcomes import Outcome
from daemon.pick.outcome import CycleEnd


def end(outcome: Outcome, label: str | None, why: str, stops: int) -> CycleEnd:
    return CycleEnd(1, outcome, label, why, stops, 18.0, None, None, None, (), None, brought=False)


def test_a_pick_that_approached_nothing_does_not_count_the_looks_of_its_approach() -> None:
    nothing = end(Outcome.EMPTY, None, "nothing on the table that can be picked", 0)
    assert describe_end(nothing) == "empty: no part, 18.0 s (nothing on the table that can be picked)"
    assert describe_end(end(Outcome.LOST, "cube", "gone", 1)) == "lost: cube, 1 look, 18.0 s (gone)"
    held = end(Outcome.EMPTIED, None, "put down what was in the hand", 0)
    assert describe_end(held) == "emptied: put down what was in the hand, 18.0 s"


def test_a_part_that_was_set_down_says_at_which_place_and_how_far_off() -> None:
    placed = replace(end(Outcome.PICKED, "cube", "cube at place tray.1: 0.18 mm off", 2), place="tray.1")
    assert describe_end(placed) == "picked: cube, 2 looks, 18.0 s (cube at place tray.1: 0.18 mm off)"
    assert describe_end(end(Outcome.PICKED, "cube", "showed above the bin", 2)) == "picked: cube, 2 looks, 18.0 s"
    assert end_json(placed)["place"] == "tray.1"
    stopped = replace(end(Outcome.PICKED, "cube", "showed above the bin; then stopped", 2), ended_by=JobEvent.STOP)
    assert describe_end(stopped).endswith("(showed above the bin; then stopped)"), "a stop is told with the pick"
