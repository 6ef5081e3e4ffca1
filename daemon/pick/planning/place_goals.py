"""Goals at places: the pose that a part should have, the gripper's poses that bring it there, its deviation. Pure.

A place holds the pose of the part, never of the tool: that follows from how the part is held. Going there is
set_down.py's.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise, product
from typing import NamedTuple

import cv2
import numpy as np

from daemon import frames
from daemon.arm import PATH_MM, CameraMounting, FixtureBox, SupportContact, paths
from daemon.arrays import Array
from daemon.pick.planning.viewpoints import Reachable
from daemon.pick.settings import Settings, SurveyView
from daemon.store.place_file import Fixture, Place, PlaceSettings, about_vertical, pattern_of
from daemon.store.place_status import PlaceSpot
from daemon.vision.geometry import Polyhedron
from daemon.vision.model import Axis, axis_of_revolution, turns_onto_themselves

ALIKE_MM = 1.5
"""Turns of a part after which every corner is this near to one look the same: taught corners err by less than half."""
FLAT_MM = 3.0
"""Three corners of what a part rests on are as high as each other to within so much."""
NEARLY_FLAT_RAD = 0.06
"""A side that leans by less lies flat: looks err by less."""
UPSIDE_DOWN = np.diag([1.0, -1.0, -1.0])
"""A half turn about x: what Polyhedron.laid_flat lays face up comes to lie on that face."""
LOOK_TILTS_DEG = 30.0, 10.0, 50.0
"""How far looks at a place lean where the arm cannot look at it as it has set the part down."""
TOUCH_MM = 0.1
"""Parts of a pattern that touch one another by no more than rounding do not overlap."""


TABLE = "the table"
"""Where a part is laid down between two grasps, as the name of a goal: no place of a cell is called so."""


class PartPlaceError(ValueError):
    """A place cannot be one of this part, and why."""


@dataclass(frozen=True, eq=False)
class Goal:
    """A place for a part of known shape. poses: world_from_part (4, 4) mm, the one of the file first, then those that
    look the same; level_mm: height of what the part rests on, world z."""

    place: Place
    shape: Polyhedron
    poses: tuple[Array, ...]
    level_mm: float

    @property
    def between(self) -> bool:
        """Whether the part lies here between two grasps only."""
        return self.place.name == TABLE

    @property
    def description(self) -> str:
        """In words: place nest."""
        return TABLE if self.between else f"place {self.place.name}"

    @property
    def centre(self) -> Array:
        """(3,) world mm: mean of the shape's corners."""
        centre: Array = frames.apply(self.poses[0], self.shape.corners_mm).mean(axis=0)
        return centre

    @property
    def corners(self) -> Array:
        """(N, 3) world mm."""
        return frames.apply(self.poses[0], self.shape.corners_mm)

    @cached_property
    def outline(self) -> list[list[float]]:
        """From above: (x, y) world mm of its corners, anticlockwise."""
        return outline_of(self.corners[:, :2])

    def nearest(self, world_from_part: Array) -> Array:
        """The one (4, 4) of the poses that look the same that is nearest to how a part lies: a body of revolution may
        lie in any turn about its axis."""
        corners = frames.apply(world_from_part, self.shape.corners_mm)
        poses = [self._turned_as(pose, world_from_part) for pose in self.poses]
        apart = [np.linalg.norm(frames.apply(pose, self.shape.corners_mm) - corners, axis=1).max() for pose in poses]
        return poses[int(np.argmin(apart))]

    def _turned_as(self, pose: Array, world_from_part: Array) -> Array:
        """A pose turned about the axis of a body of revolution to be as near as it can to another one (4, 4)."""
        if self.axis is None:
            return pose
        way = self.axis.direction
        about = frames.rotation_from_vector(way * frames.turn_about(way, pose[:3, :3].T @ world_from_part[:3, :3]))
        return pose @ frames.rigid(about, self.axis.point_mm - about @ self.axis.point_mm)

    @cached_property
    def axis(self) -> Axis | None:
        """That about which any turn of the part will do; None where one must be kept."""
        if self.place.settings.any_turn:
            return Axis(self.shape.corners_mm.mean(axis=0), self.poses[0][2, :3])
        return axis_of_revolution(self.shape) if self.place.settings.equivalents else None

    @property
    def spot(self) -> PlaceSpot:
        """Where its status is kept of."""
        return spot_of(self.place.settings, self.shape, self.poses[0])


