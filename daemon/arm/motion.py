"""The one gate between a decision and the arm: guard, log, send, and see that it arrived. Decides nothing itself.

Whoever wants the arm to move goes through `Mover.go`; the guard is asked after every wait and immediately before the
robot is told, so that a stop or a fault that came meanwhile closes the gate.
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
from daemon.arm.guard import ArmState, Limits, MoveCommand, Refusal, SupportContact, hand_above_mm
from daemon.arm.permit import MotionPermit
from daemon.arm.robot import HeldBackError, Kinematics
from daemon.arm.route import OUT_MM, PathSegment, planned_way
from daemon.arm.sweep import places_clear, way_clear
from daemon.arm.workcell import Workcell
from daemon.arrays import Array, Flags
from daemon.errors import FacetdError
from daemon.events.codes import BY_RULE, CauseCode
from daemon.quantities import Length, Seconds, Turn


class NotSentError(FacetdError):
    """Nothing was sent, and that is no fault."""


class MoveRefusedError(NotSentError):
    """The guard refused; nothing was sent."""

    def __init__(self, refusal: Refusal) -> None:
        super().__init__(f"{refusal.rule}: {refusal.text}")
        self.refusal = refusal
        self.code = BY_RULE.get(refusal.rule, CauseCode.MOVE_REFUSED)


class UnansweredError(NotSentError):
    """Nobody confirmed a move while the look behind it was valid."""


class NotAtTargetError(FacetdError):
    """The controller says that the arm is at rest elsewhere than it was sent, or otherwise than it was to get there."""

    code = "arm_not_there"


class MovedByOthersError(NotAtTargetError):
    """The arm is not where it came to rest, and nothing of ours moved it; nothing was sent."""

    code = "moved_by_others"


class OutOfReachError(NotSentError):
    """The arm, as it is configured, has no way there; nothing was sent."""

    code = "out_of_reach"


OTHERWISE_DEG = 5.0
"""More than what an arrival may be off (Arrival.within_deg) turns a joint by, the wrist as near to straight as it may
be; an arm that has turned over is far more off."""


@dataclass(frozen=True)
class Arrival:
    """How far WHERE may be from the target, and how long a move may take before the arm counts as lost."""

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
        """Whether that is elsewhere."""
        return off_mm > self.within_mm or off_deg > self.within_deg

    def longest_s(self, start: Reading, command: MoveCommand, joints_rad: Array | None) -> float:
        """How long this move may take; joints_rad (6,): where the joints end, if that is known."""
        way_s = self._way_s(start, command.world_from_tool, joints_rad)
        return min(self.timeout_s, self.slack_s + way_s / max(command.speed_pct / 100.0, 0.01))

    def usual_s(self, start: Reading, world_from_tool: Array, joints_rad: Array | None, speed_pct: float) -> float:
        """About how long a way takes, its stops left out."""
        return self._way_s(start, world_from_tool, joints_rad) / 2 / (speed_pct / 100.0)

    def _way_s(self, start: Reading, world_from_tool: Array, joints_rad: Array | None) -> float:
        """At the slowest, and a speed of 100 percent."""
        motion = frames.difference(world_from_tool, start.world_from_tool)
        turned = motion[3:] if joints_rad is None else np.append(joints_rad - start.joints_rad, motion[3:])
        way_s = float(np.linalg.norm(motion[:3])) / self.slowest_mm_s
        return way_s + float(np.degrees(np.abs(turned).max())) / self.slowest_deg_s


@dataclass(frozen=True, eq=False)
class Reach:
    """Where an arm that is at rest here can be, and how long it takes to go there: a value, for plans made in another
    process. bounds: the limits with what is carried."""

    kinematics: Kinematics
    here: Reading
    bounds: Limits
    arrival: Arrival

    def allows(self, world_from_tool: Array) -> bool:
        """Whether the arm can be there: reached in its present configuration, and no rule of place broken."""
        return bool(self.allows_each(world_from_tool[None])[0])

    def allows_each(self, world_from_tool: Array) -> Flags:
        """(N,) the same of each of (N, 4, 4): for plans, which ask for thousands."""
        if not len(world_from_tool):
            return np.zeros(0, bool)
        near = np.tile(self.here.joints_rad, (len(world_from_tool), 1))
        joints = self.kinematics.along(world_from_tool, near)
        lost = ~np.isfinite(joints).all(axis=1)
        if lost.any():  # perhaps by a turn of the wrist that is nearest, and past its limit
            near[:, [3, 5]] = 0.0
            joints[lost] = self.kinematics.along(world_from_tool[lost], near[lost])
        allowed: Flags = np.asarray(np.isfinite(joints).all(axis=1))
        if allowed.any():
            allowed[allowed] = places_clear(joints[allowed], self.kinematics, self.bounds)
        return allowed

    def takes_s(self, world_from_tool: Array, speed_pct: float) -> float:
        """About how long it takes to go there from here."""
        joints = self.kinematics.reachable(world_from_tool, self.here.joints_rad)
        return self.arrival.usual_s(self.here, world_from_tool, joints, min(speed_pct, self.bounds.max_speed_pct))


UNCONFIRMED = "not_confirmed"
"""The rule by which a move is refused that waited for a yes until the look behind it was too old."""

Gate = Callable[[str, Callable[[], Awaitable[object]], float], Awaitable[None]]
"""May hold back what moves, told in words. How things stand after a wait is seen by the gate itself, by what it is
given, and what was to be held by then is held again. The number: for how many seconds a yes counts. Raises
UnansweredError where there is none."""


async def _open_gate(*_: object) -> None:
    return None


class Mover:
    """Sends guarded moves, where the robot's permit allows them. gate may hold arm and gripper (pause, step); dry: all
    but the bytes."""

    def __init__(self, cell: Workcell, limits: Limits, arrival: Arrival, gate: Gate = _open_gate) -> None:
        self.cell = cell
        self.limits = limits
        self.arrival = arrival
        self.gate = gate
        self.work_gripper: Callable[[bool, float], Awaitable[None]] = self.by_hand_valves
        """Opens or closes the gripper, and waits for as long as it needs."""
        self.dry = False
        self.cycle = 0

    @property
    def permit(self) -> MotionPermit:
        """Whether arm and gripper may move."""
        return self.cell.robot.permit

    @property
    def beliefs(self) -> Beliefs:
        """Who owns what is believed of this cell."""
        return self.cell.robot.beliefs

    @property
    def belief(self) -> CellBelief:
        """What is believed of this cell now."""
        return self.beliefs.now

    @property
    def bounds(self) -> Limits:
        """The limits with what is, or may be, in the gripper: guarded as the gripper is. A dry run works no gripper and
        moves nothing: it goes on as if one that counts as empty were."""
        load = () if self.dry and self.belief.holds_part is False else self.belief.capsules
        return replace(self.limits, capsules=self.limits.capsules + load) if load else self.limits

    def _bounds(self, command: MoveCommand) -> Limits:
        """The limits for one command: on the last stretch of a set-down the part may come down to its support."""
        contact, bounds = command.contact, self.bounds
        if contact is None:
            return bounds
        lowered = tuple(
            replace(c, level_mm=contact.level_mm, may_touch=contact.fixture) if isinstance(c, CarriedCapsule) else c
            for c in bounds.capsules
        )
        return replace(bounds, capsules=lowered)

    @property
    def here(self) -> Reading | None:
        """Where the next move starts."""
        return self.belief.here

    @property
    def low(self) -> bool:
        """Whether the hand, or what it holds, is amid what may lie on the table."""
        assert self.here is not None
        return hand_above_mm(self.here.world_from_tool, self.bounds) < OUT_MM

    def standing(self) -> ArmState:
        """How things stand now."""
        at = None if self.here is None else self.here.world_from_tool
        return ArmState(self.permit.enabled, self.permit.hindrance, at, self.cell.clock())

    async def rest(self) -> Reading:
        """Ask the controller where the arm is at rest, and believe it. Raises where it moves on."""
        self.beliefs.void(VoidingEvent.MOVE_BEGUN)
        reading = await self.cell.robot.rest()
        self.beliefs.learn(BeliefSource.REPORTED, position=reading)
        return reading

    def check(self, command: MoveCommand) -> None:
        """Raise MoveRefusedError, and log it, where the command breaks a rule now, on its whole way from here."""
        refusal = way_clear(command, self.standing(), self.here, self.cell.robot.kinematics, self._bounds(command))
        refusal = refusal or self._turned_over(command)
        if refusal is not None:
            raise self._refused(refusal)

    def _turned_over(self, command: MoveCommand) -> Refusal | None:
        """What keeps back a joint-interpolated move of an arm that a pendant turned over: the controller turns
        shoulder, elbow and wrist as in the move before, and would turn them back on a path that nobody looked along. A
        straight move keeps them as they are."""
        last, here = self.belief.turned, self.here
        if command.straight or last is None or here is None:
            return None
        ends = [
            self.cell.robot.kinematics.reachable(command.world_from_tool, reading.joints_rad)
            for reading in (here, last.value)
        ]
        if ends[0] is not None and ends[1] is not None and _joints_apart_deg(ends[0], ends[1]).max() <= OTHERWISE_DEG:
            return None
        return Refusal(
            "turned_over",
            "somebody turned shoulder, elbow or wrist over since the last joint-interpolated move; the controller may "
            "turn it back on an unchecked path. Turn it back with the pendant. If somebody typed FLIP, LEFTY or BELOW "
            "at the controller, do not: send the arm on with `robot monitor`",
        )

    @property
    def reach(self) -> Reach:
        """Where the arm can be from where it is at rest now."""
        assert self.here is not None
        return Reach(self.cell.robot.kinematics, self.here, self.bounds, self.arrival)

    async def go(self, command: MoveCommand, then: MoveCommand | None = None) -> Reading:
        """One move, to rest; one that is held as it is being typed is checked and sent anew. then: the move that is to
        follow at once. Raises MoveRefusedError before, NotAtTargetError after, or what the robot raises."""
        while True:
            reading = await self._sent(command, then)
            if reading is not None:
                return reading

    async def _sent(self, command: MoveCommand, then: MoveCommand | None) -> Reading | None:
        """Check, wait out a hold, check again, send; None where it was held before its last byte left."""
        self.check(command)
        look_s = command.look_taken_s
        valid_s = inf if look_s is None else self.limits.max_look_age_s - (self.cell.clock() - look_s)
        try:
            await self._held(_in_words(command) + self._way_in_words(command), valid_s)
        except UnansweredError as unanswered:
            raise self._refused(Refusal(UNCONFIRMED, str(unanswered))) from None
        self.check(command)
        assert self.here is not None
        self._log_move(command)
        joints = self.cell.robot.kinematics.reachable(command.world_from_tool, self.here.joints_rad)
        if self.dry:
            there = Reading(command.world_from_tool, self.here.joints_rad if joints is None else joints)
            self.beliefs.learn(BeliefSource.COMMANDED, planned=there)
            return there
        start = self.here
        not_begun = self.beliefs.void(VoidingEvent.MOVE_BEGUN)
        longest_s = self.arrival.longest_s(start, command, joints)
        started_s = self.cell.clock()
        try:
            reading = await self.cell.robot.move(
                command.world_from_tool,
                starts=lambda now: self._starts_there(command.purpose, start, now),
                straight=command.straight,
                speed_pct=command.speed_pct,
                timeout_s=longest_s,
                then=then,
            )
        except HeldBackError:  # as it was being typed: nothing has left, and all is asked again
            self._log_held_back("move")
            not_begun()
            return None
        self.beliefs.learn(BeliefSource.REPORTED, position=reading)
        self._arrived(command, reading, self.cell.clock() - started_s)
        if not command.straight:  # elsewhere it may be where a pendant put it
            self.beliefs.learn(BeliefSource.REPORTED, turned=reading)
        if joints is not None:
            _went_as_looked_along(command, reading, joints)
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
        """Go there in as many moves as the step limits ask for, on the line or the joints' own way (or over what is
        in that).

        speed_pct(world_from_tool of a step) is cut to the limit; contact: see MoveCommand. Raises OutOfReachError
        before anything is sent, and what `go` raises.
        """
        way = self._way(MoveCommand(target, straight, self.limits.max_speed_pct, purpose, look_taken_s, contact))
        speeds = [min(round(speed_pct(leg.world_from_tool), 1), self.limits.max_speed_pct) for leg in way]
        moves = [
            MoveCommand(leg.world_from_tool, leg.straight, speed, purpose, look_taken_s, contact)
            for leg, speed in zip(way, speeds, strict=True)
        ]
        for move, then in zip_longest(moves, moves[1:]):
            await self.go(move, then)

    def check_through(self, poses: Iterable[Array], contact: SupportContact | None = None) -> None:
        """Raise what `travel` would where straight ways through these poses (4, 4), one after the other from here,
        could not all be gone: for whoever must come out again of where he goes in."""
        here = self.here
        if here is None:
            return
        for pose in poses:
            command = MoveCommand(pose, straight=True, speed_pct=self.limits.max_speed_pct, purpose="plan")
            self._way_from(here, replace(command, contact=contact))
            joints = self.cell.robot.kinematics.reachable(pose, here.joints_rad)
            assert joints is not None, "there is a way to it"
            here = Reading(pose, joints)

    def _way(self, command: MoveCommand) -> tuple[PathSegment, ...]:
        if self.here is None:
            return (PathSegment(command.world_from_tool, command.straight),)
        return self._way_from(self.here, command)

    def _way_from(self, start: Reading, command: MoveCommand) -> tuple[PathSegment, ...]:
        standing = replace(self.standing(), at=start.world_from_tool)
        way = planned_way(command, standing, start, self.cell.robot.kinematics, self._bounds(command))
        if not isinstance(way, Refusal):
            return way
        raise OutOfReachError(way.text) if way.rule == "out_of_reach" else self._refused(way)

    async def hand(self, closed: bool, hand_s: float = 0.0) -> None:
        """Open or close the gripper: held, and refused by enable and fault, as a move is. hand_s: what it
        needs; until then it is neither open nor closed.

        Whoever reads the log after a crash must not take a hand for open that only was to be: it is told closed before
        it is, and open once it was opened.
        """
        while not await self._gripper_worked(closed, hand_s):
            pass

    async def _gripper_worked(self, closed: bool, hand_s: float) -> bool:
        """Whether it was worked, and not held before the last byte left."""
        self._check_hand()
        await self._held(f"{'close' if closed else 'open'} the gripper")
        self._check_hand()
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
            self.beliefs.learn(BeliefSource.COMMANDED, closed=False, holding=False, held=None, load=None)
            self._log_hand(closed)
        return True

    async def by_hand_valves(self, closed: bool, hand_s: float) -> None:
        """Work the gripper by the controller's own valves, and wait. Raises what the robot's hand raises."""
        await self.cell.robot.hand(closed)
        await asyncio.sleep(hand_s)

    async def _held(self, text: str, valid_s: float = inf) -> None:
        """Held back by the gate. Raises MovedByOthersError where the arm stands elsewhere after it: somebody had time
        to move it by its pendant, and its way amid what lies there was planned from where it stood."""
        place = self.belief.at

        async def still_there() -> None:
            if not self.dry:
                now = await self.rest()
                self._not_moved_by_others(text, place or now, now)

        await self.gate(text, still_there, valid_s)

    def _way_in_words(self, command: MoveCommand) -> str:
        """How far a move goes from here: for whoever confirms it."""
        if self.here is None:
            return ""
        x, y, z = np.round(command.world_from_tool[:3, 3] - self.here.world_from_tool[:3, 3]) + 0.0
        _, deg = _apart(self.here.world_from_tool, command.world_from_tool)
        return f", from here x {x:+g} y {y:+g} z {z:+g} mm and {deg:.0f} degrees"

    async def still_there(self, doing: str) -> None:
        """Raise MovedByOthersError where the arm is not where it came to rest: asked before anything else is blamed for
        what that explains."""
        place = self.belief.at
        if place is not None and not self.dry:
            self._not_moved_by_others(doing, place, await self.cell.robot.where())

    def _starts_there(self, purpose: str, start: Reading, now: Reading) -> None:
        """Raise MovedByOthersError where a move's way, which was looked along from start, would begin elsewhere."""
        try:
            self._not_moved_by_others(purpose, start, now)
        except MovedByOthersError as moved:
            self.cell.log.record("refusal", cycle=self.cycle, rule="moved_by_others", text=str(moved))
            self._log_held_back("move")
            raise

    def _not_moved_by_others(self, doing: str, then: Reading, now: Reading) -> None:
        """Raise MovedByOthersError where the arm is farther from where it was than an arrival may be off.

        No less: an arm that creeps so far as it settles, or gives so much as the hand closes, was not moved by anybody.
        No more: every way is looked along `clearance_mm` (2) from what it must not touch, and each joint turned by
        0.1 degrees, the tool 0.5 mm off, leaves nothing of an arm of 0.9 m farther than 1.6 mm from its looked-along
        way. Joints are asked as well: about a straight wrist two of them turn, and the tool stays.
        """
        off_mm, off_deg = _apart(now.world_from_tool, then.world_from_tool)
        off_deg = max(off_deg, float(np.degrees(np.abs(now.joints_rad - then.joints_rad)).max()))
        if self.arrival.missed_by(off_mm, off_deg):
            self.beliefs.void(VoidingEvent.MOVED_BY_OTHERS)
            told = f"by {off_mm:.2f} mm and {off_deg:.2f} degrees"
            raise MovedByOthersError(
                f"{doing}: since it came to rest somebody else moved the arm, {told} (its pendant, another terminal?); "
                "nothing was sent"
            )

    def _check_hand(self) -> None:
        hindrance = self.permit.hindrance
        if hindrance is not None or not self.permit.enabled:
            name = "fault_stands" if hindrance is not None else "not_enabled"
            raise self._refused(Refusal(name, f"the gripper does not move: {hindrance or 'the arm is not enabled'}"))

    def _refused(self, refusal: Refusal) -> MoveRefusedError:
        """Logged, and to be raised."""
        if PERHAPS_HELD in refusal.text:
            remedy = "look at the gripper: where it is empty say `holding no`, or open it (`hand open`)"
            refusal = replace(refusal, text=f"{refusal.text}; {remedy}")
        self.cell.log.record("refusal", cycle=self.cycle, rule=refusal.rule, text=refusal.text)
        return MoveRefusedError(refusal)

    def _log_hand(self, closed: bool) -> None:
        self.cell.log.record("hand", cycle=self.cycle, closed=closed, sent=not self.dry)

    def _log_held_back(self, what: str) -> None:
        """That what was told last was taken back: read after a crash, it is on its way."""
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
                f"{command.purpose}: sent, but WHERE is {off_mm:.2f} mm and {off_deg:.2f} degrees off"
            )


