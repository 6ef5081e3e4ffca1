"""The pick cycle's table: which event leads from which state to which. Read it as the specification; no behaviour here.

A state is left only by the events of its rows. What each does is its handler in find.py, approach.py, take.py or
set_down.py, by the table HANDLERS in cycle.py. The words are those of the run log and of `status` (of earlier releases:
daemon/events/upgrade.py).
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import NamedTuple


class PickState(StrEnum):
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
    BIN = "bin"
    SET_DOWN = "set_down"
    LOOK_AT_PLACE = "look_at_place"
    LOOK_AT_LAID = "look_at_laid"
    HOME = "home"
    PAUSED = "paused"
    FAULT = "fault"
    ANY = "*"
    """In a row only: any state of a pick."""
    BACK = "back"
    """In a row only: the state it came from."""


SHOWN: Mapping[str, str] = {
    PickState.IDLE: "idle", PickState.SURVEY: "survey the table", PickState.CHOOSE: "choose a part",
    PickState.SECOND_VIEW: "look from another side", PickState.STOP_N: "approach", PickState.LOOKING: "look",
    PickState.ESTIMATING: "estimate the pose", PickState.FINAL: "move to the grasp",
    PickState.CLOSING: "close the gripper", PickState.RETREAT: "lift", PickState.VERIFY: "verify the grasp",
    PickState.BIN: "bring it to the bin", PickState.SET_DOWN: "set it down",
    PickState.LOOK_AT_PLACE: "look at its place",
    PickState.LOOK_AT_LAID: "look at it on the table, to take it anew",
    PickState.HOME: "move home", PickState.PAUSED: "paused", PickState.FAULT: "fault",
}  # fmt: skip
"""Names of the states for people, in `status` and on pages."""


class PickEvent(StrEnum):
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
    MEASURED = "measured"
    SET_DOWN = "set_down"
    LAID_DOWN = "laid_down"
    MISSED = "missed"
    BINNED = "binned"
    DROPPED = "dropped"
    STILL_HELD = "still_held"
    PAUSE = "pause"
    RESUME = "resume"
    ABORT = "abort"
    ERROR = "error"
    STOP = "stop"


class Row(NamedTuple):
    """In this state this event leads there."""

    state: PickState
    event: PickEvent
    then: PickState
    meaning: str


TABLE: tuple[Row, ...] = (
    Row(PickState.IDLE, PickEvent.BEGIN, PickState.SURVEY, "an operator or auto asks for a part"),
    Row(PickState.IDLE, PickEvent.FULL_HAND, PickState.BIN, "a part is in the hand: first put it down"),
    Row(PickState.SURVEY, PickEvent.SEEN, PickState.CHOOSE, "something on the table was not skipped before"),
    Row(PickState.SURVEY, PickEvent.NOTHING, PickState.HOME, "no view shows anything to pick"),
    Row(PickState.CHOOSE, PickEvent.CHOSEN, PickState.STOP_N, "named, a grasp holds it, the whole approach is reached"),
    Row(
        PickState.CHOOSE,
        PickEvent.DOUBTFUL,
        PickState.SECOND_VIEW,
        "more than one part fits, or none, or a lone facet bars the way: look from another side",
    ),
    Row(PickState.CHOOSE, PickEvent.STALE, PickState.SURVEY, "the look is too old to move on"),
    Row(PickState.CHOOSE, PickEvent.NONE_LEFT, PickState.HOME, "what is left is skipped, each with its reason"),
    Row(
        PickState.SECOND_VIEW,
        PickEvent.SEEN,
        PickState.CHOOSE,
        "looked at from where a look settles most for its time, or from far away from the earlier looks",
    ),
    Row(PickState.STOP_N, PickEvent.THERE, PickState.LOOKING, "at the next stand-off, at rest"),
    Row(PickState.STOP_N, PickEvent.UNREACHABLE, PickState.CHOOSE, "the guard refused the move: plan again, or skip"),
    Row(PickState.LOOKING, PickEvent.LOOKED, PickState.ESTIMATING, "found where it was expected"),
    Row(PickState.LOOKING, PickEvent.ELSEWHERE, PickState.CHOOSE, "seen, but not as it was thought to lie: plan again"),
    Row(PickState.LOOKING, PickEvent.LOST, PickState.CHOOSE, "not found where it was expected: skip"),
    Row(PickState.ESTIMATING, PickEvent.UNSURE, PickState.STOP_N, "the predicted error at the grasp is too large"),
    Row(PickState.ESTIMATING, PickEvent.SURE, PickState.FINAL, "the predicted error allows the blind stretch"),
    Row(
        PickState.ESTIMATING,
        PickEvent.DOUBT,
        PickState.SURVEY,
        "looks disagree: hold the whole table against the look before",
    ),
    Row(
        PickState.ESTIMATING,
        PickEvent.ELSEWHERE,
        PickState.CHOOSE,
        "the planned grasp does not hold it as it lies: plan again",
    ),
    Row(PickState.ESTIMATING, PickEvent.LOST, PickState.CHOOSE, "planned anew too often: skip"),
    Row(PickState.ESTIMATING, PickEvent.GAVE_UP, PickState.CHOOSE, "still unsure after the most looks: skip"),
    Row(PickState.FINAL, PickEvent.THERE, PickState.CLOSING, "the hand is around the part"),
    Row(PickState.FINAL, PickEvent.DRY, PickState.HOME, "nothing was sent: there is nothing to close on"),
    Row(PickState.FINAL, PickEvent.UNREACHABLE, PickState.CHOOSE, "the guard refused the move: plan again, or skip"),
    Row(PickState.CLOSING, PickEvent.CLOSED, PickState.RETREAT, "the hand has closed"),
    Row(PickState.RETREAT, PickEvent.THERE, PickState.VERIFY, "lifted and backed off"),
    Row(
        PickState.VERIFY,
        PickEvent.GONE,
        PickState.BIN,
        "the part shows in the gripper, or no longer lies there and the gripper does not show empty",
    ),
    Row(
        PickState.VERIFY,
        PickEvent.MEASURED,
        PickState.SET_DOWN,
        "the part has a place, and its edges show how it is held",
    ),
    Row(PickState.SET_DOWN, PickEvent.SET_DOWN, PickState.LOOK_AT_PLACE, "lowered to its support, let go, backed off"),
    Row(
        PickState.SET_DOWN,
        PickEvent.LAID_DOWN,
        PickState.LOOK_AT_LAID,
        "laid on the table on another side, to be taken by another grasp; let go, backed off",
    ),
    Row(PickState.SET_DOWN, PickEvent.UNREACHABLE, PickState.BIN, "the guard refused the way to its place"),
    Row(
        PickState.SET_DOWN,
        PickEvent.LOST,
        PickState.BIN,
        "lost on the way: the gripper's sensor says so, and no look shows the part in the gripper",
    ),
    Row(PickState.SET_DOWN, PickEvent.DRY, PickState.HOME, "nothing was sent: the hand holds what it held"),
    Row(PickState.LOOK_AT_PLACE, PickEvent.SEEN, PickState.HOME, "right, off by so much, or not there"),
    Row(PickState.LOOK_AT_LAID, PickEvent.SEEN, PickState.STOP_N, "it lies there: the next grasp is planned"),
    Row(
        PickState.LOOK_AT_LAID,
        PickEvent.LOST,
        PickState.SURVEY,
        "not seen where it was laid down, or no grasp brings it on as it lies: skip",
    ),
    Row(
        PickState.VERIFY,
        PickEvent.MISSED,
        PickState.SURVEY,
        "it lies there still, or elsewhere, or the hand is empty: opened over the bin, try again or skip",
    ),
    Row(PickState.BIN, PickEvent.BINNED, PickState.HOME, "let go over the bin"),
    Row(
        PickState.BIN, PickEvent.DROPPED, PickState.HOME, "the gripper came to the bin empty: the part fell on the way"
    ),
    Row(
        PickState.BIN,
        PickEvent.STILL_HELD,
        PickState.HOME,
        "the part still shows in the opened gripper: the next pick puts it down again",
    ),
    Row(PickState.BIN, PickEvent.DRY, PickState.HOME, "nothing was sent: the hand holds what it held"),
    Row(PickState.HOME, PickEvent.THERE, PickState.IDLE, "the pick has ended"),
    Row(PickState.ANY, PickEvent.PAUSE, PickState.PAUSED, "an operator holds it before its next move"),
    Row(PickState.PAUSED, PickEvent.RESUME, PickState.BACK, "and lets it go on"),
    Row(PickState.ANY, PickEvent.ABORT, PickState.IDLE, "the arm is stopped, the part is given up"),
    Row(PickState.ANY, PickEvent.ERROR, PickState.FAULT, "the arm is stopped first, then the error is reported"),
    Row(PickState.ANY, PickEvent.STOP, PickState.FAULT, "the arm is stopped first, then it is reported"),
    Row(PickState.FAULT, PickEvent.ABORT, PickState.FAULT, "the arm is stopped; the fault stands"),
    Row(PickState.FAULT, PickEvent.RESUME, PickState.IDLE, "an operator says that it may move again"),
)
NEXT = {(row.state, row.event): row.then for row in TABLE}


def follows(state: PickState, event: PickEvent, held: PickState) -> PickState:
    """Where an event leads from a state; held: where a pause came in. KeyError where the table has no row for it."""
    then = NEXT.get((state, event)) or NEXT[PickState.ANY, event]
    return held if then is PickState.BACK else then
