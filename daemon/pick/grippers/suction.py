"""How a suction cup takes hold of a part: on which facet, where on it, and with what share of its force. Pure.

Where on a facet: as far from its edges and holes, and from what rises above it, as the lip and the error need; there
as near to below the mass centre as can be, or where there is most room. Rooms are found on a grid over the facet: on a
point of the grid they are exact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta

from daemon import frames
from daemon.arm import PALM_MM, HandBody, suction_cup
from daemon.arrays import Array
from daemon.pick.grippers.gripper import Grasps, HoldingVolume, PlannedGrasp
from daemon.pick.grippers.two_fingers import NEAR_RAD, SWEPT_MM, centre_of_mass, contact_hull, hull
from daemon.quantities import Lean, Length, Room
from daemon.vision.geometry import Polyhedron, inside, off_segments

BAR_N_MM2, GRAVITY_M_S2 = 0.1, 9.81
RISES_MM = 0.5
"""What is higher than this above a facet's plane is in the cup's way; drawings and taught corners err by less."""
PITCH_MM, MOST_POINTS = 1.0, 2500.0
"""Of the grid, where that makes no more points than so many."""
TURNS = 12
"""So many ways, evenly, the hand is turned about the cup's axis."""
SAME_SPOT_MM = 3.0
MOST_REASONS = 3
"""For so many facets the message says why they do not serve."""
Factor = Annotated[float, Meta(ge=1, le=10)]
Bar = Annotated[float, Meta(gt=0, le=1)]
Density = Annotated[float, Meta(gt=0, le=25)]
Dwell = Annotated[float, Meta(ge=0, le=10)]
Friction = Annotated[float, Meta(gt=0, le=5)]


