"""The arm's collision body: capsules in link frames, and their distances from the table and from keep-out boxes.

Pure: frames of the links in, distances out. A capsule is all that is within radius_mm of the line between two points
fixed to a link; a point is a capsule without length or radius. sweep.py checks whole paths with these distances.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.quantities import Coordinate, Name, Room

Point = tuple[Coordinate, Coordinate, Coordinate]
Link = Literal["upper_arm", "forearm", "wrist", "tool"]

LINK_FRAME: dict[Link, int] = {"upper_arm": 2, "forearm": 3, "wrist": 6, "tool": 7}
"""The index of each link's frame among those of Kinematics.frames (daemon/arm/robot.py). The wrist has the flange's
frame, with its origin in the wrist centre, so that wrist and tool move together."""


@dataclass(frozen=True)
class Capsule:
    """A rounded cylinder around a section of the arm or the gripper."""

    name: Name
    """Name for people."""
    link: Link
    """The link that carries it."""
    from_mm: Point
    """One end of its axis, in the frame of its link, mm."""
    to_mm: Point
    """The other end of its axis, in the frame of its link, mm."""
    radius_mm: Room
    """Its radius, mm."""


@dataclass(frozen=True)
class CarriedCapsule(Capsule):
    """A section of the part in the gripper. Planes are checked against its corners (no radius), which is exact: the
    lowest point of a solid is a corner. Boxes are checked against the capsule that encloses the corners.

    level_mm: on the last straight move, the height that it may reach instead of the table's clearance;
    may_touch: names of the keep-outs that it may be near on that move.
    """

    encloses: bool = False
    level_mm: float | None = None
    may_touch: tuple[str, ...] = ()


@dataclass(frozen=True)
class KeepOut:
    """A box in the world that no section of the arm may enter: a post, a light, a neighbouring machine."""

    name: Name
    """Name for people."""
    low_mm: Point
    """Lowest corner, world frame, mm."""
    high_mm: Point
    """Highest corner, world frame, mm."""


@dataclass(frozen=True)
class FixtureBox(KeepOut):
    """A box of a fixture, its corners in the fixture's frame: upright, turned by heading_deg, its origin at
    point_mm."""

    point_mm: Point = (0.0, 0.0, 0.0)
    heading_deg: float = 0.0


TWO_SIDES = np.triu_indices(6, 1)
"""Every pair of the six sides of a box."""


@dataclass(frozen=True, eq=False)
class ArmBody:
    """C capsules as arrays: names, frame (C,) index of the Robot's frames, ends_mm (C, 2, 3), radius_mm (C,).

    encloses (C,), level_mm (C,) nan where there is none, may_touch: see CarriedCapsule. The last entry is the tool
    centre point.
    """

    names: tuple[str, ...]
    frame: NDArray[np.intp]
    ends_mm: Array
    radius_mm: Array
    encloses: NDArray[np.bool_]
    level_mm: Array
    may_touch: tuple[tuple[str, ...], ...]

    def only(self, which: NDArray[np.intp]) -> ArmBody:
        """A selection of the capsules, in the given order."""
        names = tuple(self.names[k] for k in which)
        touch = tuple(self.may_touch[k] for k in which)
        frame, ends, radius = self.frame[which], self.ends_mm[which], self.radius_mm[which]
        return ArmBody(names, frame, ends, radius, self.encloses[which], self.level_mm[which], touch)

    def above_floor_mm(self, ends: Array, table_z_mm: float, clearance_mm: float) -> Array:
        """(N, C): height of each capsule (N, C, 2, 3) above the table's clearance, or above its support."""
        floor = np.where(np.isnan(self.level_mm), table_z_mm + clearance_mm, self.level_mm)
        return np.where(self.encloses, np.inf, above_mm(ends, self.radius_mm, floor))

    def placed(self, frames: Array) -> Array:
        """(N, C, 2, 3) world: the capsules' ends for link frames (N, 8, 4, 4). One large product a link is fast."""
        ends = np.empty((len(frames), len(self.frame), 2, 3))
        for link in set(self.frame.tolist()):
            on_it = self.frame == link
            points = self.ends_mm[on_it].reshape(-1, 3)
            moved = points @ frames[:, link, :3, :3].swapaxes(1, 2) + frames[:, link, None, :3, 3]
            ends[:, on_it] = moved.reshape(len(frames), -1, 2, 3)
        return ends


