"""Plan regrasps: place a part on the table between two grasps, to reach a side that one grasp cannot. Pure.

The nodes of a graph are a part on one of its stable sides with a grasp of it there; an edge is a pick and set-down with
that grasp, which the arm can reach at both ends with the hand clear of the table and of obstacles. The shortest path is
the plan, of at most MOST_GRASPS grasps. Results that depend only on part and gripper (sides, grasps, which grasp keeps
the hand clear of the table on which side) are computed once (`grasp_table`); reachability is computed for the present
scene, for many poses at once. Source: Tournassoud, Lozano-Perez and Mazer, Regrasping (1987); D'Souza leaves it open.
"""

from collections import OrderedDict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from daemon import frames
from daemon.arm import CameraMounting, hand_of, paths
from daemon.arrays import Array, Flags, Index
from daemon.events.codes import CauseCode
from daemon.pick.grippers import Gripper, PlannedGrasp, centre_of_mass, contact_hull, hull
from daemon.pick.looks import Look
from daemon.pick.planning.place_goals import (
    NEARLY_FLAT_RAD,
    TABLE,
    UPSIDE_DOWN,
    Goal,
    SetDown,
    goes_through,
    looks_round,
    set_down_of,
    ways_to,
)
from daemon.pick.planning.plan import (
    MOST_GOALS,
    SHOWS_COUNT,
    Destination,
    NoPlan,
    approach_poses,
    final_approach,
    held_part_visibility,
    is_supported,
    stable_sides,
)
from daemon.pick.planning.table_room import Obstacles, free_spots, obstacles_of
from daemon.pick.planning.viewpoints import Reachable, view_worth
from daemon.pick.seen import in_both_images
from daemon.pick.settings import Settings
from daemon.store.place_file import Place, PlaceSettings, about_vertical
from daemon.vision.geometry import Polyhedron, StereoRig

MOST_GRASPS = 3
"""Maximum number of grasps of a plan."""
HEADINGS = 16
"""Number of evenly spaced headings for a set-down."""
MOST_SPOTS = 12
"""Maximum number of free spots tried for each side."""
RELEASE_MM = 0.5
"""Height over the table at which the gripper opens."""
AS_LAID_MM, AS_LAID_DEG = 10.0, 10.0
"""A part this near to its set-down pose has not toppled."""
ROUND_MM = 0.1
"""A face of the convex hull beyond which a curved surface bulges by more is no stable side."""
MOST_TABLES = 32


@dataclass(frozen=True, eq=False)
class GraspTable:
    """Grasps of a part by a gripper on all its stable sides. lying (S, 4, 4): its stable poses at the origin of a table
    at z = 0; reach_mm (S,): its radius there along the table. Of G grasps: grasps, and the side (G,) of each;
    part_from_tool (G, 4, 4)."""

    lying: Array
    reach_mm: Array
    grasps: tuple[PlannedGrasp, ...]
    side: Index
    part_from_tool: Array


_TABLES = OrderedDict[tuple[object, ...], GraspTable]()


def grasp_table(shape: Polyhedron, gripper: Gripper, error_mm: float) -> GraspTable:
    """The grasp table of a part and a gripper; cached. Raises ValueError where the corners span no volume."""
    key = (shape.corners_mm.tobytes(), shape.facets, gripper, error_mm)
    if key not in _TABLES:
        _TABLES[key] = work_out_grasps(shape, gripper, error_mm)
        while len(_TABLES) > MOST_TABLES:
            _TABLES.popitem(last=False)
    _TABLES.move_to_end(key)
    return _TABLES[key]


def work_out_grasps(shape: Polyhedron, gripper: Gripper, error_mm: float) -> GraspTable:
    """Compute the grasps of a part on each of its stable sides."""
    lying = resting_poses(shape)
    reach = [np.linalg.norm(frames.apply(pose, shape.corners_mm)[:, :2], axis=1).max() for pose in lying]
    found = [(n, grasp) for n, pose in enumerate(lying) for grasp in gripper.grasps(shape, pose, 0.0, error_mm).found]
    on_side = np.array([n for n, _ in found], np.intp)
    grasps = tuple(grasp for _, grasp in found)
    held = [frames.inverse(lying[n]) @ grasp.world_from_tool for n, grasp in found]
    return GraspTable(lying, np.array(reach), grasps, on_side, np.reshape(held, (-1, 4, 4)))


