"""How to take hold of a part: antipodal grasps from its corners, its pose and the table. Pure.

A grasp is where the tool must be, world frame; whether the arm gets there and what the cameras see is plan.py's.
The solid is the convex hull of the taught corners: what a gripper with two flat fingers feels of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Annotated

import numpy as np
from msgspec import Meta

from daemon import frames
from daemon.arrays import Array
from daemon.quantities import Lean, Length, Room
from daemon.vision.geometry import Polyhedron, exact

UP = np.array([0.0, 0.0, 1.0])
TOUCHING_MM = 0.6
"""Soft pads and taught corners: what is this near to the finger touches it."""
MEETING_MM = 2.0
"""Faces that are reached within this of one another meet there in an edge or a corner."""
NEAR_RAD = 0.25
LEAST_SIZE_MM2, SAME_PLANE = 20.0, float(np.cos(np.radians(6.0)))
"""Twice the area of three corners that give a plane, and the cosine above which two planes are one."""
ALONG_DEG = 9.0
"""A face this near to parallel lies along a finger; the closing finger turns the part the rest."""


@dataclass(frozen=True)
class Gripper:
    """The gripper's numbers, mm. opening between the fingers; finger_width along tool x; pad_back and tip: how far the
    fingers reach from the tool centre point along tool z; finger_thick along tool y; friction: coefficient the pads can
    be trusted for; side_clearance: room for each finger beside the part; swing: how far the part's middle may be from
    the line between the contacts; tip_clearance: least height of the tips over the table. tilts_deg: how far from
    straight down the approach may lean."""

    opening_mm: Length = 90.0
    finger_width_mm: Length = 15.0
    pad_back_mm: Room = 50.0
    tip_mm: Room = 10.0
    finger_thick_mm: Length = 8.0
    friction: Annotated[float, Meta(gt=0, le=5)] = 0.6
    side_clearance_mm: Room = 6.0
    swing_mm: Room = 20.0
    tip_clearance_mm: Room = 4.0
    tilts_deg: tuple[Lean, ...] = (10.0, 20.0, 30.0, 40.0)


@dataclass(frozen=True, eq=False)
class Grasp:
    """world_from_tool (4, 4) with the hand around the part; width_mm between the contacts; slip_deg: the larger angle
    of a contact's normal from the closing direction; tilt_deg from straight down; blocked: a neighbour is near."""

    world_from_tool: Array
    width_mm: float
    slip_deg: float
    tilt_deg: float
    blocked: bool = False


def closed_fingers(gripper: Gripper) -> Polyhedron:
    """Both fingers met, nothing between them, as one box in the tool frame."""
    x, y = gripper.finger_width_mm / 2, gripper.finger_thick_mm
    corners = np.array(list(product((-x, x), (-y, y), (-gripper.pad_back_mm, gripper.tip_mm))))
    rings = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return exact(corners, rings)


def tool_rotation(heading: Array, tilt_rad: float) -> Array:
    """(3, 3) tool axes in world for a hand that leans tilt_rad from straight down towards the horizontal heading (3,).

    The closing direction (tool y) is horizontal and the cameras (tool -x) are on the upper side.
    """
    u, v, _ = heading
    sine, cosine = np.sin(tilt_rad), np.cos(tilt_rad)
    return np.array([[-cosine * u, -v, sine * u], [-cosine * v, u, sine * v], [-sine, 0.0, -cosine]])


def hull_planes(corners_mm: Array, flat_mm: float = 1.5) -> tuple[Array, Array]:
    """Planes of the convex hull of (N, 3) corners: outward unit normals (F, 3) and offsets (F,), inside n.x <= d.

    Corners within flat_mm of a plane lie on it, so that taught (noisy) faces come out whole. For the few corners a
    part has, trying each three is quick. Raises ValueError where the corners span no volume.
    """
    if len(corners_mm) < 4:
        raise ValueError(f"{len(corners_mm)} corners span no solid")
    first, second, third = corners_mm[np.array(list(combinations(range(len(corners_mm)), 3))).T]
    every = np.cross(second - first, third - first)
    size = np.linalg.norm(every, axis=1)
    wide = size >= LEAST_SIZE_MM2
    every, first = every[wide] / size[wide, None], first[wide]
    heights = every @ corners_mm.T - np.einsum("ti,ti->t", every, first)[:, None]
    above, below = heights.max(axis=1) > flat_mm, heights.min(axis=1) < -flat_mm
    every, heights = np.where(above[:, None], -every, every), np.where(above[:, None], -heights, heights)
    normals: list[Array] = []
    offsets: list[float] = []
    for k in np.flatnonzero(above != below):
        if any(float(n @ every[k]) > SAME_PLANE for n in normals):
            continue
        normals.append(every[k])
        offsets.append(float((corners_mm[heights[k] > -flat_mm] @ every[k]).max()))
    if len(normals) < 4:
        raise ValueError(f"{len(corners_mm)} corners span no solid")
    return np.array(normals), np.array(offsets)


