"""Plan a pick: a grasp whose whole approach is checked before the first move.

Pure: what is seen and what the arm can reach in, plans out. Doing them is approach.py's and take.py's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from daemon import frames
from daemon.arm import CameraMounting, InWorld, paths
from daemon.arrays import Array
from daemon.events.codes import CauseCode
from daemon.pick.grippers import PlannedGrasp, centre_of_mass, contact_hull
from daemon.pick.planning import viewpoints
from daemon.pick.planning.place_goals import FLAT_MM, Goal, SetDown, goes_through, ways_to
from daemon.pick.planning.viewpoints import Reachable
from daemon.pick.seen import Facing, apart_mm, visible_share
from daemon.pick.settings import Settings
from daemon.vision.geometry import FACING, Polyhedron, StereoRig, inside

MOST_CHANGE_MM = 25.0
"""How far a grasp may change from look to look (a radian of turn counts as 50 mm)."""
MOST_GOALS = 3
"""So many free places of a part are tried, in the order in which they are filled."""
SAME_SIDE_RAD = 0.5
"""A look from within this angle of one that did not find the part would not find it either."""
SHOWS_COUNT, ALONG_EDGE, RIM_PX = 2.0, np.linspace(0.1, 0.9, 5), 5.0
"""How much it counts that a part shows in the gripper: one that does not is not measured there, and cannot be set down;
where along its edges, and how far inside of the pictures."""


@dataclass(frozen=True, eq=False)
class Plan:
    """How one part will be taken: the grasp; how well looks along its approach show the part (0 to 2); neighbours:
    (M, 3) world corners of the parts that leave it room; way: how it is set down, at its place, or on the table to be
    taken anew, None: over the bin; grasps: how many bring it to its place, this one counted; destination: that."""

    grasp: PlannedGrasp
    worth: float
    neighbours: Sequence[Array] = ()
    way: SetDown | None = None
    grasps: int = 1
    destination: "Destination | None" = None


@dataclass(frozen=True, eq=False)
class Destination:
    """Where a part belongs: the goals that are free, in order; taken: (M, 3) world corners of the parts at others;
    reserved: the same of all places, which stay free between two grasps."""

    goals: Sequence[Goal]
    taken: Sequence[Array] = ()
    reserved: Sequence[Array] = ()


class FinalApproach(NamedTuple):
    """The poses of a grasp that the arm passes without a look, in order; world_from_tool. back: from where its place
    is looked at afterwards."""

    before: Array
    at: Array
    lifted: Array
    back: Array


def final_approach(grasp: PlannedGrasp, centre: Array, settings: Settings, mounting: CameraMounting) -> FinalApproach:
    """From before the grasp to the look after it; centre: the part's (3,)."""
    at = grasp.world_from_tool
    back = mounting.approach_pose(at, centre, settings.verify_mm)
    return FinalApproach(paths.backed_off(at, settings.pregrasp_mm), at, paths.lifted(at, settings.lift_mm), back)


def approach_poses(grasp: PlannedGrasp, centre: Array, settings: Settings, mounting: CameraMounting) -> list[Array]:
    """Every pose of the approach and the retreat, in order; world_from_tool."""
    at = grasp.world_from_tool
    looks = [mounting.approach_pose(at, centre, distance) for distance in settings.stops.stand_offs_mm]
    return [*looks, *final_approach(grasp, centre, settings, mounting)]


def held_part_visibility(shape: Polyhedron, tool_from_part: Array, mounting: CameraMounting, rig: StereoRig) -> float:
    """Which share of the edges that face the cameras both have in view, of a part in the gripper (4, 4)."""
    if isinstance(mounting, InWorld):
        return 0.0
    near, (ends, bounds) = frames.inverse(mounting.tool_from_cyclopean) @ tool_from_part, shape.lines
    faced = ends[bounds[shape.facing(near) > FACING].any(axis=0)]
    if not len(faced):
        return 0.0
    start, end = (frames.apply(near, shape.corners_mm)[faced[:, k]] for k in (0, 1))
    points = (start[:, None] + ALONG_EDGE[:, None] * (end - start)[:, None]).reshape(-1, 3)
    in_view = np.ones(len(points), bool)
    for camera in (rig.left, rig.right):
        px = camera.project(points)
        in_view &= ((px > RIM_PX) & (px < np.array(rig.image_size) - RIM_PX)).all(axis=1)
    return float(in_view.mean())


class NoPlan(NamedTuple):
    """Why there is no plan, as a code and in words."""

    code: CauseCode
    why: str


