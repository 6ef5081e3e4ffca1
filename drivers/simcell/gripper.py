"""Simulated gripper: geometry of a part between two closing fingers. Pure.

Tool frame: jaws close along y, symmetrically; fingers along z, tips at +tip_mm; lengths mm.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from drivers.arrays import Array
from drivers.rigid import apply, rigid, turn
from drivers.simcell.parts import ConvexSolid, PartShape, box, hull
from drivers.simcell.surface import DrawnSurface
from drivers.simcell.truth import GripperTruth, Rod

TOUCH_MM = 0.3
"""Softness of the pads: points this near to the outermost one touch the pad, too."""
PALM_MM = 60.0
FACES = 0.5
"""Cosine by which a side faces a jaw at the least to be met by it."""
BEND_RAD = 1e-3
"""Normals of one triangle that differ by more are of a round surface."""


@dataclass(frozen=True, eq=False)
class Grip:
    """Result of taking hold of one part, by jaws or by a suction cup.

    held: whether it is between them now; why: the reason. tool_from_part: before and after (4, 4) mm. shift_mm (signed,
    along tool y) and turn_deg: how the jaws moved the part, that is the tool's distance from the ideal grasp line.
    width_mm between the jaws.
    """

    held: bool
    why: str
    tool_from_part_before: Array
    tool_from_part: Array
    shift_mm: float = 0.0
    turn_deg: float = 0.0
    width_mm: float = 0.0


@dataclass(frozen=True, eq=False)
class Bite:
    """The volume of a shape between the fingers: corners (N, 3), the part's outward normals at each; and for each the
    normals (N, 3, 3) at the ends of the triangle of a surface that it is of: they differ where that is round."""

    corners: Array
    normals: tuple[Array, ...]
    bends: Array | None = None

    def turns(self, up: Array) -> NDArray[np.bool_]:
        """(N,) which are of something round as seen along up (3,)."""
        if self.bends is None:
            return np.zeros(len(self.corners), bool)
        level = self.bends - (self.bends @ up)[..., None] * up
        level /= np.maximum(np.linalg.norm(level, axis=2, keepdims=True), 1e-9)
        return np.asarray(np.einsum("nij,nj->ni", level, level[:, 0]).min(axis=1) < np.cos(BEND_RAD))


def finger_rods(gripper: GripperTruth) -> list[Rod]:
    """Both open fingers as inscribed rods: along each, and across its tip."""
    half, offset = gripper.finger_width_mm / 2, (gripper.opening_mm + gripper.finger_thickness_mm) / 2
    tip, back = gripper.tip_mm, gripper.tip_mm - gripper.finger_length_mm
    rods = []
    for y in (offset, -offset):
        rods.append(Rod("a finger", "tool", [2.0 - half, y, tip - 2.0], [half - 2.0, y, tip - 2.0], 2.0))
        rods.append(Rod("a finger", "tool", [0.0, y, tip - half - 0.5], [0.0, y, back], half))
    return rods


def fingers(gripper: GripperTruth, gap_mm: float) -> tuple[ConvexSolid, ConvexSolid]:
    """Both fingers as boxes in the tool frame, gap_mm between their pads."""
    near, far = gap_mm / 2, gap_mm / 2 + gripper.finger_thickness_mm
    return _strip(gripper, near, far), _strip(gripper, -far, -near)


def reaches(shape: PartShape, tool_from_part: Array, gripper: GripperTruth) -> bool:
    """Whether any of the part is between the open fingers."""
    half = gripper.opening_mm / 2 + gripper.finger_thickness_mm
    return len(within(shape, tool_from_part, _strip(gripper, -half, half)).corners) > 0


def close_on(shape: PartShape, tool_from_part: Array, up: Array, gripper: GripperTruth) -> Grip:
    """Close the open jaws on a part. up (3,): world up in the tool frame, about which a part on a table turns."""

    def lost(why: str, shift_mm: float = 0.0) -> Grip:
        return Grip(False, why, tool_from_part, tool_from_part, shift_mm=shift_mm)

    if strikes(shape, tool_from_part, gripper):
        return lost("a finger or the palm strikes the part")
    between = _strip(gripper, -gripper.opening_mm / 2, gripper.opening_mm / 2)
    angle = _turn_to_jaws(shape, tool_from_part, within(shape, tool_from_part, between), up)
    if angle is None or abs(np.degrees(angle)) > gripper.turn_deg:
        return lost("no side of the part lies along the jaws")
    about = within(shape, tool_from_part, between).corners.mean(axis=0)
    turned = rigid(np.eye(3), about) @ rigid(turn(up, angle), -turn(up, angle) @ about) @ tool_from_part
    bite = within(shape, turned, between)
    if not len(bite.corners):
        return lost("the part slips out from between the jaws")
    low, high = bite.corners[:, 1].min(), bite.corners[:, 1].max()
    shift = -(low + high) / 2
    if abs(shift) > gripper.centring_mm:
        return lost("the part lies too far to one side", shift_mm=float(np.sign(shift) * gripper.centring_mm))
    reason = _why_it_slips(bite, turned, shape, gripper)
    if reason:
        return lost(reason, shift_mm=float(shift))
    after = rigid(np.eye(3), [0.0, shift, 0.0]) @ turned
    return Grip(True, "held", tool_from_part, after, float(shift), float(np.degrees(angle)), float(high - low))


@lru_cache(maxsize=16)
def _strip(gripper: GripperTruth, low_y: float, high_y: float) -> ConvexSolid:
    """A box of the fingers' width and length between two y: the gap, or one finger."""
    half, back = gripper.finger_width_mm / 2, gripper.tip_mm - gripper.finger_length_mm
    return hull(box((-half, low_y, back), (half, high_y, gripper.tip_mm)))


