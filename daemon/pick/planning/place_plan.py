"""Plan how a part gets to its place: with one grasp, or with several where one is not enough. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

from daemon import frames
from daemon.arm import CameraMounting, Reach
from daemon.arrays import Array
from daemon.events.codes import CauseCode
from daemon.pick.looks import Look
from daemon.pick.planning.place_goals import TABLE, UPSIDE_DOWN, Goal
from daemon.pick.planning.plan import Destination, NoPlan, Plan, plan_part
from daemon.pick.planning.regrasp import MOST_GRASPS, Regrasping, RegraspStep
from daemon.pick.planning.viewpoints import Reachable
from daemon.pick.seen import Facing
from daemon.pick.settings import Settings
from daemon.store.place_file import about_vertical
from daemon.vision.geometry import Polyhedron, StereoRig

HEADINGS_DEG = (10.0, 100.0, 190.0, 280.0)
"""How a part is turned for which it is planned beforehand: along no axis of the arm's."""
MAY_HELP = frozenset({CauseCode.NO_WAY_TO_PLACE, CauseCode.OUT_OF_REACH, CauseCode.NO_GRASP})
"""Why no one ordinary grasp brings a part to its place, where others, or several in turn, may."""


def then_in_words(plan: Plan) -> str:
    """What follows the first grasp, as the end of a line; empty where that one brings the part to its place."""
    return f"; then laid on {TABLE} and taken anew, {plan.grasps} grasps in all" if plan.grasps > 1 else ""


def plan_to_place(
    shape: Polyhedron,
    world_from_part: Array,
    neighbours: Sequence[Array],
    settings: Settings,
    mounting: CameraMounting,
    allowed: Reachable,
    rig: StereoRig,
    destination: Destination | None,
    seen: Sequence[Facing] = (),
    unseen_from: Sequence[Array] = (),
    looks: Sequence[Look] = (),
    most: int = MOST_GRASPS,
) -> tuple[Plan | NoPlan, tuple[RegraspStep, ...]]:
    """The grasp by which a part is taken, or why there is none (see plan_part), and the steps to its place: where no
    one ordinary grasp brings it there, the shortest plan of at most so many. looks: at the table that it is laid on in
    between."""
    plan = plan_part(
        shape, world_from_part, neighbours, settings, mounting, allowed, seen, unseen_from, destination, rig
    )
    if destination is None or (isinstance(plan, NoPlan) and plan.code not in MAY_HELP):
        return plan, ()
    if isinstance(plan, Plan):
        return plan, () if plan.way is None else (RegraspStep(plan.grasp, plan.way),)
    steps = Regrasping(shape, destination, settings, mounting, allowed, rig, neighbours, looks).plan(
        world_from_part, most
    )
    if isinstance(steps, NoPlan):
        return (steps if plan.code is CauseCode.NO_WAY_TO_PLACE else plan), ()
    return _first_of(steps, neighbours, destination), steps


def plan_anew(
    shape: Polyhedron,
    world_from_part: Array,
    most: int,
    before: Plan,
    looks: Sequence[Look],
    settings: Settings,
    mounting: CameraMounting,
    reach: Reach,
    rig: StereoRig,
) -> Plan | NoPlan:
    """The next grasp of a part that lies on the table between two grasps, by the shortest plan of at most so many from
    how it is seen to lie, or why there is none. Raises ValueError where the corners span no volume."""
    assert before.destination is not None
    arm = settings, mounting, reach.allows_each, rig
    steps = Regrasping(shape, before.destination, *arm, before.neighbours, looks).plan(world_from_part, most)
    return steps if isinstance(steps, NoPlan) else _first_of(steps, before.neighbours, before.destination)


def _first_of(steps: Sequence[RegraspStep], neighbours: Sequence[Array], destination: Destination) -> Plan:
    return Plan(steps[0].grasp, 0.0, neighbours, steps[0].way, len(steps), destination)


@dataclass(frozen=True, eq=False)
class PlannedMotion:
    """A pick and set-down as it is drawn: in words, and where the part is as it is taken and let go, and the tool, each
    (4, 4) mm in the world."""

    grasp: str
    part_taken: Array
    tool_taken: Array
    part_laid: Array
    tool_laid: Array


@dataclass(frozen=True)
class SidePlan:
    """How a part that lies on one side, from 1, can be brought to a place. found: at how many of so many headings
    (tried); motions: the picks and set-downs of one of these; why: what keeps it from there at one of the others."""

    side: int
    found: int
    tried: int
    motions: tuple[PlannedMotion, ...]
    why: str


def plan_from_side(
    goal: Goal, side: int, lying_at: Array, settings: Settings, mounting: CameraMounting, reach: Reach, rig: StereoRig
) -> SidePlan:
    """Whether a part that lies on a side, from 0, can be brought to a place, and by what. lying_at: (3,) world mm, on
    the table. Raises ValueError where the taught corners span no solid."""
    ways, whys = list[tuple[PlannedMotion, ...]](), list[str]()
    for heading_deg in HEADINGS_DEG:
        pose = frames.rigid(about_vertical(heading_deg) @ UPSIDE_DOWN, lying_at) @ goal.shape.flat_from_solid[side]
        arm = settings, mounting, reach.allows_each, rig
        plan, steps = plan_to_place(goal.shape, pose, (), *arm, Destination([goal]))
        if isinstance(plan, NoPlan):
            whys.append(plan.why)
        else:
            ways.append(_motions(pose, steps))
    best = min(ways, key=len, default=())
    return SidePlan(side + 1, len(ways), len(HEADINGS_DEG), best, next(iter(whys), ""))


def _motions(pose: Array, steps: Sequence[RegraspStep]) -> tuple[PlannedMotion, ...]:
    found = list[PlannedMotion]()
    for step in steps:
        found.append(
            PlannedMotion(step.grasp.description, pose, step.grasp.world_from_tool, step.way.pose, step.way.at)
        )
        pose = step.way.pose
    return tuple(found)