def _went_as_looked_along(command: MoveCommand, reading: Reading, joints_rad: Array) -> None:
    """Raise NotAtTargetError where the joints ended otherwise than planned (6,): somebody set the controller to turn
    shoulder, elbow or wrist over (FLIP, LEFTY, BELOW), and the arm took a path that was never checked. On a straight
    move a joint may have gone once round."""
    off_deg = np.degrees(np.abs(reading.joints_rad - joints_rad))
    if command.straight:
        off_deg = _joints_apart_deg(reading.joints_rad, joints_rad)
    joint = int(off_deg.argmax())
    if off_deg[joint] > OTHERWISE_DEG:
        raise NotAtTargetError(
            f"{command.purpose}: the arm arrived with joint {joint + 1} turned by {off_deg[joint]:.0f} degrees against "
            "the planned path. Did somebody set FLIP, LEFTY or BELOW at the controller? Set it back, then `resume`"
        )


def _joints_apart_deg(a: Array, b: Array) -> Array:
    """(6,) degrees between two positions of the joints (6,) rad, whole turns left out."""
    return np.asarray(np.abs((np.degrees(a - b) + 180.0) % 360.0 - 180.0))


def _apart(a: Array, b: Array) -> tuple[float, float]:
    """mm and degrees between two poses (4, 4)."""
    return float(np.linalg.norm(a[:3, 3] - b[:3, 3])), float(np.degrees(frames.angle_between(a, b)))


def _in_words(command: MoveCommand) -> str:
    x, y, z = np.round(command.world_from_tool[:3, 3], 1)
    how = "straight" if command.straight else "joint"
    return f"{command.purpose}: {how} move to x {x:g} y {y:g} z {z:g} mm at {command.speed_pct:.0f} %"