@lru_cache(maxsize=4)
def _palm(gripper: GripperTruth) -> ConvexSolid:
    half, outer = PALM_MM / 2, gripper.opening_mm / 2 + gripper.finger_thickness_mm
    back = gripper.tip_mm - gripper.finger_length_mm
    return hull(box((-half, -outer, back - PALM_MM), (half, outer, back)))


def strikes(shape: PartShape, tool_from_part: Array, gripper: GripperTruth) -> bool:
    """Whether an open finger or the palm collides with the part."""
    solids = (*fingers(gripper, gripper.opening_mm), _palm(gripper))
    return any(len(within(shape, tool_from_part, region).corners) for region in solids)


def within(shape: PartShape, tool_from_part: Array, region: ConvexSolid) -> Bite:
    """What of the shape is in a convex region, in tool coordinates."""
    if shape.surface is not None:
        return _clip_surface(shape.surface, tool_from_part, region)
    bites = [_clip(piece, tool_from_part, region) for piece in shape.pieces]
    corners = np.vstack([b.corners for b in bites])
    return Bite(corners, tuple(n for b in bites for n in b.normals))


def _clip(solid: ConvexSolid, tool_from_part: Array, region: ConvexSolid) -> Bite:
    """Intersection of two convex solids: points of three planes that are beyond no plane."""
    part_normals = solid.normals @ tool_from_part[:3, :3].T
    normals = np.vstack([part_normals, region.normals])
    offsets = np.concatenate([solid.offsets + part_normals @ tool_from_part[:3, 3], region.offsets])
    triples = np.array(list(combinations(range(len(normals)), 3)))
    systems = normals[triples]
    meeting = np.abs(np.linalg.det(systems)) > 1e-9
    points = np.linalg.solve(systems[meeting], offsets[triples[meeting]][..., None])[..., 0]
    points = points[np.all(points @ normals.T <= offsets + 1e-7, axis=1)]
    on = np.abs(points @ part_normals.T - offsets[: len(part_normals)]) < 1e-6
    return Bite(points.reshape(-1, 3), tuple(part_normals[row] for row in on))


def _clip_surface(surface: DrawnSurface, tool_from_part: Array, region: ConvexSolid) -> Bite:
    """The part of a surface inside a convex region: its corners, with the surface's true normals there."""
    points = apply(tool_from_part, surface.corners_mm)[surface.triangles]
    beyond: Array = points @ region.normals.T - region.offsets
    outside: NDArray[np.bool_] = beyond > 0.0
    near = np.flatnonzero(~np.any(np.all(outside, axis=1), axis=1))
    every = surface.normals @ tool_from_part[:3, :3].T
    rings, bends = [np.zeros((0, 6))], [np.zeros((0, 3, 3))]
    for k in near:
        ring = np.column_stack([points[k], every[k]])
        for plane in np.flatnonzero(np.any(outside[k], axis=0)):
            ring = _below(ring, ring[:, :3] @ region.normals[plane] - region.offsets[plane])
        rings.append(ring)
        bends.append(np.broadcast_to(every[k], (len(ring), 3, 3)))
    found = np.vstack(rings)
    normals = found[:, 3:] / np.linalg.norm(found[:, 3:], axis=1, keepdims=True)
    return Bite(found[:, :3], tuple(normals[:, None]), np.concatenate(bends))


