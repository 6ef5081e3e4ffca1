"""Send moves to the arm: check each against the guard, log it, send it, and verify that the arm arrived.

Every move goes through `Mover.go`. The guard checks after every wait and immediately before a move is sent, so that a
stop or a fault that came meanwhile prevents it.
"""

import asyncio
from collections.abc import Awaitable, Callable, Iterable
from dataclasses import dataclass, replace
from itertools import zip_longest
from math import inf

import numpy as np

from daemon import frames
from daemon.arm.belief import Beliefs, BeliefSource, CellBelief, Reading, VoidingEvent
from daemon.arm.body import PERHAPS_HELD, CarriedCapsule
from daemon.arm.guard import ArmState, Limits, MoveCommand, SupportContact, hand_above_mm
from daemon.arm.permission import MotionPermission, Refusal
from daemon.arm.robot import HeldBackError, Kinematics
from daemon.arm.route import OUT_MM, PathSegment, plan_path
from daemon.arm.sweep import path_refusal, places_clear
from daemon.arm.workcell import Workcell
from daemon.arrays import Array, Flags
from daemon.errors import FacetdError
from daemon.events.codes import BY_RULE, CauseCode
from daemon.quantities import Length, Seconds, Turn


class NotSentError(FacetdError):
    """Nothing was sent to the arm; this is not a fault."""


class MoveRefusedError(NotSentError):
    """The guard refused; nothing was sent."""

    def __init__(self, refusal: Refusal) -> None:
        super().__init__(f"{refusal.rule}: {refusal.text}")
        self.refusal = refusal
        self.code = BY_RULE.get(refusal.rule, CauseCode.MOVE_REFUSED)


class UnansweredError(NotSentError):
    """Nobody confirmed a move while its look was valid."""


class NotAtTargetError(FacetdError):
    """The controller reports that the arm stopped away from its target, or in another configuration than planned."""

    code = "arm_not_there"


class MovedByOthersError(NotAtTargetError):
    """The arm is no longer where it came to rest, and facetd did not move it; nothing was sent."""

    code = "moved_by_others"


class OutOfReachError(NotSentError):
    """The arm cannot reach the pose in its present configuration; nothing was sent."""

    code = "out_of_reach"


CONFIGURATION_DEG = 5.0
"""A joint farther than this from where it was planned: the arm is in another configuration. An error within
Arrival.within_deg turns a joint by less, even with the wrist as straight as is allowed; another configuration is far
more off."""


@dataclass(frozen=True)
class Arrival:
    """The tolerance of an arrival, and how long a move may take before the arm counts as lost."""

    within_mm: Length = 0.5
    """Largest distance of WHERE from the target, mm."""
    within_deg: Turn = 0.1
    """Largest angle of WHERE from the target, degrees."""
    slack_s: Seconds = 4.0
    """Time added to the expected time of each move, s."""
    slowest_mm_s: Length = 250.0
    """Least speed expected of the tool at a monitor speed of 100 %, mm/s. Half of what the arm reaches."""
    slowest_deg_s: Turn = 50.0
    """Least speed expected of a joint at a monitor speed of 100 %, degrees/s. Half of what the arm reaches."""
    timeout_s: Seconds = 60.0
    """Longest time of any move, s."""

    def missed_by(self, off_mm: float, off_deg: float) -> bool:
        """Whether a position that is off by so much is not the target."""
        return off_mm > self.within_mm or off_deg > self.within_deg

    def longest_s(self, start: Reading, command: MoveCommand, joints_rad: Array | None) -> float:
        """The longest time that this move may take; joints_rad (6,): the joints at its end, if known."""
        path_s = self._path_s(start, command.world_from_tool, joints_rad)
        return min(self.timeout_s, self.slack_s + path_s / max(command.speed_pct / 100.0, 0.01))

    def usual_s(self, start: Reading, world_from_tool: Array, joints_rad: Array | None, speed_pct: float) -> float:
        """The usual time of a path, without its stops."""
        return self._path_s(start, world_from_tool, joints_rad) / 2 / (speed_pct / 100.0)

    def _path_s(self, start: Reading, world_from_tool: Array, joints_rad: Array | None) -> float:
        """The time of a path at a monitor speed of 100 % and the slowest expected speeds."""
        motion = frames.difference(world_from_tool, start.world_from_tool)
        turned = motion[3:] if joints_rad is None else np.append(joints_rad - start.joints_rad, motion[3:])
        line_s = float(np.linalg.norm(motion[:3])) / self.slowest_mm_s
        return line_s + float(np.degrees(np.abs(turned).max())) / self.slowest_deg_s


