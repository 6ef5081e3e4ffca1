"""The simulated machine behind the controller's line: arm, gripper, power, memory. Time is an argument.

Commands call its methods; it has no line of its own. A test of a minute is a command and `advance(60)`.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress

import numpy as np

from drivers.arrays import Array
from drivers.puma560 import Configuration, UnreachableError
from drivers.simcell.arm import EMERGENCY_BRAKING, Motion, SimulatedArm, SingularWristError, standing
from drivers.simcell.controller.expressions import Memory, MonitorError, location
from drivers.simcell.controller.faults import Faults, Mishap
from drivers.simcell.controller.manners import Manners
from drivers.simcell.history import GripperRecord, History, MotionRecord, StopRecord

FULL_PERCENT = 100.0
PENDANT = "the teach pendant"
PENDANT_PERCENT = 40.0


class Machine:
    """Arm, gripper, power and memory. Errors are MonitorError, with the controller's messages."""

    def __init__(
        self,
        arm: SimulatedArm,
        manners: Manners | None = None,
        on_hand: Callable[[bool], None] | None = None,
        faults: Faults | None = None,
        cold: bool = False,
    ) -> None:
        """on_hand: called with True when the gripper closes. cold: as after power-up."""
        self.arm, self.manners, self.faults = arm, manners or Manners(), faults or Faults()
        self.now_s = 0.0
        self.alive = True
        self.arm_power = self.calibrated = not cold
        self.hand_closed = False
        self.outputs: set[int] = set()
        """Numbers of the digital outputs that are on."""
        self.after_outputs: Callable[[], None] = lambda: None
        self.inputs: set[int] = set()
        """Numbers of the digital inputs that the line has switched on."""
        self.before_input: Callable[[], None] = lambda: None
        """Called before an input is read: sensors of the cell switch their own."""
        self._zero_found_s = 0.0
        """End of CAL's motion."""
        self.by, self.received_s, self.by_others = "", float("-inf"), False
        """The last command line, its time, and whether somebody other than the daemon ended it: recorded as the cause
        of what follows."""
        self.printed_place: list[str] = []
        """The output of the last WHERE."""
        self.history = History()
        self._on_hand = on_hand or (lambda closed: None)
        self._mishap: tuple[float, Mishap] | None = None
        self._power_comes_s: float | None = None
        self._forget()

    # Time

    def advance(self, seconds: float) -> Mishap | None:
        return self.advance_to(self.now_s + seconds)

    def advance_to(self, moment_s: float) -> Mishap | None:
        """Advance time to a moment, or to the first mishap before, which is returned."""
        if self._mishap is not None and self._mishap[0] <= moment_s:
            self._pass_to(self._mishap[0])
            what = self._mishap[1]
            self.befall(what)
            return what
        self._pass_to(moment_s)
        return None

    def next_event_s(self) -> float | None:
        """Time of the next spontaneous event, or None."""
        moments = [self._mishap[0] if self._mishap else None, self._power_comes_s]
        return min((moment for moment in moments if moment is not None), default=None)

    def _pass_to(self, moment_s: float) -> None:
        self.now_s = max(self.now_s, moment_s)
        if self._power_comes_s is not None and self._power_comes_s <= self.now_s:
            self.arm_power, self._power_comes_s = True, None

    # Places

    def pose(self) -> Array:
        """world_from_tool (4, 4) mm, as reported."""
        return self.arm.reported_pose_at(self.now_s)

    def joints(self) -> Array:
        """Joint angles (6,) rad, as reported."""
        return self.arm.joints_at(self.now_s)

    def place(self, text: str) -> Array:
        """world_from_tool (4, 4) of a transformation expression. Raises MonitorError."""
        return location(text, self.memory, self.pose())

    def joints_for(self, world_from_tool: Array) -> Array:
        """Joint angles (6,) rad that reach a pose in the requested configuration. Raises MonitorError."""
        with _arm_errors():
            return self.arm.joints_for(world_from_tool, self.wanted, self.now_s)

    # Motion

    def at_rest(self) -> bool:
        return self.arm.at_rest(self.now_s)

    def check_ready(self) -> None:
        """Raise MonitorError where the arm cannot move now."""
        if not self.arm_power:
            self.miss_arm_power()
            raise MonitorError("*Arm power off*")
        if not self.calibrated:
            raise MonitorError("*Not calibrated*")
        if self.faults.refusals:
            raise MonitorError(self.faults.refusals.pop(0))

    def program_speed(self, percent: float, always: bool) -> None:
        """Set the program speed, percent of the monitor speed, for the next motion or for all."""
        self._next_percent = None if always else percent
        if always:
            self.program_percent = percent

    def _pace(self) -> float:
        """Speed of the next motion, percent of full."""
        percent, self._next_percent = self._next_percent or self.program_percent, None
        return min(FULL_PERCENT, self.speed_percent * percent / FULL_PERCENT)

    def move_joints(self, joints_rad: Array, percent: float | None = None) -> None:
        """Start a joint-interpolated motion to (6,) rad; percent of full speed (None: by SPEED). Raises
        MonitorError."""
        percent = self._pace() if percent is None else percent
        with _arm_errors():
            self.arm.move_joints(joints_rad, percent / FULL_PERCENT, self.now_s)
        self._started(percent)

    def move_straight(self, world_from_tool: Array) -> None:
        """Start a straight-line motion to a pose (4, 4). Raises MonitorError."""
        percent = self._pace()
        with _arm_errors():
            self.arm.move_straight(world_from_tool, percent / FULL_PERCENT, self.now_s)
        self._started(percent)

    def drive_by_pendant(self, joints_rad: Array) -> None:
        """A person moves the arm by the teach pendant; nothing is printed. The pendant brakes a moving arm, and moves
        one at rest to (6,) rad where they are within its limits."""
        if not self.at_rest() or self.now_s < self._zero_found_s:
            self.halt()
        elif self.arm_power:
            with suppress(UnreachableError):
                self.arm.move_joints(joints_rad, PENDANT_PERCENT / FULL_PERCENT, self.now_s)
                motion = self.arm.motion
                self.history.add(MotionRecord(motion, PENDANT, self.now_s, PENDANT_PERCENT, True))

    def calibrate(self) -> float:
        """Start the calibration of the joints' zeros. Returns the time of its end."""
        motion = standing(self.joints(), self.now_s, self.manners.calibration_s)
        self._record(motion, 0.0)
        self._zero_found_s = motion.ends_s
        return motion.ends_s

    def halt(self, braking: float = 1.0) -> None:
        """Come to rest along the path; braking: times the usual deceleration."""
        self.arm.halt(self.now_s, braking)
        self.history.cut(self.now_s, braking)
        self._zero_found_s = min(self._zero_found_s, self.now_s)

    def stop(self, by: str, by_others: bool) -> None:
        """Record a stop command and brake."""
        self.history.add(StopRecord(self.now_s, by, by_others))
        self.halt()

    def hand(self, closed: bool) -> None:
        self.hand_closed = closed
        self.history.add(GripperRecord(self.now_s, self.by, self.received_s, closed, self.by_others))
        self._on_hand(closed)

    def _started(self, percent: float) -> None:
        """Record the motion, and set the time of a mishap scripted for it."""
        self._record(self.arm.motion, percent)
        if self.faults.in_move:
            share, what = self.faults.in_move.pop(0)
            self._mishap = self.now_s + share * (self.arm.rests_s - self.now_s), what

    def _record(self, motion: Motion, percent: float) -> None:
        self.history.add(MotionRecord(motion, self.by, self.received_s, percent, self.by_others))

    def signal(self, numbers: Sequence[int]) -> None:
        """Switch outputs: n on, -n off."""
        for number in numbers:
            (self.outputs.add if number > 0 else self.outputs.discard)(abs(number))
        self.after_outputs()

    def input_is_on(self, number: int) -> bool:
        self.before_input()
        return number in self.inputs

    # What may befall it

    def befall(self, what: Mishap) -> None:
        self.halt(EMERGENCY_BRAKING)
        self.spare()
        if what is Mishap.DEAD:
            self.alive = False
            return
        self.arm_power = False
        if what is Mishap.POWER_CYCLED:
            self.alive, self.calibrated = True, False
            self.outputs.clear()
            self.after_outputs()
            self.arm.tool = np.eye(4)
            self._forget()

    def spare(self) -> None:
        """Cancel the mishap scripted for this move."""
        self._mishap = None

    def miss_arm_power(self) -> None:
        """A command lacked arm power: a person may switch it on after a while."""
        if self.manners.arm_power_after_s is not None:
            self._power_comes_s = self.now_s + self.manners.arm_power_after_s

    def _forget(self) -> None:
        """Reset the memory, as at power-up."""
        self.memory = Memory(unit_mm=self.manners.unit_mm)
        self.speed_percent, self.wanted = FULL_PERCENT, Configuration()
        self.program_speed(FULL_PERCENT, always=True)


@contextmanager
def _arm_errors() -> Iterator[None]:
    """Context: raise the arm's errors as the controller's messages."""
    try:
        yield
    except SingularWristError as error:
        raise MonitorError("*Wrist singularity*") from error
    except UnreachableError as error:
        message = "*Location out of range*" if error.joint is None else f"*Joint {error.joint} out of range*"
        raise MonitorError(message) from error
