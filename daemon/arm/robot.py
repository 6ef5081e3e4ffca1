"""The arm of a cell, as everything above the cell sees it: `Robot`, its data and its controller's command line.

A back-end's arm honours `Robot` (VAL II's: daemon/cell/val2_arm.py; LinuxCNC's: daemon/cell/linuxcnc_arm.py). Protocols
only; no hardware.
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager
from typing import Protocol

from daemon.arm.belief import Beliefs, Reading
from daemon.arm.body import Capsule
from daemon.arm.guard import MoveCommand
from daemon.arm.permit import MotionPermit
from daemon.arrays import Array
from daemon.errors import FacetdError


class StopRefusedError(FacetdError):
    """The controller does not take the word that is to stop the arm."""

    code = "controller_refused"


class HeldBackError(FacetdError):
    """What was to move was held back as the last byte of it was about to leave: nothing was carried out."""


class Kinematics(Protocol):
    """How an arm moves: a value without a line, that another process can have."""

    def reachable(self, world_from_tool: Array, joints_rad: Array) -> Array | None:
        """Joints (6,) rad that bring the tool there in the arm's present configuration (righty/above/flip as in
        joints_rad), within the joint limits and clear of singular wrists, or None."""

    def between(self, joints_rad: Array, to_rad: Array, share: float) -> Array:
        """world_from_tool (4, 4) a share (0 to 1) of the way of a joint-interpolated move."""

    def frames(self, joints_rad: Array) -> Array:
        """(N, 8, 4, 4) world from the arm's base, its links 1 to 6 and the tool at (N, 6) joint angles.

        z of frame k - 1 is the axis of joint k and passes its origin; links 4 to 6 have theirs in the wrist centre.
        """

    def along(self, world_from_tool: Array, joints_rad: Array) -> Array:
        """(N, 6) joints along a straight way of (N, 4, 4) poses that begins at joints_rad (6,), in its configuration;
        or, joints_rad (N, 6), at poses each near to one where the joints are known. nan where the arm does not get
        there, as in `reachable`."""


class ArmModel(Kinematics, Protocol):
    """An arm as data: what is known of it before there is a line to it."""

    def ways(self, world_from_tool: Array) -> Sequence[Array]:
        """Joints (6,) rad of every configuration that brings the tool there within the joint limits."""

    @property
    def reach_mm(self) -> float:
        """How far from the shoulder the tool centre point gets, at most."""

    @property
    def shoulder_mm(self) -> Array:
        """(3,) world: where axes 1 and 2 cross."""

    @property
    def links(self) -> tuple[Capsule, ...]:
        """What of the arm may strike something, the hand and the cameras aside."""


class ControllerMonitor(Protocol):
    """A controller's own command line, which a robot may have: an operator's way past facetd. Every method that sends
    may raise, and returns once the arm is at rest."""

    @property
    def question(self) -> str | None:
        """The controller's open question, or None."""

    @property
    def asks_whether_to_move(self) -> bool:
        """Whether a yes to that question may start a motion."""

    @property
    def heard_unasked(self) -> bool:
        """Whether something came on its line while nothing was asked: the next question to the robot reports it."""

    def check_typable(self, text: str) -> None:
        """Raise a FacetdError where a line cannot be typed to this controller."""

    def moves_the_arm(self, text: str) -> bool:
        """Whether the line may move the arm: anything that is not known to move nothing."""

    def turns_over(self, text: str) -> bool:
        """Whether the line may turn shoulder, elbow or wrist over at the next move."""

    def works_the_hand(self, text: str) -> bool:
        """Whether the line may open or close the gripper, by itself or by a program that it starts."""

    async def power_up(self, replies: Sequence[str]) -> list[str]:
        """Answer the controller's questions. Returns its output."""

    async def calibrate(self, reply: str) -> list[str]:
        """Let the arm find its zeros by a motion of its own. Returns the controller's output."""

    async def monitor(self, text: str) -> list[str]:
        """Send a line, as typed at the controller's own terminal. Returns its output."""

    def terminal(
        self, show: Callable[[bytes], None], tell: Callable[[str], None]
    ) -> AbstractAsyncContextManager[Callable[[bytes], None]]:
        """Context: the terminal for a person. Its output goes to `show`; yields the function that types. tell: called
        with what the person is to know once they left."""


