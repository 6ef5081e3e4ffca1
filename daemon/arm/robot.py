"""The interfaces of an arm: `Robot`, its kinematics, and its controller's command line. Protocols only; no hardware.

Each arm back-end implements `Robot` (VAL II: daemon/cell/val2_arm.py; LinuxCNC: daemon/cell/linuxcnc_arm.py).
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager
from typing import Protocol

from daemon.arm.belief import Beliefs, Reading
from daemon.arm.body import Capsule
from daemon.arm.guard import MoveCommand
from daemon.arm.permission import MotionPermission
from daemon.arrays import Array
from daemon.errors import FacetdError


class StopRefusedError(FacetdError):
    """The controller does not accept the stop command."""

    code = "controller_refused"


class HeldBackError(FacetdError):
    """The motion permission was withheld just before the last byte of a motion command left: nothing was carried
    out."""


class Kinematics(Protocol):
    """The kinematics of an arm: a value without a controller line, which can be sent to another process."""

    def reachable(self, world_from_tool: Array, joints_rad: Array) -> Array | None:
        """Joints (6,) rad that bring the tool there in the arm's present configuration (righty/above/flip as in
        joints_rad), within the joint limits and clear of singular wrists, or None."""

    def between(self, joints_rad: Array, to_rad: Array, share: float) -> Array:
        """world_from_tool (4, 4) at a share (0 to 1) of a joint-interpolated move."""

    def frames(self, joints_rad: Array) -> Array:
        """(N, 8, 4, 4) world from the arm's base, its links 1 to 6 and the tool at (N, 6) joint angles.

        z of frame k - 1 is the axis of joint k, through the frame's origin; the origins of links 4 to 6 are in the
        wrist centre.
        """

    def along(self, world_from_tool: Array, joints_rad: Array) -> Array:
        """(N, 6) joints for (N, 4, 4) poses on a straight path that starts at joints_rad (6,), in its configuration;
        or, with joints_rad (N, 6), for poses that are each near a pose with these joints. nan where the arm cannot
        reach a pose, as in `reachable`."""


class ArmModel(Kinematics, Protocol):
    """The model of an arm: kinematics, reach and collision shapes, without a controller line."""

    def ways(self, world_from_tool: Array) -> Sequence[Array]:
        """Joints (6,) rad of every configuration that brings the tool there within the joint limits."""

    @property
    def reach_mm(self) -> float:
        """The greatest distance of the tool centre point from the shoulder."""

    @property
    def shoulder_mm(self) -> Array:
        """(3,) world: where axes 1 and 2 cross."""

    @property
    def links(self) -> tuple[Capsule, ...]:
        """The collision shapes of the arm, without gripper and cameras."""


class ControllerMonitor(Protocol):
    """The controller's own command line, with which an operator commands the controller directly. Every method that
    sends may raise, and returns once the arm is at rest."""

    @property
    def question(self) -> str | None:
        """The controller's open question, or None."""

    @property
    def asks_whether_to_move(self) -> bool:
        """Whether answering that question with yes may start a motion."""

    @property
    def heard_unasked(self) -> bool:
        """Whether the controller sent something unasked; the next request to the robot reports it."""

    def check_typable(self, text: str) -> None:
        """Check that a line can be typed to this controller. Raises a FacetdError."""

    def moves_the_arm(self, text: str) -> bool:
        """Whether the line may move the arm: True for every line that is not known to be harmless."""

    def turns_over(self, text: str) -> bool:
        """Whether the line may change the configuration of shoulder, elbow or wrist at the next move."""

    def works_the_hand(self, text: str) -> bool:
        """Whether the line, or a program that it starts, may open or close the gripper."""

    async def power_up(self, replies: Sequence[str]) -> list[str]:
        """Answer the controller's questions. Returns its output."""

    async def calibrate(self, reply: str) -> list[str]:
        """Let the controller calibrate the arm, which moves it. Returns the controller's output."""

    async def monitor(self, text: str) -> list[str]:
        """Send a line, as typed at the controller's own terminal. Returns its output."""

    def terminal(
        self, show: Callable[[bytes], None], tell: Callable[[str], None]
    ) -> AbstractAsyncContextManager[Callable[[bytes], None]]:
        """Context: connect a person to the controller's terminal. Its output goes to `show`; yields the function that
        types. tell: called with a message for the person after they leave."""


