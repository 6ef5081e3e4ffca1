"""Random travels of the arm with their true clearances, by brute force at every half millimetre.

Independent of the sweep's own code (daemon/arm/sweep.py): capsules are rows of spheres, tested one by one.
Used by tests/bench/long/travels.py and the sweep's tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from daemon import frames
from daemon.arm.belief import Reading
from daemon.arm.body import Capsule, KeepOut, Point
from daemon.arm.guard import ArmState, Limits, MoveCommand, refuse
from daemon.arrays import Array
from drivers import puma560

FINE_MM, COARSE_MM, BALLS_MM = 0.5, 4.0, 3.0
CLOSE_MM = 10.0
"""An interval of COARSE_MM that stays farther than this from everything is not sampled finely."""
ARM = puma560.ArmGeometry(flange_from_tool=frames.rigid(np.eye(3), np.array([0.0, 0.0, 130.0])))
FRAME_OF = {"upper_arm": 2, "forearm": 3, "wrist": 6, "tool": 7}
NEAR_SINGULAR, NEARER = 3.0, 2.5
"""Degrees: no wrist nearer to straight than that where the sweep asks; between two such places it may come nearer."""


def _reachable(pose: Array, joints_rad: Array) -> Array | None:
    try:
        found = puma560.inverse(pose, puma560.configuration_of(joints_rad), ARM, joints_rad)
    except puma560.UnreachableError:
        return None
    return None if puma560.wrist_is_singular(found, within_rad=np.radians(NEAR_SINGULAR)) else found


def _along(poses: Array, joints_rad: Array, least_deg: float = NEAR_SINGULAR) -> Array:
    joints = puma560.inverse_along(poses, joints_rad, ARM)
    joints[np.abs(np.sin(joints[:, 4])) < np.sin(np.radians(least_deg))] = np.nan
    return joints


ROBOT: Any = SimpleNamespace(
    reachable=_reachable,
    along=_along,
    frames=lambda joints: puma560.link_frames(joints, ARM),
    between=lambda a, b, share: puma560.forward(a + share * (b - a), ARM),
)
"""The PUMA's kinematics for the sweep."""


@dataclass(frozen=True, eq=False)
class Travel:
    """One move: its start, its command, its limits."""

    start: Reading
    command: MoveCommand
    limits: Limits

    @property
    def standing(self) -> ArmState:
        """The arm's state: enabled, no fault, at the start."""
        return ArmState(None, self.start.world_from_tool, 0.0)


@dataclass(frozen=True)
class Truth:
    """What is so: reached: the arm follows all the way. Least gaps on the way, mm (negative: inside): to the table, the
    room's sides and keep-outs (touch), and of the tool centre point to the sides of its box (box); what: which of them
    was least."""

    reached: bool
    touch_mm: float
    box_mm: float
    what: str = ""


def random_travel(
    rng: np.random.Generator, keep_outs: int = 0, straight: bool | None = None, room: bool = False
) -> Travel:
    """A travel whose ends are each allowed, the whole body considered, and not farther apart than one step. room: its
    walls and its ceiling stand close about the arm."""
    while True:
        limits = Limits(keep_out=tuple(_post(rng, k) for k in range(keep_outs)))
        if room:
            low, high = rng.uniform([-550.0, -800.0], [-200.0, -450.0]), rng.uniform([700.0, 450.0], [1000.0, 800.0])
            ceiling = float(rng.uniform(500.0, 900.0))
            limits = replace(limits, room_low_mm=(*low.tolist(), -2000.0), room_high_mm=(*high.tolist(), ceiling))
        start = _place(rng, limits)
        target = _place(rng, limits, start)
        line = bool(rng.integers(2)) if straight is None else straight
        command = MoveCommand(target.world_from_tool, line, 50.0, "random")
        travel = Travel(start, command, limits)
        if refuse(command, travel.standing, limits) is None and _stands(start, limits) and _stands(target, limits):
            return travel


