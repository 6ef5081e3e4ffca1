"""What the arm may never be told. Pure: a command and how things stand in, the broken rule out.

Every motion of the arm passes `refuse` immediately before its bytes leave (motion.py), its whole way looked along
before (sweep.py); nothing here remembers anything, so that each rule can be read, and tested, on its own.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.arm.body import PERHAPS_HELD, ArmBody, Capsule, KeepOut, Point, above_mm, body_of
from daemon.arm.collision_shapes import ARM, BODY_MM
from daemon.arrays import Array
from daemon.quantities import Coordinate, Length, Percent, Seconds, Turn


@dataclass(frozen=True)
class Limits:
    """The limits that the guard keeps. Each refusal names its rule."""

    box_low_mm: Point = (0.0, -650.0, -300.0)
    """Lowest corner of the box that the tool centre point may be in, world frame, mm."""
    box_high_mm: Point = (900.0, 650.0, 1100.0)
    """Highest corner of that box, world frame, mm."""
    room_low_mm: Point = (-2000.0, -2000.0, -2000.0)
    """Lowest corner of the room (walls, floor) that nothing of the arm leaves, world frame, mm."""
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
    """Points of the tool that may strike something, tool frame, mm."""
    capsules: tuple[Capsule, ...] = ARM
    """Pieces of arm and gripper that may strike something. Default: a PUMA 560 with the gripper shown in
    etc/facetd.yaml."""
    keep_out: tuple[KeepOut, ...] = ()
    """Boxes of the world that nothing of the arm may enter."""


@dataclass(frozen=True)
class SupportContact:
    """What the part in the gripper comes to rest on, on the last straight stretch: the support's height, world z, mm,
    and the names of the boxes of its fixture, which the part goes in between. Arm and gripper keep clear of all as
    ever."""

    level_mm: float
    fixture: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class MoveCommand:
    """One motion: world_from_tool (4, 4) mm; look_taken_s: when the look it was computed from was exposed, None for a
    taught place; purpose in words for log and operator; contact: what the part in the gripper comes to rest on at its
    end."""

    world_from_tool: Array
    straight: bool
    speed_pct: float
    purpose: str
    look_taken_s: float | None = None
    contact: SupportContact | None = None


@dataclass(frozen=True)
class Strike:
    """What the whole way of a command would break: the rule's name and a line for people."""

    rule: str
    text: str


@dataclass(frozen=True, eq=False)
class ArmState:
    """How things stand at this moment: enabled by an operator, the fault that stands (None), where the arm is by its
    own last word (None when it has none), the time on the clock that stamps looks, and what the way from there to the
    command's target meets (sweep.py)."""

    enabled: bool
    fault: str | None
    at: Array | None
    now_s: float
    strikes: tuple[Strike, ...] = ()


@dataclass(frozen=True)
class Refusal:
    """The broken rule's name and a line for people."""

    rule: str
    text: str


Rule = Callable[[MoveCommand, ArmState, Limits], str | None]


def _fault_stands(_: MoveCommand, standing: ArmState, __: Limits) -> str | None:
    return f"the fault {standing.fault!r} stands until `resume`" if standing.fault is not None else None


def _not_enabled(_: MoveCommand, standing: ArmState, __: Limits) -> str | None:
    return None if standing.enabled else "the arm is not enabled: say `enable`"


def _not_a_location(command: MoveCommand, _: ArmState, __: Limits) -> str | None:
    pose = command.world_from_tool
    if pose.shape != (4, 4) or not np.all(np.isfinite(pose)):
        return "the target is not a 4x4 matrix of numbers"
    wrong = frames.not_a_rotation(pose[:3, :3], 1e-6)
    return None if wrong is None else f"the target's orientation is not a rotation: {wrong}"


def _arm_lost(_: MoveCommand, standing: ArmState, __: Limits) -> str | None:
    return "it is not known where the arm is: ask `where` first" if standing.at is None else None


