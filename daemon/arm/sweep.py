"""Is the whole way of a move clear, for everything of the arm? Proven, not sampled. Pure: values in, values out.

A way is looked at in places; between two places the travel of each capsule is bounded from the arm's lengths and the
turn of its joints, and a thing that far from what it must not touch cannot touch it in between. Where the bound does
not suffice the stretch is parted again (conservative advancement), so that many places are asked for only where it is
tight. A way may be proven to within SLACK_MM of the limits, never beyond half the clearance.

What is inside a limit when the way begins (below the table's clearance, in a keep-out, outside box or room) may only
leave:
its gap may nowhere be less than it was before on the same way, until it is clear; then it stays clear.
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
from daemon.arm.guard import ArmState, Limits, MoveCommand, Refusal, Strike, refuse
from daemon.arm.robot import Kinematics
from daemon.arrays import Array, Flags

SLACK_MM = 0.5
"""How far between places a gap may be below its limit; half the clearance where that is less."""
FIRST_MM, FOLLOWED_MM = 25.0, 6.0
"""How far anything goes, at most, in a stretch to begin with; how far the hand between two places where it is asked
whether the arm can follow it on a line, so that a wrist that comes near to straight on the way is seen."""
NEAR_MM = 30.0
"""What comes nearer than this to its limit in a keep-out box is measured exactly."""
FINEST_MM = 0.2
"""A stretch this short that is not proven clear is not clear."""
MOST_AT_FIRST, MOST_PARTS, MOST_PLACES = 120, 12, 500
"""Stretches to begin with; parts of one at a time; places after which it is given up: what asking costs is bounded, and
a way so tight, or so near to where joints turn fast for little, is better gone otherwise."""
MOST_FALL = 0.75
"""A stretch of a line where the least lever arm, squared, may fall by a greater share is looked at more closely."""
TCP, FLANGE, TOOL, WRIST_JOINTS, SIDES = -1, 6, 7, 3, 6
AFTER, BEFORE = [1, 2, 0], [2, 0, 1]
"""Which of x, y, z comes behind each, and before it."""


class Way(Protocol):
    """One move from its start (share 0) to its end (share 1)."""

    def first(self) -> Array:
        """(N,) the rising shares at which it is looked at to begin with."""

    def links(self, shares: Array) -> Array:
        """(N, 8, 4, 4): Kinematics.frames at (N,) shares; nan where the arm does not get there."""

    def travel_mm(self, shares: Array) -> Array:
        """(N - 1, C): no point of a capsule moves farther than this between two neighbouring shares."""


@dataclass(frozen=True, eq=False)
class JointWay:
    """All joints start and end together: speed_mm (C,) is each capsule's greatest travel from start to end."""

    robot: Kinematics
    start_rad: Array
    change_rad: Array
    speed_mm: Array

    def first(self) -> Array:
        """See Way."""
        return np.linspace(0.0, 1.0, _stretches(float(self.speed_mm.max()), FIRST_MM) + 1)

    def links(self, shares: Array) -> Array:
        """See Way."""
        return self.robot.frames(self.start_rad + shares[:, None] * self.change_rad)

    def travel_mm(self, shares: Array) -> Array:
        """See Way."""
        return np.diff(shares)[:, None] * self.speed_mm


@dataclass(frozen=True, eq=False)
class StraightWay:
    """The tool goes on a line and turns evenly; the joints follow. shares (G,): where they were asked for to begin
    with; joints_rad (G, 6), places (G, 8, 4, 4): the joints and Kinematics.frames there; gone_mm (G, C): no point of a
    capsule goes farther up to there, and between two of them none goes faster than evenly."""

    robot: Kinematics
    start: Reading
    motion: Array
    shares: Array
    joints_rad: Array
    places: Array
    gone_mm: Array

    def first(self) -> Array:
        """See Way."""
        return self.shares

    def links(self, shares: Array) -> Array:
        """See Way. The joints of other places follow those of the one before that was asked for to begin with."""
        before = np.searchsorted(self.shares, shares, side="right") - 1
        if (self.shares[before] == shares).all():
            return self.places[before]
        return self.robot.frames(_following(self.robot, self.start, self.motion, shares, self.joints_rad[before]))

    def travel_mm(self, shares: Array) -> Array:
        """See Way."""
        before = np.minimum(np.searchsorted(self.shares, shares, side="right") - 1, len(self.shares) - 2)
        part = (shares - self.shares[before]) / np.diff(self.shares)[before]
        gone = self.gone_mm[before] + part[:, None] * (self.gone_mm[before + 1] - self.gone_mm[before])
        return np.asarray(np.diff(gone, axis=0))