@dataclass(frozen=True, eq=False)
class Reach:
    """The poses that the arm can reach from where it is at rest, and the time to get there: a value, for plans that
    another process makes. bounds: the limits, with the part in the gripper."""

    kinematics: Kinematics
    here: Reading
    bounds: Limits
    arrival: Arrival

    def allows(self, world_from_tool: Array) -> bool:
        """Whether the arm can reach this pose in its present configuration, and keeps every limit there."""
        return bool(self.allows_each(world_from_tool[None])[0])

    def allows_each(self, world_from_tool: Array) -> Flags:
        """(N,): `allows` for each of (N, 4, 4); plans check thousands."""
        if not len(world_from_tool):
            return np.zeros(0, bool)
        near = np.tile(self.here.joints_rad, (len(world_from_tool), 1))
        joints = self.kinematics.along(world_from_tool, near)
        lost = ~np.isfinite(joints).all(axis=1)
        if lost.any():  # perhaps only because the nearest turn of the wrist is past a joint limit
            near[:, [3, 5]] = 0.0
            joints[lost] = self.kinematics.along(world_from_tool[lost], near[lost])
        allowed: Flags = np.asarray(np.isfinite(joints).all(axis=1))
        if allowed.any():
            allowed[allowed] = places_clear(joints[allowed], self.kinematics, self.bounds)
        return allowed

    def takes_s(self, world_from_tool: Array, speed_pct: float) -> float:
        """The usual time of a move there from here, s."""
        joints = self.kinematics.reachable(world_from_tool, self.here.joints_rad)
        return self.arrival.usual_s(self.here, world_from_tool, joints, min(speed_pct, self.bounds.max_speed_pct))


UNCONFIRMED = "not_confirmed"
"""The rule of a refusal where nobody confirmed the move before its look was too old."""

Gate = Callable[[str, Callable[[], Awaitable[object]], float], Awaitable[None]]
"""Makes a move wait (PauseAndStep.wait). Arguments: the move as text; a check that runs after each wait; for how many
seconds the move can be confirmed. Raises UnansweredError where nobody confirms it in that time."""


async def _open_gate(*_: object) -> None:
    return None


