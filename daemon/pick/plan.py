"""What a pick is set to do: settings, places, the order of parts, and a whole approach checked before its first move.

Pure: what is seen and what the arm can reach in, plans out. Doing them is daemon/pick/picking.py.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from daemon import approach, frames
from daemon.approach import Doubt, Reachable, Stops
from daemon.guard import Limits, Point
from daemon.pick.grasp import Grasp, Gripper, grasps, tool_rotation
from daemon.pick.looking import Look, Settling
from daemon.pick.motion import Arrival
from daemon.pick.tracking import Shape, poses_that_fit
from daemon.vision.data import Facet

Array = NDArray[np.float64]


UNKNOWN = "unknown"
SAME_PLACE_MM = 30.0
"""Two parts seen nearer than this to one place are one part."""
CLOSE_MM = 340.0
"""From how far a part that could not be named is looked at again."""


PATH_MM = 40.0
"""How densely a straight way is checked."""
MOST_CHANGE_MM = 25.0
"""How far a grasp may change from look to look (a radian of turn counts as 50 mm)."""


@dataclass(frozen=True)
class View:
    """From where to look at the table: the point looked at, how far the cameras are from it, and how the tool leans
    (heading: the horizontal direction it leans to, degrees from world x; tilt from straight down)."""

    centre_mm: Point = (520.0, 0.0, -280.0)
    distance_mm: float = 480.0
    heading_deg: float = 0.0
    tilt_deg: float = 45.0

    def pose(self, tool_from_cyclopean: Array) -> Array:
        """world_from_tool (4, 4)."""
        rotation = tool_rotation(heading(self.heading_deg), float(np.radians(self.tilt_deg)))
        return approach.look_pose(rotation, np.array(self.centre_mm), self.distance_mm, tool_from_cyclopean)


@dataclass(frozen=True)
class Place:
    """A taught place of the tool centre point, mm, leaning as a View does."""

    point_mm: Point
    heading_deg: float = 0.0
    tilt_deg: float = 0.0

    def pose(self) -> Array:
        """world_from_tool (4, 4)."""
        rotation = tool_rotation(heading(self.heading_deg), float(np.radians(self.tilt_deg)))
        return frames.rigid(rotation, np.array(self.point_mm))


@dataclass(frozen=True)
class Settings:
    """All of a pick. surveys: from where the table is looked at, until a part has a name; last_surveys: from where else
    before it is called empty; order: which part first; tries: how often one part is tried; views_of_doubtful: how often
    a part that cannot be named is looked at from another side; verify_mm: from how far the place is looked at
    afterwards; gone_mm: a part this near to where it lay still lies there; hand_s: what fingers need;
    epipolar_limit_px: beyond it a camera was knocked."""

    surveys: tuple[View, ...] = (View(heading_deg=50.0), View(heading_deg=-50.0), View(heading_deg=90.0))
    last_surveys: tuple[View, ...] = (View(heading_deg=-90.0, tilt_deg=35.0), View(heading_deg=0.0, tilt_deg=20.0))
    home: Place = Place((420.0, 0.0, 60.0), tilt_deg=20.0)
    bin: Place = Place((250.0, 410.0, -150.0), heading_deg=58.0, tilt_deg=10.0)
    order: Literal["nearest", "surest"] = "surest"
    tries: int = 2
    views_of_doubtful: int = 4
    travel_pct: float = 100.0
    near_pct: float = 30.0
    pregrasp_mm: float = 50.0
    lift_mm: float = 60.0
    verify_mm: float = 300.0
    gone_mm: float = 30.0
    epipolar_limit_px: float = 1.0
    hand_s: float = 0.0
    limits: Limits = field(default_factory=Limits)
    arrival: Arrival = field(default_factory=Arrival)
    stops: Stops = field(default_factory=Stops)
    doubt: Doubt = field(default_factory=Doubt)
    gripper: Gripper = field(default_factory=Gripper)
    settling: Settling = field(default_factory=Settling)


@dataclass(frozen=True, eq=False)
class Seen:
    """A part as one look saw it, in the world: what for, how sure, where, and its facets (in that look's frame)."""

    label: str
    confidence: float
    ambiguous: bool
    candidates: tuple[str, ...]
    reason: str
    world_from_part: Array
    facets: tuple[Facet, ...]
    look: Look

    @property
    def named(self) -> bool:
        """Whether it was recognised as one taught part."""
        return not self.ambiguous and self.label != UNKNOWN

    @property
    def centre(self) -> Array:
        """(3,) world, mm: mean of the seen corners."""
        corners = np.concatenate([f.corners_mm for f in self.facets])
        centre: Array = frames.apply(self.look.world_from_cyclopean, corners).mean(axis=0)
        return centre

    @property
    def corners(self) -> Array:
        """(N, 3) world, mm: the seen corners."""
        return frames.apply(self.look.world_from_cyclopean, np.concatenate([f.corners_mm for f in self.facets]))


class Quality(Protocol):
    """What a calibration says of itself (daemon/calibration/file.py)."""

    @property
    def reprojection_px(self) -> float | None: ...

    @property
    def hand_eye_mm(self) -> float | None: ...

    @property
    def hand_eye_deg(self) -> float | None: ...


def doubt_of(quality: Quality) -> Doubt:
    """The doubts a calibration admits to; where it says nothing, the careful default."""
    said = {
        "pixels": quality.reprojection_px,
        "hand_eye_mm": quality.hand_eye_mm,
        "hand_eye_deg": quality.hand_eye_deg,
    }
    return replace(Doubt(), **{name: value for name, value in said.items() if value is not None})


def heading(degrees: float) -> Array:
    """Unit horizontal direction (3,) at an angle from world x."""
    angle = np.radians(degrees)
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def seen_parts(look: Look) -> list[Seen]:
    """The look's parts in the world."""
    return [
        Seen(
            label=part.recognition.label,
            confidence=part.recognition.confidence,
            ambiguous=part.recognition.ambiguous,
            candidates=part.recognition.candidates,
            reason=part.recognition.reason,
            world_from_part=look.world_from_cyclopean @ part.cyclopean_from_part,
            facets=part.facets,
            look=look,
        )
        for part in look.scene.parts
        if part.facets
    ]


def merged(before: Sequence[Seen], now: Sequence[Seen]) -> list[Seen]:
    """What is known to lie there after another look: the newest sight of each place, but a name is not unlearnt."""
    kept = [old for old in before if not any(_same_place(old, new) for new in now)]
    for new in now:
        named = [old for old in before if old.named and _same_place(old, new)]
        kept.append(named[0] if named and not new.named else new)
    return kept


def _same_place(a: Seen, b: Seen) -> bool:
    return float(np.linalg.norm(a.centre - b.centre)) < SAME_PLACE_MM


def ordered(parts: Sequence[Seen], order: str) -> list[Seen]:
    """Nearest to the cameras first, or surest first; parts with one name before the others."""

    def rank(part: Seen) -> tuple[bool, float]:
        away = float(np.linalg.norm(part.centre - part.look.world_from_cyclopean[:3, 3]))
        return not part.named, away if order == "nearest" else -part.confidence

    return sorted(parts, key=rank)


BLIND_RAD = 0.5
"""A look from within this angle of one that did not find the part would not find it either."""


@dataclass(frozen=True, eq=False)
class Plan:
    """How one part will be taken: the grasp, and how well looks along its approach show the part (0 to 2)."""

    grasp: Grasp
    worth: float


@dataclass(frozen=True, eq=False)
class Facing:
    """A facet in the world: its centre (3,) mm and outward unit normal (3,)."""

    centre: Array
    normal: Array


def facings(part: Seen) -> list[Facing]:
    """The facets a look saw of a part."""
    turn = part.look.world_from_cyclopean
    found = []
    for facet in part.facets:
        corners = frames.apply(turn, facet.corners_mm)
        around = corners - corners.mean(axis=0)
        normal = np.cross(around, np.roll(around, -1, axis=0)).sum(axis=0)
        found.append(Facing(corners.mean(axis=0), normal / np.linalg.norm(normal)))
    return found


def is_own(other: Seen, part: Seen) -> bool:
    """Whether what was seen beside a named part is nothing but one of its facets, measured worse: a lone unnamed facet
    whose middle lies within the part's reach. It would keep the fingers from every grasp."""
    reach = float(np.linalg.norm(part.corners - part.centre, axis=1).max())
    lone = not other.named and len(other.facets) == 1
    return lone and float(np.linalg.norm(other.centre - part.centre)) < reach


def seen_again(seen: Sequence[Facing], eye: Array, least_cosine: float = 0.3) -> float:
    """How well the facets told apart before would show to the eye (3,), world: 0 to 1, their mean."""
    if not seen:
        return 0.0
    rays = [eye - f.centre for f in seen]
    cosines = [float(f.normal @ ray) / float(np.linalg.norm(ray)) for f, ray in zip(seen, rays, strict=True)]
    return float(np.mean(np.sqrt(np.clip((np.array(cosines) - least_cosine) / (1 - least_cosine), 0, 1))))


def approach_poses(grasp: Grasp, centre: Array, settings: Settings, tool_from_cyclopean: Array) -> list[Array]:
    """Every pose of the approach and the retreat, in order; world_from_tool."""
    at = grasp.world_from_tool
    looks = [
        approach.look_pose(at[:3, :3], centre, d, tool_from_cyclopean)
        for d in (*settings.stops.stand_offs_mm, settings.verify_mm)
    ]
    return [
        *looks[:-1],
        approach.backed_off(at, settings.pregrasp_mm),
        at,
        approach.lifted(at, settings.lift_mm),
        looks[-1],
    ]


def plan_part(
    shape: Shape,
    world_from_part: Array,
    neighbours: Sequence[Array],
    settings: Settings,
    tool_from_cyclopean: Array,
    allowed: Reachable,
    seen: Sequence[Facing] = (),
    blind: Sequence[Array] = (),
) -> Plan | str:
    """The best grasp whose whole approach is allowed (reached, in the box, above the table), or why there is none.

    seen: facets that a look has told apart; their shading, and so their contrast, is the same from everywhere, so that
    a look along the approach should show them again. blind: (3,) directions from the part in which a camera stood that
    did not find it.
    """
    try:
        found = grasps(shape.corners_mm, world_from_part, settings.limits.table_z_mm, settings.gripper, neighbours)
    except ValueError as error:
        return f"taught corners give no solid to grasp: {error}"
    if not found:
        return "no grasp holds it as it lies"
    centre = frames.apply(world_from_part, shape.corners_mm).mean(axis=0)
    middle = settings.stops.stand_offs_mm[len(settings.stops.stand_offs_mm) // 2]
    plans = []
    for grasp in found:
        pose = approach.look_pose(grasp.world_from_tool[:3, :3], centre, middle, tool_from_cyclopean)
        eye = (pose @ tool_from_cyclopean)[:3, 3]
        if any(approach.angle_at(centre, eye, centre + away) < BLIND_RAD for away in blind):
            continue
        worth = approach.view_worth(shape, world_from_part, eye) + seen_again(seen, eye)
        plans.append(Plan(grasp, worth))
    if not plans:
        return "it was looked for from every side that a grasp leaves"
    plans.sort(key=lambda p: (p.grasp.blocked, p.grasp.slip_deg / 45.0 - p.worth))
    for plan in plans:
        if not plan.grasp.blocked:
            poses = approach_poses(plan.grasp, centre, settings, tool_from_cyclopean)
            if all(allowed(pose) for pose in poses) and all(
                allowed(pose) for a, b in pairwise(poses) for pose in approach.steps(a, b, PATH_MM, 90.0)[:-1]
            ):
                return plan
    blocked = sum(p.grasp.blocked for p in plans)
    return f"none of its {len(plans)} grasps can be reached all the way ({blocked} blocked by a neighbour)"


def other_view(
    part: Seen,
    shape_of: Callable[[str], Shape | None],
    eyes_before: Sequence[Array],
    tool_from_cyclopean: Array,
    allowed: Reachable,
) -> tuple[Array | None, str]:
    """Where to look at a part that could not be named, and why: from where its candidates would show most facets and
    look most unlike, away from every look before. world_from_tool, or None where no view of it is allowed."""
    x, y, z = (float(v) for v in part.centre)
    views = [View((x, y, z), CLOSE_MM, float(h), float(t)) for h in range(-180, 180, 30) for t in (20, 35, 50)]
    poses = [p for p in (v.pose(tool_from_cyclopean) for v in views) if allowed(p)]
    eyes = [(p @ tool_from_cyclopean)[:3, 3] for p in poses]
    if not poses:
        return None, "no other view of it is in reach"
    candidates = []
    for label in part.candidates:
        shape = shape_of(label)
        fits = poses_that_fit(shape, part.facets) if shape is not None else []
        if shape is not None and fits:
            candidates.append((shape, part.look.world_from_cyclopean @ fits[0].cyclopean_from_part))
    before = [*eyes_before, part.look.world_from_cyclopean[:3, 3]]
    fresh = [min(approach.angle_at(part.centre, eye, old) for old in before) for eye in eyes]
    if not candidates:
        return poses[int(np.argmax(fresh))], f"from another side: {part.reason}"
    unlike = [approach.unlikeness(candidates, eye) for eye in eyes]
    worth = [min(approach.view_worth(shape, pose, eye) for shape, pose in candidates) for eye in eyes]
    scores = [w + u / 2 + min(f, 0.6) for w, u, f in zip(worth, unlike, fresh, strict=True)]
    return poses[int(np.argmax(scores))], f"to tell whether it is {' or '.join(part.candidates)}: {part.reason}"


def regrasp(shape: Shape, world_from_part: Array, before: Plan, settings: Settings) -> Plan | None:
    """The same grasp on the part where it is now known to be: the nearest of today's grasps by turn and place. None
    where none is near (the part lies otherwise than was thought: plan again)."""
    old = before.grasp.world_from_tool
    table_z_mm, gripper = settings.limits.table_z_mm, settings.gripper
    found = grasps(shape.corners_mm, world_from_part, table_z_mm, gripper, near=old[:3, :3])

    def away(grasp: Grasp) -> float:
        gap = float(np.linalg.norm(grasp.world_from_tool[:3, 3] - old[:3, 3]))
        return gap + 50.0 * frames.angle_between(grasp.world_from_tool, old)

    nearest = min(found, key=away, default=None)
    return None if nearest is None or away(nearest) > MOST_CHANGE_MM else Plan(nearest, before.worth)
