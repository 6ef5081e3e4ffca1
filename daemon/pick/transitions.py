"""The pick cycle's table: which event leads from which state to which. Read it as the specification; no behaviour here.

A state is left only by the events of its rows. What each does is the handler of its name in finding.py or picking.py.
"""

from __future__ import annotations

from typing import NamedTuple


class Row(NamedTuple):
    """In this state this event leads there. `*`: any state of a pick; `back`: the state it came from."""

    state: str
    event: str
    then: str
    meaning: str


TABLE: tuple[Row, ...] = (
    Row("idle", "begin", "survey", "an operator or auto asks for a part"),
    Row("idle", "full_hand", "place", "a part is in the hand: first put it down"),
    Row("survey", "seen", "choose", "something on the table was not skipped before"),
    Row("survey", "nothing", "home", "no view shows anything to pick"),
    Row("choose", "chosen", "stop_n", "named, a grasp holds it, the whole approach is reached"),
    Row(
        "choose",
        "doubtful",
        "second_view",
        "more than one part fits, or none, or a lone facet bars the way: look from another side",
    ),
    Row("choose", "stale", "survey", "the look is too old to move on"),
    Row("choose", "none_left", "home", "what is left is skipped, each with its reason"),
    Row(
        "second_view", "seen", "choose", "looked at from where its candidates differ, or from afar of the looks before"
    ),
    Row("stop_n", "there", "looking", "at the next stand-off, at rest"),
    Row("stop_n", "unreachable", "choose", "the guard refused the move: skip"),
    Row("looking", "looked", "estimating", "found where it was expected"),
    Row("looking", "elsewhere", "choose", "seen, but not as it was thought to lie: plan again"),
    Row("looking", "lost", "choose", "not found where it was expected: skip"),
    Row("estimating", "unsure", "stop_n", "the predicted error at the grasp is too large"),
    Row("estimating", "sure", "final", "the predicted error allows the blind stretch"),
    Row("estimating", "doubt", "survey", "looks disagree: hold the whole table against the look before"),
    Row("estimating", "elsewhere", "choose", "the planned grasp does not hold it as it lies: plan again"),
    Row("estimating", "lost", "choose", "planned anew too often: skip"),
    Row("estimating", "gave_up", "choose", "still unsure after the most looks: skip"),
    Row("final", "there", "closing", "the hand is around the part"),
    Row("final", "dry", "home", "nothing was sent: there is nothing to close on"),
    Row("final", "unreachable", "choose", "the guard refused the move: skip"),
    Row("closing", "closed", "retreat", "the hand has closed"),
    Row("retreat", "there", "verify", "lifted and backed off"),
    Row("verify", "gone", "place", "the part no longer lies there, and the hand is not seen to be empty"),
    Row("verify", "missed", "survey", "it lies there still, or elsewhere, or the hand is empty: try again or skip"),
    Row("place", "placed", "home", "let go over the bin"),
    Row("home", "there", "idle", "the pick has ended"),
    Row("*", "pause", "paused", "an operator holds it before its next move"),
    Row("paused", "resume", "back", "and lets it go on"),
    Row("*", "abort", "idle", "the arm is stopped, the part is given up"),
    Row("*", "error", "fault", "the arm is stopped first, then the error is reported"),
    Row("*", "stop", "fault", "the arm is stopped first, then it is reported"),
    Row("fault", "resume", "idle", "an operator says that it may move again"),
)
NEXT = {(row.state, row.event): row.then for row in TABLE}


def printed_table() -> str:
    """The table for people."""
    widths = [max(len(row[i]) for row in TABLE) for i in range(3)]
    return "\n".join("  ".join(c.ljust(w) for c, w in zip(row, widths, strict=False)) + "  " + row[3] for row in TABLE)