def _post(rng: np.random.Generator, number: int) -> KeepOut:
    """A keep-out box of 20 to 250 mm a side (a post, a light, a neighbour); some stand on the table."""
    size = rng.uniform(20.0, 250.0, 3)
    low = rng.uniform([150.0, -600.0, -300.0], [800.0, 600.0, 500.0])
    if rng.integers(2):
        low[2], size[2] = -300.0, rng.uniform(50.0, 700.0)
    return KeepOut(f"thing {number}", tuple(low), tuple(low + size))


def _place(rng: np.random.Generator, limits: Limits, near: Reading | None = None) -> Reading:
    """A random allowed and reachable pose; near: in the same configuration."""
    while True:
        low = bool(rng.integers(2))
        z = rng.uniform(-296.0, -200.0) if low else rng.uniform(-290.0, 500.0)
        point = np.array([rng.uniform(50.0, 880.0), rng.uniform(-640.0, 640.0), z])
        if near is not None:
            point[:2] = near.world_from_tool[:2, 3] + rng.uniform(-300.0, 300.0, 2)
        pose = frames.rigid(_hand(rng), point)
        if refuse(MoveCommand(pose, True, 1.0, ""), ArmState(None, pose, 0.0), limits) is not None:
            continue
        if near is not None:
            joints = _reachable(pose, near.joints_rad)
            if joints is not None:
                return Reading(pose, joints)
            continue
        ways = [
            joints
            for _, joints in puma560.solutions(pose, ARM)
            if not puma560.wrist_is_singular(joints, within_rad=np.radians(NEAR_SINGULAR))
        ]
        if ways:
            return Reading(pose, ways[int(rng.integers(len(ways)))])


def _hand(rng: np.random.Generator) -> Array:
    """(3, 3): an orientation of the tool that points down, tilted by up to 75 degrees, turned at random."""
    heading, tilt, turn = rng.uniform(-np.pi, np.pi), rng.uniform(0.0, 1.3), rng.uniform(-np.pi, np.pi)
    down = np.diag([1.0, -1.0, -1.0])
    lean = frames.rotation_from_vector(tilt * np.array([np.cos(heading), np.sin(heading), 0.0]))
    return np.asarray(lean @ down @ frames.rotation_from_vector(np.array([0.0, 0.0, turn])))


def _stands(reading: Reading, limits: Limits) -> bool:
    """Whether the whole body keeps its clearances at a position of the arm."""
    touch, _, _ = _gaps(puma560.link_frames(reading.joints_rad[None], ARM), limits)
    return bool(touch.min() >= limits.clearance_mm)


def truth_of(travel: Travel, least_deg: float = NEAR_SINGULAR) -> Truth:
    """Look along it: every half millimetre where it is close to anything, every four where it is not. least_deg: no
    wrist nearer to straight than that."""
    shares = np.linspace(0.0, 1.0, 9)
    while True:
        links = _links(travel, shares, least_deg)
        if links is None:
            return Truth(False, np.nan, np.nan)
        moved = _moved_mm(links, travel.limits)
        if moved.max() <= COARSE_MM:
            break
        shares = _finer(shares, np.ceil(moved / (0.9 * COARSE_MM)))
    touch, box, names = _gaps(links, travel.limits)
    nearest = np.minimum(touch.min(axis=1), box)
    close = np.minimum(nearest[:-1], nearest[1:]) < CLOSE_MM
    if close.any():
        shares = _finer(shares, np.where(close, np.ceil(moved / (0.9 * FINE_MM)), 1))
        links = _links(travel, shares, least_deg)
        if links is None:
            return Truth(False, np.nan, np.nan)
        touch, box, names = _gaps(links, travel.limits)
    return Truth(True, float(touch.min()), float(box.min()), names[int(touch.min(axis=0).argmin())])


def _finer(shares: Array, parts: Array) -> Array:
    new = [np.linspace(a, b, int(n) + 1)[:-1] for a, b, n in zip(shares[:-1], shares[1:], parts, strict=True)]
    return np.concatenate([*new, shares[-1:]])