def _following(robot: Kinematics, start: Reading, motion: Array, shares: Array, near_rad: Array) -> Array:
    """(N, 6): the joints that follow a line (6,) from the start, at rising (N,) shares. near_rad: as `along` has it."""
    poses = np.tile(np.eye(4), (len(shares), 1, 1))
    poses[:, :3, :3] = _turns(motion[3:], shares) @ start.world_from_tool[:3, :3]
    poses[:, :3, 3] = start.world_from_tool[:3, 3] + shares[:, None] * motion[:3]
    joints = robot.along(poses, near_rad)
    joints[shares == 0.0] = start.joints_rad
    return joints


def _jacobians_mm(links: Array) -> Array:
    """(N, 3, 3): how the wrist centre moves for joints 1 to 3, a row each."""
    axes, origins, wrist = links[:, :3, :3, 2], links[:, :3, :3, 3], links[:, None, FLANGE, :3, 3]
    return _cross(axes, wrist - origins)


def _cross(a: Array, b: Array) -> Array:
    """(..., 3): numpy's, without what it asks of shapes first."""
    return np.asarray(a[..., AFTER] * b[..., BEFORE] - a[..., BEFORE] * b[..., AFTER])


@dataclass(frozen=True, eq=False)
class Tight:
    """What is not proven clear of everything yet: which capsules, the tool centre point always, and which boxes."""

    capsules: NDArray[np.intp]
    boxes: NDArray[np.intp]

    def gaps_of(self, links: Array, body: ArmBody, limits: Limits) -> Gaps:
        """The gaps between them, and the tool centre point's to its box; `capsule` counts all of the body."""
        some = body.only(self.capsules)
        gaps = gaps_of(links, some, replace(limits, keep_out=tuple(limits.keep_out[k] for k in self.boxes)))
        return replace(gaps, capsule=self.capsules[gaps.capsule])

    def columns(self, body: ArmBody) -> NDArray[np.intp]:
        """(P,) which of all columns they are, in order."""
        count = len(body.names)
        of_all = np.concatenate([[0, count], 2 * count + SIDES + self.boxes * count])[:, None] + self.capsules
        return np.concatenate([of_all[:2].ravel(), 2 * count + np.arange(SIDES), of_all[2:].ravel()])

    def where(self, unproven: NDArray[np.bool_], capsule: NDArray[np.intp], count: int) -> Tight:
        """Those with an unproven column of these (P,)."""
        capsules = np.union1d(capsule[unproven], count - 1)
        of_boxes = unproven[2 * len(self.capsules) + SIDES :].reshape(len(self.boxes), len(self.capsules))
        return Tight(capsules, self.boxes[of_boxes.any(axis=1)])


def _stretches(longest_mm: float, each_mm: float) -> int:
    return int(np.clip(np.ceil(longest_mm / each_mm), 2, MOST_AT_FIRST))