def resting_poses(shape: Polyhedron) -> Array:
    """(S, 4, 4) stable poses of a part of uniform density on a table at z = 0, the centre of the supporting face at the
    origin: on each of its sides and each face of its convex hull that supports its centre of mass, except curved ones.
    Raises ValueError where the corners span no volume."""
    ground, mass = hull(shape.corners_mm), centre_of_mass(contact_hull(shape))
    round_mm = np.concatenate([shape.covers.reshape(-1, 3), *(arc.points_mm for arc in shape.arcs)])
    found = [shape.flat_from_solid[side] for side in stable_sides(shape)]
    for side, laid in enumerate(ground.flat_from_solid):
        beyond_mm = frames.apply(laid, round_mm)[:, 2].max(initial=0.0)
        known = any(laid[2, :3] @ other[2, :3] > np.cos(NEARLY_FLAT_RAD) for other in found)
        if not known and beyond_mm < ROUND_MM and is_supported(mass, ground, side):
            found.append(laid)
    return np.reshape(frames.rigid(UPSIDE_DOWN, np.zeros(3)) @ np.reshape(found, (-1, 4, 4)), (-1, 4, 4))


@dataclass(frozen=True, eq=False)
class RegraspStep:
    """One pick and set-down: the grasp, world_from_tool, and how the part is set down with it, on the table or, the
    last one, at its place."""

    grasp: PlannedGrasp
    way: SetDown


@dataclass(frozen=True, eq=False)
class _PartHeld:
    """A part in the gripper: tool_from_part (4, 4), the grasp that took it, and the steps before."""

    tool_from_part: Array
    grasp: PlannedGrasp
    before: tuple[RegraspStep, ...] = ()