def _links(travel: Travel, shares: Array, least_deg: float) -> Array | None:
    """(N, 8, 4, 4): the link frames; None where the arm cannot follow."""
    start, command = travel.start, travel.command
    if not command.straight:
        end = _reachable(command.world_from_tool, start.joints_rad)
        assert end is not None
        return puma560.link_frames(start.joints_rad + shares[:, None] * (end - start.joints_rad), ARM)
    motion = frames.difference(command.world_from_tool, start.world_from_tool)
    poses = np.array([frames.perturb(start.world_from_tool, share * motion) for share in shares])
    joints = _along(poses, start.joints_rad, least_deg)
    return puma560.link_frames(joints, ARM) if np.isfinite(joints).all() else None


@lru_cache(maxsize=4)
def _balls(
    capsules: tuple[Capsule, ...], points_mm: tuple[Point, ...]
) -> tuple[list[tuple[str, int, Array, float]], Array]:
    """Each capsule as a row of balls: name, frame, middles (M, 3), radius; and the tool's points."""
    rows = []
    for capsule in capsules:
        a, b = np.array(capsule.from_mm), np.array(capsule.to_mm)
        count = int(np.ceil(np.linalg.norm(b - a) / BALLS_MM)) + 1
        rows.append((capsule.name, FRAME_OF[capsule.link], np.linspace(a, b, count), capsule.radius_mm))
    return rows, np.array((*points_mm, (0.0, 0.0, 0.0)))


def _moved_mm(links: Array, limits: Limits) -> Array:
    """(N - 1,): how far any ball's middle went from place to place, radius included by the turn of its row's ends."""
    rows, points = _balls(limits.capsules, limits.body_mm)
    every = [("tool", 7, points, 0.0), *rows]
    steps = [np.linalg.norm(np.diff(_at(links, f, m[[0, -1]] if r else m), axis=0), axis=2) for _, f, m, r in every]
    return np.asarray(np.concatenate(steps, axis=1).max(axis=1))


def _at(links: Array, frame: int, middles: Array) -> Array:
    """(N, M, 3): world positions, with each coordinate contiguous in memory."""
    at = np.empty((3, len(links), len(middles)))
    for axis in range(3):
        at[axis] = links[:, frame, axis, :3] @ middles.T + links[:, frame, axis, 3, None]
    return at.transpose(1, 2, 0)


def _gaps(links: Array, limits: Limits) -> tuple[Array, Array, Sequence[str]]:
    """(N, things) gaps to table, the room's sides and keep-outs, (N,) least gap of the tool centre point to its box,
    names of things."""
    rows, points = _balls(limits.capsules, limits.body_mm)
    columns, names = [], []
    for name, frame, middles, radius in [("tool", 7, points, 0.0), *rows]:
        at = _at(links, frame, middles).transpose(2, 0, 1)
        columns.append(at[2].min(axis=1) - limits.table_z_mm - radius)
        names.append(f"{name}: table")
        walls = zip(at, limits.room_low_mm, limits.room_high_mm, strict=True)
        columns.append(np.min([np.minimum(x - low, high - x).min(axis=1) for x, low, high in walls], axis=0) - radius)
        names.append(f"{name}: the room")
        for box in limits.keep_out:
            sides = zip(at, box.low_mm, box.high_mm, strict=True)
            x, y, z = (np.maximum(low - along, along - high) for along, low, high in sides)
            outside = np.sqrt(np.maximum(x, 0.0) ** 2 + np.maximum(y, 0.0) ** 2 + np.maximum(z, 0.0) ** 2)
            inside = np.minimum(np.maximum(np.maximum(x, y), z), 0.0)
            columns.append((outside + inside).min(axis=1) - radius)
            names.append(f"{name}: {box.name}")
    tcp = links[:, 7, :3, 3]
    box_gap = np.minimum(tcp - np.array(limits.box_low_mm), np.array(limits.box_high_mm) - tcp).min(axis=1)
    return np.stack(columns, axis=1), box_gap, names
