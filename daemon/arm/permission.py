"""The motion permission: whether arm and gripper may move now. Supervisor, mover and controller line share one object.

The supervisor grants and withdraws it, and sets the fault and the hold; the controller line reports whether the stop
works. The mover checks it before it plans a move and before it sends it; the line checks it again before the last byte
of a motion command leaves (drivers/val2/conversation.py).
"""

from dataclasses import dataclass
from enum import StrEnum

from daemon.events.codes import BY_OPERATOR, FaultCause


@dataclass(frozen=True)
class Refusal:
    """Why a motion is refused: the broken rule's name and a line for people."""

    rule: str
    text: str


@dataclass(frozen=True)
class Fault:
    """An active fault. text: a line for people; causes: that of the text's first words, then those of the faults that
    joined it before `resume`."""

    text: str
    causes: tuple[FaultCause, ...] = (BY_OPERATOR,)

    @property
    def cause(self) -> FaultCause:
        """The cause to remove first."""
        return self.causes[0]

    def __str__(self) -> str:
        return self.text


class Grant(StrEnum):
    """What an operator permits the arm to do."""

    NOTHING = "nothing"
    TYPED_LINES = "typed lines"
    """Only motions that an operator types to the controller: the guard cannot check moves in this cell."""
    ALL = "all"


class MotionPermission:
    """The motion permission (see the module).

    stop_tests: how often facetd has verified that the controller accepts the stop command; 0: not yet since the line
    was opened or the controller was switched on. stop_answered: how often the controller sent something after a stop
    command; heard: how often it sent anything. stop_took_s: the duration of the tested stop; 0: not tested. fault:
    the active fault, until `resume`."""

    def __init__(self) -> None:
        self.stop_tests = self.stop_answered = self.heard = 0
        self.stop_took_s = 0.0
        self.fault: Fault | None = None
        self.why = ""
        """The reason of the current or last stop."""
        self._grant, self._granted_with = Grant.NOTHING, 0
        self._stops_under_way = 0
        self._holds = self._released_at = 0
        """The number of holds (pause, step mode), and that number when the last move was released."""

    @property
    def granted(self) -> bool:
        """Whether an operator permits motion, whether or not the stop is still verified."""
        return self._grant is not Grant.NOTHING

    @property
    def enabled(self) -> bool:
        """Whether an operator permits motion and the stop is verified."""
        return self._grant is Grant.ALL and self.stop_as_granted

    @property
    def typed_lines_only(self) -> bool:
        """Whether only motions that an operator types to the controller are permitted."""
        return self._grant is Grant.TYPED_LINES and self.stop_as_granted

    @property
    def stop_as_granted(self) -> bool:
        """Whether the stop tested at `enable` is still valid. False after a lost line, a restarted controller or a
        refused stop, also if the stop was tested again since: the operator must enable anew."""
        return self.stop_tests == self._granted_with > 0

    @property
    def stopping(self) -> bool:
        """Whether a stop is under way: until the controller reports the arm at rest and the job has ended."""
        return self._stops_under_way > 0

    @property
    def blocked(self) -> bool:
        """Whether nothing may move, whatever was granted: a fault is active, or a stop is under way."""
        return self.fault is not None or self.stopping

    def refusal(self, typed: bool = False) -> Refusal | None:
        """Why arm and gripper may not move now; None: they may. typed: whether an operator types the motion to the
        controller; otherwise facetd commands it, and the guard checks it."""
        if self.fault is not None:
            return Refusal("fault_active", f"a fault is active ({self.fault}): `resume` first")
        if self.stopping:
            return Refusal("fault_active", f"the arm is being stopped ({self.why}): try again when it is at rest")
        if self.enabled or (typed and self.typed_lines_only):
            return None
        if self.typed_lines_only:
            only = "the arm is enabled for `robot` only: calibrate hand-eye first (calibration.yaml has no hand_eye)"
            return Refusal("not_enabled", only)
        return Refusal("not_enabled", "the arm is not enabled: `enable` first")

    @property
    def must_wait(self) -> bool:
        """Whether a hold began since the last move was released."""
        return self._holds != self._released_at

    @property
    def withheld(self) -> bool:
        """Whether a released move must not be sent after all; the line checks this before its last byte leaves. On a
        bad line sending takes seconds: an operator who pauses in that time means this move."""
        return self.must_wait or self.refusal(typed=True) is not None

    def grant(self, what: Grant) -> None:
        """Permit motion from now on, with the present verification of the stop."""
        self._grant, self._granted_with = what, self.stop_tests

    def withdraw(self) -> None:
        """Permit no motion."""
        self._grant = Grant.NOTHING

    def stop_begins(self) -> None:
        """Block motion until this stop has ended."""
        self._stops_under_way += 1

    def stop_ends(self) -> None:
        """End one of the stops that began."""
        self._stops_under_way -= 1

    def require_wait(self) -> None:
        """Hold the next move."""
        self._holds += 1

    def release(self) -> None:
        """Let a move be sent, after it waited or had no need to."""
        self._released_at = self._holds
