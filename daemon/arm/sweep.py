"""Prove that the whole path of a move is free of collisions, for every section of the arm. Pure: values in, values out.

The path is checked at samples. Between two samples the travel of each capsule is bounded, from the arm's lengths and
the rotation of its joints: a capsule that is farther than this from an obstacle cannot touch it there. Where the bound
is too coarse, the interval is subdivided (conservative advancement), so that many samples are needed only in narrow
places. A path is proven to within SLACK_MM of the limits, and never to less than half the clearance.

A capsule that violates a limit at the start (below the table's clearance, in a keep-out box, outside box or room) may
only move out: its gap may never get smaller on the path until it is clear, and then it must stay clear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arm.belief import Reading
from daemon.arm.body import ArmBody, away_mm, body_of, upright_bounds, within_mm
from daemon.arm.guard import ArmState, Limits, MoveCommand, refuse
from daemon.arm.permission import Refusal
from daemon.arm.robot import Kinematics
from daemon.arrays import Array, Flags

SLACK_MM = 0.5
"""How far between samples a gap may be below its limit; half the clearance where that is less."""
FIRST_MM, FOLLOWED_MM = 25.0, 6.0
"""The greatest travel of any capsule in one of the first intervals of a joint-interpolated path; that of the gripper on
a straight path, where close samples are needed to see a wrist that gets nearly straight on the way."""
NEAR_MM = 30.0
"""The distance from a keep-out box's limit below which it is computed exactly."""
FINEST_MM = 0.2
"""An interval with less travel than this that is not proven clear counts as a collision."""
MOST_AT_FIRST, MOST_PARTS, MOST_PLACES = 120, 12, 500
"""The most intervals at first, parts of one interval at a time, and samples in all. They bound the computing time; a
path that needs more, because it is so narrow or so near to a singularity, is better avoided."""
MOST_FALL = 0.75
"""On a straight path, an interval where the least squared singular value may fall by a greater share is subdivided."""
TCP, FLANGE, TOOL, WRIST_JOINTS, SIDES = -1, 6, 7, 3, 6
AFTER, BEFORE = [1, 2, 0], [2, 0, 1]
"""The axes after and before each of x, y, z in cyclic order."""


class MovePath(Protocol):
    """The path of one move, from its start (share 0) to its end (share 1)."""

    def first(self) -> Array:
        """(N,) the first samples: rising shares of the path."""

    def links(self, shares: Array) -> Array:
        """(N, 8, 4, 4): Kinematics.frames at (N,) shares; nan where the arm cannot reach the pose."""

    def travel_mm(self, shares: Array) -> Array:
        """(N - 1, C): an upper bound of the travel of any point of each capsule between two neighbouring shares."""


@dataclass(frozen=True, eq=False)
class JointPath:
    """A joint-interpolated path: all joints start and end together. speed_mm (C,): a bound of each capsule's travel on
    the whole path."""

    robot: Kinematics
    start_rad: Array
    change_rad: Array
    speed_mm: Array

    def first(self) -> Array:
        return np.linspace(0.0, 1.0, _interval_count(float(self.speed_mm.max()), FIRST_MM) + 1)

    def links(self, shares: Array) -> Array:
        return self.robot.frames(self.start_rad + shares[:, None] * self.change_rad)

    def travel_mm(self, shares: Array) -> Array:
        return np.diff(shares)[:, None] * self.speed_mm