class Mover:
    """Sends guarded moves while the robot's permission allows motion. gate: may make moves wait (pause, step mode);
    dry: everything is done but the sending."""

    def __init__(self, cell: Workcell, limits: Limits, arrival: Arrival, gate: Gate = _open_gate) -> None:
        self.cell = cell
        self.limits = limits
        self.arrival = arrival
        self.gate = gate
        self.work_gripper: Callable[[bool, float], Awaitable[None]] = self.operate_hand_valves
        """Opens or closes the gripper, and waits until that is done."""
        self.dry = False
        self.cycle = 0

    @property
    def permission(self) -> MotionPermission:
        """Whether arm and gripper may move."""
        return self.cell.robot.permission

    @property
    def beliefs(self) -> Beliefs:
        """The owner of the beliefs about this cell."""
        return self.cell.robot.beliefs

    @property
    def belief(self) -> CellBelief:
        """The present beliefs about this cell."""
        return self.beliefs.now

    @property
    def bounds(self) -> Limits:
        """The limits, with the part that is, or may be, in the gripper added to the guarded body. A dry run moves
        nothing: there a gripper that counts as empty is treated as empty."""
        load = () if self.dry and self.belief.holds_part is False else self.belief.capsules
        return replace(self.limits, capsules=self.limits.capsules + load) if load else self.limits

    def _bounds(self, command: MoveCommand) -> Limits:
        """The limits for one command: on the last move of a set-down the part may reach its support."""
        contact, bounds = command.contact, self.bounds
        if contact is None:
            return bounds
        lowered = tuple(
            replace(c, level_mm=contact.level_mm, may_touch=contact.fixture) if isinstance(c, CarriedCapsule) else c
            for c in bounds.capsules
        )
        return replace(bounds, capsules=lowered)

    @property
    def next_start(self) -> Reading | None:
        return self.belief.next_start

    @property
    def low(self) -> bool:
        """Whether the gripper, or the part in it, is so low that it may be between parts on the table."""
        assert self.next_start is not None
        return hand_above_mm(self.next_start.world_from_tool, self.bounds) < OUT_MM

    def arm_state(self) -> ArmState:
        """The arm's present state, for the guard."""
        at = None if self.next_start is None else self.next_start.world_from_tool
        return ArmState(self.permission.refusal(), at, self.cell.clock())

    async def wait_until_at_rest(self) -> Reading:
        """Read from the controller where the arm is at rest, and store it. Raises where the arm keeps moving."""
        self.beliefs.void(VoidingEvent.MOVE_BEGUN)
        reading = await self.cell.robot.wait_until_at_rest()
        self.beliefs.learn(BeliefSource.REPORTED, position=reading)
        return reading

    def check(self, command: MoveCommand) -> None:
        """Check a command, on its whole path from here. Raises MoveRefusedError, and logs it, where it breaks a
        rule."""
        refusal = path_refusal(
            command, self.arm_state(), self.next_start, self.cell.robot.kinematics, self._bounds(command)
        )
        refusal = refusal or self._configuration_refusal(command)
        if refusal is not None:
            raise self._refused(refusal)

    def _configuration_refusal(self, command: MoveCommand) -> Refusal | None:
        """Refuse a joint-interpolated move if somebody changed the arm's configuration with the pendant: the controller
        uses the shoulder, elbow and wrist configuration of the previous such move, and would change it back on a path
        that was not checked. A straight move keeps the present configuration."""
        last, here = self.belief.last_joint_move_end, self.next_start
        if command.straight or last is None or here is None:
            return None
        ends = [
            self.cell.robot.kinematics.reachable(command.world_from_tool, reading.joints_rad)
            for reading in (here, last.value)
        ]
        between = None if ends[0] is None or ends[1] is None else _joint_difference_deg(ends[0], ends[1])
        if between is not None and between.max() <= CONFIGURATION_DEG:
            return None
        return Refusal(
            "turned_over",
            "somebody turned shoulder, elbow or wrist over since the last joint-interpolated move; the controller may "
            "turn it back on an unchecked path. Turn it back with the pendant. If somebody typed FLIP, LEFTY or BELOW "
            "at the controller, do not: send the arm on with `robot monitor`",
        )

    @property
    def reach(self) -> Reach:
        """The poses that the arm can reach from where it is at rest now."""
        assert self.next_start is not None
        return Reach(self.cell.robot.kinematics, self.next_start, self.bounds, self.arrival)

    async def go(self, command: MoveCommand, then: MoveCommand | None = None) -> Reading:
        """Make one move and wait until the arm is at rest. A move that a pause holds while it is being sent is checked
        and sent again. then: the move that will follow at once. Raises MoveRefusedError before the move,
        NotAtTargetError after it, or what the robot raises."""
        while True:
            reading = await self._send(command, then)
            if reading is not None:
                return reading

    async def _send(self, command: MoveCommand, then: MoveCommand | None) -> Reading | None:
        """Check, wait while held, check again, send. None: the move was held before its last byte left."""
        self.check(command)
        look_s = command.look_taken_s
        valid_s = inf if look_s is None else self.limits.max_look_age_s - (self.cell.clock() - look_s)
        try:
            await self._wait_while_held(_describe(command) + self._describe_distance(command), valid_s)
        except UnansweredError as unanswered:
            raise self._refused(Refusal(UNCONFIRMED, str(unanswered))) from None
        self.check(command)
        assert self.next_start is not None
        self._log_move(command)
        joints = self.cell.robot.kinematics.reachable(command.world_from_tool, self.next_start.joints_rad)
        if self.dry:
            there = Reading(command.world_from_tool, self.next_start.joints_rad if joints is None else joints)
            self.beliefs.learn(BeliefSource.COMMANDED, planned=there)
            return there
        start = self.next_start
        not_begun = self.beliefs.void(VoidingEvent.MOVE_BEGUN)
        longest_s = self.arrival.longest_s(start, command, joints)
        started_s = self.cell.clock()
        try:
            reading = await self.cell.robot.move(
                command,
                starts=lambda now: self._check_start(command.purpose, start, now),
                timeout_s=longest_s,
                then=then,
            )
        except HeldBackError:  # held while it was being sent: nothing moved, so check everything again
            self._log_held_back("move")
            not_begun()
            return None
        self.beliefs.learn(BeliefSource.REPORTED, position=reading)
        self._arrived(command, reading, self.cell.clock() - started_s)
        if not command.straight:  # a straight move may end in a configuration that a pendant chose
            self.beliefs.learn(BeliefSource.REPORTED, last_joint_move_end=reading)
        if joints is not None:
            _check_configuration(command, reading, joints)
        return reading

    async def travel(
        self,
        target: Array,
        purpose: str,
        speed_pct: Callable[[Array], float],
        straight: bool = False,
        look_taken_s: float | None = None,
        contact: SupportContact | None = None,
    ) -> None:
        """Move to a pose in as many moves as the step limits require: on a straight line, or joint-interpolated and, if
        something is in the way, above it.

        speed_pct: the speed of a step from its world_from_tool; it is cut to the limit; contact: see MoveCommand.
        Raises OutOfReachError before anything is sent, and what `go` raises.
        """
        whole = MoveCommand(target, straight, self.limits.max_speed_pct, purpose, look_taken_s, contact)
        here = self.next_start
        path = (PathSegment(target, straight),) if here is None else self._path_from(here, whole)
        speeds = [min(round(speed_pct(leg.world_from_tool), 1), self.limits.max_speed_pct) for leg in path]
        moves = [
            MoveCommand(leg.world_from_tool, leg.straight, speed, purpose, look_taken_s, contact)
            for leg, speed in zip(path, speeds, strict=True)
        ]
        for move, then in zip_longest(moves, moves[1:]):
            await self.go(move, then)

    def check_through(self, poses: Iterable[Array], contact: SupportContact | None = None) -> None:
        """Check that straight moves from here through these poses (4, 4), one after the other, are possible: for a
        caller that must also get out of where it goes in. Raises what `travel` would."""
        here = self.next_start
        if here is None:
            return
        for pose in poses:
            command = MoveCommand(pose, straight=True, speed_pct=self.limits.max_speed_pct, purpose="plan")
            self._path_from(here, replace(command, contact=contact))
            joints = self.cell.robot.kinematics.reachable(pose, here.joints_rad)
            assert joints is not None, "a path to it was found"
            here = Reading(pose, joints)

    def _path_from(self, start: Reading, command: MoveCommand) -> tuple[PathSegment, ...]:
        path = plan_path(command, self.arm_state(), start, self.cell.robot.kinematics, self._bounds(command))
        if not isinstance(path, Refusal):
            return path
        raise OutOfReachError(path.text) if path.rule == "out_of_reach" else self._refused(path)

    async def set_gripper(self, closed: bool, hand_s: float = 0.0) -> None:
        """Open or close the gripper. Like a move it can be held, and is refused while the arm is disabled or a fault is
        active. hand_s: the time that it needs; until then it is neither open nor closed.

        The log must never call a gripper open that was only about to open, because it is read after a crash: closing
        is logged before it begins, opening after it has ended.
        """
        while not await self._operate_gripper(closed, hand_s):
            pass

    async def _operate_gripper(self, closed: bool, hand_s: float) -> bool:
        """Whether the gripper was operated; False: it was held before the last byte left."""
        self._check_gripper_permitted()
        await self._wait_while_held(f"{'close' if closed else 'open'} the gripper")
        self._check_gripper_permitted()
        if self.dry:
            self._log_hand(closed)
            return True
        not_begun = self.beliefs.void(VoidingEvent.GRIPPER_CLOSES if closed else VoidingEvent.GRIPPER_OPENS)
        if closed:
            self._log_hand(closed)
        try:
            await self.work_gripper(closed, hand_s)
        except HeldBackError:
            if closed:
                self._log_held_back("hand")
            not_begun()
            return False
        if closed:
            self.beliefs.learn(BeliefSource.COMMANDED, closed=True)
        else:
            self.beliefs.learn(BeliefSource.COMMANDED, closed=False, holding=False, grasped_part=None, held_shape=None)
            self._log_hand(closed)
        return True

    async def operate_hand_valves(self, closed: bool, hand_s: float) -> None:
        """Operate the gripper through the controller's own valves, and wait. Raises what Robot.set_gripper raises."""
        await self.cell.robot.set_gripper(closed)
        await asyncio.sleep(hand_s)

    async def _wait_while_held(self, text: str, valid_s: float = inf) -> None:
        """Wait at the gate. Raises MovedByOthersError where the arm is at another place afterwards: somebody had time
        to move it with the pendant, and the path was planned from where it was."""
        place = self.belief.resting_reading

        async def check_not_moved() -> None:
            if not self.dry:
                now = await self.wait_until_at_rest()
                self._check_not_moved(text, place or now, now)

        await self.gate(text, check_not_moved, valid_s)

    def _describe_distance(self, command: MoveCommand) -> str:
        """How far a move goes from here: for the operator who confirms it."""
        if self.next_start is None:
            return ""
        x, y, z = np.round(command.world_from_tool[:3, 3] - self.next_start.world_from_tool[:3, 3]) + 0.0
        _, deg = _apart(self.next_start.world_from_tool, command.world_from_tool)
        return f", from here x {x:+g} y {y:+g} z {z:+g} mm and {deg:.0f} degrees"

    async def still_there(self, doing: str) -> None:
        """Check that the arm is where it came to rest, before its failure is blamed on anything else. Raises
        MovedByOthersError."""
        place = self.belief.resting_reading
        if place is not None and not self.dry:
            self._check_not_moved(doing, place, await self.cell.robot.where())

    def _check_start(self, purpose: str, start: Reading, now: Reading) -> None:
        """Check that a move begins where its checked path begins. Raises MovedByOthersError."""
        try:
            self._check_not_moved(purpose, start, now)
        except MovedByOthersError as moved:
            self.cell.log.record("refusal", cycle=self.cycle, rule="moved_by_others", text=str(moved))
            self._log_held_back("move")
            raise

    def _check_not_moved(self, doing: str, then: Reading, now: Reading) -> None:
        """Check that the arm is where it was, within the tolerance of an arrival. Raises MovedByOthersError.

        The tolerance is not smaller, because an arm creeps so far as it settles, and yields so far as the gripper
        closes. It is not larger, because paths are checked with `clearance_mm` (2): if each joint is turned by 0.1
        degrees and the tool is 0.5 mm off, no point of an arm of 0.9 m is farther than 1.6 mm from its checked path.
        Joints are compared as well: with a straight wrist two of them can turn while the tool stays.
        """
        off_mm, off_deg = _apart(now.world_from_tool, then.world_from_tool)
        off_deg = max(off_deg, float(np.degrees(np.abs(now.joints_rad - then.joints_rad)).max()))
        if self.arrival.missed_by(off_mm, off_deg):
            self.beliefs.void(VoidingEvent.MOVED_BY_OTHERS)
            by = f"by {off_mm:.2f} mm and {off_deg:.2f} degrees"
            raise MovedByOthersError(
                f"{doing}: somebody else moved the arm after it came to rest, {by} (with the pendant, or from another "
                "terminal?); facetd sent nothing. Look at the arm, then `resume`"
            )

    def _check_gripper_permitted(self) -> None:
        refusal = self.permission.refusal()
        if refusal is not None:
            raise self._refused(refusal)

    def _refused(self, refusal: Refusal) -> MoveRefusedError:
        if PERHAPS_HELD in refusal.text:
            remedy = "look into the gripper: if it is empty, type `holding no`; if not, `hand open` (the part falls)"
            refusal = replace(refusal, text=f"{refusal.text}; {remedy}")
        self.cell.log.record("refusal", cycle=self.cycle, rule=refusal.rule, text=refusal.text)
        return MoveRefusedError(refusal)

    def _log_hand(self, closed: bool) -> None:
        self.cell.log.record("hand", cycle=self.cycle, closed=closed, sent=not self.dry)

    def _log_held_back(self, what: str) -> None:
        """Record that the last logged command was not carried out: after a crash it would be read as carried out."""
        self.cell.log.record("held_back", cycle=self.cycle, what=what)

    def _log_move(self, command: MoveCommand) -> None:
        self.cell.log.record(
            "move",
            cycle=self.cycle,
            how="straight" if command.straight else "joint",
            target=command.world_from_tool,
            speed_pct=command.speed_pct,
            purpose=command.purpose,
            sent=not self.dry,
        )

    def _arrived(self, command: MoveCommand, reading: Reading, seconds: float) -> None:
        off_mm, off_deg = _apart(reading.world_from_tool, command.world_from_tool)
        self.cell.log.record(
            "moved",
            cycle=self.cycle,
            where=reading.world_from_tool,
            joints=reading.joints_rad,
            error_mm=off_mm,
            error_deg=off_deg,
            seconds=seconds,
        )
        if self.arrival.missed_by(off_mm, off_deg):
            raise NotAtTargetError(
                f"{command.purpose}: the arm did not arrive: WHERE is {off_mm:.2f} mm and {off_deg:.2f} degrees from "
                "the target. Is something in its way? Look, then `resume`"
            )


