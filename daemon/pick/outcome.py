"""How a pick ends, and its observer. Values only."""

import asyncio
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from daemon.arm import JobEvent
from daemon.arrays import Array
from daemon.events.codes import CauseCode, DecisionCode
from daemon.events.outcomes import Outcome
from daemon.pick.looks import Look


@dataclass(frozen=True)
class PickResult:
    """Result of a pick: its outcome, the reason as text, and the code of its cause; None where no cause needs
    attention."""

    outcome: Outcome
    why: str
    code: CauseCode | DecisionCode | None


NOTHING_THERE = PickResult(Outcome.EMPTY, "nothing on the table that can be picked", None)
"""Result of a pick that has found nothing yet."""


@dataclass(frozen=True, eq=False)
class Skipped:
    """A skipped part: its label, its position (3,) world mm, the outcome, and the reason."""

    label: str
    centre: Array
    outcome: Outcome
    why: str


@dataclass(frozen=True, eq=False)
class CycleEnd:
    """How a pick ended. skipped: parts left alone in this pick; grasp: world_from_tool at the grasp;
    corners: (N, 3) world mm, where the part's corners were estimated to be; brought: whether the part that
    was grasped was let go over the bin or at its place, and not lost before; place: where it was set down, None: not at
    a place; ended_by: what stopped the arm before the pick had ended, perhaps after its outcome."""

    cycle: int
    outcome: Outcome
    label: str | None
    why: str
    stops: int
    seconds: float
    predicted_mm: float | None
    predicted_deg: float | None
    grasp: Array | None
    skipped: tuple[Skipped, ...]
    corners: Array | None
    brought: bool
    place: str | None = None
    ended_by: JobEvent | None = None


class InGripper(StrEnum):
    """What a look at the gripper shows."""

    PART = "part"
    EMPTY = "empty"
    UNCLEAR = "unclear"


def not_looked_at(label: str, where: str) -> PickResult:
    """Result of a pick when the gripper opens at the destination, before a look has verified it."""
    why = f"{label} was released {where}; no look checked it"
    return PickResult(Outcome.RELEASED, why, CauseCode.RELEASE_UNCONFIRMED)


def released(label: str, above: InGripper, opened: InGripper) -> PickResult:
    """Result of a pick whose gripper opened above the bin. above, opened: what the looks before and after show."""
    if opened is not InGripper.PART and above is InGripper.PART:
        why = f"{label} showed in the gripper above the bin, and no longer once it had opened"
        return PickResult(Outcome.PICKED, why, None)
    if opened is InGripper.PART:
        why = f"{label} still shows in the gripper after it opened above the bin"
    elif above is InGripper.EMPTY:
        why = f"the gripper came to the bin empty: {label} fell on the way"
    else:
        why = f"{label} did not show in the gripper above the bin, so it is not proven that the part fell into the bin"
    return PickResult(Outcome.RELEASED, why, CauseCode.RELEASE_UNCONFIRMED)


class Observer(Protocol):
    """Called for each look and each pick, after its record is written. To stop the arm, an observer calls the
    supervisor; an exception does not stop it."""

    def looked(self, look: Look) -> None:
        """A look was taken, in a pick or between."""

    def ended(self, end: CycleEnd) -> None:
        """A pick has ended."""


def notify(observer: Observer | None, what: Look | CycleEnd) -> None:
    """Call the observer, if any. The event loop reports its exceptions; they stop nothing."""
    if observer is None:
        return
    try:
        if isinstance(what, Look):
            observer.looked(what)
        else:
            observer.ended(what)
    except Exception as error:
        report = {"message": "an observer of the cycle failed", "exception": error}
        asyncio.get_running_loop().call_exception_handler(report)