@lru_cache(maxsize=16)
def body_of(capsules: tuple[Capsule, ...], points_mm: tuple[Point, ...]) -> ArmBody:
    """Capsules, the tool's points and the tool centre point as one ArmBody."""
    points = (Capsule("tool", "tool", p, p, 0.0) for p in (*points_mm, (0.0, 0.0, 0.0)))
    every = tuple(chain(capsules, points))
    carried = [c if isinstance(c, CarriedCapsule) else None for c in every]
    return ArmBody(
        tuple(c.name for c in every),
        np.array([LINK_FRAME[c.link] for c in every]),
        np.array([(c.from_mm, c.to_mm) for c in every], float),
        np.array([c.radius_mm for c in every], float),
        np.array([c is not None and c.encloses for c in carried]),
        np.array([np.nan if c is None or c.level_mm is None else c.level_mm for c in carried], float),
        tuple(() if c is None else c.may_touch for c in carried),
    )


def carried_part(points_mm: Array, name: str) -> tuple[CarriedCapsule, ...]:
    """The capsules of a part in the gripper, from its corners (N, 3) in the tool's frame: each corner, and a capsule
    that encloses them all."""
    around = capsule_around(points_mm, name)
    corners = (CarriedCapsule(name, "tool", p, p, 0.0) for p in map(point_of, points_mm))
    return (*corners, CarriedCapsule(name, "tool", around.from_mm, around.to_mm, around.radius_mm, encloses=True))


def capsule_around(points_mm: Array, name: str) -> Capsule:
    """A capsule that encloses (N, 3) points, and so their hull, in the tool's frame: the smallest of those along the
    points' principal axes."""
    middle = points_mm.mean(axis=0)
    axes = np.linalg.svd(points_mm - middle)[2]
    found = []
    for axis in axes:
        along = (points_mm - middle) @ axis
        off_axis = np.linalg.norm(points_mm - middle - along[:, None] * axis, axis=1)
        radius = float(off_axis.max())
        spare = np.sqrt(np.maximum(radius**2 - off_axis**2, 0.0))  # zero for the farthest point, so low <= high
        low, high = float((along + spare).min()), float((along - spare).max())
        volume = radius**2 * (high - low + 4 / 3 * radius)
        found.append((volume, middle + low * axis, middle + high * axis, radius))
    _, start, end, radius = min(found, key=lambda each: each[0])
    return Capsule(name, "tool", point_of(start), point_of(end), radius)


PERHAPS_HELD = "a part perhaps in the gripper"


def held_anyhow(parts_mm: Iterable[Array], back_mm: float, tip_mm: float, width_mm: float) -> Capsule | None:
    """A capsule that encloses any one of the parts, corners (N, 3) each, however it is gripped; None without parts.

    The gripper touches a part within half of width_mm of a line from back_mm behind the tool centre point to tip_mm
    before it. No point of the part is farther from that contact than the part's greatest length.
    """
    longest = [float(np.linalg.norm(part[:, None] - part, axis=-1).max()) for part in parts_mm]
    if not longest:
        return None
    return Capsule(PERHAPS_HELD, "tool", (0.0, 0.0, -back_mm), (0.0, 0.0, tip_mm), max(longest) + width_mm / 2)


def point_of(place: Array) -> Point:
    """Convert (3,) to a point of a capsule."""
    x, y, z = (float(value) for value in place)
    return x, y, z


def above_mm(ends: Array, radius_mm: Array, height_mm: float | Array) -> Array:
    """(N, C): height of each capsule above a horizontal plane, or above its own plane (C,); negative: below it."""
    return np.asarray(np.minimum(ends[..., 0, 2], ends[..., 1, 2]) - radius_mm - height_mm)


def within_mm(points: Array, low_mm: Point, high_mm: Point) -> Array:
    """(..., 6): distances of (..., 3) points to the inside of a box's sides: x, y, z above low, then below high."""
    return np.concatenate([points - np.array(low_mm), np.array(high_mm) - points], axis=-1)


def away_mm(ends: Array, radius_mm: Array, boxes: Sequence[KeepOut], near_mm: float) -> Array:
    """(N, B, C): distance of each capsule (N, C, 2, 3) from each box; never too large, and exact below near_mm.
    Negative: depth inside the box, to the nearest side."""
    low, high = np.array([box.low_mm for box in boxes], float), np.array([box.high_mm for box in boxes], float)
    in_box = _in_box_frames(ends, boxes)
    start, end = in_box[..., 0, :], in_box[..., 1, :]
    axis = end - start
    half_mm = np.sqrt(np.einsum("...i,...i", axis, axis)) / 2
    first, middle, last = (_signed(points, low[:, None], high[:, None]) for points in (start, (start + end) / 2, end))
    # Between two points, the distance to a box changes by no more than the points are apart.
    gaps = np.minimum(middle, (np.minimum(first, last) + middle - half_mm) / 2)
    place, box, capsule = np.nonzero((gaps - radius_mm < near_mm) & (half_mm > 0.0))
    if len(place):
        gaps[place, box, capsule] = _axis_distance(
            start[place, box, capsule], axis[place, box, capsule], low[box], high[box]
        )
    return np.asarray(gaps - radius_mm)