class Robot(Protocol):
    """The arm; poses are matrices. Every method may raise; after an error the arm may still be moving.

    permission: checked before the last byte of a motion command leaves; if it is withheld, HeldBackError is raised and
    nothing was carried out. beliefs: the beliefs about arm and gripper. Before the robot raises, it voids those that
    are no longer valid (somebody else types on its line, the line was reconnected).
    """

    @property
    def permission(self) -> MotionPermission: ...

    @property
    def beliefs(self) -> Beliefs: ...

    @property
    def controller(self) -> ControllerMonitor | None:
        """The controller's own command line; None where it has none that a person may use."""

    @property
    def heard_s(self) -> float | None:
        """The time of the controller's last answer, on the cell's clock."""

    @property
    def connected(self) -> bool:
        """Whether there is a line to the controller."""

    @property
    def aside(self) -> bool:
        """Whether a task has exclusive use of the line. It has its own time limits, so no check runs meanwhile."""

    @property
    def stopped_on_opening(self) -> bool:
        """Whether the arm was moving when the line was last opened, and was stopped."""

    async def open(self) -> None:
        """Open the line. If the arm is moving, stop it."""

    async def close(self) -> None:
        """Close the line; may be called twice. Does not stop the arm."""

    async def check(self) -> str | None:
        """Check that the controller answers. Returns a state of it that keeps the arm from moving until a person acts,
        as text, or None."""

    async def where(self) -> Reading:
        """Read the arm's position from the controller, also while it moves."""

    async def wait_until_at_rest(self) -> Reading:
        """Return the position of the arm at rest (two readings that agree). Waits briefly for it; raises where the arm
        keeps moving."""

    async def move(
        self, command: MoveCommand, starts: Callable[[Reading], None], timeout_s: float, then: MoveCommand | None = None
    ) -> Reading:
        """Send one move, wait until the arm is at rest (two readings that agree), and return the last reading.

        Speed, location, a position reading and the move are sent without interruption, whatever was sent before.
        starts: called with that reading; an exception of it propagates, and nothing has moved. The caller checks the
        arrival. then: the move that will follow at once; its preparation may be sent before the last reading of this
        one.
        """

    async def set_gripper(self, closed: bool) -> None:
        """Close the gripper, or open it (VAL II: CLOSEI, OPENI)."""

    async def set_outputs(self, numbers: Sequence[int]) -> None:
        """Switch digital outputs: n on, -n off."""

    async def work_valves(self, numbers: Sequence[int]) -> None:
        """Switch digital outputs that operate the gripper, n on and -n off; needs the permission, as `set_gripper`
        does."""

    async def ask_input(self, text: str) -> str:
        """Send a line that reads an input. Returns the controller's output as one line."""

    async def at_rest(self) -> bool:
        """Whether the arm is at rest now: two readings agree."""

    async def stop_motion(self) -> None:
        """Stop the arm now; may be called from another task at any time, also when nothing moves. Returns when the arm
        is at rest. Raises StopRefusedError at once where the controller refuses the command, others after some
        tries."""

    async def test_stop(self) -> None:
        """Verify that the controller accepts the stop command. Raises StopRefusedError."""

    @property
    def kinematics(self) -> ArmModel:
        """The model of the arm with its present tool."""

    def use_tool(self, flange_from_tool: Array) -> None:
        """Use another gripper's tool centre point, (4, 4) mm in the wrist centre's frame. Moves nothing."""
