"""Whether arm and gripper may move at this moment: one object, held by the supervisor, the mover and the line.

The supervisor grants and withdraws it, keeps the fault and the hold; the line to the controller says whether the stop
is seen to work. The mover asks it before a move is planned and before it is sent, the line once more before the last
byte of what moves leaves (drivers/val2/conversation.py).
"""

from enum import StrEnum


class Grant(StrEnum):
    """What an operator permits the arm to do."""

    NOTHING = "nothing"
    BY_HAND = "by hand"
    """Only what an operator tells the controller himself: no guard knows how this cell stands."""
    ALL = "all"


class MotionPermit:
    """See the module. stop_seen: how often it has come to be seen that the controller takes the word that stops the
    arm; 0 where it was not since the line was opened or the controller switched on. stop_answered: how often something
    was heard behind that word; heard: how often anything was. stop_took_s: how long the stop took, as it was tried; 0
    where it was not. fault: what is active until `resume`."""

    def __init__(self) -> None:
        self.stop_seen = self.stop_answered = self.heard = 0
        self.stop_took_s = 0.0
        self.fault: str | None = None
        self.why = ""
        """Why the arm is being stopped, or was last."""
        self._grant, self._granted_with = Grant.NOTHING, 0
        self._stops = 0
        self._holds = self._released_at = 0
        """How often the next move was to wait (pause, step), and how often as the last one was released."""

    @property
    def granted(self) -> bool:
        """Whether an operator let the arm move, be its stop seen to work still or not."""
        return self._grant is not Grant.NOTHING

    @property
    def enabled(self) -> bool:
        """Whether an operator lets the arm move, its stop seen to work."""
        return self._grant is Grant.ALL and self.stop_as_granted

    @property
    def by_hand_only(self) -> bool:
        """Whether an operator lets the arm do what he tells the controller himself, and nothing else."""
        return self._grant is Grant.BY_HAND and self.stop_as_granted

    @property
    def stop_as_granted(self) -> bool:
        """Whether the stop is seen to work as it was when the permit was granted. Where it was not meanwhile (the line
        was lost, the controller switched off, or refuses it), that it is seen again gives no permit back."""
        return self.stop_seen == self._granted_with > 0

    @property
    def stopping(self) -> bool:
        """Whether a stop is under way: until the arm was seen at rest and the job has ended."""
        return self._stops > 0

    @property
    def hindrance(self) -> str | None:
        """The fault that is active, or the stop that is under way: nothing moves."""
        return self.fault or (f"being stopped ({self.why})" if self.stopping else None)

    @property
    def held(self) -> bool:
        """Whether the next move is to wait, since one was released."""
        return self._holds != self._released_at

    @property
    def withheld(self) -> bool:
        """Whether what was released is held after all: asked before its last byte leaves. On a bad line it takes
        seconds until that, and whoever says in them that the next move is to wait means this one."""
        return self.held or self.hindrance is not None or not (self.enabled or self.by_hand_only)

    def grant(self, what: Grant) -> None:
        """What an operator permits from now on, the stop as it is seen to work now."""
        self._grant, self._granted_with = what, self.stop_seen

    def withdraw(self) -> None:
        """Nothing may move."""
        self._grant = Grant.NOTHING

    def stop_begins(self) -> None:
        """Nothing moves until this stop has ended."""
        self._stops += 1

    def stop_ends(self) -> None:
        """One of the stops that began has ended."""
        self._stops -= 1

    def hold(self) -> None:
        """The next move is to wait."""
        self._holds += 1

    def release(self) -> None:
        """A move that waited, or had no need to, may be sent."""
        self._released_at = self._holds