def _outside_workspace(command: MoveCommand, _: ArmState, limits: Limits) -> str | None:
    point = command.world_from_tool[:3, 3]
    for axis, value, low, high in zip("xyz", point, limits.box_low_mm, limits.box_high_mm, strict=True):
        if not low <= value <= high:
            return f"{axis} = {value:.1f} mm is outside {low:g} to {high:g}"
    return None


def hand_of(limits: Limits) -> ArmBody:
    """What of the guarded body goes with the tool: gripper, what it holds, and what carries the cameras."""
    return body_of(tuple(c for c in limits.capsules if c.link == "tool"), limits.body_mm)


def hand_above_mm(world_from_tool: Array, limits: Limits) -> float:
    """How far the lowest of the hand, and what it holds, is above the table at a pose (4, 4)."""
    body = hand_of(limits)
    ends = frames.apply(world_from_tool, body.ends_mm)
    return float(np.where(body.encloses, np.inf, above_mm(ends, body.radius_mm, limits.table_z_mm)).min())


def _below_table(command: MoveCommand, _: ArmState, limits: Limits) -> str | None:
    body = hand_of(limits)
    ends = frames.apply(command.world_from_tool, body.ends_mm)
    gaps = body.above_floor_mm(ends[None], limits.table_z_mm, limits.clearance_mm)[0]
    worst = int(gaps.argmin())
    if gaps[worst] < 0.0:
        if not np.isnan(body.level_mm[worst]):
            return f"the {body.names[worst]} would be {-gaps[worst]:.1f} mm below what it is to rest on"
        lowest = gaps[worst] + limits.clearance_mm
        what = PERHAPS_HELD if body.names[worst] == PERHAPS_HELD else "the tool"
        return f"{what} would be {lowest:.1f} mm above the table, {limits.clearance_mm:g} is the least"
    return None


def _step_too_long(command: MoveCommand, standing: ArmState, limits: Limits) -> str | None:
    assert standing.at is not None
    step = float(np.linalg.norm(command.world_from_tool[:3, 3] - standing.at[:3, 3]))
    return f"a step of {step:.1f} mm, {limits.max_step_mm:g} is the most" if step > limits.max_step_mm else None


def _turn_too_far(command: MoveCommand, standing: ArmState, limits: Limits) -> str | None:
    assert standing.at is not None
    turn = float(np.degrees(frames.angle_between(standing.at, command.world_from_tool)))
    return f"a turn of {turn:.1f} degrees, {limits.max_turn_deg:g} is the most" if turn > limits.max_turn_deg else None


def _too_fast(command: MoveCommand, _: ArmState, limits: Limits) -> str | None:
    within = 0 < command.speed_pct <= limits.max_speed_pct
    return None if within else f"speed {command.speed_pct:g} % is not within 0 to {limits.max_speed_pct:g}"


def _stale_look(command: MoveCommand, standing: ArmState, limits: Limits) -> str | None:
    if command.look_taken_s is None:
        return None
    age = standing.now_s - command.look_taken_s
    if not 0 <= age <= limits.max_look_age_s:
        return f"the look behind it is {age:.1f} s old, {limits.max_look_age_s:g} is the most"
    return None


# In this order: the first broken rule is the one named, and later rules may rely on earlier ones.
# None: a rule of the way alone, which the sweep has judged.
RULES: tuple[tuple[str, Rule | None], ...] = (
    ("fault_stands", _fault_stands),
    ("not_enabled", _not_enabled),
    ("not_a_location", _not_a_location),
    ("arm_lost", _arm_lost),
    ("outside_workspace", _outside_workspace),
    ("below_table", _below_table),
    ("outside_room", None),
    ("kept_out", None),
    ("no_way", None),
    ("step_too_long", _step_too_long),
    ("turn_too_far", _turn_too_far),
    ("too_fast", _too_fast),
    ("stale_look", _stale_look),
)


def refuse(command: MoveCommand, standing: ArmState, limits: Limits) -> Refusal | None:
    """The first rule the command would break, or None when it may go."""
    for name, rule in RULES:
        text = None if rule is None else rule(command, standing, limits)
        text = text or next((strike.text for strike in standing.strikes if strike.rule == name), None)
        if text is not None:
            return Refusal(name, text)
    return None
