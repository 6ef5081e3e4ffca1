"""Outcomes of picks, and the definition of "tried" and of success by which every table, page and metric counts."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum


class Outcome(StrEnum):
    """How a pick ended, or why a part was not picked."""

    PICKED = "picked"
    RELEASED = "released"
    OFF = "off"
    MISSED = "missed"
    EMPTY = "empty"
    LOST = "lost"
    AMBIGUOUS = "ambiguous"
    UNKNOWN = "unknown"
    UNREACHABLE = "unreachable"
    UNSURE = "unsure"
    DRY = "dry"
    EMPTIED = "emptied"
    FULL = "full"
    ABORTED = "aborted"
    FAULT = "fault"


BROUGHT = frozenset({Outcome.PICKED, Outcome.RELEASED, Outcome.OFF})
"""The part was put down where it was to go, or near it."""
UNFINISHED = "unfinished"
"""The outcome of a pick without a record of its end: the end of its run interrupted it."""
GOING_ON = "going on"
"""The outcome of such a pick while facetd still writes its run."""
NOTHING_TO_PICK = frozenset({Outcome.EMPTY, Outcome.DRY, Outcome.EMPTIED, Outcome.FULL})
INTERRUPTED = frozenset({Outcome.ABORTED, UNFINISHED, GOING_ON})
GRASPED = frozenset({Outcome.PICKED, Outcome.RELEASED, Outcome.OFF, Outcome.MISSED})
"""The gripper closed on the part: only these picks have an error at the grasp."""
DEFINITION = (
    "A pick counts as tried when there was a part to pick and neither a person nor the end of the run ended it. It "
    "is a success when the cameras confirmed the part in the gripper. A person's stop or abort, an interrupted pick, "
    "an empty table and a gripper that was only emptied do not count as tried. What stops the arm after the part was "
    "let go is counted as a stop and leaves the pick its outcome."
)


def is_tried(outcome: str) -> bool:
    """Whether a pick with this outcome counts as tried; an outcome of a newer release does."""
    return outcome not in NOTHING_TO_PICK and outcome not in INTERRUPTED


def is_success(outcome: str) -> bool:
    """Whether a pick with this outcome is a success."""
    return outcome == Outcome.PICKED


@dataclass(frozen=True)
class PickCounts:
    """Numbers of picks. released: the gripper opened over the bin, the part unconfirmed; aborted: ended by a person."""

    tried: int
    picked: int
    released: int
    aborted: int

    @property
    def failed(self) -> int:
        """Tried without success; unconfirmed releases do not count."""
        return self.tried - self.picked - self.released


def tally(outcomes: Iterable[str]) -> PickCounts:
    """Count the outcomes of picks; a Counter counts each outcome by its number."""
    counts = Counter(outcomes)
    return PickCounts(
        tried=sum(n for outcome, n in counts.items() if is_tried(outcome)),
        picked=sum(n for outcome, n in counts.items() if is_success(outcome)),
        released=counts[Outcome.RELEASED],
        aborted=counts[Outcome.ABORTED],
    )
