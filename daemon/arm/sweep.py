"""Is the whole way of a move clear, for everything of the arm? Proven, not sampled. Pure: values in, values out.

A way is looked at in places; between two places the travel of each capsule is bounded from the arm's lengths and the
turn of its joints, and a thing that far from what it must not touch cannot touch it in between. Where the bound does
not suffice the stretch is parted again (conservative advancement), so that many places are asked for only where it is
tight. A way may be proven to within SLACK_MM of the limits, never beyond half the clearance.

What is inside a limit when the way begins (below the table's clearance, in a keep-out, outside the box) may only leave:
its gap may nowhere be less than it was before on the same way, until it is clear; then it stays clear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arm.body import Body, above_mm, away_mm, body_of, within_mm
from daemon.arm.guard import ArmState, Command, Limits, Refusal, Strike, refuse
from daemon.arm.workcell import Reading, Robot
from daemon.arrays import Array

SLACK_MM = 0.5
"""How far between places a gap may be below its limit; half the clearance where that is less."""
FIRST_JOINTS_MM, FIRST_STRAIGHT_MM = 25.0, 6.0
"""How far the hand goes, at most, in a stretch to begin with."""
NEAR_MM = 30.0
"""What comes nearer than this to its limit in a keep-out box is measured exactly."""
FINEST_MM = 0.2
"""A stretch this short that is not proven clear is not clear."""
MOST_AT_FIRST, MOST_PARTS, MOST_PLACES = 120, 6, 500
"""Stretches to begin with; parts of one at a time; places after which it is given up: what asking costs is bounded, and
a way so tight, or so near to where joints turn fast for little, is better gone otherwise."""
TCP, FLANGE, WRIST_JOINTS, SIDES = -1, 6, 3, 6


class Way(Protocol):
    """One move from its start (share 0) to its end (share 1)."""

    def stretches(self) -> int:
        """In how many stretches it is looked at to begin with."""

    def links(self, shares: Array, new: NDArray[np.bool_]) -> Array:
        """(M, 8, 4, 4): the Robot's frames at the M new ones of rising (N,) shares; nan where the arm does not get
        there."""

    def levers_mm(self, links: Array) -> Array:
        """(M,): what `travel_mm` asks of each place."""

    def travel_mm(self, shares: Array, levers_mm: Array) -> Array:
        """(N - 1, C): no point of a capsule moves farther than this between two neighbouring shares."""


@dataclass(frozen=True, eq=False)
class JointWay:
    """All joints start and end together: speed_mm (C,) is each capsule's greatest travel from start to end."""

    robot: Robot
    start_rad: Array
    change_rad: Array
    speed_mm: Array

    def stretches(self) -> int:
        """See Way."""
        return _stretches(float(self.speed_mm.max()), FIRST_JOINTS_MM)

    def links(self, shares: Array, new: NDArray[np.bool_]) -> Array:
        """See Way."""
        return self.robot.frames(self.start_rad + shares[new, None] * self.change_rad)

    def levers_mm(self, links: Array) -> Array:
        """See Way. Nothing: all joints turn evenly."""
        return np.zeros(len(links))

    def travel_mm(self, shares: Array, levers_mm: Array) -> Array:
        """See Way."""
        return np.diff(shares)[:, None] * self.speed_mm