def _check_configuration(command: MoveCommand, reading: Reading, joints_rad: Array) -> None:
    """Check that the joints ended as planned, joints_rad (6,). Otherwise somebody set the controller to another
    configuration (FLIP, LEFTY, BELOW), and the arm took a path that was not checked. After a straight move a joint may
    differ by a whole turn. Raises NotAtTargetError."""
    off_deg = np.degrees(np.abs(reading.joints_rad - joints_rad))
    if command.straight:
        off_deg = _joint_difference_deg(reading.joints_rad, joints_rad)
    joint = int(off_deg.argmax())
    if off_deg[joint] > CONFIGURATION_DEG:
        raise NotAtTargetError(
            f"{command.purpose}: the arm arrived with joint {joint + 1} turned by {off_deg[joint]:.0f} degrees against "
            "the planned path. Did somebody set FLIP, LEFTY or BELOW at the controller? Set it back, then `resume`"
        )


def _joint_difference_deg(a: Array, b: Array) -> Array:
    """(6,) degrees between two positions of the joints (6,) rad, without whole turns."""
    return np.asarray(np.abs((np.degrees(a - b) + 180.0) % 360.0 - 180.0))


def _apart(a: Array, b: Array) -> tuple[float, float]:
    """Distance and angle between two poses (4, 4): mm and degrees."""
    return float(np.linalg.norm(a[:3, 3] - b[:3, 3])), float(np.degrees(frames.angle_between(a, b)))


def _describe(command: MoveCommand) -> str:
    x, y, z = np.round(command.world_from_tool[:3, 3], 1)
    how = "straight" if command.straight else "joint"
    return f"{command.purpose}: {how} move to x {x:g} y {y:g} z {z:g} mm at {command.speed_pct:.0f} %"
