"""The state of arm and gripper as far as facetd knows it: each fact with its source and time, and what invalidates it.

One value (`CellBelief`) has one owner (`Beliefs`). A teach pendant, a second terminal, a program in the controller or
a part that slips can change the cell without facetd's knowledge. So a belief is only a hint: code that acts on one
checks its source, and a move reads the position from the controller again immediately before it is sent (motion.py).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from typing import Any, Generic, TypeVar

import numpy as np

from daemon.arm.body import Capsule
from daemon.arrays import Array

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Reading:
    """A position of the arm, as the controller reports it: world_from_tool (4, 4) mm, joints_rad (6,)."""

    world_from_tool: Array
    joints_rad: Array


class BeliefSource(StrEnum):
    """How a fact was learnt."""

    REPORTED = "reported by the controller"
    COMMANDED = "commanded by facetd"
    OBSERVED = "observed by the cameras"
    OPERATOR = "reported by an operator"
    ASSUMED = "assumed"


@dataclass(frozen=True, eq=False)
class Belief(Generic[T]):
    """One fact; learnt_s: when, on the cell's clock."""

    value: T
    source: BeliefSource
    learnt_s: float


@dataclass(frozen=True, eq=False)
class HeldPart:
    """The grasped part: label; tool_from_part (4, 4) mm at the grasp, with its covariance (6, 6)."""

    label: str
    tool_from_part: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class CellBelief:
    """All beliefs about the cell; None: unknown. The monitor speed is not stored: each move sends its own."""

    position: Belief[Reading] | None = None
    """Where the arm is at rest."""
    planned: Belief[Reading] | None = None
    """In a dry run, where the arm would be had its moves been sent."""
    last_joint_move_end: Belief[Reading] | None = None
    """Where the last joint-interpolated move ended. The controller keeps that configuration of shoulder, elbow and
    wrist for the next such move, even if a pendant has changed the arm's configuration since."""
    tool: Belief[Array] | None = None
    """The controller's TOOL, flange_from_tool (4, 4) mm."""
    closed: Belief[bool] | None = None
    """Whether the gripper is closed."""
    holding: Belief[bool] | None = None
    """Whether the gripper holds a part."""
    grasped_part: Belief[HeldPart] | None = None
    """Which part facetd grasped, and how."""
    held_shape: Belief[tuple[Capsule, ...]] | None = None
    """The shape of that part for the guard, capsules in the tool's frame."""

    @property
    def resting_reading(self) -> Reading | None:
        return None if self.position is None else self.position.value

    @property
    def next_start(self) -> Reading | None:
        """Where the next move starts: where the arm is or, in a dry run, would be."""
        return self.resting_reading if self.planned is None else self.planned.value

    @property
    def holds_part(self) -> bool | None:
        """Whether a part is in the gripper; None: unknown."""
        return None if self.holding is None else self.holding.value

    @property
    def empty_unproven(self) -> bool:
        """Whether the gripper counts as empty for another reason than that facetd opened it. Such a reason may be
        wrong: an operator may have looked at another cell or overlooked a small part, a record from before the start
        may be outdated, and after a stop somebody may have closed the gripper on a part with the pendant."""
        return self.holding is not None and not self.holding.value and self.holding.source is not BeliefSource.COMMANDED

    @property
    def may_hold(self) -> bool:
        """Whether a part is, or may be, in the gripper: it holds one, or that is unknown, or nobody has checked since
        it was last known to be open."""
        return self.holding is None or self.holding.value or self.holding.source is BeliefSource.ASSUMED

    @property
    def capsules(self) -> tuple[Capsule, ...]:
        """The guarded shape of a part that is, or may be, in the gripper."""
        return () if self.held_shape is None else self.held_shape.value

    def json(self, now_s: float) -> dict[str, dict[str, object]]:
        """Each known fact for people: its value, its source, and its age in s."""
        known = {KEYS.get(field.name, field.name): getattr(self, field.name) for field in fields(self)}
        return {
            name: {"value": _plain(belief.value), "how": str(belief.source), "age_s": round(now_s - belief.learnt_s, 1)}
            for name, belief in known.items()
            if belief is not None
        }


KEYS = {"last_joint_move_end": "turned", "grasped_part": "held", "held_shape": "load"}
"""Keys of `status` for programs, where they are not the field's name."""


class VoidingEvent(StrEnum):
    """An event after which some beliefs are no longer valid (see VOIDS)."""

    MOVE_BEGUN = "the arm may be moving"
    GRIPPER_CLOSES = "the gripper is closing"
    GRIPPER_OPENS = "the gripper is opening"
    STOPPED = "the arm was stopped"
    FAULT_CLEARED = "a fault was cleared; people may have worked at the arm while it was active"
    RECONNECTED = "the line was opened again"
    RESTARTED = "facetd was restarted"
    OPERATOR_TYPED = "an operator typed to the controller"
    TURN_TYPED = "a line that may turn shoulder, elbow or wrist over was typed to the controller"
    GRIPPER_TYPED = "a line that may work the gripper was typed to the controller"
    MOVED_BY_OTHERS = "somebody else moved the arm"
    OTHERS_TYPED = "somebody else typed on the arm's line"
    GRIPPER_CHANGED = "another gripper was mounted, or its tool centre point is another"


