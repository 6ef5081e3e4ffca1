"""The rules that every move of the arm must obey. Pure: a command and the arm's state in, the broken rule out.

Every motion of the arm passes `refuse` immediately before it is sent (motion.py), after sweep.py has checked its whole
path. Nothing here keeps state, so that each rule can be read, and tested, on its own.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.arm.body import PERHAPS_HELD, ArmBody, Capsule, KeepOut, Point, above_mm, body_of
from daemon.arm.collision_shapes import ARM, BODY_MM
from daemon.arm.permission import Refusal
from daemon.arrays import Array
from daemon.quantities import Coordinate, Length, Percent, Seconds, Turn


@dataclass(frozen=True)
class Limits:
    """The limits that the guard enforces. Each refusal names its rule."""

    box_low_mm: Point = (0.0, -650.0, -300.0)
    """Lowest corner of the box that the tool centre point may be in, world frame, mm."""
    box_high_mm: Point = (900.0, 650.0, 1100.0)
    """Highest corner of that box, world frame, mm."""
    room_low_mm: Point = (-2000.0, -2000.0, -2000.0)
    """Lowest corner of the room (walls, floor) that no section of the arm may leave, world frame, mm."""
    room_high_mm: Point = (2000.0, 2000.0, 2000.0)
    """Highest corner of the room (walls, ceiling), world frame, mm."""
    table_z_mm: Coordinate = -300.0
    """Height of the table, world frame, mm."""
    clearance_mm: Length = 2.0
    """Least distance of arm and gripper from the table, the room's sides and each box of `keep_out`, mm."""
    max_step_mm: Length = 450.0
    """Longest move, mm."""
    max_turn_deg: Turn = 100.0
    """Largest rotation of the tool in one move, degrees."""
    max_speed_pct: Percent = 100.0
    """Highest monitor speed, %."""
    max_look_age_s: Seconds = 20.0
    """Greatest age of the look that a location is computed from, s."""
    body_mm: tuple[Point, ...] = BODY_MM
    """Points of the tool that are checked for collisions, tool frame, mm."""
    capsules: tuple[Capsule, ...] = ARM
    """Sections of arm and gripper that are checked for collisions. Default: a PUMA 560 with the gripper of
    etc/facetd.yaml."""
    keep_out: tuple[KeepOut, ...] = ()
    """Boxes in the world that no section of the arm may enter."""


@dataclass(frozen=True)
class SupportContact:
    """The support on which the last straight move places the part: its height, world z, mm, and the names of the boxes
    of its fixture, between which the part goes. Arm and gripper keep their clearance from all of these."""

    level_mm: float
    fixture: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class MoveCommand:
    """One motion: world_from_tool (4, 4) mm; look_taken_s: exposure time of the look that it was computed from, None
    for a taught place; purpose: text for log and operator; contact: where the part in the gripper is placed at the end
    of the move."""

    world_from_tool: Array
    straight: bool
    speed_pct: float
    purpose: str
    look_taken_s: float | None = None
    contact: SupportContact | None = None


@dataclass(frozen=True, eq=False)
class ArmState:
    """The state that the rules are checked against. not_permitted: why nothing may move now (MotionPermission.refusal),
    or None; at: the arm's last reported position, None: unknown; now_s: on the clock that stamps looks; violations: the
    rules that the path from there to the command's target breaks (sweep.py)."""

    not_permitted: Refusal | None
    at: Array | None
    now_s: float
    violations: tuple[Refusal, ...] = ()


Rule = Callable[[MoveCommand, ArmState, Limits], str | None]


def _not_a_location(command: MoveCommand, _: ArmState, __: Limits) -> str | None:
    pose = command.world_from_tool
    if pose.shape != (4, 4) or not np.all(np.isfinite(pose)):
        return "the target is not a 4x4 matrix of numbers"
    wrong = frames.not_a_rotation(pose[:3, :3], 1e-6)
    return None if wrong is None else f"the target's orientation is not a rotation: {wrong}"


def _arm_lost(_: MoveCommand, state: ArmState, __: Limits) -> str | None:
    return "the position of the arm is unknown: type `where` first" if state.at is None else None


def _outside_workspace(command: MoveCommand, _: ArmState, limits: Limits) -> str | None:
    point = command.world_from_tool[:3, 3]
    for axis, value, low, high in zip("xyz", point, limits.box_low_mm, limits.box_high_mm, strict=True):
        if not low <= value <= high:
            return f"{axis} = {value:.1f} mm is outside {low:g} to {high:g}"
    return None


