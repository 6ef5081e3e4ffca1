"""How two fingers take hold of a part: antipodal grasps from its corners, its pose and the table. Pure.

A grasp is where the tool must be, world frame; whether the arm gets there and what the cameras see is plan.py's.
The solid is the part where all its sides are known, and else the convex hull of the corners that are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations, pairwise, product
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from daemon import frames
from daemon.arm import HandBody, two_fingers
from daemon.arrays import Array
from daemon.pick.grippers.gripper import Grasps, HoldingVolume, PlannedGrasp
from daemon.quantities import Lean, Length, Room
from daemon.vision.geometry import Polyhedron, exact, inside

UP = np.array([0.0, 0.0, 1.0])
TOUCHING_MM = 0.6
"""Soft pads and taught corners: what is this near to the finger touches it."""
LEAST_BITE_MM = 4.5
"""How deep the part must reach between the fingers at the least."""
EACH_BITE_MM = 3.0
"""How deep what each finger rests on must reach between them: looks err by 1 mm, in height most."""
MEETING_MM = 2.0
"""Faces that are reached within this of one another meet there in an edge or a corner."""
NEAR_RAD = 0.25
LEAST_SIZE_MM2, SAME_PLANE = 20.0, float(np.cos(np.radians(6.0)))
"""Twice the area of three corners that give a plane, and the cosine above which two planes are one."""
LEAST_SLOPE, LEG_FACES, LEGS_APART_MM = 1e-6, 0.9, 3.0
"""The least that a face faces the fingers by to be met at all, and the least by which two are the sides of a leg; how
far two legs are apart."""
SWEPT_MM = 80.0
"""How long the last stretch is, on which neighbours must leave room."""
UPRIGHT = 0.95
"""Height of what is one long and stands upright, from here on."""
SLIPS_DEG = 45.0
"""Contacts this far off square hold nothing."""
ALONG_DEG = 9.0
"""A face this near to parallel lies along a finger; the closing finger turns the part the rest."""


class TwoFingers(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="fingers"):
    """Two parallel fingers: their dimensions, and what grasps they may make."""

    opening_mm: Length = 90.0
    """Opening between the fingers, mm."""
    finger_width_mm: Length = 15.0
    """Width of a finger along tool x, mm."""
    pad_back_mm: Room = 50.0
    """How far the fingers reach back from the tool centre point along tool z, mm."""
    tip_mm: Room = 10.0
    """How far the finger tips reach beyond the tool centre point along tool z, mm."""
    finger_thick_mm: Length = 8.0
    """Thickness of a finger along tool y, mm."""
    friction: Annotated[float, Meta(gt=0, le=5)] = 0.6
    """Coefficient of friction that the pads can be trusted for."""
    side_clearance_mm: Room = 6.0
    """Clearance for each finger beside the part, mm."""
    swing_mm: Room = 20.0
    """Largest distance of the part's middle from the line between the contacts, mm."""
    tip_clearance_mm: Room = 4.0
    """Least height of the finger tips over the table, mm."""
    tilts_deg: tuple[Lean, ...] = (10.0, 20.0, 30.0, 40.0)
    """Angles from straight down at which the approach may lean, degrees."""
    turn_tilts_deg: tuple[Lean, ...] = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, -10.0, -20.0, -30.0, -40.0, -50.0)
    """The same for a part that is to lie on another side than before; below 0 the cameras are on the lower side."""

    @property
    def by_vacuum(self) -> bool:
        return False

    @property
    def body(self) -> HandBody:
        return two_fingers(self.opening_mm, self.finger_width_mm, self.finger_thick_mm, self.pad_back_mm, self.tip_mm)

    @property
    def outside(self) -> tuple[str, float]:
        return "opening_mm", self.opening_mm / 2 + self.finger_thick_mm

    @property
    def holding_volume(self) -> HoldingVolume:
        return HoldingVolume(self.pad_back_mm, self.tip_mm, self.finger_width_mm)

    @property
    def widest_mm(self) -> float:
        return self.opening_mm

    @property
    def empty(self) -> Polyhedron:
        return closed_fingers(self)

    @property
    def turning(self) -> TwoFingers:
        return msgspec.structs.replace(self, tilts_deg=self.turn_tilts_deg)

    def work_time_s(self, closed: bool) -> float:
        """See Gripper. That of fingers is pick.hand_s."""
        return 0.0

    def grasps(
        self,
        shape: Polyhedron,
        world_from_part: Array,
        table_z_mm: float,
        error_mm: float,
        neighbours: Sequence[Array] = (),
        near: Array | None = None,
    ) -> Grasps:
        """See Gripper. Fingers centre the part, so that their clearance beside it has room for the error."""
        found = grasps(shape, world_from_part, table_z_mm, self, neighbours, near)
        room_mm = self.opening_mm - 2 * self.side_clearance_mm
        why = (
            f"no grasp holds it as it lies, with the tips {self.tip_clearance_mm:g} mm over the table and "
            f"{room_mm:g} mm between the fingers: lay it on another side, or mount another gripper, as a suction cup"
        )
        return Grasps(found, "" if found else why)

    def takes(self, shape: Polyhedron, error_mm: float) -> str:
        return ""

    def sweeps(self, world_from_tool: Array, neighbour: Array) -> bool:
        return sweeps(world_from_tool, neighbour, self)