PLACE = frozenset({"position", "planned"})
CONTROLLER = PLACE | {"tool", "closed"}
GRIPPER = frozenset({"closed", "holding", "grasped_part", "held_shape"})
VOIDS: Mapping[VoidingEvent, frozenset[str]] = {
    VoidingEvent.MOVE_BEGUN: PLACE,
    VoidingEvent.GRIPPER_CLOSES: GRIPPER,
    VoidingEvent.GRIPPER_OPENS: frozenset({"closed"}),
    VoidingEvent.STOPPED: CONTROLLER,
    VoidingEvent.FAULT_CLEARED: CONTROLLER,
    VoidingEvent.RECONNECTED: CONTROLLER | {"last_joint_move_end"},
    VoidingEvent.RESTARTED: CONTROLLER | GRIPPER | {"last_joint_move_end"},
    VoidingEvent.OPERATOR_TYPED: CONTROLLER,
    VoidingEvent.TURN_TYPED: frozenset({"last_joint_move_end"}),
    VoidingEvent.GRIPPER_TYPED: GRIPPER,
    VoidingEvent.MOVED_BY_OTHERS: PLACE | {"closed", "held_shape"},
    VoidingEvent.OTHERS_TYPED: CONTROLLER | GRIPPER,
    VoidingEvent.GRIPPER_CHANGED: CONTROLLER | GRIPPER | {"last_joint_move_end"},
}
"""The facts that each event makes unknown. After a stop, what the gripper holds is still believed, unless it was
opening. A closing gripper, or one that a pendant may have operated, may hold another part than the guarded one."""
RECORDED = frozenset({VoidingEvent.GRIPPER_TYPED, VoidingEvent.OTHERS_TYPED, VoidingEvent.GRIPPER_CHANGED})
"""The events after which the content of the gripper is unknown and that have no other record in the run."""


def voided(belief: CellBelief, change: VoidingEvent) -> CellBelief:
    """The beliefs that remain after an event. A gripper believed to be empty stays so; but if it is no longer known to
    be open, that is only assumed: a pendant may have closed it on a part. An assumed shape stays, because it covers any
    part that this gripper may hold; only another gripper voids it."""
    unknown = VOIDS[change]
    assumed = belief.held_shape is not None and belief.held_shape.source is BeliefSource.ASSUMED
    if assumed and change is not VoidingEvent.GRIPPER_CHANGED:
        unknown -= {"held_shape"}
    if change is VoidingEvent.GRIPPER_OPENS and belief.holds_part:
        unknown |= {"holding", "grasped_part"}
    if "closed" in unknown and belief.holding is not None and not belief.holding.value:
        belief = replace(belief, holding=replace(belief.holding, source=BeliefSource.ASSUMED))
    return replace(belief, **dict.fromkeys(unknown))


class Beliefs:
    """The owner of the beliefs about a cell: only this class replaces `now`.

    clock: the cell's; record: writes to the run log. After a crash the log is the only source that says that a part
    may be in the gripper, so that is recorded at once.
    """

    def __init__(self, clock: Callable[[], float], record: Callable[..., None]) -> None:
        self._clock, self._record = clock, record
        self.now = CellBelief(holding=Belief(False, BeliefSource.ASSUMED, clock()))

    def learn(self, source: BeliefSource, **facts: object) -> None:
        """Store new facts; a fact of None becomes unknown."""
        now_s = self._clock()
        learnt: dict[str, Any] = {
            name: None if value is None else Belief(value, source, now_s) for name, value in facts.items()
        }
        self.now = replace(self.now, **learnt)

    def void(self, change: VoidingEvent) -> Callable[[], None]:
        """Make unknown what an event invalidates. Returns a function that undoes this, for an event that did not happen
        after all; it does nothing once anything else was learnt or voided."""
        before, after = self.now, voided(self.now, change)
        self.now = after
        if change in RECORDED:
            self._record("holding", held=None)

        def undo() -> None:
            if self.now is after:
                self.now = before

        return undo


def _plain(value: object) -> object:
    """A belief's value as JSON."""
    match value:
        case Reading():
            return value.world_from_tool[:3, 3].round(2).tolist()
        case HeldPart():
            return value.label
        case np.ndarray():
            return value[:3, 3].round(2).tolist()
        case tuple():
            return [capsule.name for capsule in value]
    return value