class Robot(Protocol):
    """The arm, in matrices. Every method may raise; a method that raised has not promised that the arm stands still.

    permit: asked before the last byte of what moves arm or gripper leaves; where it is withheld, HeldBackError is
    raised and nothing was carried out. beliefs: what is believed of arm and gripper; the robot voids what it hears to
    be so no longer (somebody else types on its line, it was opened again), before it raises.
    """

    @property
    def permit(self) -> MotionPermit: ...

    @property
    def beliefs(self) -> Beliefs: ...

    @property
    def controller(self) -> ControllerMonitor | None:
        """The controller's own command line; None where it has none that a person may use."""

    @property
    def heard_s(self) -> float | None:
        """When the controller last answered, on the cell's clock."""

    @property
    def connected(self) -> bool:
        """Whether there is a line to the controller."""

    @property
    def aside(self) -> bool:
        """Whether a task has the line for itself: it knows by itself how long to wait, and nobody checks meanwhile."""

    @property
    def stopped_on_opening(self) -> bool:
        """Whether the arm was moving when the line was last opened, and was stopped."""

    async def open(self) -> None:
        """Claim the line. An arm that is found moving is stopped."""

    async def close(self) -> None:
        """Release the line; safe to call twice. Does not stop the arm."""

    async def check(self) -> str | None:
        """See that the controller answers. What it says that keeps the arm from moving until a person acts, or None."""

    async def where(self) -> Reading:
        """Ask the controller where the arm is; one that moves is a place on the way."""

    async def rest(self) -> Reading:
        """Where the arm is at rest (two readings that agree); waits a little for it, raises where it goes on moving."""

    async def move(
        self,
        world_from_tool: Array,
        *,
        starts: Callable[[Reading], None],
        straight: bool,
        speed_pct: float,
        timeout_s: float,
        then: MoveCommand | None = None,
    ) -> Reading:
        """Send one move and return when the arm is at rest (two readings that agree), with the last of them.

        In one turn of the line, whatever was said before: speed, location, a reading of where the arm is, the move.
        starts: called with that reading; what it raises comes out of here, and nothing has moved. straight: the tool
        goes along a straight line, otherwise the joints move together. Whether it arrived is for the caller to judge.
        then: the move that is expected to follow at once: what is said before it may be said before the last reading
        of this one.
        """

    async def hand(self, closed: bool) -> None:
        """Close the gripper, or open it (VAL II: CLOSEI, OPENI)."""

    async def set_outputs(self, numbers: Sequence[int]) -> None:
        """Switch digital outputs: n on, -n off."""

    async def work_valves(self, numbers: Sequence[int]) -> None:
        """Switch digital outputs that work the gripper, n on and -n off; held back as `hand` is."""

    async def ask_input(self, text: str) -> str:
        """What the controller prints to a line that reads an input, on one line."""

    async def at_rest(self) -> bool:
        """Whether the arm is at rest now: two readings agree."""

    async def abort(self) -> None:
        """Stop the arm now; may be called from another task at any time, also when nothing moves. Returns when it was
        seen at rest; raises StopRefusedError at once where the word is not taken, others after some tries."""

    async def prove_stop(self) -> None:
        """See that the controller takes the word that stops the arm. Raises StopRefusedError."""

    @property
    def kinematics(self) -> ArmModel:
        """The arm as data, with the tool that it has now."""

    def use_tool(self, flange_from_tool: Array) -> None:
        """Another gripper is mounted: its tool centre point, (4, 4) mm from the wrist centre. Moves nothing."""