@dataclass(frozen=True, eq=False, kw_only=True)
class FingerGrasp(PlannedGrasp):
    """The fingers around the part. width_mm between the contacts; slip_deg: the larger angle of a contact's normal from
    the closing direction; rounded: only what is round lies along the fingers."""

    width_mm: float
    slip_deg: float
    rounded: bool = False

    @property
    def risk(self) -> float:
        return 1.0 if self.rounded else self.slip_deg / SLIPS_DEG

    @property
    def any_turn(self) -> bool:
        return self.rounded

    @property
    def description(self) -> str:
        text = f"{self.width_mm:.0f} mm wide, tilted {self.tilt_deg:g} degrees"
        return f"{text}, contacts {self.slip_deg:.0f} degrees off perpendicular"

    @property
    def figures(self) -> Mapping[str, float]:
        return {"slip_deg": self.slip_deg}


def closed_fingers(gripper: TwoFingers) -> Polyhedron:
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


def contact_hull(shape: Polyhedron) -> Polyhedron:
    """The surface that flat fingers can touch: all facets where every side is known, flat or, from a drawing, curved,
    the flat ones first; else the convex hull of the known corners. Raises ValueError where those span no volume."""
    curved = np.concatenate([shape.covers.reshape(-1, 3), _fillets(shape)])
    if shape.open_edges and not (shape.smooth or shape.arcs or shape.holes or len(curved)):
        return hull(shape.corners_mm)
    sides = np.arange(len(curved)).reshape(-1, 4) + len(shape.corners_mm)
    whole = exact(np.concatenate([shape.corners_mm, curved]), [*shape.facets, *sides])
    return whole if len(whole.facets) >= 4 else hull(shape.corners_mm)


def _fillets(shape: Polyhedron) -> Array:
    """(4 N, 3) corners of N sides that close the roundings of inner edges, where two sides end smoothly and look
    towards each other, each as far from where their planes meet: a finger meets such a rounding before either."""
    of_side = {(ring[k - 1], ring[k]): side for side, ring in enumerate(shape.facets) for k in range(len(ring))}
    smooth = [edge for pair in sorted(shape.smooth) for edge in (pair, pair[::-1]) if edge in of_side]
    found, points = [np.zeros((0, 3))], shape.corners_mm
    for (a, b), (c, d) in combinations(smooth, 2):
        along, across = points[b] - points[a], points[d] - points[a]
        alike = np.linalg.norm(along + points[d] - points[c]) < TOUCHING_MM
        square = abs(float(across @ along)) < TOUCHING_MM * float(np.linalg.norm(along))
        rises = across @ shape.normals[of_side[a, b]], -across @ shape.normals[of_side[c, d]]
        if alike and square and min(rises) > TOUCHING_MM > abs(rises[0] - rises[1]):
            found.append(points[[b, a, d, c]])
    return np.concatenate(found)