@dataclass(frozen=True, eq=False)
class SetDown:
    """How a held part is set down: world_from_tool (4, 4) mm over the place, where the gripper opens, clear of the part
    again, and from where the place is looked at; pose: world_from_part that is aimed at; contact: what it rests on."""

    goal: Goal
    pose: Array
    over: Array
    at: Array
    clear: Array
    look: Array
    contact: SupportContact

    @property
    def ways(self) -> tuple[Array, ...]:
        """The poses in order."""
        return self.over, self.at, self.clear, self.look


class PlaceDeviation(NamedTuple):
    """How far a part lies from its place: off_mm of its middle along the support; off_deg of its turn, from the nearest
    pose that looks the same; height_mm of its middle, above (or below) where it would rest."""

    off_mm: float
    off_deg: float
    height_mm: float = 0.0

    def __str__(self) -> str:
        return f"{self.off_mm:.2f} mm and {self.off_deg:.2f} degrees off"


@lru_cache(maxsize=512)
def goal_of(place: Place, shape: Polyhedron) -> Goal:
    """A place for a part of this shape. Raises PartPlaceError where the part has no such side."""
    if place.frame_from_part is not None:
        pose = place.world_from_frame @ place.frame_from_part
    else:
        pose = place.world_from_frame @ _on_side(place, shape)
    motions = turns_onto_themselves((shape,), ALIKE_MM)[0].motions if place.settings.equivalents else [np.eye(4)]
    heights = np.sort(frames.apply(pose, shape.corners_mm)[:, 2])
    if heights[min(2, len(heights) - 1)] - heights[0] > FLAT_MM:
        raise PartPlaceError(
            f"{place.part} would not lie flat there: teach the place again, with the part on its support"
        )
    level_mm = float(heights[0])
    return Goal(place, shape, tuple(pose @ motion for motion in motions), level_mm)


def outline_of(points: Array) -> list[list[float]]:
    """The convex hull of (N, 2), anticlockwise, to a tenth."""
    rounded = np.round(points, 1)
    corners = np.ravel(cv2.convexHull(rounded.astype(np.float32), clockwise=False, returnPoints=False)).astype(int)
    outline: list[list[float]] = rounded[corners].tolist()
    return outline


def spot_of(place_settings: PlaceSettings, shape: Polyhedron, world_from_part: Array) -> PlaceSpot:
    """Where a part lies, as the status of a place keeps it."""
    corners = frames.apply(world_from_part, shape.corners_mm)
    middle = corners.mean(axis=0)
    reach_mm = float(np.linalg.norm(corners - middle, axis=1).max())
    turn = world_from_part[:3, :3]
    return PlaceSpot(
        place_settings.part, middle, turn, reach_mm, place_settings.tolerance_mm, place_settings.tolerance_deg
    )


def _on_side(place: Place, shape: Polyhedron) -> Array:
    """(4, 4) frame_from_part with a side down, the middle of its corners at the place's point, its first edge along the
    place's heading."""
    assert place.side_down is not None
    assert place.point_mm is not None
    if place.side_down > len(shape.rings):
        raise PartPlaceError(f"{place.part} has {len(shape.rings)} sides, and side_down is {place.side_down}")
    turned = frames.rigid(about_vertical(place.heading_deg) @ UPSIDE_DOWN, np.array(place.point_mm))
    return np.asarray(turned @ shape.flat_from_solid[place.side_down - 1])


def set_down_of(
    goal: Goal, pose: Array, tool_from_part: Array, settings: Settings, mounting: CameraMounting
) -> SetDown:
    """How a part that is held like this gets to one of the poses of its goal."""
    place_settings = goal.place.settings
    at = paths.lifted(pose, place_settings.release_mm) @ frames.inverse(tool_from_part)
    look = mounting.look_pose(at[:3, :3], goal.centre, settings.verify_mm)
    return SetDown(
        goal,
        pose,
        paths.lifted(at, place_settings.approach_mm),
        at,
        paths.backed_off(at, settings.pregrasp_mm),
        look,
        SupportContact(goal.level_mm, fixture_names(place_settings.fixture, settings)),
    )


def ways_to(
    goal: Goal,
    tool_from_part: Array,
    settings: Settings,
    mounting: CameraMounting,
    allowed: Reachable,
    neighbours: Sequence[Array],
) -> Iterator[SetDown]:
    """The ways that arm, table, fixtures and neighbours leave open. neighbours: (M, 3) world corners of the parts that
    lie at places beside it."""
    for pose in goal.poses:
        way = set_down_of(goal, pose, tool_from_part, settings, mounting)
        if any(settings.gripper.sweeps(way.at, each) for each in neighbours):
            continue
        if goes_through(way.ways[:3], allowed):
            looks = np.stack([way.look, *looks_round(goal.centre, settings, mounting)])
            if (seen_from := np.flatnonzero(allowed(looks))).size:
                yield replace(way, look=looks[seen_from[0]])


