"""How to get to a pose: in legs within the step limits, each swept clear; where the direct way strikes, over it.

Pure: where the arm is and what it is to do in, legs or the reason why there are none out.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from daemon.arm import paths
from daemon.arm.belief import Reading
from daemon.arm.guard import ArmState, Limits, MoveCommand, Refusal, hand_above_mm, refuse
from daemon.arm.robot import Kinematics
from daemon.arm.sweep import way_clear
from daemon.arrays import Array

PATH_MM = 40.0
"""How densely a straight way is checked for reach before it is parted in steps."""
HIGHER_MM = (60.0, 120.0, 240.0, 400.0)
"""How far over the higher of start and target a way is looked for when the direct one strikes."""
OUT_MM = 60.0
"""How high over the table the hand, and what it holds, is where it goes elsewhere than straight: no guard knows of the
parts that lie there, which are lower."""
STRIKES = ("outside_workspace", "below_table", "outside_room", "kept_out")
MOST_STEPS = 40


@dataclass(frozen=True, eq=False)
class PathSegment:
    """One move of a way: world_from_tool (4, 4) mm where it ends, on the line or the joints' own way."""

    world_from_tool: Array
    straight: bool


def planned_way(
    command: MoveCommand, standing: ArmState, start: Reading, robot: Kinematics, limits: Limits
) -> tuple[PathSegment, ...] | Refusal:
    """The legs to the command's target, none of which breaks a rule as things stand.

    A joint-interpolated way that begins or ends low goes straight up first and straight down last, where it can, out of
    and into what lies on the table. Where one strikes: straight up, across at that height, straight down; the lowest
    that is clear. A straight way is asked for because only that will do, and is refused where it strikes.
    """
    whole = PathSegment(command.world_from_tool, command.straight)
    may_be_there = refuse(command, replace(standing, at=command.world_from_tool), limits) is None
    for legs in _upright(whole, start, limits) if may_be_there and not command.straight else ():
        upright = _clear(legs, command, standing, start, robot, limits)
        if not isinstance(upright, Refusal):
            return upright
    direct = _clear([whole], command, standing, start, robot, limits)
    if not isinstance(direct, Refusal) or command.straight or direct.rule not in STRIKES or not may_be_there:
        return direct
    for height_mm in HIGHER_MM:
        top_mm = height_mm + max(start.world_from_tool[2, 3], command.world_from_tool[2, 3])
        up, over = (paths.lifted(p, top_mm - p[2, 3]) for p in (start.world_from_tool, command.world_from_tool))
        legs = [PathSegment(up, True), PathSegment(over, False), replace(whole, straight=True)]
        higher = _clear(legs, command, standing, start, robot, limits)
        if not isinstance(higher, Refusal):
            return higher
    return replace(direct, text=f"{direct.text}; nor is a way over it clear")


def _upright(whole: PathSegment, start: Reading, limits: Limits) -> Iterator[list[PathSegment]]:
    """The joints' way up first and down last; where it cannot come down so, up first alone. None where it begins and
    ends high."""
    ends = start.world_from_tool, whole.world_from_tool
    out_mm, in_mm = (max(0.0, OUT_MM - hand_above_mm(end, limits)) for end in ends)
    up = [PathSegment(paths.lifted(start.world_from_tool, out_mm), True)] if out_mm else []
    if in_mm:
        yield [*up, PathSegment(paths.lifted(whole.world_from_tool, in_mm), False), replace(whole, straight=True)]
    if up:
        yield [*up, whole]


def _clear(
    legs: Sequence[PathSegment],
    command: MoveCommand,
    standing: ArmState,
    start: Reading,
    robot: Kinematics,
    limits: Limits,
) -> tuple[PathSegment, ...] | Refusal:
    """The legs in steps, every one of them swept; or the first refusal."""
    found: list[PathSegment] = []
    for leg in legs:
        steps = _steps(leg, start, robot, limits)
        if isinstance(steps, Refusal):
            return steps
        for pose in steps:
            told = replace(command, world_from_tool=pose, straight=leg.straight)
            refusal = way_clear(told, replace(standing, at=start.world_from_tool), start, robot, limits)
            if refusal is not None:
                return refusal
            joints = robot.reachable(pose, start.joints_rad)
            if joints is None:
                return _out_of_reach(pose)
            start = Reading(pose, joints)
            found.append(PathSegment(pose, leg.straight))
    return tuple(found)


def _steps(leg: PathSegment, start: Reading, robot: Kinematics, limits: Limits) -> list[Array] | Refusal:
    """Poses on the leg's own way, the last its end, each within the step limits of the one before."""
    target = leg.world_from_tool
    if leg.straight:
        for pose in paths.steps(start.world_from_tool, target, PATH_MM, 90.0):
            if robot.reachable(pose, start.joints_rad) is None:
                return _out_of_reach(pose)
        return paths.steps(start.world_from_tool, target, limits.max_step_mm, limits.max_turn_deg)
    joints = robot.reachable(target, start.joints_rad)
    if joints is None:
        return _out_of_reach(target)
    for count in range(1, MOST_STEPS):
        way = [robot.between(start.joints_rad, joints, k / count) for k in range(1, count)]
        way = [start.world_from_tool, *way, target]
        if all(paths.within(a, b, limits.max_step_mm, limits.max_turn_deg) for a, b in pairwise(way)):
            return way[1:]
    return [target]


def _out_of_reach(pose: Array) -> Refusal:
    x, y, z = pose[:3, 3]
    text = f"the arm as it is configured cannot reach {x:.0f}, {y:.0f}, {z:.0f} mm at that angle"
    return Refusal("out_of_reach", text)