def _turns(vector: Array, shares: Array) -> Array:
    """(N, 3, 3): rotations by shares of an axis times angle (3,)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / max(angle, 1e-12)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned = (shares * angle)[:, None, None]
    return np.asarray(np.eye(3) + np.sin(turned) * cross + (1.0 - np.cos(turned)) * (cross @ cross))


def reaches_mm(links: Array, body: ArmBody) -> Array:
    """(6, C): no point of a capsule is ever farther than this from the axis of a joint, 0 where that does not move it.

    From frames (8, 4, 4) of any moment.
    """
    ends = body.placed(links[None])[0]
    last = np.minimum(body.frame, FLANGE)
    tips = np.linalg.norm(ends - links[last, None, :3, 3], axis=-1).max(axis=1) + body.radius_mm
    return np.where(np.arange(6)[:, None] < last, _origins_off_mm(links)[:, last] + tips, 0.0)


def _origins_off_mm(links: Array) -> Array:
    """(6, 7): no farther is the origin of a frame ever from the axis of a joint that moves it: what lies between is one
    rigid length after the other."""
    legs = np.diff(links[:7, :3, 3], axis=0)
    across = np.linalg.norm(_cross(links[:6, :3, 2], legs), axis=1)
    whole = np.concatenate([[0.0], np.cumsum(np.linalg.norm(legs, axis=1))])
    return np.asarray(across[:, None] + whole - whole[1:, None])


def way_of(
    start: Reading, command: MoveCommand, joints_rad: Array | None, robot: Kinematics, body: ArmBody
) -> JointWay | StraightWay | Strike:
    """The way of a command; joints_rad (6,): where a joint-interpolated one ends. A Strike where there is none."""
    links = robot.frames(start.joints_rad[None])[0]
    reaches = reaches_mm(links, body)
    if not command.straight:
        if joints_rad is None:
            return Strike("no_way", "the arm, as it is configured, does not get there")
        change = joints_rad - start.joints_rad
        return JointWay(robot, start.joints_rad, change, np.abs(change) @ reaches)
    return _straight_way(start, command, robot, body, links, reaches)


def _straight_way(
    start: Reading, command: MoveCommand, robot: Kinematics, body: ArmBody, links: Array, reaches: Array
) -> StraightWay | Strike:
    """How fast joints 1 to 3 turn between two places while the hand goes a straight line and turns evenly.

    s, the least singular value of the wrist centre's Jacobian J, bounds q' = v / J by v / s; it bounds as well how much
    more q' can be than at the nearer place: |q''| <= (|v'| + |J'| |q'|) / s.
    """
    motion = frames.difference(command.world_from_tool, start.world_from_tool)
    tips = np.linalg.norm(body.placed(links[None])[0] - links[TOOL, :3, 3], axis=-1).max(axis=1) + body.radius_mm
    far, turn = frames.size(motion)
    arm = body.frame <= WRIST_JOINTS
    speed_mm, arm_mm = np.where(arm, 0.0, far + turn * tips), np.where(arm, reaches[:WRIST_JOINTS], 0.0)
    hand_mm = float(np.linalg.norm(_wrist_off(links)))
    bend_mm, whole_bend_mm = _bends_mm(_origins_off_mm(links)[:WRIST_JOINTS, FLANGE])
    shares = np.linspace(0.0, 1.0, _stretches(float(speed_mm.max()), FOLLOWED_MM) + 1)
    for closer in (False, True):
        joints = _following(robot, start, motion, shares, start.joints_rad)
        places = robot.frames(joints)
        if (lost := _lost(shares, places)) is not None:
            return lost
        stretch, jacobians = np.diff(shares), _jacobians_mm(places)
        way_mm = (far + turn * hand_mm) * stretch
        least, falls = _least_squared(jacobians, bend_mm * way_mm)
        parts = _closer(falls)
        if closer or (parts == 1).all():
            break
        if parts.sum() > MOST_PLACES:
            return _no_way(shares[falls.argmax()], "it comes too near to where joints turn fast for little")
        shares, _ = _parted(shares, parts)
    if arm.any() and least.min() <= 0.0:
        return _no_way(shares[least.argmin()], "the arm is stretched out too far to know its elbow's way")
    levers_mm = np.sqrt(np.maximum(least, 1e-9))
    fastest = way_mm / levers_mm
    change = (hand_mm * np.square(turn * stretch) + whole_bend_mm * np.square(fastest)) / levers_mm
    rates = _rates(jacobians, motion[:3] + _cross(motion[3:], _wrist_off(places)))
    turned = _most_turned(rates, stretch, fastest, change)
    gone = np.concatenate([np.zeros((1, len(arm))), np.cumsum(turned @ arm_mm + stretch[:, None] * speed_mm, axis=0)])
    return StraightWay(robot, start, motion, shares, joints, places, gone)


def _wrist_off(links: Array) -> Array:
    """(..., 3) mm: from the tool centre point to the wrist centre."""
    return np.asarray(links[..., FLANGE, :3, 3] - links[..., TOOL, :3, 3])


def _bends_mm(levers_mm: Array) -> tuple[float, float]:
    """How much the wrist centre's Jacobian changes for each radian turned, at most: but for the turn of joint 1, which
    turns all of it and no singular value, and with it. levers_mm (3,): no farther is the wrist centre from the axes of
    joints 1 to 3; d J[i] / d q[j] is as long as the lever arm of the later of the two joints."""
    first, second, third = np.square(levers_mm)
    return float(np.sqrt(2 * second + 4 * third)), float(np.sqrt(first + 3 * second + 5 * third))


def _least_squared(jacobians: Array, bent: Array) -> tuple[Array, Array]:
    """(N - 1,) mm^2: between two places the least singular value, squared, is nowhere less; and which share of it could
    be lost there. jacobians (N, 3, 3); bent (N - 1,) mm^2: the way of the wrist centre in between, times its bend.

    It falls by at most bend for each radian turned, and they turn by no more than w / s on a way w: its square falls by
    no more than 2 bend w. It is least where the falls from both places meet.
    """
    squared = np.linalg.eigvalsh(jacobians @ jacobians.swapaxes(1, 2))[:, 0]
    middle = (squared[:-1] + squared[1:]) / 2
    return middle - bent, bent / np.maximum(middle, 1e-9)


def _closer(falls: Array) -> NDArray[np.intp]:
    """(N,): in how many parts each stretch is looked at more closely."""
    return np.where(falls < MOST_FALL, 1, np.ceil(np.minimum(2.0 * falls, MOST_PARTS))).astype(int)


def _rates(jacobians: Array, speeds_mm: Array) -> Array:
    """(N, 3) rad: how fast joints 1 to 3 turn where the wrist centre goes at (N, 3) mm."""
    return np.asarray(np.abs(np.linalg.solve(jacobians.swapaxes(1, 2), speeds_mm[..., None])[..., 0]))


def _most_turned(rates: Array, stretch: Array, fastest: Array, change: Array) -> Array:
    """(N - 1, 3) rad: joints turn no farther between two places, a stretch of the way apart. rates (N, 3): how fast at
    them, for all of it. Each (N - 1,) rad: fastest, what none ever exceeds in that stretch; change, by how much more
    they get in all of it: the nearer place is half of it away."""
    at_ends = np.maximum(rates[:-1], rates[1:]) * stretch[:, None]
    return np.minimum(at_ends + change[:, None] / 2, fastest[:, None])


@dataclass(frozen=True, eq=False)
class Gaps:
    """What is asked of each place, as P columns: values_mm (N, P) to spare; what (P,): (rule, part, thing); capsule
    (P,) whose travel changes them."""

    values_mm: Array
    what: tuple[tuple[str, str, str], ...]
    capsule: NDArray[np.intp]


def gaps_of(links: Array, body: ArmBody, limits: Limits) -> Gaps:
    """Everything of the body to the table, the sides of the room and each keep-out, the tool centre point to the sides
    of its box."""
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


def strikes(way: Way, body: ArmBody, limits: Limits) -> tuple[Strike, ...]:
    """What the way would break, the worst place seen of each rule; none where it is proven clear."""
    slack = min(SLACK_MM, limits.clearance_mm / 2)
    shares = way.first()
    new = np.ones(len(shares), bool)
    links = way.links(shares)
    tight = _not_far(body.placed(links), way.travel_mm(shares), body, limits)
    values = np.empty((0, len(tight.columns(body))))
    while True:
        gaps = tight.gaps_of(links, body, limits)
        values = _merged(values, gaps.values_mm, new)
        allowed = np.minimum(np.maximum.accumulate(values, axis=0)[:-1], 0.0)
        if (values[1:] < allowed - slack).any():
            how = [f"on the way ({100 * share:.0f} %)" for share in shares[1:]]
            return _told(gaps, allowed - values[1:], body.placed(way.links(shares[1:])), how, slack)
        travel = way.travel_mm(shares)[:, gaps.capsule]
        each = travel / np.maximum(values[:-1] + values[1:] - 2 * (allowed - slack), 1e-9)
        need = each.max(axis=1)
        unproven = need > 1.0
        if not unproven.any():
            return ()
        parts = np.where(unproven, np.ceil(np.minimum(need, MOST_PARTS)), 1).astype(int)
        if ((travel.max(axis=1) < FINEST_MM) & unproven).any() or parts.sum() > MOST_PLACES:
            return (_no_way(shares[need.argmax()], "it passes too closely"),)
        shares, new = _parted(shares, parts)
        links = way.links(shares[new])
        if (lost := _lost(shares[new], links)) is not None:
            return (lost,)
        # What was proven all the way is not asked again; what was inside its limit is, as long as anything is.
        open_ones = np.asarray((each > 1.0).any(axis=0) | (values < 0.0).any(axis=0))
        before, tight = tight.columns(body), tight.where(open_ones, gaps.capsule, len(body.names))
        values = values[:, np.isin(before, tight.columns(body))]


def _not_far(ends: Array, travel: Array, body: ArmBody, limits: Limits) -> Tight:
    """What could touch anything: by boxes that hold each capsule all the way. ends (N, C, 2, 3), travel (N - 1, C)."""
    margin = (body.radius_mm + limits.clearance_mm + travel.max(axis=0) / 2)[:, None]
    each = ends.reshape(len(ends), -1)
    low = each.min(axis=0).reshape(ends.shape[1:]).min(axis=1) - margin
    high = each.max(axis=0).reshape(ends.shape[1:]).max(axis=1) + margin
    boxes = upright_bounds(limits.keep_out)[:, :, None]
    meets = ((low < boxes[:, 1]) & (high > boxes[:, 0])).all(axis=2)
    leaves = ((low < limits.room_low_mm) | (high > limits.room_high_mm)).any(axis=1)
    near = meets.any(axis=0) | leaves | (low[:, 2] < limits.table_z_mm)
    near[TCP] = True
    return Tight(np.flatnonzero(near), np.flatnonzero(meets.any(axis=1)))


def _no_way(share: float, why: str) -> Strike:
    return Strike("no_way", f"after {100 * share:.0f} % of the way {why}")


def _lost(shares: Array, links: Array) -> Strike | None:
    """Where the arm does not get to, first; None where it gets to all (N,) shares, its frames there (N, 8, 4, 4)."""
    reached = np.isfinite(links).all(axis=(1, 2, 3))
    return None if reached.all() else _no_way(shares[~reached].min(), "the arm, as it is configured, cannot follow")


def _parted(shares: Array, parts: NDArray[np.intp]) -> tuple[Array, NDArray[np.bool_]]:
    """The places with new ones between, the k-th stretch parted in parts[k] alike, and which are new."""
    stretch = np.repeat(np.arange(len(parts)), parts)
    nth = np.arange(len(stretch)) - np.repeat(np.cumsum(parts) - parts, parts)
    finer = shares[stretch] + (shares[stretch + 1] - shares[stretch]) * nth / parts[stretch]
    return np.append(finer, shares[-1]), np.append(nth > 0, False)


def _merged(old: Array, found: Array, new: NDArray[np.bool_]) -> Array:
    """(N, P) rows in order: the found ones where they are new, the old ones between."""
    values = np.empty((len(new), found.shape[1]))
    values[new] = found
    if not new.all():
        values[~new] = old
    return values


def _told(gaps: Gaps, lacking: Array, ends: Array, where: Sequence[str], slack: float) -> tuple[Strike, ...]:
    """For each rule the place and part (N, P) that lacks most, where that is more than slack."""
    found = []
    for rule in dict.fromkeys(what[0] for what in gaps.what):
        columns = np.array([k for k, what in enumerate(gaps.what) if what[0] == rule])
        place, column = np.unravel_index(lacking[:, columns].argmax(), (len(lacking), len(columns)))
        by_mm, pair = float(lacking[place, columns[column]]), columns[column]
        if by_mm > slack:
            _, part, thing = gaps.what[pair]
            axis = ends[place, gaps.capsule[pair]]
            at = "{:.0f} {:.0f} {:.0f}".format(*axis[axis[:, 2].argmin()])
            text = f"{where[int(place)]} the {part}, at {at}, comes {by_mm:.1f} mm too far towards {thing}"
            found.append(Strike(rule, text))
    return tuple(found)


def places_clear(joints_rad: Array, robot: Kinematics, limits: Limits) -> Flags:
    """(N,) whether no rule of place is broken with all of the arm at (N, 6) joints, and none is let off."""
    body = body_of(limits.capsules, limits.body_mm)
    return np.asarray((gaps_of(robot.frames(joints_rad), body, limits).values_mm >= 0.0).all(axis=1))


def way_clear(
    command: MoveCommand, standing: ArmState, start: Reading | None, robot: Kinematics, limits: Limits
) -> Refusal | None:
    """The first rule the command would break now, on its whole way from start (where the arm is); None: it may go."""
    refusal = refuse(command, standing, limits)
    if refusal is not None or start is None:
        return refusal
    joints = None if command.straight else robot.reachable(command.world_from_tool, start.joints_rad)
    body = body_of(limits.capsules, limits.body_mm)
    way = way_of(start, command, joints, robot, body)
    met = (way,) if isinstance(way, Strike) else strikes(way, body, limits)
    return refuse(command, replace(standing, strikes=met), limits) if met else None