def closing_directions(normals: Array, corners_mm: Array) -> list[Array]:
    """Horizontal unit directions (3,) worth closing along: each side face's normal, evenly between two faces that look
    away from each other, and along and across the longest edge; world frame."""
    seeds = [a - b for a, b in combinations(normals, 2) if a @ b < -0.3]
    seeds += [n for n in normals if abs(n[2]) < 0.95]
    gaps = corners_mm[:, None] - corners_mm[None]
    i, j = np.unravel_index(int(np.linalg.norm(gaps, axis=2).argmax()), (len(corners_mm),) * 2)
    seeds += [gaps[i, j], np.cross(UP, gaps[i, j])]
    found: list[Array] = []
    for seed in seeds:
        flat = seed * (1.0, 1.0, 0.0)
        size = float(np.linalg.norm(flat))
        if size > 1e-6 and not any(abs(float(flat @ d)) / size > np.cos(np.radians(4.0)) for d in found):
            found.append(flat / size)
    return found


@dataclass(frozen=True, eq=False)
class Contact:
    """Where the closing fingers meet the solid, in the tool frame: the two positions along tool y; slip_deg, the most
    that a contact's normal, or the line between the contacts, is off the closing direction; line_mm (2,) x and z of
    that line."""

    low_mm: float
    high_mm: float
    slip_deg: float
    line_mm: Array