class SuctionCup(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag="suction"):
    """One round suction cup, the middle of its lip at the tool centre point: `kind: suction`. CLOSEI switches the
    vacuum on, OPENI switches it off and blows the part off; or outputs with the roles `vacuum` and `blow_off` do
    (`signals`)."""

    cup_radius_mm: Length = 10.0
    """Radius of the lip, mm."""
    lip_mm: Room = 3.0
    """Lip travel: how far the lip gives, mm. The cup is pressed onto a facet by half of it."""
    cup_length_mm: Length = 60.0
    """Length of cup and tube, from the lip back to the palm, mm."""
    edge_mm: Room = 1.5
    """Least distance of the lip from the edges and holes of a facet, besides the predicted error, mm."""
    vacuum_bar: Bar = 0.6
    """Pressure below the air's that the vacuum surely reaches on a tight part, bar."""
    friction: Friction = 0.5
    """Coefficient of friction that the lip can be trusted for: 0.5 dry, 0.1 to 0.3 oily."""
    safety: Factor = 2.0
    """How many times as much the cup must hold as a part weighs and turns it."""
    density_g_cm3: Density = 7.9
    """Density of the parts' material, g/cm³: steel 7.9, aluminium 2.7, plastics 1.2."""
    lean_deg: Lean = 40.0
    """How far the approach may lean from straight down, degrees."""
    carried_deg: Lean = 20.0
    """How far the hand leans at most as it carries a part (pick.bin and places), degrees."""
    dwell_s: Dwell = 0.3
    """Time from vacuum on to the lift, s: the vacuum must be there."""
    blow_off_s: Dwell = 0.2
    """Time from vacuum off to the next move, s: the part must have left."""

    @property
    def by_vacuum(self) -> bool:
        return True

    @property
    def tip_mm(self) -> float:
        return 0.0

    @property
    def body(self) -> HandBody:
        return suction_cup(self.cup_radius_mm, self.cup_length_mm)

    @property
    def outside(self) -> tuple[str, float]:
        return "cup_radius_mm", self.cup_radius_mm

    @property
    def holding_volume(self) -> HoldingVolume:
        return HoldingVolume(0.0, 0.0, 2 * self.cup_radius_mm)

    @property
    def widest_mm(self) -> None:
        return None

    @property
    def empty(self) -> None:
        """See Gripper. A cup looks the same with a part as without."""
        return None

    @property
    def turning(self) -> None:
        """See Gripper. A cup holds a part near to level only (carried_deg)."""
        return None

    def work_time_s(self, closed: bool) -> float:
        return self.dwell_s if closed else self.blow_off_s

    @property
    def force_n(self) -> float:
        """What the vacuum pulls with, N."""
        return self.vacuum_bar * BAR_N_MM2 * float(np.pi) * self.cup_radius_mm**2

    def load(self, weight_n: float, across_mm: float, deep_mm: float, tilt_deg: float) -> float:
        """The share of what the cup can hold that a part asks of it, as far as the hand may lean with it: pulled off
        and along (friction), or turned off (half the force at the lip's radius). across_mm, deep_mm: of the mass
        centre, beside the cup's axis and before the lip."""
        lean = float(np.radians(max(tilt_deg, self.carried_deg)))
        needed_n = self.safety * weight_n
        pulled = needed_n * (np.cos(lean) + np.sin(lean) / self.friction) / self.force_n
        lever_mm = across_mm * np.cos(lean) + max(deep_mm, 0.0) * np.sin(lean)
        return float(max(pulled, needed_n * lever_mm / (self.force_n * self.cup_radius_mm / 2)))

    def grasps(
        self,
        shape: Polyhedron,
        world_from_part: Array,
        table_z_mm: float,
        error_mm: float,
        neighbours: Sequence[Array] = (),
        near: Array | None = None,
    ) -> Grasps:
        """See Gripper. The tool's z goes down along a facet's normal, into the facet by half of the lip travel."""
        shape = shape if shape.facets else hull(shape.corners_mm)
        facets = upward_facets(shape, world_from_part, self.lean_deg)
        if not facets:
            return Grasps((), f"no flat facet of it faces up to within {self.lean_deg:g} degrees")
        weight_n, mass = weight_and_centroid(shape, self.density_g_cm3)
        found: list[CupGrasp] = []
        reasons: list[str] = []
        for facet, tilt_deg in facets:
            spots, why = self.spots(shape, facet, mass, error_mm)
            for spot in spots:
                load = self._load_at(shape, facet, spot, (weight_n, mass), tilt_deg)
                if load > 1.0:
                    why = f"the load is {load:.1f} times what the cup can hold there"
                    continue
                for rotation in rotations_about_normal(shape, facet):
                    here = frames.rigid(rotation, spot.at_mm + rotation[:, 2] * self.lip_mm / 2)
                    world_from_tool = world_from_part @ here
                    if near is not None and float((world_from_tool[:3, :3] * near).sum()) < 1 + 2 * np.cos(NEAR_RAD):
                        continue
                    blocked = any(self.sweeps(world_from_tool, each) for each in neighbours)
                    of = CupGrasp(world_from_tool, tilt_deg, blocked, facet=facet + 1, room_mm=spot.room_mm, load=load)
                    found.append(of)
            reasons += [f"facet {facet + 1}: {why}"] if why else []
        found.sort(key=lambda grasp: (grasp.blocked, round(grasp.load, 1), grasp.tilt_deg))
        return Grasps(found, "; ".join(reasons[:MOST_REASONS]))

    def takes(self, shape: Polyhedron, error_mm: float) -> str:
        shape = shape if shape.facets else hull(shape.corners_mm)
        heavy = weight_and_centroid(shape, self.density_g_cm3)
        taken, reasons = list[str](), list[str]()
        for facet in range(len(shape.facets)):
            spots, why = self.spots(shape, facet, heavy[1], error_mm)
            load = min((self._load_at(shape, facet, spot, heavy, 0.0) for spot in spots), default=0.0)
            if spots and load <= 1.0:
                taken.append(str(facet + 1))
            elif spots:
                reasons.append(f"facet {facet + 1}: the load is {load:.1f} times what the cup can hold there")
            else:
                reasons.append(f"facet {facet + 1}: {why}")
        if taken:
            return f"suction takes facet{'s' if len(taken) > 1 else ''} {', '.join(taken)}"
        return f"suction takes no facet: {'; '.join(reasons[:MOST_REASONS])}"

    def _load_at(self, shape: Polyhedron, facet: int, spot: Spot, heavy: tuple[float, Array], tilt_deg: float) -> float:
        """See load. heavy: weight and mass centre of the part."""
        weight_n, mass = heavy
        off = mass - spot.at_mm
        deep_mm = -float(off @ shape.normals[facet])
        across_mm = float(np.linalg.norm(off + deep_mm * shape.normals[facet]))
        return self.load(weight_n, across_mm, deep_mm, tilt_deg)

    def spots(self, shape: Polyhedron, facet: int, mass: Array, error_mm: float) -> tuple[list[Spot], str]:
        """Where on a facet the cup can sit: nearest below the mass centre (3,), and where most room is; or why
        nowhere."""
        points, rooms = clearances_on(shape, facet)
        needed_mm = self.cup_radius_mm + error_mm + self.edge_mm
        most_mm = float(rooms.max(initial=0.0))
        fits = rooms >= needed_mm
        if not fits.any():
            return [], f"room for a lip of {most_mm:.1f} mm radius, {needed_mm:.1f} are needed"
        axes, normal = axes_on(shape, facet), shape.normals[facet]
        flat = (points[fits] - points[0]) @ axes.T
        for high in _outlines_above_facet(shape, facet, points[0], axes, self.cup_length_mm):
            under_palm = inside(flat, high[None])[0] | (_distance_from_sides(flat, high) < PALM_MM)
            fits[np.flatnonzero(fits)[under_palm]] = False
            flat = flat[~under_palm]
        if not fits.any():
            return [], "the part is higher beside it than the cup is long"
        some, theirs = points[fits], rooms[fits]
        away = np.linalg.norm(np.cross(some - mass, normal), axis=1)
        nearest, roomiest = int(away.argmin()), int(theirs.argmax())
        found = [Spot(some[nearest], float(theirs[nearest]))]
        if np.linalg.norm(some[nearest] - some[roomiest]) > SAME_SPOT_MM:
            found.append(Spot(some[roomiest], float(theirs[roomiest])))
        return found, ""

    def sweeps(self, world_from_tool: Array, neighbour: Array) -> bool:
        """See Gripper. Boxes along the tool's axes: errs towards `in the way`."""
        local = frames.apply(frames.inverse(world_from_tool), neighbour)
        low, high = local.min(axis=0), local.max(axis=0)
        beside = np.maximum(low[:2], -high[:2]).max()
        cup = beside < self.cup_radius_mm and high[2] > -SWEPT_MM and low[2] < 0.0
        return bool(cup or (beside < PALM_MM and low[2] < -self.cup_length_mm))