def hull(corners_mm: Array, flat_mm: float = 1.5) -> Polyhedron:
    """The convex hull of (N, 3) corners.

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
    rings: list[tuple[int, ...]] = []
    for k in np.flatnonzero(above != below):
        if not any(float(n @ every[k]) > SAME_PLANE for n in normals):
            normals.append(every[k])
            rings.append(_ring(corners_mm, np.flatnonzero(heights[k] > -flat_mm), every[k]))
    if len(normals) < 4:
        raise ValueError(f"{len(corners_mm)} corners span no solid")
    return exact(corners_mm, rings)


def _ring(corners_mm: Array, which: NDArray[np.intp], normal: Array) -> tuple[int, ...]:
    """Corners of a convex face, anticlockwise as seen from where its normal points."""
    flat = corners_mm[which] - corners_mm[which].mean(axis=0)
    right = flat[np.linalg.norm(flat, axis=1).argmax()]
    angles = np.arctan2(flat @ np.cross(normal, right), flat @ right)
    return tuple(int(k) for k in which[np.argsort(angles)])


def centre_of_mass(solid: Polyhedron) -> Array:
    """(3,) of a closed solid of one stuff: its sides cut into triangles, each with the middle a tetrahedron."""
    middle = solid.corners_mm.mean(axis=0)
    fans = [(r[0], b, c) for r in solid.facets for b, c in pairwise(r[1:])]
    spread = solid.corners_mm[np.array(fans)] - middle
    volumes = np.linalg.det(spread)
    return np.asarray(middle + volumes @ spread.sum(axis=1) / (4.0 * volumes.sum()))


def closing_directions(solid: Polyhedron, flat: int) -> list[Array]:
    """Horizontal unit directions (3,) worth closing along, in the solid's frame, whose z is up. flat: so many of its
    faces, the first ones, are no strips of something round.

    Each side face's normal, evenly between two faces that look away from each other, and along and across the longest
    edge (D'Souza, section 6.1). What stands nearly upright has no direction: which way it leans is the look's error.
    """
    here, after, _ = solid.steps
    sides = solid.corners_mm[after] - solid.corners_mm[here]
    longest = sides[int(np.linalg.norm(sides, axis=1).argmax())]
    seeds = [a - b for a, b in combinations(solid.normals[:flat], 2) if a @ b < -0.3]
    seeds = [seed for seed in (*seeds, *solid.normals, longest) if abs(seed[2]) < UPRIGHT * np.linalg.norm(seed)]
    seeds += [np.cross(UP, seed) for seed in seeds if seed is longest]
    found: list[Array] = []
    for seed in seeds:
        level = seed * (1.0, 1.0, 0.0) / np.linalg.norm(seed[:2])
        if not any(abs(float(level @ d)) > np.cos(np.radians(4.0)) for d in found):
            found.append(level)
    return found


@dataclass(frozen=True, eq=False)
class Contact:
    """Where the closing fingers meet the solid, in the tool frame: the two positions along tool y; slip_deg, the most
    that a contact's normal, or the line between the contacts, is off the closing direction; line_mm (2,) x and z of
    that line; rounded: only what is round lies along the fingers."""

    low_mm: float
    high_mm: float
    slip_deg: float
    line_mm: Array
    rounded: bool


class _Sides(NamedTuple):
    """A solid as the fingers meet it: outlines (F, K, 3), filled up with their last corners; outward normals (F, 3);
    flat: so many of them, the first ones, are no strips of something round."""

    outlines: Array
    normals: Array
    flat: int

    def seen_from(self, rotation: Array, origin: Array) -> _Sides:
        """The same in a frame with these axes (3, 3) in columns and this origin (3,)."""
        return _Sides((self.outlines - origin) @ rotation, self.normals @ rotation, self.flat)


def sides_of(solid: Polyhedron, flat: int) -> _Sides:
    """The solid's facets as sides of the same number of corners, all around the one it lies on."""
    longest = max(map(len, solid.facets))
    filled = np.array([[*ring, *ring[-1:] * (longest - len(ring))] for ring in solid.facets])
    return _Sides(solid.corners_mm[filled], solid.normals, flat)


class _FingerLines(NamedTuple):
    """Lines along tool y, laid over the fingers. base (L, 2): their x and z; high, low (F, L): how far along y each
    leaves and enters the solid through each side, -inf and inf where it does not."""

    base: Array
    high: Array
    low: Array

    def free(self, low_mm: float, high_mm: float) -> bool:
        """Whether no line meets the solid between two places along y."""
        met = ((self.high > low_mm) & (self.high < high_mm)) | ((self.low > low_mm) & (self.low < high_mm))
        left = (self.high > low_mm).sum(axis=0)
        entered = (np.isfinite(self.low) & (self.low > low_mm)).sum(axis=0)
        return not (met.any() or (left > entered).any())


@lru_cache(maxsize=2)
def _line_grid(gripper: TwoFingers) -> Array:
    """(L, 2) x and z of the lines, some of them just as deep as what a finger rests on must reach."""
    half = gripper.finger_width_mm / 2
    rows = np.union1d(np.linspace(-gripper.pad_back_mm, gripper.tip_mm, 31), gripper.tip_mm - EACH_BITE_MM)
    x, z = np.meshgrid(np.linspace(-half, half, 9), rows)
    return np.column_stack([x.ravel(), z.ravel()])


def _lines(sides: _Sides, gripper: TwoFingers) -> _FingerLines:
    """sides: in the tool frame."""
    base, across = _line_grid(gripper), sides.outlines[..., [0, 2]]
    normals = sides.normals
    over = (across.max(axis=1) > base.min(axis=0)) & (across.min(axis=1) < base.max(axis=0))
    met = np.zeros((len(across), len(base)), bool)
    near = over.all(axis=1) & (np.abs(normals[:, 1]) > LEAST_SLOPE)  # most of a round part's are not
    met[near] = inside(base, across[near])
    offsets = np.einsum("fi,fi->f", sides.outlines[:, 0], normals)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (offsets[:, None] - normals[:, [0, 2]] @ base.T) / normals[:, 1:2]
    out = normals[:, 1:2]
    return _FingerLines(
        base, np.where(met & (out > LEAST_SLOPE), reach, -np.inf), np.where(met & (out < -LEAST_SLOPE), reach, np.inf)
    )


def contacts(sides: _Sides, up: Array, gripper: TwoFingers) -> Contact | None:
    """Close the open fingers on a solid, its sides in the tool frame; None where a finger would stand in it, where they
    meet nothing, or nothing that lies along them (a part gripped by two opposite edges turns away), or by their tips
    only. up (3,): world up, tool frame.

    Lines along tool y are laid over the fingers. A finger rests where the solid reaches farthest; where several faces
    meet there, it holds any direction between their normals.
    """
    lines, half = _lines(sides, gripper), gripper.opening_mm / 2
    top = np.where(lines.high < half, lines.high, -np.inf)
    bottom = np.where(lines.low > -half, lines.low, np.inf)
    met = (top.max(axis=0) > -np.inf) & (bottom.min(axis=0) < np.inf)
    if met.sum() < 4 or gripper.tip_mm - lines.base[met, 1].min() < LEAST_BITE_MM:
        return None
    upper = _finger_contact(top[:, met], lines.base[met], sides, up, 1.0)
    lower = _finger_contact(-bottom[:, met], lines.base[met], sides, up, -1.0)
    flat = upper.flat or lower.flat
    if not flat and not (upper.rounded and lower.rounded):
        return None
    high_mm, low_mm = float(top.max()), float(bottom.min())
    deep = lines.base[:, 1] <= gripper.tip_mm - EACH_BITE_MM
    if max(high_mm - top[:, deep].max(), bottom[:, deep].min() - low_mm) > MEETING_MM:
        return None
    middle, out = (high_mm + low_mm) / 2, half + gripper.finger_thick_mm
    roomy = half - gripper.side_clearance_mm
    if not (lines.free(middle + roomy, middle + out) and lines.free(middle - out, middle - roomy)):
        return None
    ends = np.maximum(upper.low, lower.low), np.minimum(upper.high, lower.high)
    askew = float(np.degrees(np.arctan2(np.linalg.norm(np.maximum(ends[0] - ends[1], 0.0)), high_mm - low_mm)))
    slip_deg = max(upper.slip_deg, lower.slip_deg, askew)
    return Contact(low_mm, high_mm, slip_deg, (ends[0] + ends[1]) / 2, not flat)


@dataclass(frozen=True, eq=False)
class _FingerContact:
    """One finger's contact: degrees the closing direction is off the normals there; whether a face lies along the
    finger (seen from above), a flat one, or a strip of something round; bounds (2,) of x and z it extends over."""

    slip_deg: float
    flat: bool
    rounded: bool
    low: Array
    high: Array


def _finger_contact(reach: Array, base: Array, sides: _Sides, up: Array, sign: float) -> _FingerContact:
    """reach (F, L): how far along sign * y each line gets to each side it leaves the solid by."""
    farthest = reach.max(axis=0)
    most = farthest.max()
    faces = np.unique(reach.argmax(axis=0)[farthest > most - MEETING_MM])
    closing, normals = np.array([0.0, sign, 0.0]), sides.normals[faces]
    level = normals - np.outer(normals @ up, up)
    along = level @ closing > np.cos(np.radians(ALONG_DEG)) * np.maximum(np.linalg.norm(level, axis=1), 0.3)
    spots = base[farthest > most - TOUCHING_MM]
    flat = faces < sides.flat
    slip_deg, low, high = off_cone_deg(closing, normals), spots.min(axis=0), spots.max(axis=0)
    return _FingerContact(slip_deg, bool((along & flat).any()), bool((along & ~flat).any()), low, high)


def off_cone_deg(direction: Array, normals: Array) -> float:
    """Degrees between a unit direction and the nearest in the cone spanned by one or two of the (N, 3) unit normals."""
    near = normals @ direction
    alike = normals @ normals.T
    weights = (near[:, None] - alike * near) / np.maximum(1.0 - alike**2, 1e-9)  # of the first of each two of them
    spans = (alike**2 < 1.0 - 1e-9) & (weights > 0) & (weights.T > 0)
    between = np.where(spans, np.sqrt(np.maximum(weights * near[:, None] + weights.T * near, 0.0)), -1.0)
    return float(np.degrees(np.arccos(np.clip(max(near.max(), between.max()), -1.0, 1.0))))


def grasps(
    shape: Polyhedron,
    world_from_part: Array,
    table_z_mm: float,
    gripper: TwoFingers,
    neighbours: Sequence[Array] = (),
    near: Array | None = None,
) -> list[FingerGrasp]:
    """All grasps that hold, firmest first (unblocked before blocked).

    shape: in the part frame; neighbours: (M, 3) world corners of other parts on the table; near (3, 3): only
    grasps whose tool is turned within some 15 degrees of it. Grasps
    through the table, wider than the opening or needing more friction than the pads have are left out.
    Raises ValueError where the shape's corners span no volume.
    """
    solid = contact_hull(shape)
    solid = replace(solid, corners_mm=frames.apply(world_from_part, solid.corners_mm))
    curved = (len(solid.corners_mm) - len(shape.corners_mm)) // 4
    mass, flat = centre_of_mass(solid), len(solid.facets) - curved
    sides, found = sides_of(solid, flat), list[FingerGrasp]()
    for along in closing_directions(solid, flat):
        middles = _grasp_centres(solid, along, mass, gripper)
        for closing, tilt_deg in product((along, -along), gripper.tilts_deg):
            rotation = tool_rotation(np.cross(closing, UP), float(np.radians(tilt_deg)))
            if near is not None and float((rotation * near).sum()) < 1.0 + 2.0 * np.cos(NEAR_RAD):
                continue
            for middle in middles:
                grasp = _placed(rotation, tilt_deg, middle, mass, sides, table_z_mm, gripper)
                if grasp is not None:
                    blocked = any(sweeps(grasp.world_from_tool, n, gripper) for n in neighbours)
                    found.append(replace(grasp, blocked=blocked))
    return sorted(found, key=lambda g: (g.blocked, g.rounded, round(g.slip_deg / 5.0), abs(g.tilt_deg)))


def _grasp_centres(solid: Polyhedron, along: Array, mass: Array, gripper: TwoFingers) -> list[Array]:
    """The mass centre (3,), and middles (3,) between sides that look away from each other along the closing direction:
    where a part that is not convex has a leg to be held by. Each line along that direction once."""
    found = [mass]
    heights = solid.normals @ solid.corners_mm.T - np.einsum("fi,fi->f", solid.normals, solid.centres_mm)[:, None]
    if heights.max() < MEETING_MM:
        return found
    facing = solid.normals @ along
    for a, b in product(np.flatnonzero(facing > LEG_FACES), np.flatnonzero(facing < -LEG_FACES)):
        gap, middle = solid.centres_mm[a] - solid.centres_mm[b], (solid.centres_mm[a] + solid.centres_mm[b]) / 2
        if 0.0 < float(gap @ along) < gripper.opening_mm:
            away = np.cross(np.reshape(found, (-1, 3)) - middle, along)
            if (np.linalg.norm(away, axis=1) > LEGS_APART_MM).all():
                found.append(middle)
    return found


def _placed(
    rotation: Array, tilt_deg: float, middle: Array, mass: Array, sides: _Sides, table_z_mm: float, gripper: TwoFingers
) -> FingerGrasp | None:
    """The grasp with this orientation: at this middle (3,) or as low as the tips allow, centred."""
    tips = np.array([[sx * gripper.finger_width_mm / 2, 0.0, gripper.tip_mm] for sx in (-1, 1)])
    least_z = table_z_mm + gripper.tip_clearance_mm - float((tips @ rotation.T)[:, 2].min())
    centre = np.array([*middle[:2], max(middle[2], least_z)])
    in_hand = sides.seen_from(rotation, centre)
    if _hits_palm(in_hand.outlines, gripper):
        return None
    contact = contacts(in_hand, UP @ rotation, gripper)
    if contact is None or contact.slip_deg > np.degrees(np.arctan(gripper.friction)):
        return None
    if np.linalg.norm(((mass - centre) @ rotation)[[0, 2]] - contact.line_mm) > gripper.swing_mm:
        return None
    width = contact.high_mm - contact.low_mm
    if width > gripper.opening_mm - 2 * gripper.side_clearance_mm:
        return None
    here = frames.rigid(rotation, centre + rotation[:, 1] * (contact.high_mm + contact.low_mm) / 2)
    return FingerGrasp(here, tilt_deg, width_mm=width, slip_deg=contact.slip_deg, rounded=contact.rounded)


def _hits_palm(corners: Array, gripper: TwoFingers) -> bool:
    """Whether corners (..., 3), tool frame, lie where the fingers come from; a palm as wide as they open is there."""
    wide = gripper.opening_mm / 2 + gripper.finger_thick_mm
    return bool(((corners[..., 2] < -gripper.pad_back_mm) & (np.abs(corners[..., :2]) < wide).all(axis=-1)).any())


def sweeps(world_from_tool: Array, neighbour: Array, gripper: TwoFingers) -> bool:
    """Whether the neighbour reaches into the room the open fingers sweep on their last stretch (box against box along
    the tool's axes: errs towards `in the way`)."""
    local = frames.apply(frames.inverse(world_from_tool), neighbour)
    wide = gripper.opening_mm / 2 + gripper.finger_thick_mm
    half = gripper.finger_width_mm / 2
    low, high = np.array([-half, -wide, -SWEPT_MM]), np.array([half, wide, gripper.tip_mm])
    return bool(np.all(local.min(axis=0) < high) and np.all(local.max(axis=0) > low))
