"""How a pick ends, and the one definition of "tried" and of success by which every table, page and metric counts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum


class Outcome(StrEnum):
    """How a pick ended, or why a part was left where it lies, in a word."""

    PICKED = "picked"
    RELEASED = "released"
    MISSED = "missed"
    EMPTY = "empty"
    LOST = "lost"
    AMBIGUOUS = "ambiguous"
    UNKNOWN = "unknown"
    UNREACHABLE = "unreachable"
    UNSURE = "unsure"
    DRY = "dry"
    PLACED = "placed"
    ABORTED = "aborted"
    FAULT = "fault"


UNFINISHED = "unfinished"
"""The outcome of a pick that the end of its run cut off: its record of an end is missing."""
GOING_ON = "going on"
"""The same while its run is still being written."""
NOTHING_TO_PICK = frozenset({Outcome.EMPTY, Outcome.DRY, Outcome.PLACED})
INTERRUPTED = frozenset({Outcome.ABORTED, UNFINISHED, GOING_ON})
GRASPED = frozenset({Outcome.PICKED, Outcome.RELEASED, Outcome.MISSED})
"""The gripper closed on the part: an error at the grasp applies to these picks alone."""
DEFINITION = (
    "A pick counts as tried when something to pick lay there and neither a person nor the end of the run ended it. It "
    "is a success when the part was seen to be picked. A person's stop or abort, an interrupted pick, an empty table "
    "and a part that was only put down are not tried."
)


def is_tried(outcome: str) -> bool:
    """Whether a pick with this outcome counts as tried; an outcome that a newer release added does."""
    return outcome not in NOTHING_TO_PICK and outcome not in INTERRUPTED


def is_success(outcome: str) -> bool:
    """Whether a pick with this outcome is a success."""
    return outcome == Outcome.PICKED


@dataclass(frozen=True)
class PickCounts:
    """Picks counted. released: the gripper let go over the bin and nothing confirmed the part; aborted: ended by a
    person; interrupted: cut off by the end of a run, or not ended yet."""

    tried: int
    picked: int
    released: int
    aborted: int
    interrupted: int

    @property
    def failed(self) -> int:
        """Tried without success, the unconfirmed left out."""
        return self.tried - self.picked - self.released


def tally(outcomes: Iterable[str]) -> PickCounts:
    """Count the outcomes of picks; a Counter counts by its numbers."""
    counts = Counter(outcomes)
    return PickCounts(
        tried=sum(n for outcome, n in counts.items() if is_tried(outcome)),
        picked=sum(n for outcome, n in counts.items() if is_success(outcome)),
        released=counts[Outcome.RELEASED],
        aborted=counts[Outcome.ABORTED],
        interrupted=counts[UNFINISHED] + counts[GOING_ON],
    )