class Spot(NamedTuple):
    """A point on a facet (3,), part frame, and how far it is from all that the lip must not reach."""

    at_mm: Array
    room_mm: float


@dataclass(frozen=True, eq=False, kw_only=True)
class CupGrasp(PlannedGrasp):
    """The cup on a facet, numbered from 1; room_mm: from the cup's axis to the nearest edge or hole; load: the share of
    what the cup can hold."""

    facet: int
    room_mm: float
    load: float

    @property
    def risk(self) -> float:
        return self.load

    @property
    def description(self) -> str:
        text = (
            f"by facet {self.facet}, tilted {self.tilt_deg:.0f} degrees, room for a lip of {self.room_mm:.1f} mm radius"
        )
        return f"{text}, {100 * self.load:.0f} % of what the cup holds"

    @property
    def figures(self) -> Mapping[str, float]:
        return {"facet": self.facet, "room_mm": self.room_mm, "load": self.load}


def weight_and_centroid(shape: Polyhedron, density_g_cm3: float) -> tuple[float, Array]:
    """N, and the mass centre (3,) in the part frame, of a part that is all of one material: holes left out, which only
    make it lighter. Raises ValueError where the corners span no volume."""
    solid = contact_hull(shape)
    middle = solid.corners_mm.mean(axis=0)
    fans = np.array([(r[0], b, c) for r in solid.facets for b, c in pairwise(r[1:])])
    volume_mm3 = abs(float(np.linalg.det(solid.corners_mm[fans] - middle).sum())) / 6.0
    return volume_mm3 * 1e-6 * density_g_cm3 * GRAVITY_M_S2, centre_of_mass(solid)


def upward_facets(shape: Polyhedron, world_from_part: Array, lean_deg: float) -> list[tuple[int, float]]:
    """(facet, degrees that it leans) of those that look up, the most level first."""
    up = (shape.normals @ world_from_part[:3, :3].T)[:, 2]
    leans = np.degrees(np.arccos(np.clip(up, -1.0, 1.0)))
    order = np.argsort(leans, kind="stable")
    return [(int(k), float(leans[k])) for k in order if leans[k] <= lean_deg]


