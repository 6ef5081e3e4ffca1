"""Plan a path to a pose: moves within the step limits, each checked for collisions; over an obstacle if necessary.

Pure: the arm's position and the command in; the moves, or the reason why there are none, out.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from daemon.arm import paths
from daemon.arm.belief import Reading
from daemon.arm.guard import ArmState, Limits, MoveCommand, hand_above_mm, refuse
from daemon.arm.permission import Refusal
from daemon.arm.robot import Kinematics
from daemon.arm.sweep import path_refusal
from daemon.arrays import Array

PATH_MM = 40.0
"""Distance between the poses at which the reach along a straight path is checked, before it is divided into steps."""
HIGHER_MM = (60.0, 120.0, 240.0, 400.0)
"""Heights above the higher of start and target at which a path is tried when the direct one collides."""
OUT_MM = 60.0
"""Least height of the gripper, and what it holds, above the table during a joint-interpolated move. Parts on the table
are lower; the guard does not know where they are."""
COLLISION_RULES = ("outside_workspace", "below_table", "outside_room", "kept_out")
MOST_STEPS = 40


@dataclass(frozen=True, eq=False)
class PathSegment:
    """One move of a path: world_from_tool (4, 4) mm at its end; straight, or joint-interpolated."""

    world_from_tool: Array
    straight: bool


def plan_path(
    command: MoveCommand, state: ArmState, start: Reading, robot: Kinematics, limits: Limits
) -> tuple[PathSegment, ...] | Refusal:
    """Plan the moves to the command's target; none of them breaks a rule.

    A joint-interpolated path that begins or ends low goes straight up first and straight down last, if it can, so that
    it clears parts on the table. If the direct path collides: straight up, across at that height, straight down, at
    the lowest height that is clear. A straight path has no alternative: if it collides, it is refused.
    """
    whole = PathSegment(command.world_from_tool, command.straight)
    target_allowed = refuse(command, replace(state, at=command.world_from_tool), limits) is None
    for legs in _with_vertical_ends(whole, start, limits) if target_allowed and not command.straight else ():
        vertical = _checked(legs, command, state, start, robot, limits)
        if not isinstance(vertical, Refusal):
            return vertical
    direct = _checked([whole], command, state, start, robot, limits)
    if not isinstance(direct, Refusal) or command.straight or direct.rule not in COLLISION_RULES or not target_allowed:
        return direct
    for height_mm in HIGHER_MM:
        top_mm = height_mm + max(start.world_from_tool[2, 3], command.world_from_tool[2, 3])
        up, over = (paths.lifted(p, top_mm - p[2, 3]) for p in (start.world_from_tool, command.world_from_tool))
        legs = [PathSegment(up, True), PathSegment(over, False), replace(whole, straight=True)]
        higher = _checked(legs, command, state, start, robot, limits)
        if not isinstance(higher, Refusal):
            return higher
    return replace(direct, text=f"{direct.text}; a path higher up is not clear either")


def _with_vertical_ends(whole: PathSegment, start: Reading, limits: Limits) -> Iterator[list[PathSegment]]:
    """A joint-interpolated path with a straight move up first and down last, then one with only the move up. Yields
    nothing where the path begins and ends high."""
    ends = start.world_from_tool, whole.world_from_tool
    out_mm, in_mm = (max(0.0, OUT_MM - hand_above_mm(end, limits)) for end in ends)
    up = [PathSegment(paths.lifted(start.world_from_tool, out_mm), True)] if out_mm else []
    if in_mm:
        yield [*up, PathSegment(paths.lifted(whole.world_from_tool, in_mm), False), replace(whole, straight=True)]
    if up:
        yield [*up, whole]


def _checked(
    legs: Sequence[PathSegment],
    command: MoveCommand,
    state: ArmState,
    start: Reading,
    robot: Kinematics,
    limits: Limits,
) -> tuple[PathSegment, ...] | Refusal:
    """Divide the legs into steps and check each step's path. Returns the steps, or the first refusal."""
    found: list[PathSegment] = []
    for leg in legs:
        steps = _steps(leg, start, robot, limits)
        if isinstance(steps, Refusal):
            return steps
        for pose in steps:
            step = replace(command, world_from_tool=pose, straight=leg.straight)
            refusal = path_refusal(step, replace(state, at=start.world_from_tool), start, robot, limits)
            if refusal is not None:
                return refusal
            joints = robot.reachable(pose, start.joints_rad)
            if joints is None:
                return _out_of_reach(pose)
            start = Reading(pose, joints)
            found.append(PathSegment(pose, leg.straight))
    return tuple(found)


def _steps(leg: PathSegment, start: Reading, robot: Kinematics, limits: Limits) -> list[Array] | Refusal:
    """Poses along the leg, the last at its end, each within the step limits of the previous one."""
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
        poses = [robot.between(start.joints_rad, joints, k / count) for k in range(1, count)]
        poses = [start.world_from_tool, *poses, target]
        if all(paths.within(a, b, limits.max_step_mm, limits.max_turn_deg) for a, b in pairwise(poses)):
            return poses[1:]
    return [target]


def _out_of_reach(pose: Array) -> Refusal:
    x, y, z = pose[:3, 3]
    text = f"the arm in its present configuration cannot reach {x:.0f}, {y:.0f}, {z:.0f} mm at that angle"
    return Refusal("out_of_reach", text)