@dataclass(frozen=True, eq=False)
class StraightWay:
    """The tool goes on a line and turns evenly; the joints follow. speed_mm (C,) for what moves as the tool does;
    arm (C,): what does not; reaches_mm (3, C): how far its points can be from joints 1 to 3; wrist_mm: the wrist
    centre's way; bend_mm: how fast, per radian of joints 2 and 3, the wrist's lever arms can change."""

    robot: Robot
    start: Reading
    motion: Array
    speed_mm: Array
    arm: NDArray[np.bool_]
    reaches_mm: Array
    wrist_mm: float
    bend_mm: float

    def stretches(self) -> int:
        """See Way. Shorter ones, so that a wrist that comes near to straight on the way is seen."""
        return _stretches(float(self.speed_mm[~self.arm].max()), FIRST_STRAIGHT_MM)

    def links(self, shares: Array, new: NDArray[np.bool_]) -> Array:
        """See Way. The joints of all places: each follows the one before."""
        poses = np.tile(np.eye(4), (len(shares), 1, 1))
        poses[:, :3, :3] = _turns(self.motion[3:], shares) @ self.start.world_from_tool[:3, :3]
        poses[:, :3, 3] = self.start.world_from_tool[:3, 3] + shares[:, None] * self.motion[:3]
        joints = self.robot.along(poses, self.start.joints_rad)
        joints[shares == 0.0] = self.start.joints_rad
        return self.robot.frames(joints[new])

    def levers_mm(self, links: Array) -> Array:
        """See Way. The least lever arm of joints 1 to 3: the least singular value of the wrist's Jacobian."""
        axes, origins, wrist = links[:, :3, :3, 2], links[:, :3, :3, 3], links[:, None, FLANGE, :3, 3]
        return np.asarray(np.linalg.svd(np.cross(axes, wrist - origins), compute_uv=False)[:, -1], float)

    def travel_mm(self, shares: Array, levers_mm: Array) -> Array:
        """See Way. The hand: its own line and turn. The arm: how fast joints 1 to 3 turn for the wrist centre's way.

        Their least lever arm s at a place falls by at most bend_mm for each radian turned (joint 1 turns all of the
        Jacobian, and changes none), so that after a way w from there the joints have turned by no more than the u with
        s u - bend u^2 / 2 = w.
        """
        stretch = np.diff(shares)
        travel = stretch[:, None] * self.speed_mm
        half_mm = stretch * self.wrist_mm / 2
        turned = _turned(levers_mm[:-1], half_mm, self.bend_mm) + _turned(levers_mm[1:], half_mm, self.bend_mm)
        travel[:, self.arm] = turned[:, None] * np.linalg.norm(self.reaches_mm[:, self.arm], axis=0)
        return travel


@dataclass(frozen=True, eq=False)
class Tight:
    """What is not proven clear of everything yet: which capsules, the tool centre point always, and which boxes."""

    capsules: NDArray[np.intp]
    boxes: NDArray[np.intp]

    def gaps_of(self, links: Array, body: Body, limits: Limits) -> Gaps:
        """The gaps between them, and the tool centre point's to its box; `capsule` counts all of the body."""
        some = body.only(self.capsules)
        gaps = gaps_of(links, some, replace(limits, keep_out=tuple(limits.keep_out[k] for k in self.boxes)))
        return replace(gaps, capsule=self.capsules[gaps.capsule])

    def columns(self, body: Body) -> NDArray[np.intp]:
        """(P,) which of all columns they are, in order."""
        count = len(body.names)
        kept_out = (count + SIDES + self.boxes[:, None] * count + self.capsules).ravel()
        return np.concatenate([self.capsules, count + np.arange(SIDES), kept_out])

    def where(self, unproven: NDArray[np.bool_], capsule: NDArray[np.intp], count: int) -> Tight:
        """Those with an unproven column of these (P,)."""
        capsules = np.union1d(capsule[unproven], count - 1)
        of_boxes = unproven[len(self.capsules) + SIDES :].reshape(len(self.boxes), len(self.capsules))
        return Tight(capsules, self.boxes[of_boxes.any(axis=1)])


def _stretches(longest_mm: float, each_mm: float) -> int:
    return int(np.clip(np.ceil(longest_mm / each_mm), 2, MOST_AT_FIRST))


def _turned(least_mm: Array, way_mm: Array, bend_mm: float) -> Array:
    """(N,) rad; inf where nothing is proven. See StraightWay.travel_mm."""
    room = least_mm**2 - 2 * bend_mm * way_mm
    return np.where(room > 0, (least_mm - np.sqrt(np.maximum(room, 0.0))) / bend_mm, np.inf)