@dataclass(frozen=True, eq=False)
class StraightPath:
    """A straight path: the tool moves along a line and rotates evenly; the joints follow. shares (G,): the first
    samples; joints_rad (G, 6), places (G, 8, 4, 4): the joints and Kinematics.frames there; moved_mm (G, C): a bound of
    each capsule's travel from the start to there. Between two samples the bound grows linearly."""

    robot: Kinematics
    start: Reading
    motion: Array
    shares: Array
    joints_rad: Array
    places: Array
    moved_mm: Array

    def first(self) -> Array:
        return self.shares

    def links(self, shares: Array) -> Array:
        """Joints at other shares are computed from those of the first sample before them."""
        before = np.searchsorted(self.shares, shares, side="right") - 1
        if (self.shares[before] == shares).all():
            return self.places[before]
        return self.robot.frames(joints_along(self.robot, self.start, self.motion, shares, self.joints_rad[before]))

    def travel_mm(self, shares: Array) -> Array:
        before = np.minimum(np.searchsorted(self.shares, shares, side="right") - 1, len(self.shares) - 2)
        part = (shares - self.shares[before]) / np.diff(self.shares)[before]
        moved = self.moved_mm[before] + part[:, None] * (self.moved_mm[before + 1] - self.moved_mm[before])
        return np.asarray(np.diff(moved, axis=0))


def joints_along(robot: Kinematics, start: Reading, motion: Array, shares: Array, near_rad: Array) -> Array:
    """(N, 6): the joints on a straight motion (6,) from the start, at rising (N,) shares. near_rad: as for `along`."""
    poses = np.tile(np.eye(4), (len(shares), 1, 1))
    poses[:, :3, :3] = _rotations(motion[3:], shares) @ start.world_from_tool[:3, :3]
    poses[:, :3, 3] = start.world_from_tool[:3, 3] + shares[:, None] * motion[:3]
    joints = robot.along(poses, near_rad)
    joints[shares == 0.0] = start.joints_rad
    return joints


def jacobians_mm(links: Array) -> Array:
    """(N, 3, 3): Jacobians of the wrist centre for joints 1 to 3, one row a joint, mm/rad."""
    axes, origins, wrist = links[:, :3, :3, 2], links[:, :3, :3, 3], links[:, None, FLANGE, :3, 3]
    return _cross(axes, wrist - origins)


def _cross(a: Array, b: Array) -> Array:
    """(..., 3): the cross product; faster than numpy's, which checks shapes first."""
    return np.asarray(a[..., AFTER] * b[..., BEFORE] - a[..., BEFORE] * b[..., AFTER])


@dataclass(frozen=True, eq=False)
class Unproven:
    """The capsules (always with the tool centre point) and keep-out boxes that are not proven apart yet."""

    capsules: NDArray[np.intp]
    boxes: NDArray[np.intp]

    def gaps_of(self, links: Array, body: ArmBody, limits: Limits) -> Gaps:
        """The gaps between them, and those of the tool centre point to its box; `capsule` indexes the whole body."""
        some = body.only(self.capsules)
        gaps = gaps_of(links, some, replace(limits, keep_out=tuple(limits.keep_out[k] for k in self.boxes)))
        return replace(gaps, capsule=self.capsules[gaps.capsule])

    def columns(self, body: ArmBody) -> NDArray[np.intp]:
        """(P,) the indices of their columns among those of the whole body, in order."""
        count = len(body.names)
        of_all = np.concatenate([[0, count], 2 * count + SIDES + self.boxes * count])[:, None] + self.capsules
        return np.concatenate([of_all[:2].ravel(), 2 * count + np.arange(SIDES), of_all[2:].ravel()])

    def where(self, unproven: NDArray[np.bool_], capsule: NDArray[np.intp], count: int) -> Unproven:
        """The capsules and boxes of the unproven columns (P,)."""
        capsules = np.union1d(capsule[unproven], count - 1)
        of_boxes = unproven[2 * len(self.capsules) + SIDES :].reshape(len(self.boxes), len(self.capsules))
        return Unproven(capsules, self.boxes[of_boxes.any(axis=1)])


def _interval_count(longest_mm: float, each_mm: float) -> int:
    return int(np.clip(np.ceil(longest_mm / each_mm), 2, MOST_AT_FIRST))


