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


S, E = PickState, PickEvent
TABLE: tuple[Row, ...] = (
    Row(S.IDLE, E.BEGIN, S.SURVEY, "an operator or auto asks for a part"),
    Row(S.IDLE, E.FULL_HAND, S.BIN, "a part is in the gripper: first bring it to the bin"),
    Row(S.SURVEY, E.SEEN, S.CHOOSE, "something on the table was not skipped before"),
    Row(S.SURVEY, E.NOTHING, S.HOME, "no view shows anything to pick"),
    Row(S.CHOOSE, E.CHOSEN, S.STOP_N, "a part has a name and a grasp, and the arm can reach the whole approach"),
    Row(S.CHOOSE, E.DOUBTFUL, S.SECOND_VIEW,
        "more than one part fits, or none, or an unnamed facet is in the way: look from another side"),
    Row(S.CHOOSE, E.STALE, S.SURVEY, "the look is too old to base a move on"),
    Row(S.CHOOSE, E.NONE_LEFT, S.HOME, "what is left is skipped, each with its reason"),
    Row(S.SECOND_VIEW, E.SEEN, S.CHOOSE,
        "looked again, from the side that promises most for its time, or from far from the earlier looks"),
    Row(S.STOP_N, E.THERE, S.LOOKING, "at the next stand-off, at rest"),
    Row(S.STOP_N, E.UNREACHABLE, S.CHOOSE, "the guard refused the move: plan again, or skip"),
    Row(S.LOOKING, E.LOOKED, S.ESTIMATING, "found where it was expected"),
    Row(S.LOOKING, E.ELSEWHERE, S.CHOOSE, "seen, but it lies otherwise than expected: plan again"),
    Row(S.LOOKING, E.LOST, S.CHOOSE, "not found where it was expected: skip"),
    Row(S.ESTIMATING, E.UNSURE, S.STOP_N, "the predicted error at the grasp is too large"),
    Row(S.ESTIMATING, E.SURE, S.FINAL, "the predicted error is small enough to grasp without a further look"),
    Row(S.ESTIMATING, E.DOUBT, S.SURVEY, "looks disagree: look at the whole table and compare it with the look before"),
    Row(S.ESTIMATING, E.ELSEWHERE, S.CHOOSE, "the planned grasp does not fit the part as it lies: plan again"),
    Row(S.ESTIMATING, E.LOST, S.CHOOSE, "planned anew too often: skip"),
    Row(S.ESTIMATING, E.GAVE_UP, S.CHOOSE, "still unsure after the largest number of looks: skip"),
    Row(S.FINAL, E.THERE, S.CLOSING, "the gripper is around the part"),
    Row(S.FINAL, E.DRY, S.HOME, "nothing was sent: there is nothing to close on"),
    Row(S.FINAL, E.UNREACHABLE, S.CHOOSE, "the guard refused the move: plan again, or skip"),
    Row(S.CLOSING, E.CLOSED, S.RETREAT, "the gripper has closed"),
    Row(S.RETREAT, E.THERE, S.VERIFY, "lifted and backed off"),
    Row(S.VERIFY, E.GONE, S.BIN,
        "the part shows in the gripper, or no longer lies there and the gripper does not show empty"),
    Row(S.VERIFY, E.MEASURED, S.SET_DOWN, "the part has a place, and its edges show how the gripper holds it"),
    Row(S.SET_DOWN, E.SET_DOWN, S.LOOK_AT_PLACE, "lowered to its support, released, backed off"),
    Row(S.SET_DOWN, E.LAID_DOWN, S.LOOK_AT_LAID,
        "laid on the table on another side, for another grasp; released, backed off"),
    Row(S.SET_DOWN, E.UNREACHABLE, S.BIN, "the guard refused the way to its place"),
    Row(S.SET_DOWN, E.LOST, S.BIN,
        "lost on the way: the gripper's sensor says so, and no look shows the part in the gripper"),
    Row(S.SET_DOWN, E.DRY, S.HOME, "dry run: nothing was sent, the gripper holds what it held before"),
    Row(S.LOOK_AT_PLACE, E.SEEN, S.HOME, "the look shows the part right, off, or not at all"),
    Row(S.LOOK_AT_LAID, E.SEEN, S.STOP_N, "it lies there: the next grasp is planned"),
    Row(S.LOOK_AT_LAID, E.LOST, S.SURVEY, "not seen where it was laid down, or no grasp for it from there: skip"),
    Row(S.VERIFY, E.MISSED, S.SURVEY,
        "the part still lies there, or elsewhere, or the gripper is empty: open over the bin, then try again or skip"),
    Row(S.BIN, E.BINNED, S.HOME, "released over the bin"),
    Row(S.BIN, E.DROPPED, S.HOME, "the gripper came to the bin empty: the part fell on the way"),
    Row(S.BIN, E.STILL_HELD, S.HOME, "the part still shows in the opened gripper: the next pick puts it down again"),
    Row(S.BIN, E.DRY, S.HOME, "dry run: nothing was sent, the gripper holds what it held before"),
    Row(S.HOME, E.THERE, S.IDLE, "the pick has ended"),
    Row(S.ANY, E.PAUSE, S.PAUSED, "an operator holds the arm before its next move"),
    Row(S.PAUSED, E.RESUME, S.BACK, "an operator lets the pick go on"),
    Row(S.ANY, E.ABORT, S.IDLE, "the arm is stopped, the part is given up"),
    Row(S.ANY, E.ERROR, S.FAULT, "the arm is stopped first, then the error is reported"),
    Row(S.ANY, E.STOP, S.FAULT, "the arm is stopped first, then it is reported"),
    Row(S.FAULT, E.ABORT, S.FAULT, "the arm is stopped; the fault stays active"),
    Row(S.FAULT, E.RESUME, S.IDLE, "an operator permits motion again"),
)  # fmt: skip
NEXT = {(row.state, row.event): row.then for row in TABLE}


def follows(state: PickState, event: PickEvent, held: PickState) -> PickState:
    """Where an event leads from a state; held: where a pause came in. KeyError where the table has no row for it."""
    then = NEXT.get((state, event)) or NEXT[S.ANY, event]
    return held if then is S.BACK else then