def _turns(vector: Array, shares: Array) -> Array:
    """(N, 3, 3): rotations by shares of an axis times angle (3,)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / max(angle, 1e-12)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned = (shares * angle)[:, None, None]
    return np.asarray(np.eye(3) + np.sin(turned) * cross + (1.0 - np.cos(turned)) * (cross @ cross))


def reaches_mm(links: Array, body: Body) -> Array:
    """(6, C): no point of a capsule is ever farther than this from the axis of a joint, 0 where that does not move it.

    From frames (8, 4, 4) of any moment: what lies between an axis and a point is one rigid length after the other.
    """
    origins = links[:7, :3, 3]
    legs = np.diff(origins, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    across = np.linalg.norm(np.cross(links[:6, :3, 2], legs), axis=1)
    ends = body.placed(links[None])[0]
    last = np.minimum(body.frame, FLANGE)
    tips = np.linalg.norm(ends - origins[last][:, None], axis=-1).max(axis=1) + body.radius_mm
    joints = np.arange(6)[:, None]
    whole = np.concatenate([[0.0], np.cumsum(lengths)])
    reach = across[:, None] + whole[last] - whole[1:, None] + tips
    return np.where(joints < last, reach, 0.0)


def way_of(
    start: Reading, command: Command, joints_rad: Array | None, robot: Robot, body: Body
) -> JointWay | StraightWay | None:
    """The way of a command; joints_rad (6,): where a joint-interpolated one ends. None where that is not known."""
    links = robot.frames(start.joints_rad[None])[0]
    reaches = reaches_mm(links, body)
    if not command.straight:
        if joints_rad is None:
            return None
        change = joints_rad - start.joints_rad
        return JointWay(robot, start.joints_rad, change, np.abs(change) @ reaches)
    motion = frames.difference(command.world_from_tool, start.world_from_tool)
    ends = body.placed(links[None])[0] - links[7, :3, 3]
    tips = np.linalg.norm(ends, axis=-1).max(axis=1) + body.radius_mm
    far, turn = float(np.linalg.norm(motion[:3])), float(np.linalg.norm(motion[3:]))
    wrist_mm = far + turn * float(np.linalg.norm(links[FLANGE, :3, 3] - links[7, :3, 3]))
    arm = body.frame <= WRIST_JOINTS
    levers = _wrist_reaches_mm(links)
    # d J[i] / d q[j] is as long as the lever arm of the later of the two joints.
    bend = float(np.sqrt(sum(levers[max(i, j)] ** 2 for j in (1, 2) for i in range(3))))
    return StraightWay(robot, start, motion, far + turn * tips, arm, reaches[:3], wrist_mm, bend)


def _wrist_reaches_mm(links: Array) -> Array:
    """(3,): no farther is the wrist centre ever from the axes of joints 1 to 3."""
    wrist = Body(("wrist",), np.array([FLANGE]), np.zeros((1, 2, 3)), np.zeros(1))
    return reaches_mm(links, wrist)[:3, 0]


@dataclass(frozen=True, eq=False)
class Gaps:
    """What is asked of each place, as P columns: values_mm (N, P) to spare; what (P,): (rule, part, thing); capsule
    (P,) whose travel changes them."""

    values_mm: Array
    what: tuple[tuple[str, str, str], ...]
    capsule: NDArray[np.intp]


def gaps_of(links: Array, body: Body, limits: Limits) -> Gaps:
    """Everything of the body to the table and each keep-out, the tool centre point to the sides of its box."""
    ends = body.placed(links)
    each = np.arange(len(body.names))
    least = limits.clearance_mm
    columns = [above_mm(ends, body.radius_mm, limits.table_z_mm) - least]
    what = [("below_table", name, "the table") for name in body.names]
    columns.append(within_mm(ends[:, TCP, 0], limits.box_low_mm, limits.box_high_mm))
    sides = [f"{side} {axis} of the box" for side in ("the least", "the greatest") for axis in "xyz"]
    what += [("outside_workspace", "tool centre point", side) for side in sides]
    if limits.keep_out:
        away = away_mm(ends, body.radius_mm, limits.keep_out, NEAR_MM + least) - least
        columns.append(away.reshape(len(ends), -1))
        what += [("kept_out", name, box.name) for box in limits.keep_out for name in body.names]
    capsule = np.concatenate([each, np.full(SIDES, each[TCP]), *[each for _ in limits.keep_out]])
    return Gaps(np.concatenate(columns, axis=1), tuple(what), capsule)


def strikes(way: Way, body: Body, limits: Limits) -> tuple[Strike, ...]:
    """What the way would break, the worst place seen of each rule; none where it is proven clear."""
    slack = min(SLACK_MM, limits.clearance_mm / 2)
    shares = np.linspace(0.0, 1.0, way.stretches() + 1)
    new, levers = np.ones(len(shares), bool), np.empty((0, 1))
    tight = Tight(np.arange(len(body.names)), np.arange(len(limits.keep_out)))
    values = np.empty((0, len(tight.columns(body))))
    while True:
        links = way.links(shares, new)
        reached = np.isfinite(links).all(axis=(1, 2, 3))
        if not reached.all():
            place = 100 * shares[new][~reached].min()
            return _no_way(f"after {place:.0f} % of the line the arm, as it is configured, cannot follow")
        gaps = tight.gaps_of(links, body, limits)
        values, levers = _merged(values, gaps.values_mm, new), _merged(levers, way.levers_mm(links)[:, None], new)
        allowed = np.minimum(np.maximum.accumulate(values, axis=0)[:-1], 0.0)
        if (values[1:] < allowed - slack).any():
            how = [f"on the way ({100 * share:.0f} %)" for share in shares[1:]]
            ends = body.placed(way.links(shares, np.ones(len(shares), bool)))
            return _told(gaps, allowed - values[1:], ends[1:], how, slack)
        travel = way.travel_mm(shares, levers[:, 0])[:, gaps.capsule]
        each = travel / np.maximum(values[:-1] + values[1:] - 2 * (allowed - slack), 1e-9)
        need = each.max(axis=1)
        unproven = need > 1.0
        if not unproven.any():
            return ()
        parts = np.where(unproven, np.ceil(np.clip(need, 2.0, MOST_PARTS)), 1).astype(int)
        finest = (np.where(np.isfinite(travel), travel, 0.0).max(axis=1) < FINEST_MM) & unproven
        if finest.any() or parts.sum() > MOST_PLACES:
            return _unproven(shares, unproven, need)
        shares, new = _parted(shares, parts)
        # What was proven all the way is not asked again; what was inside its limit is, as long as anything is.
        open_ones = np.asarray((each > 1.0).any(axis=0) | (values < 0.0).any(axis=0))
        before, tight = tight.columns(body), tight.where(open_ones, gaps.capsule, len(body.names))
        values = values[:, np.isin(before, tight.columns(body))]


def _no_way(text: str) -> tuple[Strike, ...]:
    return (Strike("no_way", text),)


def _unproven(shares: Array, unproven: NDArray[np.bool_], need: Array) -> tuple[Strike, ...]:
    place = shares[int(np.flatnonzero(unproven)[need[unproven].argmax()])]
    why = (
        "the arm is stretched out too far to know its elbow's way" if np.isinf(need).any() else "it passes too closely"
    )
    return _no_way(f"after {100 * place:.0f} % of the way {why}")


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


def place_clear(command: Command, there: Reading, robot: Robot, limits: Limits) -> Refusal | None:
    """The first rule of place that the command's target would break with all of the arm; there: the arm at it."""
    body = body_of(limits.capsules, limits.body_mm)
    links = robot.frames(there.joints_rad[None])
    gaps = gaps_of(links, body, limits)
    met = _told(gaps, -gaps.values_mm, body.placed(links), ["there"], 0.0)
    return refuse(command, ArmState(True, None, there.world_from_tool, 0.0, met), limits)


def way_clear(
    command: Command, standing: ArmState, start: Reading | None, robot: Robot, limits: Limits
) -> Refusal | None:
    """The first rule the command would break now, on its whole way from start (where the arm is); None: it may go."""
    refusal = refuse(command, standing, limits)
    if refusal is not None or start is None:
        return refusal
    joints = None if command.straight else robot.reachable(command.world_from_tool, start.joints_rad)
    body = body_of(limits.capsules, limits.body_mm)
    way = way_of(start, command, joints, robot, body)
    met = _no_way("the arm, as it is configured, does not get there") if way is None else strikes(way, body, limits)
    return refuse(command, replace(standing, strikes=met), limits) if met else None