def hand_of(limits: Limits) -> ArmBody:
    """The part of the guarded body that is fixed to the tool: gripper, the part that it holds, camera bracket."""
    return body_of(tuple(c for c in limits.capsules if c.link == "tool"), limits.body_mm)


def hand_above_mm(world_from_tool: Array, limits: Limits) -> float:
    """Height above the table of the lowest point of the gripper and what it holds, at a pose (4, 4), mm."""
    body = hand_of(limits)
    ends = frames.apply(world_from_tool, body.ends_mm)
    return float(np.where(body.encloses, np.inf, above_mm(ends, body.radius_mm, limits.table_z_mm)).min())


def below_table(command: MoveCommand, _: ArmState, limits: Limits) -> str | None:
    """Refuse a move that would bring any section of the gripper, or of what it holds, below the table."""
    body = hand_of(limits)
    ends = frames.apply(command.world_from_tool, body.ends_mm)
    gaps = body.above_floor_mm(ends[None], limits.table_z_mm, limits.clearance_mm)[0]
    worst = int(gaps.argmin())
    if gaps[worst] < 0.0:
        if not np.isnan(body.level_mm[worst]):
            return f"the {body.names[worst]} would be {-gaps[worst]:.1f} mm below the surface that it is to rest on"
        lowest = gaps[worst] + limits.clearance_mm
        what = PERHAPS_HELD if body.names[worst] == PERHAPS_HELD else "the tool"
        return f"{what} would come to {lowest:.1f} mm above the table; at least {limits.clearance_mm:g} mm are needed"
    return None


def _step_too_long(command: MoveCommand, state: ArmState, limits: Limits) -> str | None:
    assert state.at is not None
    step = float(np.linalg.norm(command.world_from_tool[:3, 3] - state.at[:3, 3]))
    if step > limits.max_step_mm:
        return f"a move of {step:.1f} mm; the limit is {limits.max_step_mm:g} mm (pick.limits.max_step_mm)"
    return None


def _turn_too_far(command: MoveCommand, state: ArmState, limits: Limits) -> str | None:
    assert state.at is not None
    turn = float(np.degrees(frames.angle_between(state.at, command.world_from_tool)))
    if turn > limits.max_turn_deg:
        most = f"{limits.max_turn_deg:g} degrees (pick.limits.max_turn_deg)"
        return f"a rotation of {turn:.1f} degrees; the limit is {most}"
    return None


def _too_fast(command: MoveCommand, _: ArmState, limits: Limits) -> str | None:
    within = 0 < command.speed_pct <= limits.max_speed_pct
    return None if within else f"speed {command.speed_pct:g} % is not within 0 to {limits.max_speed_pct:g}"


def _stale_look(command: MoveCommand, state: ArmState, limits: Limits) -> str | None:
    if command.look_taken_s is None:
        return None
    age = state.now_s - command.look_taken_s
    if not 0 <= age <= limits.max_look_age_s:
        return f"it was computed from a look that is {age:.1f} s old; the limit is {limits.max_look_age_s:g} s"
    return None


# The order matters: a refusal names the first broken rule, and later rules may rely on earlier ones.
# None: a rule that others check: permission.py whether anything may move, sweep.py the path.
RULES: tuple[tuple[str, Rule | None], ...] = (
    ("fault_active", None),
    ("not_enabled", None),
    ("not_a_location", _not_a_location),
    ("arm_lost", _arm_lost),
    ("outside_workspace", _outside_workspace),
    ("below_table", below_table),
    ("outside_room", None),
    ("kept_out", None),
    ("no_way", None),
    ("step_too_long", _step_too_long),
    ("turn_too_far", _turn_too_far),
    ("too_fast", _too_fast),
    ("stale_look", _stale_look),
)


def refuse(command: MoveCommand, state: ArmState, limits: Limits) -> Refusal | None:
    """Return why the command may not be sent, or None where it may. Whatever withholds permission does so first; then
    counts the first broken rule of RULES, and last whatever else the path breaks."""
    if state.not_permitted is not None:
        return state.not_permitted
    found = {broken.rule: broken.text for broken in reversed(state.violations)}
    for name, rule in RULES:
        text = (None if rule is None else rule(command, state, limits)) or found.get(name)
        if text is not None:
            return Refusal(name, text)
    return next(iter(state.violations), None)