def _rotations(vector: Array, shares: Array) -> Array:
    """(N, 3, 3): rotations by shares of a rotation vector (3,)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / max(angle, 1e-12)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned = (shares * angle)[:, None, None]
    return np.asarray(np.eye(3) + np.sin(turned) * cross + (1.0 - np.cos(turned)) * (cross @ cross))


def lever_arms_mm(links: Array, body: ArmBody) -> Array:
    """(6, C): an upper bound, in any position of the arm, of the distance of a capsule's points from the axis of each
    joint; 0 where the joint does not move it.

    links: frames (8, 4, 4) at any position.
    """
    ends = body.placed(links[None])[0]
    last = np.minimum(body.frame, FLANGE)
    tips = np.linalg.norm(ends - links[last, None, :3, 3], axis=-1).max(axis=1) + body.radius_mm
    return np.where(np.arange(6)[:, None] < last, origins_off_mm(links)[:, last] + tips, 0.0)


def origins_off_mm(links: Array) -> Array:
    """(6, 7): an upper bound of the distance of each frame's origin from the axis of each joint that moves it: the sum
    of the rigid lengths between them."""
    legs = np.diff(links[:7, :3, 3], axis=0)
    across = np.linalg.norm(_cross(links[:6, :3, 2], legs), axis=1)
    whole = np.concatenate([[0.0], np.cumsum(np.linalg.norm(legs, axis=1))])
    return np.asarray(across[:, None] + whole - whole[1:, None])


def path_of(
    start: Reading, command: MoveCommand, joints_rad: Array | None, robot: Kinematics, body: ArmBody
) -> JointPath | StraightPath | Refusal:
    """The path of a command; joints_rad (6,): the end of a joint-interpolated one. A Refusal where there is no
    path."""
    links = robot.frames(start.joints_rad[None])[0]
    reaches = lever_arms_mm(links, body)
    if not command.straight:
        if joints_rad is None:
            return Refusal("no_way", "the arm cannot reach it in its present configuration")
        change = joints_rad - start.joints_rad
        return JointPath(robot, start.joints_rad, change, np.abs(change) @ reaches)
    return _straight_path(start, command, robot, body, links, reaches)


def _straight_path(
    start: Reading, command: MoveCommand, robot: Kinematics, body: ArmBody, links: Array, reaches: Array
) -> StraightPath | Refusal:
    """The straight path of a command, with bounds of the rotation of joints 1 to 3 between two samples.

    s, the least singular value of the wrist centre's Jacobian J, bounds the joint speeds: q' = v / J is at most v / s.
    It also bounds how much larger q' can be than at the nearer sample: |q''| <= (|v'| + |J'| |q'|) / s.
    """
    motion = frames.difference(command.world_from_tool, start.world_from_tool)
    tips = np.linalg.norm(body.placed(links[None])[0] - links[TOOL, :3, 3], axis=-1).max(axis=1) + body.radius_mm
    far, turn = frames.size(motion)
    arm = body.frame <= WRIST_JOINTS
    speed_mm, arm_mm = np.where(arm, 0.0, far + turn * tips), np.where(arm, reaches[:WRIST_JOINTS], 0.0)
    wrist_mm = float(np.linalg.norm(wrist_from_tcp(links)))
    bend_mm, whole_bend_mm = bends_mm(origins_off_mm(links)[:WRIST_JOINTS, FLANGE])
    shares = np.linspace(0.0, 1.0, _interval_count(float(speed_mm.max()), FOLLOWED_MM) + 1)
    for subdivided in (False, True):
        joints = joints_along(robot, start, motion, shares, start.joints_rad)
        places = robot.frames(joints)
        if (lost := _unreachable(shares, places)) is not None:
            return lost
        interval, jacobians = np.diff(shares), jacobians_mm(places)
        path_mm = (far + turn * wrist_mm) * interval
        least, falls = least_squared(jacobians, bend_mm * path_mm)
        parts = subdivisions(falls)
        if subdivided or (parts == 1).all():
            break
        if parts.sum() > MOST_PLACES:
            return _no_path(shares[falls.argmax()], "it comes too near to a singular position of the arm")
        shares, _ = _subdivide(shares, parts)
    if arm.any() and least.min() <= 0.0:
        return _no_path(shares[least.argmin()], "the arm is stretched too far to predict the path of its elbow")
    levers_mm = np.sqrt(np.maximum(least, 1e-9))
    fastest = path_mm / levers_mm
    change = (wrist_mm * np.square(turn * interval) + whole_bend_mm * np.square(fastest)) / levers_mm
    rates = joint_rates(jacobians, motion[:3] + _cross(motion[3:], wrist_from_tcp(places)))
    turned = most_turned(rates, interval, fastest, change)
    moved = np.concatenate([np.zeros((1, len(arm))), np.cumsum(turned @ arm_mm + interval[:, None] * speed_mm, axis=0)])
    return StraightPath(robot, start, motion, shares, joints, places, moved)


def wrist_from_tcp(links: Array) -> Array:
    """(..., 3) mm: from the tool centre point to the wrist centre."""
    return np.asarray(links[..., FLANGE, :3, 3] - links[..., TOOL, :3, 3])


def bends_mm(levers_mm: Array) -> tuple[float, float]:
    """Bounds of the change of the wrist centre's Jacobian for each radian of joint rotation: without joint 1, whose
    rotation changes no singular value, and with it. levers_mm (3,): bounds of the wrist centre's distance from the axes
    of joints 1 to 3; d J[i] / d q[j] is as long as the lever arm of the later of the two joints."""
    first, second, third = np.square(levers_mm)
    return float(np.sqrt(2 * second + 4 * third)), float(np.sqrt(first + 3 * second + 5 * third))


def least_squared(jacobians: Array, bent: Array) -> tuple[Array, Array]:
    """(N - 1,) mm^2: a lower bound of the least singular value, squared, between two samples; and the share by which it
    may fall there. jacobians (N, 3, 3); bent (N - 1,) mm^2: the wrist centre's path between the samples, times bend_mm.

    The singular value s falls by at most bend for each radian, and the joints turn by at most w / s on a path w, so
    its square falls by at most 2 bend w. It is least where the falls from both samples meet.
    """
    squared = np.linalg.eigvalsh(jacobians @ jacobians.swapaxes(1, 2))[:, 0]
    middle = (squared[:-1] + squared[1:]) / 2
    return middle - bent, bent / np.maximum(middle, 1e-9)


def subdivisions(falls: Array) -> NDArray[np.intp]:
    """(N,): into how many parts each interval is divided."""
    return np.where(falls < MOST_FALL, 1, np.ceil(np.minimum(2.0 * falls, MOST_PARTS))).astype(int)


def joint_rates(jacobians: Array, speeds_mm: Array) -> Array:
    """(N, 3) rad: the speeds of joints 1 to 3 for wrist centre speeds (N, 3) mm."""
    return np.asarray(np.abs(np.linalg.solve(jacobians.swapaxes(1, 2), speeds_mm[..., None])[..., 0]))


def most_turned(rates: Array, interval: Array, fastest: Array, change: Array) -> Array:
    """(N - 1, 3) rad: bounds of the rotation of joints 1 to 3 between two samples. rates (N, 3): their speeds at the
    samples, for the whole path; interval (N - 1,): its shares. Each (N - 1,) rad: fastest, which no joint exceeds in
    the interval; change, their greatest increase in all of it: the nearer sample is at most half of it away."""
    at_ends = np.maximum(rates[:-1], rates[1:]) * interval[:, None]
    return np.minimum(at_ends + change[:, None] / 2, fastest[:, None])


@dataclass(frozen=True, eq=False)
class Gaps:
    """The gaps at N samples, P columns: values_mm (N, P), negative where a limit is violated; what (P,): (rule, section
    of the arm, obstacle); capsule (P,): the capsule whose travel changes the gap."""

    values_mm: Array
    what: tuple[tuple[str, str, str], ...]
    capsule: NDArray[np.intp]


def gaps_of(links: Array, body: ArmBody, limits: Limits) -> Gaps:
    """The gaps of the whole body to the table, the sides of the room and each keep-out box, and of the tool centre
    point to the sides of its box."""
    ends = body.placed(links)
    each = np.arange(len(body.names))
    least = limits.clearance_mm
    columns = [body.above_floor_mm(ends, limits.table_z_mm, least)]
    what = [("below_table", name, "the table") for name in body.names]
    both_ends = within_mm(ends, limits.room_low_mm, limits.room_high_mm)
    columns.append(np.where(body.encloses, np.inf, both_ends.min(axis=(2, 3)) - body.radius_mm - least))
    what += [("outside_room", name, "a side of the room") for name in body.names]
    columns.append(within_mm(ends[:, TCP, 0], limits.box_low_mm, limits.box_high_mm))
    sides = [f"{side} {axis} of the box" for side in ("the least", "the greatest") for axis in "xyz"]
    what += [("outside_workspace", "tool centre point", side) for side in sides]
    if limits.keep_out:
        away = away_mm(ends, body.radius_mm, limits.keep_out, NEAR_MM + least) - least
        for number, box in enumerate(limits.keep_out):
            away[:, number, [box.name in touch for touch in body.may_touch]] = np.inf
        columns.append(away.reshape(len(ends), -1))
        what += [("kept_out", name, box.name) for box in limits.keep_out for name in body.names]
    capsule = np.concatenate([each, each, np.full(SIDES, each[TCP]), *[each for _ in limits.keep_out]])
    return Gaps(np.concatenate(columns, axis=1), tuple(what), capsule)


def violations(path: MovePath, body: ArmBody, limits: Limits) -> tuple[Refusal, ...]:
    """The rules that the path breaks, each with its worst sample; none where the path is proven clear."""
    slack = min(SLACK_MM, limits.clearance_mm / 2)
    shares = path.first()
    new = np.ones(len(shares), bool)
    links = path.links(shares)
    tight = broad_phase(body.placed(links), path.travel_mm(shares), body, limits)
    values = np.empty((0, len(tight.columns(body))))
    while True:
        gaps = tight.gaps_of(links, body, limits)
        values = _merge(values, gaps.values_mm, new)
        allowed = np.minimum(np.maximum.accumulate(values, axis=0)[:-1], 0.0)
        if (values[1:] < allowed - slack).any():
            where = [f"on the way ({100 * share:.0f} %)" for share in shares[1:]]
            return _worst(gaps, allowed - values[1:], body.placed(path.links(shares[1:])), where, slack)
        travel = path.travel_mm(shares)[:, gaps.capsule]
        each = travel / np.maximum(values[:-1] + values[1:] - 2 * (allowed - slack), 1e-9)
        need = each.max(axis=1)
        unproven = need > 1.0
        if not unproven.any():
            return ()
        parts = np.where(unproven, np.ceil(np.minimum(need, MOST_PARTS)), 1).astype(int)
        if ((travel.max(axis=1) < FINEST_MM) & unproven).any() or parts.sum() > MOST_PLACES:
            return (_no_path(shares[need.argmax()], "it passes too closely"),)
        shares, new = _subdivide(shares, parts)
        links = path.links(shares[new])
        if (lost := _unreachable(shares[new], links)) is not None:
            return (lost,)
        # Check again only columns that are not proven for the whole path, and those that violated their limit.
        open_ones = np.asarray((each > 1.0).any(axis=0) | (values < 0.0).any(axis=0))
        before, tight = tight.columns(body), tight.where(open_ones, gaps.capsule, len(body.names))
        values = values[:, np.isin(before, tight.columns(body))]


def broad_phase(ends: Array, travel: Array, body: ArmBody, limits: Limits) -> Unproven:
    """Broad phase: the capsules and boxes that could touch, from a bounding box of each capsule on the whole path. ends
    (N, C, 2, 3), travel (N - 1, C)."""
    margin = (body.radius_mm + limits.clearance_mm + travel.max(axis=0) / 2)[:, None]
    each = ends.reshape(len(ends), -1)
    low = each.min(axis=0).reshape(ends.shape[1:]).min(axis=1) - margin
    high = each.max(axis=0).reshape(ends.shape[1:]).max(axis=1) + margin
    boxes = upright_bounds(limits.keep_out)[:, :, None]
    meets = ((low < boxes[:, 1]) & (high > boxes[:, 0])).all(axis=2)
    leaves = ((low < limits.room_low_mm) | (high > limits.room_high_mm)).any(axis=1)
    near = meets.any(axis=0) | leaves | (low[:, 2] < limits.table_z_mm)
    near[TCP] = True
    return Unproven(np.flatnonzero(near), np.flatnonzero(meets.any(axis=1)))


def _no_path(share: float, why: str) -> Refusal:
    return Refusal("no_way", f"after {100 * share:.0f} % of the way {why}")


def _unreachable(shares: Array, links: Array) -> Refusal | None:
    """The first of the (N,) shares that the arm cannot reach, or None; links (N, 8, 4, 4): its frames there."""
    reached = np.isfinite(links).all(axis=(1, 2, 3))
    return None if reached.all() else _no_path(shares[~reached].min(), "the arm cannot follow in its configuration")


def _subdivide(shares: Array, parts: NDArray[np.intp]) -> tuple[Array, NDArray[np.bool_]]:
    """Divide the k-th interval into parts[k] equal parts. Returns all shares, and which of them are new."""
    interval = np.repeat(np.arange(len(parts)), parts)
    nth = np.arange(len(interval)) - np.repeat(np.cumsum(parts) - parts, parts)
    finer = shares[interval] + (shares[interval + 1] - shares[interval]) * nth / parts[interval]
    return np.append(finer, shares[-1]), np.append(nth > 0, False)


def _merge(old: Array, found: Array, new: NDArray[np.bool_]) -> Array:
    """(N, P): the found rows at the new samples, the old rows at the others."""
    values = np.empty((len(new), found.shape[1]))
    values[new], values[~new] = found, old
    return values


def _worst(gaps: Gaps, lacking: Array, ends: Array, where: Sequence[str], slack: float) -> tuple[Refusal, ...]:
    """For each rule the largest of lacking (N, P), by sample and section of the arm, if it is more than slack."""
    found = []
    for rule in dict.fromkeys(what[0] for what in gaps.what):
        columns = np.array([k for k, what in enumerate(gaps.what) if what[0] == rule])
        place, column = np.unravel_index(lacking[:, columns].argmax(), (len(lacking), len(columns)))
        by_mm, pair = float(lacking[place, columns[column]]), columns[column]
        if by_mm > slack:
            _, part, thing = gaps.what[pair]
            axis = ends[place, gaps.capsule[pair]]
            at = "{:.0f} {:.0f} {:.0f}".format(*axis[axis[:, 2].argmin()])
            text = f"{where[int(place)]} the {part}, at {at}, comes {by_mm:.1f} mm too near to {thing}"
            found.append(Refusal(rule, text))
    return tuple(found)


def places_clear(joints_rad: Array, robot: Kinematics, limits: Limits) -> Flags:
    """(N,): whether the whole arm keeps every limit at (N, 6) joints, also where it violates one now."""
    body = body_of(limits.capsules, limits.body_mm)
    return np.asarray((gaps_of(robot.frames(joints_rad), body, limits).values_mm >= 0.0).all(axis=1))


def path_refusal(
    command: MoveCommand, state: ArmState, start: Reading | None, robot: Kinematics, limits: Limits
) -> Refusal | None:
    """Return the first rule that the command breaks on its whole path from start, where the arm is; None: it may be
    sent."""
    refusal = refuse(command, state, limits)
    if refusal is not None or start is None:
        return refusal
    joints = None if command.straight else robot.reachable(command.world_from_tool, start.joints_rad)
    body = body_of(limits.capsules, limits.body_mm)
    path = path_of(start, command, joints, robot, body)
    met = (path,) if isinstance(path, Refusal) else violations(path, body, limits)
    return refuse(command, replace(state, violations=met), limits) if met else None