def _below(ring: Array, heights: Array) -> Array:
    """What of a convex ring (N, D) is not above a plane, over which its corners are so high (N,).

    Source: Sutherland and Hodgman, Reentrant polygon clipping, 1974.
    """
    start, height = np.concatenate([ring[-1:], ring[:-1]]), np.concatenate([heights[-1:], heights[:-1]])
    crosses = (height > 0.0) != (heights > 0.0)
    drop = np.where(crosses, height - heights, 1.0)
    crossing = start + (ring - start) * height[:, None] / drop[:, None]
    corners: Array = np.stack([crossing, ring], axis=1)[np.stack([crosses, heights <= 0.0], axis=1)]
    return corners


def _turn_to_jaws(shape: PartShape, tool_from_part: Array, bite: Bite, up: Array) -> float | None:
    """The smallest rotation about up, rad, that aligns a side of the part with the jaws; none where both jaws meet what
    is round as seen along up, opposite each other: it is as wide however it is turned. None where there is no side."""
    turns = bite.turns(up)
    if _meet_round(bite, turns):
        return 0.0
    straight = [normals for normals, round_ in zip(bite.normals, turns, strict=True) if not round_]
    touched = np.vstack([np.zeros((0, 3)), *straight])
    level = touched - np.outer(touched @ up, up)
    level = level[np.linalg.norm(level, axis=1) > 0.5]
    if not len(level):
        return None
    jaw = np.array([0.0, 1.0, 0.0]) - up[1] * up
    sine = np.cross(level, jaw) @ up
    angle = np.arctan2(sine, level @ jaw)
    angle = np.where(angle > np.pi / 2, angle - np.pi, np.where(angle < -np.pi / 2, angle + np.pi, angle))
    return float(angle[np.argmin(np.abs(angle))])


def _meet_round(bite: Bite, turns: NDArray[np.bool_]) -> bool:
    """Whether each jaw first meets a round place (N,) on its way in, the two opposite each other."""
    if not turns.any():
        return False
    y, faces = bite.corners[:, 1], np.array([np.abs(normals[:, 1]).max() > FACES for normals in bite.normals])
    met = [faces & touching for touching in (y > y.max() - TOUCH_MM, y < y.min() + TOUCH_MM)]
    if not all(jaw.any() and turns[jaw].all() for jaw in met):
        return False
    x = [bite.corners[jaw, 0] for jaw in met]
    return bool(max(here.min() for here in x) <= min(here.max() for here in x))


def _why_it_slips(bite: Bite, tool_from_part: Array, shape: PartShape, gripper: GripperTruth) -> str:
    """Why the turned part is not held; empty where it is."""
    y = bite.corners[:, 1]
    width = float(y.max() - y.min())
    if gripper.tip_mm - bite.corners[:, 2].min() < gripper.bite_mm:
        return "only the tips of the fingers touch the part"
    cone = float(np.arctan(gripper.friction))
    sides = []
    for sign, touching in ((1.0, y > y.max() - TOUCH_MM), (-1.0, y < y.min() + TOUCH_MM)):
        normals = [n for n, here in zip(bite.normals, touching, strict=True) if here]
        if _angle_to_cone(np.array([0.0, sign, 0.0]), normals) > cone:
            return "the sides slope too much to hold"
        sides.append(bite.corners[touching][:, [0, 2]])
    low = np.maximum(sides[0].min(axis=0), sides[1].min(axis=0))
    high = np.minimum(sides[0].max(axis=0), sides[1].max(axis=0))
    if np.linalg.norm(np.maximum(low - high, 0.0)) > np.tan(cone) * width:
        return "the fingers do not touch opposite places"
    grip_line = (low + high) / 2
    if np.linalg.norm(apply(tool_from_part, shape.centre_of_mass)[[0, 2]] - grip_line) > gripper.lever_mm:
        return "the part is gripped too far from its middle and swings out"
    return ""


def _angle_to_cone(direction: Array, normals: Sequence[Array]) -> float:
    """Angle, rad, between a unit direction and the cone spanned by unit normals."""
    spanning = np.unique(np.round(np.vstack([np.zeros((0, 3)), *normals]), 3), axis=0)
    best = np.pi
    for count in (1, 2, 3):
        some = np.array(list(combinations(range(len(spanning)), count)), int).reshape(-1, count)
        bases = spanning[some].transpose(0, 2, 1)
        weights = np.linalg.pinv(bases, 3 * np.finfo(float).eps) @ direction
        nearest: Array = (bases @ weights[..., None])[..., 0]
        length: Array = np.linalg.norm(nearest, axis=1)
        inside = np.all(weights >= -1e-9, axis=1) & (length > 1e-9)
        cosine = nearest[inside] @ direction / length[inside]
        best = min(best, float(np.arccos(np.clip(cosine, -1.0, 1.0)).min(initial=np.pi)))
    return best