def rotations_about_normal(shape: Polyhedron, facet: int) -> list[Array]:
    """(3, 3) rotations of a tool that looks down on a facet, part frame, evenly about its normal from where tool x goes
    along the facet's longest side."""
    z, x = -shape.normals[facet], axes_on(shape, facet)[0]
    first = np.column_stack([x, np.cross(z, x), z])
    angles = np.linspace(0.0, 2.0 * np.pi, TURNS, endpoint=False)
    return [first @ frames.rotation_from_vector(np.array([0.0, 0.0, angle])) for angle in angles]


def axes_on(shape: Polyhedron, facet: int) -> Array:
    """(2, 3) unit axes in a facet's plane, the first along its longest side."""
    corners, normal = shape.corners_mm[shape.rings[facet]], shape.normals[facet]
    sides = np.roll(corners, -1, axis=0) - corners
    along = sides[int(np.linalg.norm(sides, axis=1).argmax())]
    x = along - (along @ normal) * normal
    x = x / np.linalg.norm(x)
    return np.array([x, np.cross(normal, x)])


@lru_cache(maxsize=256)
def clearances_on(shape: Polyhedron, facet: int) -> tuple[Array, Array]:
    """(P, 3) points of a grid on a facet, part frame, and (P,) how far each is from the facet's border, the rims of its
    holes, and what of the part rises above it; 0 outside, in a hole, and under what rises."""
    axes, origin = axes_on(shape, facet), shape.corners_mm[shape.rings[facet][0]]
    ring = (shape.corners_mm[shape.rings[facet]] - origin) @ axes.T
    holes = [(hole.ring_mm - origin) @ axes.T for hole in shape.holes if hole.facet == facet]
    low, high = ring.min(axis=0), ring.max(axis=0)
    pitch = max(PITCH_MM, float(np.sqrt(np.prod(high - low) / MOST_POINTS)))
    x, y = np.meshgrid(*(np.arange(a + pitch / 2, b, pitch) for a, b in zip(low, high, strict=True)))
    flat = np.column_stack([x.ravel(), y.ravel()])
    above = _outlines_above_facet(shape, facet, origin, axes, RISES_MM)
    on = inside(flat, ring[None])[0]
    for other in (*holes, *above):
        on &= ~inside(flat, other[None])[0]
    flat = flat[on]
    rooms = np.full(len(flat), np.inf)
    for each in (ring, *holes, *above):
        rooms = np.minimum(rooms, _distance_from_sides(flat, each))
    return origin + flat @ axes, rooms


def _outlines_above_facet(shape: Polyhedron, facet: int, origin: Array, axes: Array, over_mm: float) -> list[Array]:
    """(K, 2) each: what of the part's other faces is higher than over_mm above a facet's plane, along its axes from a
    point (3,) of it."""
    others = [shape.corners_mm[r] for k, r in enumerate(shape.rings) if k != facet] + list(shape.covers)
    cuts = (_clipped_above(each - origin, axes, shape.normals[facet], over_mm) for each in others)
    return [cut for cut in cuts if cut is not None]


def _clipped_above(corners: Array, axes: Array, normal: Array, over_mm: float) -> Array | None:
    """(K, 2) what of a polygon (N, 3) is higher than over_mm above a plane through the origin, seen along the plane's
    normal; None: nothing."""
    heights = corners @ normal - over_mm
    if heights.max() <= 0.0:
        return None
    kept = []
    for a, b, low, high in zip(corners, np.roll(corners, -1, axis=0), heights, np.roll(heights, -1), strict=True):
        if low > 0.0:
            kept.append(a)
        if low * high < 0.0:
            kept.append(a + (b - a) * low / (low - high))
    return np.array(kept) @ axes.T


def _distance_from_sides(points: Array, ring: Array) -> Array:
    """(P,) how far points (P, 2) are from the nearest side of a ring (K, 2)."""
    return np.asarray(off_segments(points[:, None], ring, np.roll(ring, -1, axis=0)).min(axis=1))