@dataclass(frozen=True, eq=False)
class Regrasping:
    """What a plan is made of: the part, where it belongs, the arm, what lies beside (neighbours: (M, 3) world corners,
    mm), and the looks that have shown what of the table is free; none: all of it is."""

    shape: Polyhedron
    destination: Destination
    settings: Settings
    mounting: CameraMounting
    allowed: Reachable
    rig: StereoRig
    neighbours: Sequence[Array] = ()
    looks: Sequence[Look] = ()

    @cached_property
    def beside(self) -> Obstacles:
        return obstacles_of([*self.neighbours, *self.destination.taken])

    @cached_property
    def table(self) -> GraspTable:
        gripper = self.settings.gripper.turning
        assert gripper is not None
        return grasp_table(self.shape, gripper, self.settings.stops.enough_mm)

    def plan(self, world_from_part: Array, most: int = MOST_GRASPS) -> tuple[RegraspStep, ...] | NoPlan:
        """The shortest plan for a part that lies like this, of at most so many grasps, or why there is none. Raises
        ValueError where its corners span no volume."""
        if self.settings.gripper.turning is None:
            return NoPlan(CauseCode.NO_WAY_TO_PLACE, "this gripper turns no part over")
        held = list(self._first(world_from_part))
        if not held:
            return NoPlan(CauseCode.OUT_OF_REACH, "no grasp of it as it lies can be reached all the way")
        if (found := self._search(held)) is not None:
            return found
        ends = self._ends()
        if most > 1 and (found := self._search(self._after_one_set_down(held, ends))) is not None:
            return found
        if most > 2 and ends.any():
            between = list(self._after_one_set_down(held, self._grasps_before(ends)))
            if (found := self._search(self._after_one_set_down(between, ends))) is not None:
                return found
        goals = ", ".join(goal.place.name for goal in self._goals)
        if not ends.any():
            why = f"no grasp, on whichever side it lies, can set it down at {goals} as it is to lie there"
        elif most > 1:
            why = f"no sequence of up to {most} grasps can set it down at {goals} as it is to lie there"
        else:
            why = f"none of its {len(held)} grasps in reach can set it down at {goals} as it is to lie there"
        return NoPlan(CauseCode.NO_WAY_TO_PLACE, why)

    @property
    def _goals(self) -> Sequence[Goal]:
        return self.destination.goals[:MOST_GOALS]

    def _first(self, world_from_part: Array) -> Iterator[_PartHeld]:
        """Grasps that can pick the part as it lies, the surest first."""
        found = [grasp for grasp in self._grasps_of(world_from_part) if not grasp.blocked]
        tools = np.reshape([grasp.world_from_tool for grasp in found], (-1, 4, 4))
        for number in self._best(found, tools, world_from_part):
            if self._is_reachable_grasp(tools[number], world_from_part):
                yield _PartHeld(frames.inverse(tools[number]) @ world_from_part, found[number])

    def _grasps_of(self, pose: Array) -> Sequence[PlannedGrasp]:
        """Those of the part as it lies: of the table where it lies on one of its sides."""
        gripper, settings = self.settings.gripper.turning, self.settings
        assert gripper is not None
        downs = self.table.lying[:, 2, :3] @ pose[2, :3]
        side = int(downs.argmax()) if len(downs) else 0
        if not len(downs) or downs[side] < np.cos(NEARLY_FLAT_RAD):
            table_z_mm, error_mm = settings.limits.table_z_mm, settings.stops.enough_mm
            return gripper.grasps(self.shape, pose, table_z_mm, error_mm, self.neighbours).found
        found = []
        for number in np.flatnonzero(self.table.side == side):
            tool = pose @ self.table.part_from_tool[number]
            blocked = any(gripper.sweeps(tool, each) for each in self.neighbours)
            found.append(replace(self.table.grasps[number], world_from_tool=tool, blocked=blocked))
        return found

    def _best(self, grasps: Sequence[PlannedGrasp], tools: Array, pose: Array) -> list[int]:
        """Indices of grasps, the surest first: by firmness, by how well looks on the approach show the part, and by how
        much of it shows in the gripper afterwards."""
        stand_offs, centre = self.settings.stops.stand_offs_mm, self._centre(pose)
        worth = []
        for grasp, tool in zip(grasps, tools, strict=True):
            look = self.mounting.look_pose(tool[:3, :3], centre, stand_offs[len(stand_offs) // 2])
            viewpoint = self.mounting.world_from_cyclopean_at(look)[:3, 3]
            shows = held_part_visibility(self.shape, frames.inverse(tool) @ pose, self.mounting, self.rig)
            worth.append(view_worth(self.shape, pose, viewpoint) + SHOWS_COUNT * shows - grasp.risk)
        return sorted(range(len(worth)), key=lambda number: -worth[number])

    def _centre(self, pose: Array) -> Array:
        return np.asarray(frames.apply(pose, self.shape.corners_mm).mean(axis=0))

    def _is_reachable_grasp(self, tool: Array, pose: Array) -> bool:
        """Whether the arm gets to a grasp (4, 4) of the part there and back, the hand off what lies beside."""
        centre, settings = self._centre(pose), self.settings
        at = PlannedGrasp(tool, 0.0)
        near = np.stack(final_approach(at, centre, settings, self.mounting)[:3])
        return bool(self.beside.clear(near, settings.limits).all()) and goes_through(
            approach_poses(at, centre, settings, self.mounting), self.allowed
        )

    def _is_reachable_set_down(self, way: SetDown) -> bool:
        """Whether the arm gets there and away, the hand off what lies beside."""
        near = np.stack([way.at, way.clear])
        return bool(self.beside.clear(near, self.settings.limits).all()) and goes_through(way.ways[:3], self.allowed)

    def _search(self, held: Iterable[_PartHeld]) -> tuple[RegraspStep, ...] | None:
        """The plan of the first of these that can set the part down at a goal."""
        for each in held:
            for goal in self._goals:
                ways = ways_to(
                    goal, each.tool_from_part, self.settings, self.mounting, self.allowed, self.destination.taken
                )
                for way in ways:
                    if self.beside.clear(np.stack([way.at, way.clear]), self.settings.limits).all():
                        return (*each.before, RegraspStep(each.grasp, way))
        return None

    def _ends(self) -> Flags:
        """(G,) which grasps of the table may set the part down at a goal: the arm gets to one of its poses so."""
        found = np.zeros(len(self.table.grasps), bool)
        for goal in self._goals:
            poses = np.stack([paths.lifted(pose, goal.place.settings.release_mm) for pose in goal.poses])
            tools = poses[:, None] @ self.table.part_from_tool
            found |= self._reaches(tools.reshape(-1, 4, 4)).reshape(len(poses), -1).any(axis=0)
        return found

    def _reaches(self, tools: Array) -> Flags:
        """(N,) which of (N, 4, 4) the arm can have; parts that look the same turned ask for many of them often."""
        if not len(tools):
            return np.zeros(0, bool)
        rounded = np.round(tools[:, :3] * [1e3, 1e3, 1e3, 1e1]).reshape(len(tools), -1)
        _, first, which = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
        return np.asarray(self.allowed(tools[first])[which.ravel()])

    def _clear_of_table(self, part_from_tool: Array) -> Flags:
        """(G, S) whether the open hand keeps off the table by a grasp (G, 4, 4) as the part lies on that side of it."""
        limits = self.settings.limits
        hand = hand_of(limits)
        tools = self.table.lying @ part_from_tool[:, None]
        heights = np.tensordot(tools[..., 2, :3], hand.ends_mm, (-1, -1)) + tools[..., 2, 3, None, None]
        lowest = heights.min(axis=-1) - hand.radius_mm + RELEASE_MM
        return np.asarray((lowest > limits.clearance_mm).all(axis=-1))

    def _grasps_before(self, ends: Flags) -> Flags:
        """(G,) which grasps of the table can lay the part on a side on which one of these ends takes it."""
        takes = np.array([(ends & (self.table.side == side)).any() for side in range(len(self.table.lying))])
        return np.asarray((self._clear_of_table(self.table.part_from_tool) & takes).any(axis=1) & ~ends)

    def _after_one_set_down(self, held: Sequence[_PartHeld], wanted: Flags) -> Iterator[_PartHeld]:
        """The part placed on the table by one of these and taken by a grasp that is wanted, each of those once;
        searches where on the table, and how turned."""
        if not held or not wanted.any():
            return
        left, part_from_tool = wanted.copy(), np.stack([frames.inverse(each.tool_from_part) for each in held])
        lays = self._clear_of_table(part_from_tool)
        for nth in range(MOST_SPOTS):
            for side in range(len(self.table.lying)):
                takers, givers = np.flatnonzero(left & (self.table.side == side)), np.flatnonzero(lays[:, side])
                if len(takers) and len(givers) and nth < len(self._spots[side]):
                    for giver, taker, pose in self._regrasps(
                        side, part_from_tool, givers, takers, self._spots[side][nth]
                    ):
                        laid = self._step_with_set_down(held[giver], pose, self.table.part_from_tool[taker])
                        grasp = replace(
                            self.table.grasps[taker], world_from_tool=pose @ self.table.part_from_tool[taker]
                        )
                        left[taker] = False
                        tool_from_part = frames.inverse(self.table.part_from_tool[taker])
                        yield _PartHeld(tool_from_part, grasp, (*held[giver].before, laid))

    @cached_property
    def _spots(self) -> list[list[Array]]:
        """Of each side: where a part that lies on it is free of others, of places, and was seen to be."""
        taken = obstacles_of([*self.neighbours, *self.destination.taken, *self.destination.reserved])
        return [
            [spot for spot in free_spots(taken, float(reach), self.settings) if self._is_seen_free(spot, float(reach))]
            for reach in self.table.reach_mm
        ]

    def _is_seen_free(self, spot: Array, radius_mm: float) -> bool:
        """Whether one of the looks shows all of the table that a part takes up there, nothing before it."""
        around = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
        rim = spot + radius_mm * np.column_stack([np.cos(around), np.sin(around)])
        points = np.column_stack([np.vstack([rim, spot]), np.full(9, self.settings.limits.table_z_mm)])
        return not self.looks or any(
            all(in_both_images(look, point) for point in points)
            and not any(self.beside.hides(points, viewpoint) for viewpoint in look.viewpoints)
            for look in self.looks
        )

    def _regrasps(
        self, side: int, part_from_tool: Array, givers: Index, takers: Index, spot: Array
    ) -> Iterator[tuple[int, int, Array]]:
        """A giver, a taker, and where the part lies (4, 4) that both can have it, for each taker that has any."""
        turns = [about_vertical(360.0 * k / HEADINGS) for k in range(HEADINGS)]
        at = np.array([*spot, self.settings.limits.table_z_mm])
        poses = np.stack([frames.rigid(turn, at) @ self.table.lying[side] for turn in turns])
        lifted = np.stack([paths.lifted(pose, RELEASE_MM) for pose in poses])
        gives = self._reaches((lifted[:, None] @ part_from_tool[givers]).reshape(-1, 4, 4)).reshape(HEADINGS, -1)
        some = np.flatnonzero(gives.any(axis=1))
        if not len(some):
            return
        tools = poses[some][:, None] @ self.table.part_from_tool[takers]
        takes = self._reaches(tools.reshape(-1, 4, 4)).reshape(len(some), -1)
        can_lay = dict[int, int | None]()
        grasps = [self.table.grasps[k] for k in takers]
        for column in self._best(grasps, tools[0], poses[some[0]]):
            for row in np.flatnonzero(takes[:, column]):
                heading = int(some[row])
                if heading not in can_lay:
                    can_lay[heading] = self._first_usable(part_from_tool, givers[gives[heading]], side, poses[heading])
                giver = can_lay[heading]
                if giver is not None and self._is_reachable_grasp(tools[row, column], poses[heading]):
                    yield giver, int(takers[column]), poses[heading]
                    break

    def _first_usable(self, part_from_tool: Array, givers: Index, side: int, pose: Array) -> int | None:
        """The first of these that can lay the part down there."""
        for giver in givers:
            if self._is_reachable_set_down(self._set_down_at(pose, frames.inverse(part_from_tool[giver]))):
                return int(giver)
        return None

    def _set_down_at(self, pose: Array, tool_from_part: Array) -> SetDown:
        label = self.destination.goals[0].place.part
        table_z_mm = self.settings.limits.table_z_mm
        place_settings = PlaceSettings(
            part=label, release_mm=RELEASE_MM, tolerance_mm=AS_LAID_MM, tolerance_deg=AS_LAID_DEG
        )
        place = Place(TABLE, place_settings, np.eye(4), pose)
        return set_down_of(
            Goal(place, self.shape, (pose,), table_z_mm), pose, tool_from_part, self.settings, self.mounting
        )

    def _step_with_set_down(self, held: _PartHeld, pose: Array, part_from_tool: Array) -> RegraspStep:
        """The part placed on the table, and looked at from where it shows best; where the arm gets to none of these
        places, from where the next grasp is approached."""
        centre, way = self._centre(pose), self._set_down_at(pose, held.tool_from_part)
        looks = np.stack([*looks_round(centre, self.settings, self.mounting)])
        viewpoints = [self.mounting.world_from_cyclopean_at(look)[:3, 3] for look in looks]
        worth = np.array([view_worth(self.shape, pose, viewpoint) for viewpoint in viewpoints])
        worth[~self.allowed(looks)] = -1.0
        look = looks[worth.argmax()]
        if worth.max() < 0.0:
            look = self.mounting.approach_pose(pose @ part_from_tool, centre, self.settings.verify_mm)
        return RegraspStep(held.grasp, replace(way, look=look))