def contacts(normals: Array, offsets: Array, up: Array, gripper: Gripper) -> Contact | None:
    """Close the fingers on a convex solid given by its planes in the tool frame; None where they meet nothing, or
    nothing that lies along them (a part gripped by two opposite edges turns away). up (3,): world up, tool frame.

    Lines along tool y are laid over the fingers; each meets the solid between an entry and an exit face. A finger rests
    where the solid reaches farthest; where several faces meet there, it holds any direction between their normals.
    """
    half = gripper.finger_width_mm / 2
    x, z = np.meshgrid(np.linspace(-half, half, 9), np.linspace(-gripper.pad_back_mm, gripper.tip_mm, 31))
    base = np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()])
    room, slope = offsets[None] - base @ normals.T, normals[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = room / slope
    high = np.where(slope > 1e-9, reach, np.inf)
    low = np.where(slope < -1e-9, reach, -np.inf)
    outside = ((np.abs(slope) <= 1e-9) & (room < 0)).any(axis=1)
    top, bottom = high.min(axis=1), low.max(axis=1)
    inside = ~outside & (top > bottom)
    if inside.sum() < 4:
        return None
    upper = _touch(high[inside], base[inside], normals, up, 1.0)
    lower = _touch(-low[inside], base[inside], normals, up, -1.0)
    if not (upper.flat or lower.flat):
        return None
    width = float(top[inside].max() - bottom[inside].min())
    ends = np.maximum(upper.low, lower.low), np.minimum(upper.high, lower.high)
    askew = float(np.degrees(np.arctan2(np.linalg.norm(np.maximum(ends[0] - ends[1], 0.0)), width)))
    slip = max(upper.slip_deg, lower.slip_deg, askew)
    return Contact(float(bottom[inside].min()), float(top[inside].max()), slip, (ends[0] + ends[1]) / 2)


@dataclass(frozen=True, eq=False)
class _Touch:
    """One finger's contact: degrees the closing direction is off the normals there; whether a face lies along the
    finger (seen from above); bounds (2,) of x and z it extends over."""

    slip_deg: float
    flat: bool
    low: Array
    high: Array


def _touch(reach: Array, base: Array, normals: Array, up: Array, sign: float) -> _Touch:
    """reach (L, F): how far along sign * y each line gets to each face."""
    least = reach.min(axis=1)
    best = np.flatnonzero(least > least.max() - TOUCHING_MM)
    faces = np.flatnonzero((reach[best] < least[best, None] + MEETING_MM).any(axis=0))
    closing = np.array([0.0, sign, 0.0])
    level = normals[faces] - np.outer(normals[faces] @ up, up)
    along = level @ closing > np.cos(np.radians(ALONG_DEG)) * np.maximum(np.linalg.norm(level, axis=1), 0.3)
    spots = base[best][:, [0, 2]]
    return _Touch(_off_cone_deg(closing, normals[faces]), bool(along.any()), spots.min(axis=0), spots.max(axis=0))


def _off_cone_deg(direction: Array, normals: Array) -> float:
    """Degrees between a unit direction and the nearest in the cone spanned by one or two of the (N, 3) unit normals."""
    best = float((normals @ direction).max())
    for a, b in combinations(normals, 2):
        pair = np.column_stack([a, b])
        weights = np.linalg.lstsq(pair, direction, rcond=None)[0]
        if np.all(weights > 0):
            best = max(best, float(np.linalg.norm(pair @ weights)))
    return float(np.degrees(np.arccos(np.clip(best, -1.0, 1.0))))


def grasps(
    corners_mm: Array,
    world_from_part: Array,
    table_z_mm: float,
    gripper: Gripper,
    neighbours: Sequence[Array] = (),
    near: Array | None = None,
) -> list[Grasp]:
    """All grasps that hold, firmest first (unblocked before blocked).

    corners_mm (N, 3) in the part frame; neighbours: (M, 3) world corners of other parts on the table; near (3, 3): only
    grasps whose tool is turned within some 15 degrees of it. Grasps
    through the table, wider than the opening or needing more friction than the pads have are left out.
    """
    world = frames.apply(world_from_part, corners_mm)
    normals, offsets = hull_planes(world)
    found: list[Grasp] = []
    for along in closing_directions(normals, world):
        for closing in (along, -along):
            for tilt_deg in gripper.tilts_deg:
                rotation = tool_rotation(np.cross(closing, UP), float(np.radians(tilt_deg)))
                if near is not None and float((rotation * near).sum()) < 1.0 + 2.0 * np.cos(NEAR_RAD):
                    continue
                grasp = _placed(rotation, tilt_deg, world, normals, offsets, table_z_mm, gripper)
                if grasp is not None:
                    blocked = any(_in_the_way(grasp.world_from_tool, n, gripper) for n in neighbours)
                    found.append(Grasp(grasp.world_from_tool, grasp.width_mm, grasp.slip_deg, tilt_deg, blocked))
    return sorted(found, key=lambda g: (g.blocked, round(g.slip_deg / 5.0), g.tilt_deg))


def _placed(
    rotation: Array, tilt_deg: float, world: Array, normals: Array, offsets: Array, table_z_mm: float, gripper: Gripper
) -> Grasp | None:
    """The grasp with this orientation: at the solid's centre or as low as the tips allow, centred."""
    low, high = world.min(axis=0), world.max(axis=0)
    tips = np.array([[sx * gripper.finger_width_mm / 2, 0.0, gripper.tip_mm] for sx in (-1, 1)])
    least_z = table_z_mm + gripper.tip_clearance_mm - float((tips @ rotation.T)[:, 2].min())
    centre = world.mean(axis=0)
    centre[2] = max(centre[2], least_z)
    if centre[2] > high[2] - 3.0 or low[2] > high[2]:
        return None
    here = frames.rigid(rotation, centre)
    contact = contacts(normals @ rotation, offsets - normals @ centre, UP @ rotation, gripper)
    if contact is None or contact.slip_deg > np.degrees(np.arctan(gripper.friction)):
        return None
    if np.linalg.norm((rotation.T @ (world.mean(axis=0) - centre))[[0, 2]] - contact.line_mm) > gripper.swing_mm:
        return None
    width = contact.high_mm - contact.low_mm
    if width > gripper.opening_mm - 2 * gripper.side_clearance_mm:
        return None
    here[:3, 3] += rotation[:, 1] * (contact.high_mm + contact.low_mm) / 2
    return Grasp(here, width, contact.slip_deg, tilt_deg)


def _in_the_way(world_from_tool: Array, neighbour: Array, gripper: Gripper, back_mm: float = 80.0) -> bool:
    """Whether the neighbour reaches into the room the open fingers sweep on their last stretch (box against box along
    the tool's axes: errs towards `in the way`)."""
    local = frames.apply(frames.inverse(world_from_tool), neighbour)
    wide = gripper.opening_mm / 2 + gripper.finger_thick_mm
    half = gripper.finger_width_mm / 2
    low, high = np.array([-half, -wide, -back_mm]), np.array([half, wide, gripper.tip_mm])
    return bool(np.all(local.min(axis=0) < high) and np.all(local.max(axis=0) > low))