def lie_at_boxes(points: Array, boxes: Sequence[KeepOut], near_mm: float) -> bool:
    """Whether each of the points (N, 3), world, mm, lies in one of the boxes or within near_mm of it."""
    if not boxes:
        return False
    away = away_mm(np.stack([points, points], axis=1)[:, None], np.zeros(1), boxes, near_mm)
    return bool((away <= near_mm).any(axis=(1, 2)).all())


def _in_box_frames(ends: Array, boxes: Sequence[KeepOut]) -> Array:
    """(N, B, C, 2, 3): the ends (N, C, 2, 3) in each box's own frame."""
    in_box = np.repeat(ends[:, None], len(boxes), axis=1)
    for number, box in enumerate(boxes):
        if isinstance(box, FixtureBox):
            in_box[:, number] = (ends - np.array(box.point_mm)) @ _world_from_fixture(box)
    return in_box


def _world_from_fixture(box: FixtureBox) -> Array:
    """(3, 3): the rotation from a fixture's frame to the world's."""
    sine, cosine = np.sin(np.radians(box.heading_deg)), np.cos(np.radians(box.heading_deg))
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def upright_bounds(boxes: Sequence[KeepOut]) -> Array:
    """(B, 2, 3): lowest and highest corners of the axis-aligned bounding box, in the world, of each box."""
    found = np.array([(box.low_mm, box.high_mm) for box in boxes], float).reshape(-1, 2, 3)
    for number, box in enumerate(boxes):
        if isinstance(box, FixtureBox):
            corners = np.array(list(product(*zip(box.low_mm, box.high_mm, strict=True))))
            world = corners @ _world_from_fixture(box).T + np.array(box.point_mm)
            found[number] = world.min(axis=0), world.max(axis=0)
    return found


def _axis_distance(start: Array, axis: Array, low: Array, high: Array) -> Array:
    """(M,): the distance of each capsule's axis, from start (M, 3) along axis (M, 3), to its box low, high (M, 3).

    Along a line the squared distance to a box is convex. Its slope is piecewise linear, with knots where the line
    crosses the planes of the box's sides. The minimum is where the slope crosses zero.
    """
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        planes = np.nan_to_num(np.concatenate([low - start, high - start], axis=1) / np.tile(axis, 2))
    knots = np.clip(np.column_stack([planes, np.zeros(len(axis)), np.ones(len(axis))]), 0.0, 1.0)
    points = start[:, None] + knots[..., None] * axis[:, None]
    beyond = np.maximum(points - high[:, None], 0.0) - np.maximum(low[:, None] - points, 0.0)
    slopes = np.einsum("mki,mi->mk", beyond, axis)
    falls, each = slopes <= 0.0, np.arange(len(axis))
    last, first = np.where(falls, knots, -1.0).argmax(axis=1), np.where(falls, 2.0, knots).argmin(axis=1)
    fall, rise = slopes[each, last], slopes[each, first]
    share = np.where(rise > 0.0, np.where(fall > 0.0, 1.0, fall / np.where(rise > fall, fall - rise, -1.0)), 0.0)
    least = knots[each, last] + share * (knots[each, first] - knots[each, last])
    distances = _signed(start + least[:, None] * axis, low, high)
    through = distances <= 0.0
    distances[through] = _penetration(start[through], axis[through], low[through], high[through])
    return distances


def _penetration(start: Array, axis: Array, low: Array, high: Array) -> Array:
    """(M,): the greatest depth, negative, of axes that pass through their boxes. It is at an end of the axis, or where
    two sides are equally near."""
    at_start, rates = np.concatenate([low - start, start - high], axis=1), np.concatenate([-axis, axis], axis=1)
    a, b = TWO_SIDES
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        as_near = np.nan_to_num((at_start[:, a] - at_start[:, b]) / (rates[:, b] - rates[:, a]))
    shares = np.clip(np.column_stack([as_near, np.zeros(len(axis)), np.ones(len(axis))]), 0.0, 1.0)
    beyond = at_start[:, None] + shares[..., None] * rates[:, None]
    return np.asarray(beyond.max(axis=2).min(axis=1))


def _signed(points: Array, low: Array, high: Array) -> Array:
    """(...,): the signed distance of (..., 3) points to a box; negative inside (to the nearest side)."""
    beyond = np.maximum(low - points, points - high)
    outside = np.maximum(beyond, 0.0)
    deepest = np.maximum(np.maximum(beyond[..., 0], beyond[..., 1]), beyond[..., 2])
    return np.asarray(np.sqrt(np.einsum("...i,...i", outside, outside)) + np.minimum(deepest, 0.0))