def plan_part(
    shape: Polyhedron,
    world_from_part: Array,
    neighbours: Sequence[Array],
    settings: Settings,
    mounting: CameraMounting,
    allowed: Reachable,
    seen: Sequence[Facing] = (),
    unseen_from: Sequence[Array] = (),
    destination: Destination | None = None,
    rig: StereoRig | None = None,
) -> Plan | NoPlan:
    """The best grasp whose whole approach is allowed (reached, in the box, above the table), and by which the part can
    be set down where it belongs, or why there is none.

    seen: facets that a look has told apart; their shading, and so their contrast, is the same from everywhere, so that
    a look along the approach should show them again. unseen_from: (3,) directions from the part in which a
    camera stood that did not find it. rig: what measures the part in the gripper before it is set down.
    """
    try:
        found, why = settings.gripper.grasps(
            shape, world_from_part, settings.limits.table_z_mm, settings.stops.enough_mm, neighbours
        )
    except ValueError as error:
        return NoPlan(CauseCode.NO_GRASP, f"taught corners give no solid to grasp: {error}")
    if not found:
        return NoPlan(CauseCode.NO_GRASP, why)
    centre = frames.apply(world_from_part, shape.corners_mm).mean(axis=0)
    middle = settings.stops.stand_offs_mm[len(settings.stops.stand_offs_mm) // 2]
    plans = []
    for grasp in found:
        pose = mounting.look_pose(grasp.world_from_tool[:3, :3], centre, middle)
        viewpoint = mounting.world_from_cyclopean_at(pose)[:3, 3]
        if any(viewpoints.angle_at(centre, viewpoint, centre + away) < SAME_SIDE_RAD for away in unseen_from):
            continue
        worth = viewpoints.view_worth(shape, world_from_part, viewpoint) + visible_share(seen, viewpoint)
        if destination is not None and rig is not None:
            held = frames.inverse(grasp.world_from_tool) @ world_from_part
            worth += SHOWS_COUNT * held_part_visibility(shape, held, mounting, rig)
        plans.append(Plan(grasp, worth, neighbours))
    if not plans:
        return NoPlan(CauseCode.MOVE_REFUSED, "it was looked for from every side that a grasp leaves")
    plans.sort(key=lambda p: (p.grasp.blocked, p.grasp.risk - p.worth))
    approached = 0
    for plan in plans:
        if not plan.grasp.blocked:
            poses = approach_poses(plan.grasp, centre, settings, mounting)
            if goes_through(poses, allowed):
                approached += 1
                if destination is None:
                    return plan
                held = frames.inverse(plan.grasp.world_from_tool) @ world_from_part
                way = first_set_down(destination, held, settings, mounting, allowed)
                if way is not None:
                    return replace(plan, way=way, destination=destination)
    if approached and destination is not None:
        goals = ", ".join(goal.place.name for goal in destination.goals[:MOST_GOALS])
        why = f"none of its {approached} grasps in reach can set it down at {goals} as it is to lie there"
        return NoPlan(CauseCode.NO_WAY_TO_PLACE, why)
    blocked = sum(p.grasp.blocked for p in plans)
    why = f"none of its {len(plans)} grasps can be reached all the way ({blocked} blocked by a neighbour)"
    return NoPlan(CauseCode.BLOCKED if 2 * blocked >= len(plans) else CauseCode.OUT_OF_REACH, why)


def first_set_down(
    destination: Destination, held: Array, settings: Settings, mounting: CameraMounting, allowed: Reachable
) -> SetDown | None:
    """The first way to the first goal that has one."""
    for goal in destination.goals[:MOST_GOALS]:
        for way in ways_to(goal, held, settings, mounting, allowed, destination.taken):
            return way
    return None


def stable_sides(shape: Polyhedron) -> list[int]:
    """The sides, from 0, that a part of one material can lie on: nothing of it is beyond them, and the mass centre is
    above them. Raises ValueError where the corners span no volume."""
    mass, found = centre_of_mass(contact_hull(shape)), []
    for side, laid in enumerate(shape.flat_from_solid):
        beyond_mm = float(frames.apply(laid, shape.corners_mm)[:, 2].max())
        if beyond_mm < FLAT_MM and is_supported(mass, shape, side):
            found.append(side)
    return found


def is_supported(mass: Array, shape: Polyhedron, side: int) -> bool:
    """Whether a mass centre (3,) is above a side, from 0, on which a part lies."""
    laid = shape.flat_from_solid[side]
    ring = frames.apply(laid, shape.corners_mm[shape.rings[side]])[None, :, :2]
    return bool(inside(frames.apply(laid, mass[None])[:, :2], ring)[0, 0])


def same_grasp(shape: Polyhedron, world_from_part: Array, before: Plan, settings: Settings) -> Plan | None:
    """The same grasp on the part where it is now known to be: the nearest of today's grasps by turn and place that its
    neighbours leave room. None where none is near (the part lies otherwise than was thought: plan again)."""
    old = before.grasp.world_from_tool
    table_z_mm, error_mm = settings.limits.table_z_mm, settings.stops.enough_mm
    gripper = settings.gripper.turning or settings.gripper
    found, _ = gripper.grasps(shape, world_from_part, table_z_mm, error_mm, before.neighbours, near=old[:3, :3])

    def away(grasp: PlannedGrasp) -> float:
        gap_mm = apart_mm(grasp.world_from_tool[:3, 3], old[:3, 3])
        return gap_mm + 50.0 * frames.angle_between(grasp.world_from_tool, old)

    nearest = min((one for one in found if not one.blocked), key=away, default=None)
    return None if nearest is None or away(nearest) > MOST_CHANGE_MM else replace(before, grasp=nearest)
