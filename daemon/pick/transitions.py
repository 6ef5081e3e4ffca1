"""The pick cycle's table: which event leads from which state to which. Read it as the specification; no behaviour here.

A state is left only by the events of its rows. What each does is the handler of its name in find.py, approach.py or
take.py; the words stand as they are in the run log and in `status`.
"""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple


class State(StrEnum):
    """What a pick is at."""

    IDLE = "idle"
    SURVEY = "survey"
    CHOOSE = "choose"
    SECOND_VIEW = "second_view"
    STOP_N = "stop_n"
    LOOKING = "looking"
    ESTIMATING = "estimating"
    FINAL = "final"
    CLOSING = "closing"
    RETREAT = "retreat"
    VERIFY = "verify"
    PLACE = "place"
    HOME = "home"
    PAUSED = "paused"
    FAULT = "fault"
    ANY = "*"
    """In a row only: any state of a pick."""
    BACK = "back"
    """In a row only: the state it came from."""


class Event(StrEnum):
    """What leaves a state."""

    BEGIN = "begin"
    FULL_HAND = "full_hand"
    SEEN = "seen"
    NOTHING = "nothing"
    CHOSEN = "chosen"
    DOUBTFUL = "doubtful"
    STALE = "stale"
    NONE_LEFT = "none_left"
    THERE = "there"
    UNREACHABLE = "unreachable"
    LOOKED = "looked"
    ELSEWHERE = "elsewhere"
    LOST = "lost"
    UNSURE = "unsure"
    SURE = "sure"
    DOUBT = "doubt"
    GAVE_UP = "gave_up"
    DRY = "dry"
    CLOSED = "closed"
    GONE = "gone"
    MISSED = "missed"
    PLACED = "placed"
    PAUSE = "pause"
    RESUME = "resume"
    ABORT = "abort"
    ERROR = "error"
    STOP = "stop"


class Row(NamedTuple):
    """In this state this event leads there."""

    state: State
    event: Event
    then: State
    meaning: str


TABLE: tuple[Row, ...] = (
    Row(State.IDLE, Event.BEGIN, State.SURVEY, "an operator or auto asks for a part"),
    Row(State.IDLE, Event.FULL_HAND, State.PLACE, "a part is in the hand: first put it down"),
    Row(State.SURVEY, Event.SEEN, State.CHOOSE, "something on the table was not skipped before"),
    Row(State.SURVEY, Event.NOTHING, State.HOME, "no view shows anything to pick"),
    Row(State.CHOOSE, Event.CHOSEN, State.STOP_N, "named, a grasp holds it, the whole approach is reached"),
    Row(
        State.CHOOSE,
        Event.DOUBTFUL,
        State.SECOND_VIEW,
        "more than one part fits, or none, or a lone facet bars the way: look from another side",
    ),
    Row(State.CHOOSE, Event.STALE, State.SURVEY, "the look is too old to move on"),
    Row(State.CHOOSE, Event.NONE_LEFT, State.HOME, "what is left is skipped, each with its reason"),
    Row(
        State.SECOND_VIEW,
        Event.SEEN,
        State.CHOOSE,
        "looked at from where a look settles most for its time, or from afar of the looks before",
    ),
    Row(State.STOP_N, Event.THERE, State.LOOKING, "at the next stand-off, at rest"),
    Row(State.STOP_N, Event.UNREACHABLE, State.CHOOSE, "the guard refused the move: plan again, or skip"),
    Row(State.LOOKING, Event.LOOKED, State.ESTIMATING, "found where it was expected"),
    Row(State.LOOKING, Event.ELSEWHERE, State.CHOOSE, "seen, but not as it was thought to lie: plan again"),
    Row(State.LOOKING, Event.LOST, State.CHOOSE, "not found where it was expected: skip"),
    Row(State.ESTIMATING, Event.UNSURE, State.STOP_N, "the predicted error at the grasp is too large"),
    Row(State.ESTIMATING, Event.SURE, State.FINAL, "the predicted error allows the blind stretch"),
    Row(State.ESTIMATING, Event.DOUBT, State.SURVEY, "looks disagree: hold the whole table against the look before"),
    Row(State.ESTIMATING, Event.ELSEWHERE, State.CHOOSE, "the planned grasp does not hold it as it lies: plan again"),
    Row(State.ESTIMATING, Event.LOST, State.CHOOSE, "planned anew too often: skip"),
    Row(State.ESTIMATING, Event.GAVE_UP, State.CHOOSE, "still unsure after the most looks: skip"),
    Row(State.FINAL, Event.THERE, State.CLOSING, "the hand is around the part"),
    Row(State.FINAL, Event.DRY, State.HOME, "nothing was sent: there is nothing to close on"),
    Row(State.FINAL, Event.UNREACHABLE, State.CHOOSE, "the guard refused the move: plan again, or skip"),
    Row(State.CLOSING, Event.CLOSED, State.RETREAT, "the hand has closed"),
    Row(State.RETREAT, Event.THERE, State.VERIFY, "lifted and backed off"),
    Row(
        State.VERIFY,
        Event.GONE,
        State.PLACE,
        "the part is seen in the hand, or no longer lies there and the hand is not seen to be empty",
    ),
    Row(
        State.VERIFY,
        Event.MISSED,
        State.SURVEY,
        "it lies there still, or elsewhere, or the hand is empty: opened over the bin, try again or skip",
    ),
    Row(State.PLACE, Event.PLACED, State.HOME, "let go over the bin"),
    Row(State.PLACE, Event.DRY, State.HOME, "nothing was sent: the hand holds what it held"),
    Row(State.HOME, Event.THERE, State.IDLE, "the pick has ended"),
    Row(State.ANY, Event.PAUSE, State.PAUSED, "an operator holds it before its next move"),
    Row(State.PAUSED, Event.RESUME, State.BACK, "and lets it go on"),
    Row(State.ANY, Event.ABORT, State.IDLE, "the arm is stopped, the part is given up"),
    Row(State.ANY, Event.ERROR, State.FAULT, "the arm is stopped first, then the error is reported"),
    Row(State.ANY, Event.STOP, State.FAULT, "the arm is stopped first, then it is reported"),
    Row(State.FAULT, Event.ABORT, State.FAULT, "the arm is stopped; the fault stands"),
    Row(State.FAULT, Event.RESUME, State.IDLE, "an operator says that it may move again"),
)
NEXT = {(row.state, row.event): row.then for row in TABLE}


def follows(state: State, event: Event, held: State) -> State:
    """Where an event leads from a state; held: where a pause came in. KeyError where the table has no row for it."""
    then = NEXT.get((state, event)) or NEXT[State.ANY, event]
    return held if then is State.BACK else then


def printed_table() -> str:
    """The table for people."""
    widths = [max(len(row[i]) for row in TABLE) for i in range(3)]
    return "\n".join("  ".join(c.ljust(w) for c, w in zip(row, widths, strict=False)) + "  " + row[3] for row in TABLE)