def looks_round(centre: Array, settings: Settings, mounting: CameraMounting) -> Iterator[Array]:
    """world_from_tool (4, 4) from where what lies at a centre (3,) may be looked at."""
    x, y, z = (float(each) for each in centre)
    for tilt_deg, heading_deg in product(LOOK_TILTS_DEG, range(-180, 180, 45)):
        yield SurveyView((x, y, z), settings.verify_mm, float(heading_deg), tilt_deg).pose(mounting)


def goes_through(poses: Sequence[Array], allowed: Reachable) -> bool:
    """Whether the arm can have each of these poses (4, 4), and those straight between one and the next."""
    between = [pose for a, b in pairwise(poses) for pose in paths.steps(a, b, PATH_MM, 90.0)[:-1]]
    return bool(allowed(np.stack([*poses, *between])).all())


def too_tight(goals: Mapping[str, Goal]) -> dict[str, str]:
    """The places of patterns whose parts would overlap with one at another place of the same layer, each with a reason.

    Two places of different names may be meant for one spot: a part that lies there bars the other.
    """
    found: dict[str, str] = {}
    by_pattern: dict[tuple[str, float], list[Goal]] = {}
    for name, goal in goals.items():
        if pattern_of(name) != name:
            by_pattern.setdefault((pattern_of(name), round(goal.level_mm, 3)), []).append(goal)
    for (pattern, _), places in by_pattern.items():
        points = places[0].corners[:, :2]
        edges = (points[:, None] - points[None]).reshape(-1, 2)
        edges = edges[np.linalg.norm(edges, axis=1) > TOUCH_MM]
        across = np.column_stack([-edges[:, 1], edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
        widths = np.ptp(points @ across.T, axis=0)
        middles = np.array([goal.centre[:2] for goal in places])
        for number, goal in enumerate(places):
            apart = np.abs((middles[:number] - middles[number]) @ across.T)
            bars = np.flatnonzero((apart < widths - TOUCH_MM).all(axis=1))
            if len(bars):
                other = places[int(bars[0])].place.name
                found[goal.place.name] = f"parts here and at {other} would overlap: set the corners of {pattern} wider"
    return found


def flattened(world_from_part: Array, shape: Polyhedron, table_z_mm: float) -> Array:
    """The pose as the part must lie that rests: the side that looks down most exactly down, where it nearly does, and
    on the table, where it is nearly there."""
    downs = -(shape.normals @ world_from_part[:3, :3].T)[:, 2]
    down = world_from_part[:3, :3] @ shape.normals[int(downs.argmax())]
    axis, pose = np.cross(down, [0.0, 0.0, -1.0]), world_from_part
    lean = float(np.arctan2(np.linalg.norm(axis), -down[2]))
    if 0.0 < lean < NEARLY_FLAT_RAD:
        middle = frames.apply(pose, shape.corners_mm).mean(axis=0)
        upright = frames.rotation_from_vector(axis / np.linalg.norm(axis) * lean)
        pose = frames.rigid(np.eye(3), middle) @ frames.rigid(upright, -upright @ middle) @ pose
    above_mm = float(frames.apply(pose, shape.corners_mm)[:, 2].min()) - table_z_mm
    return paths.lifted(pose, -above_mm) if abs(above_mm) < FLAT_MM else pose


def fixture_boxes(fixtures: Sequence[Fixture]) -> tuple[FixtureBox, ...]:
    """The solids of fixtures as boxes that arm and gripper keep out of."""
    return tuple(
        FixtureBox(f"fixture {f.name}, box {k}", box.low_mm, box.high_mm, f.entry.point_mm, f.entry.heading_deg)
        for f in fixtures
        for k, box in enumerate(f.entry.solid, start=1)
    )


def fixture_names(fixture: str | None, settings: Settings) -> tuple[str, ...]:
    """The names of the boxes of a fixture among the limits' keep-outs."""
    start = f"fixture {fixture}, box "
    return tuple(box.name for box in settings.limits.keep_out if fixture and box.name.startswith(start))


def deviation(goal: Goal, world_from_part: Array) -> PlaceDeviation:
    """How far a part that lies like this is from its goal."""
    corners = frames.apply(world_from_part, goal.shape.corners_mm)
    nearest = goal.nearest(world_from_part)
    away = corners.mean(axis=0) - frames.apply(nearest, goal.shape.corners_mm).mean(axis=0)
    turned = float(np.degrees(frames.angle_between(nearest, world_from_part)))
    return PlaceDeviation(float(np.linalg.norm(away[:2])), turned, float(away[2]))
