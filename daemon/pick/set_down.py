"""The states in which a part is set down at its place: set_down, look_at_place. See world.py for what a handler is.

The status of the place is on the disk before anything follows from it (daemon/store/place_status.py): claimed before
the part is carried there, set before the gripper opens, and what the look showed before the pick goes on.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from daemon import frames
from daemon.arm import (
    BeliefSource,
    InWorld,
    MovedByOthersError,
    MoveRefusedError,
    OutOfReachError,
    RefusedError,
    carried_part,
)
from daemon.arrays import Array
from daemon.events.codes import CauseCode, DecisionCode
from daemon.events.outcomes import Outcome
from daemon.pick.following import (
    Target,
    expected_at,
    held_by_edges,
    held_pose,
    mount_of,
    predicted_error,
    shows_in_gripper,
    sighting_of,
)
from daemon.pick.gripper_sensor import contradiction, gripper_pair, read_sensor, stop_if_contradicted
from daemon.pick.looks import CapturedPair, Look
from daemon.pick.outcome import PickResult, not_looked_at
from daemon.pick.planning import (
    MOST_GRASPS,
    Goal,
    NoPlan,
    PlaceDeviation,
    deviation,
    farthest_viewpoint,
    plan_anew,
    reachable_poses,
    set_down_of,
    then_in_words,
    viewpoints_round,
)
from daemon.pick.pose_fusion import CHI_SQUARE_6, Estimate, Sighting, fuse
from daemon.pick.seen import same_place, seen_parts
from daemon.pick.transitions import PickEvent
from daemon.pick.world import MOVE_ERRORS, PickContext, WorldModel, look, reraise_if_all_refused, skip, travel
from daemon.store.place_status import AT_PLACE_MM, PlaceStatus
from daemon.vision.refine import Fit

LOWER_PCT = 10.0
"""Monitor speed of the last straight stretch, %: what the part touches there, it touches slowly."""
MOST_LOOKS = 3
"""At a place; the last one decides."""
BY_LOOK: Mapping[PlaceStatus, tuple[Outcome, CauseCode | None]] = {
    PlaceStatus.RIGHT: (Outcome.PICKED, None),
    PlaceStatus.OFF: (Outcome.OFF, CauseCode.OFF_PLACE),
}
"""How a pick ends by what the look at the place shows, and what causes that; released where it shows anything else."""
SIGMAS = 3.0
"""A height that is off by more than so many predicted errors is no error of the looks."""


async def measure(context: PickContext, target: Target, taken: CapturedPair) -> Array | None:
    """How the part is in the gripper, tool_from_part (4, 4) mm, by its edges in the look after the lift and by how it
    was grasped; None where they do not show, or the two disagree by more than both may err: it slipped, or was not seen
    well. The part is guarded by its corners there from now on."""
    doubt = context.settings.doubt
    held = await context.cell.compute(held_pose, target, taken, mount_of(context.cell), doubt)
    if held is None:
        return None
    moved_mm, turned = frames.size(frames.difference(held.seen, target.tool_from_part))
    context.cell.log.record(
        "in_gripper",
        cycle=context.cycle,
        label=target.label,
        tool_from_part=held.pose,
        shift_mm=moved_mm,
        shift_deg=float(np.degrees(turned)),
        chi2=held.chi2,
    )
    if held.chi2 > CHI_SQUARE_6:
        return None
    corners = frames.apply(held.pose, target.shape.corners_mm)
    context.mover.beliefs.learn(
        BeliefSource.OBSERVED, held_shape=carried_part(corners, f"{target.label} in the gripper")
    )
    return held.pose


async def set_down(
    context: PickContext, world: WorldModel
) -> Literal[PickEvent.SET_DOWN, PickEvent.LAID_DOWN, PickEvent.UNREACHABLE, PickEvent.LOST, PickEvent.DRY]:
    """Lower the part onto its place, or onto the table between two grasps: straight and slowly down, open, straight
    back. If the guard refuses the way, the part goes to the bin and the place is free again; the place is free as well
    if the part was lost on the way."""
    target, mover = world.the_target(), context.mover
    assert target.way is not None
    assert target.measured_in_gripper is not None
    goal, held = target.way.goal, target.measured_in_gripper
    way = replace(
        set_down_of(goal, target.way.pose, held, context.settings, context.cell.mounting), look=target.way.look
    )
    where = goal.description
    if not mover.dry:
        _note(context, world, goal, PlaceFinding(PlaceStatus.CLAIMED))
    try:
        await travel(context, world, way.over, f"over {where}")
        if await _lost(context, target):
            _note(context, world, goal, PlaceFinding(PlaceStatus.FREE, why="the part was lost on the way"))
            why = "the gripper's sensor says that it holds nothing, and the part does not show in it"
            context.decide(f"{target.label} was lost on the way", why, CauseCode.PART_SLIPPED, label=target.label)
            return PickEvent.LOST
        mover.check_through([way.at, way.clear], way.contact)
        await mover.travel(way.at, f"down to {where}", _slowly, straight=True, contact=way.contact)
    except MOVE_ERRORS as error:
        reraise_if_all_refused(error)
        if not mover.dry:
            _note(context, world, goal, PlaceFinding(PlaceStatus.FREE, why=f"its place cannot be reached: {error}"))
        context.decide("bring it to the bin", str(error), CauseCode.NO_WAY_TO_PLACE, label=target.label)
        return PickEvent.UNREACHABLE
    if mover.dry:
        world.result = PickResult(Outcome.DRY, f"{target.label} would be set down at {where} now", None)
        return PickEvent.DRY
    await mover.still_there(f"the gripper is to open at {where}")
    world.regrasps += goal.between
    _note(context, world, goal, PlaceFinding(PlaceStatus.SET))
    world.set_down_at = None if goal.between else goal.place.name
    await mover.set_gripper(closed=False, hand_s=context.settings.hand_time_s(closed=False))
    if not goal.between:
        world.gripper_opened, world.result = True, not_looked_at(target.label, f"at {where}")
    sensor = await read_sensor(context, "let go")
    stop_if_contradicted(context, contradiction(target.label, sensor, f"was let go at {where}", False))
    target.plan = replace(target.plan, way=way)
    await mover.travel(way.clear, f"back from {where}", _slowly, straight=True)
    return PickEvent.LAID_DOWN if goal.between else PickEvent.SET_DOWN


async def _lost(context: PickContext, target: Target) -> bool:
    """Whether the gripper holds the part no longer, before it is lowered: its sensor says so, and no look shows it
    there. Raises SensorDisagreesError where one does."""
    if await read_sensor(context, "over its place") is not False:
        return False
    taken = await gripper_pair(context, target)
    doubt, mount = context.settings.doubt, mount_of(context.cell)
    shows = taken is not None and await context.cell.compute(shows_in_gripper, target, taken, mount, doubt)
    stop_if_contradicted(context, contradiction(target.label, False, "is in it", shows))
    return True


def _slowly(_: Array) -> float:
    return LOWER_PCT


async def look_at_place(context: PickContext, world: WorldModel) -> Literal[PickEvent.SEEN]:
    """Look where the part was set down, and keep what the look shows: right, off by so much, or not there."""
    target = world.the_target()
    assert target.way is not None
    goal = target.way.goal
    await travel(context, world, target.way.look, f"look at place {goal.place.name}")
    seen = (await _judge(context, world, goal, PlaceStatus.MISSING))[0].status
    outcome, code = BY_LOOK.get(seen, (Outcome.RELEASED, CauseCode.NOT_AT_PLACE))
    why = f"{target.label} at place {goal.place.name}: {context.placing.statuses.of(goal.place.name).why}"
    world.gripper_opened, world.result = False, PickResult(outcome, why, code)
    context.decide(outcome, why, code or DecisionCode.PICKED, label=target.label)
    return PickEvent.SEEN


async def look_at_laid(context: PickContext, world: WorldModel) -> Literal[PickEvent.SEEN, PickEvent.LOST]:
    """Look at the part on the table between two grasps, and plan how it is taken from there. One that is not seen, or
    that no grasp brings on, stays where it is, and the pick says so."""
    target = world.the_target()
    assert target.way is not None
    goal, settings, mounting = target.way.goal, context.settings, context.cell.mounting
    await travel(context, world, target.way.look, f"look at it on {goal.description}")
    found, seen = await _judge(context, world, goal, PlaceStatus.MISSING)
    target.seen_at, target.world_from_part = goal.centre, target.way.pose
    if found.pose is None:
        why = f"not seen where it was laid down on {goal.description}: {found.why}"
        skip(context, world, Outcome.LOST, target, why, CauseCode.NOT_WHERE_LAID)
        return PickEvent.LOST
    most, looks = max(1, MOST_GRASPS - world.regrasps), [*world.looks]
    arm = settings, mounting, context.mover.reach, context.cell.rig
    plan = await context.cell.compute(plan_anew, target.shape, found.pose, most, target.plan, looks, *arm)
    if isinstance(plan, NoPlan):
        skip(context, world, Outcome.UNREACHABLE, target, f"laid down on {goal.description}, {plan.why}", plan.code)
        return PickEvent.LOST
    side_view = mounting.out_of_view[:3, :3] if isinstance(mounting, InWorld) else None
    world.target = world.last_target = Target(
        target.label,
        target.shape,
        found.pose,
        plan,
        seen,
        side_view=side_view,
        confidence=target.confidence,
        seen_at=frames.apply(found.pose, target.shape.corners_mm).mean(axis=0),
    )
    why = f"{found.why}; grasp {plan.grasp.description}{then_in_words(plan)}"
    context.decide(f"take {target.label} anew", why, DecisionCode.LAID_DOWN, label=target.label, grasps=plan.grasps)
    return PickEvent.SEEN


async def look_at_unseen(context: PickContext, world: WorldModel) -> None:
    """Look at every place that a pick which was cut off has left, or that has moved: what lies there is kept, and a
    place that shows nothing is free. One that cannot be looked at stays as it is: nothing is brought there."""
    for goal in context.placing.unseen():
        try:
            await look_at(context, world, goal)
        except MOVE_ERRORS as error:
            reraise_if_all_refused(error)
            text = f"place {goal.place.name} is to be looked at: left alone"
            context.decide(text, str(error), CauseCode.NO_WAY_TO_PLACE, label=goal.place.part)


async def look_at(context: PickContext, world: WorldModel, goal: Goal) -> PlaceStatus:
    """Go where a place can be looked at from, look, keep what the looks show. Raises what a refused move does where
    none is in reach."""
    if context.mover.dry:
        return context.placing.status(goal.place.name)
    await go_round(context, world, goal.centre, f"place {goal.place.name}", [])
    return (await _judge(context, world, goal, PlaceStatus.FREE))[0].status


async def locate(context: PickContext, world: WorldModel, label: str) -> Array:
    """Where the one part of this label that lies here is, world_from_part (4, 4) mm, by looks from up to three sides.
    Raises RefusedError where there is none, or more than one."""
    shape, reading = context.recogniser.shape(label), context.mover.belief.resting_reading
    assert reading is not None
    seen = await context.look_exposed(reading, f"find {label}")
    found = [part for part in seen_parts(seen) if part.named and part.label == label]
    if shape is None or len(found) != 1:
        raise RefusedError(f"{len(found)} parts are recognised as {label}: exactly one must be in view, at its place")
    pose, centre = found[0].world_from_part, found[0].centre
    expected = expected_at(label, shape, pose)
    sightings: list[Sighting] = []
    viewpoints: list[Array] = []
    while len(viewpoints) < (0 if context.mover.dry else MOST_LOOKS):
        await go_round(context, world, centre, label, viewpoints)
        seen = await look(context, world, f"find {label}", expected)
        viewpoints.append(seen.world_from_cyclopean[:3, 3])
        if seen.tracked is not None:
            sightings.append(sighting_of(seen, seen.tracked, context.cell.rig, context.settings.doubt))
    if not sightings and not context.mover.dry:
        raise RefusedError(f"the edges of the {label} do not show clearly: improve the light, or turn it")
    return fuse(sightings, context.settings.doubt).world_from_part if sightings else pose


class HeldHere(NamedTuple):
    """The part in the gripper: its label, where it is, world_from_part (4, 4) mm, and how far off that may be, one
    standard deviation, mm and degrees."""

    label: str
    world_from_part: Array
    errs_mm: float
    errs_deg: float


async def held_here(context: PickContext) -> HeldHere:
    """The part in the gripper, from where the arm rests: see PickCycle.held_here. Raises RefusedError where it is not
    known."""
    cell, held = context.cell, context.mover.belief.grasped_part
    if held is None or context.mover.belief.holds_part is False:
        raise RefusedError(
            "the gripper holds no part that facetd picked: `pick` one, and `stop` while the arm carries it"
        )
    label, shape = held.value.label, context.recogniser.shape(held.value.label)
    lay_it = "lay it where it belongs, and `place teach NAME PART`"
    if shape is None:
        raise RefusedError(f"the {label} in the gripper is no longer taught: {lay_it}")
    if cell.alone is not None or isinstance(cell.mounting, InWorld):
        raise RefusedError(f"only both cameras on the gripper see how it holds a part: {lay_it}")
    before = await context.mover.wait_until_at_rest()
    seen = await context.look_exposed(before, f"{label} in the gripper")
    try:
        await context.mover.still_there(f"the place of the {label} is to be taught")
    except MovedByOthersError as moved:
        raise RefusedError(f"{moved}: keep the arm still, then repeat") from None
    found = await cell.compute(held_by_edges, shape, held.value, seen.taken, mount_of(cell), context.settings.doubt)
    if found is None:
        raise RefusedError(
            f"the edges of the {label} do not show clearly in the gripper: improve the light, or {lay_it}"
        )
    if found.chi2 > CHI_SQUARE_6:
        raise RefusedError(f"the {label} is not held as it was grasped: {lay_it}")
    errs = predicted_error(shape, found.pose, found.covariance, context.settings.doubt)
    return HeldHere(label, before.world_from_tool @ found.pose, *errs)


async def go_round(
    context: PickContext, world: WorldModel, centre: Array, name: str, viewpoints_before: Sequence[Array]
) -> None:
    """Go to a reachable viewpoint of a point (3,), the one farthest from all earlier viewpoints. viewpoints_before:
    (3,) world mm."""
    mounting = context.cell.mounting
    poses = viewpoints_round(centre, mounting, context.settings.verify_mm)
    poses = await context.cell.compute(reachable_poses, poses, context.mover.reach)
    order: Sequence[int] = range(len(poses))
    if viewpoints_before:
        order = farthest_viewpoint(
            centre, [mounting.world_from_cyclopean_at(pose)[:3, 3] for pose in poses], viewpoints_before
        )
    refused: MoveRefusedError | OutOfReachError = OutOfReachError(
        f"{name} can be looked at from nowhere in the arm's reach"
    )
    for number in order:
        try:
            await travel(context, world, poses[number], f"look at {name}")
        except MOVE_ERRORS as error:
            reraise_if_all_refused(error)
            refused = error
            continue
        return
    raise refused


async def _judge(
    context: PickContext, world: WorldModel, goal: Goal, empty: PlaceStatus
) -> tuple["PlaceFinding", Look]:
    """Look at a place from where the arm is at rest, and from further sides as long as the result is closer to the
    tolerance than its error, or the part is not seen. Return what the looks say together, and the last of them. empty:
    what a place is that shows nothing."""
    expected = expected_at(goal.place.part, goal.shape, goal.poses[0])
    sightings: list[Sighting] = []
    viewpoints: list[Array] = []
    doubt, rig = context.settings.doubt, context.cell.rig
    while True:
        seen = await look(context, world, f"place {goal.place.name}", expected)
        viewpoints.append(seen.world_from_cyclopean[:3, 3])
        fit = seen.tracked or named_at(goal, seen)
        if fit is not None:
            sightings.append(sighting_of(seen, fit, rig, doubt))
        found = combined_pose(goal, fuse(sightings, doubt)) if sightings else judged(goal, seen, empty)
        if found.sure or len(viewpoints) == MOST_LOOKS:
            break
        try:
            await go_round(context, world, goal.centre, f"place {goal.place.name}", viewpoints)
        except MOVE_ERRORS as error:
            reraise_if_all_refused(error)
            break
    _note(context, world, goal, found)
    return found, seen


@dataclass(frozen=True)
class PlaceFinding:
    """The status of a place, and what looks say of it. sure: whether one more would not change it; pose:
    world_from_part (4, 4) mm of the part that belongs there, None: it was not seen."""

    status: PlaceStatus
    off: PlaceDeviation | None = None
    why: str = ""
    sure: bool = False
    pose: Array | None = None


def named_at(goal: Goal, seen: Look) -> Fit | None:
    """The pose of the part that belongs there, as a look named it: of those that look the same the nearest to the goal;
    None where none was named at the place."""
    near = [p for p in seen_parts(seen) if p.named and p.label == goal.place.part]
    near = [p for p in near if same_place(p.centre, goal.centre, AT_PLACE_MM)]
    if not near:
        return None
    part = min((p.part for p in near), key=lambda each: each.residual_mm)
    wanted = frames.inverse(seen.world_from_cyclopean) @ goal.poses[0]
    poses = [part.cyclopean_from_part, *part.equivalents]
    pose = min(poses, key=lambda each: float(np.abs(each - wanted)[:3, :3].max()))
    return Fit(pose, part.covariance, part.residual_mm, sum(map(len, part.fitted_mm)))


def judged(goal: Goal, seen: Look, empty: PlaceStatus) -> PlaceFinding:
    """What a look says that does not show the part at its place."""
    if any(same_place(part.centre, goal.centre, AT_PLACE_MM) for part in seen_parts(seen)):
        return PlaceFinding(PlaceStatus.OFF, None, f"something lies there that does not show as {goal.place.part}")
    return PlaceFinding(empty, None, "the looks show nothing there")


def combined_pose(goal: Goal, estimate: Estimate) -> PlaceFinding:
    """What looks say together that found the part by its edges. Looks err most in height, and a part rests on its
    support: its height counts only where it is more than they may err."""
    off, place_settings = deviation(goal, estimate.world_from_part), goal.place.settings
    if goal.axis is not None:  # its turn no look can say, and no place asks for
        estimate = estimate.of_any_turn(estimate.world_from_part[:3, :3] @ goal.axis.direction)
    variance = np.diag(estimate.covariance)
    errs_mm, errs_deg = float(np.sqrt(variance[:2].sum())), float(np.degrees(np.sqrt(variance[3:].sum())))
    most_height_mm = max(place_settings.tolerance_mm, SIGMAS * float(np.sqrt(variance[2])))
    most = f"{place_settings.tolerance_mm:g} mm and {place_settings.tolerance_deg:g} degrees"
    if abs(off.height_mm) > most_height_mm:
        higher = "higher" if off.height_mm > 0 else "lower"
        why = f"{off}, {abs(off.height_mm):.1f} mm {higher} than it would rest"
        sure = abs(off.height_mm) > 2 * most_height_mm
        return PlaceFinding(PlaceStatus.OFF, off, why, sure, estimate.world_from_part)
    spare_mm, spare_deg = place_settings.tolerance_mm - off.off_mm, place_settings.tolerance_deg - off.off_deg
    right = min(spare_mm, spare_deg) >= 0.0
    sure = min(spare_mm - errs_mm, spare_deg - errs_deg) > 0.0 or min(spare_mm + errs_mm, spare_deg + errs_deg) < 0.0
    why = f"{off}, {'within' if right else 'more than'} {most}"
    return PlaceFinding(PlaceStatus.RIGHT if right else PlaceStatus.OFF, off, why, sure, estimate.world_from_part)


def _note(context: PickContext, world: WorldModel, goal: Goal, found: PlaceFinding) -> None:
    """The disk first, then the log. What is laid on the table in between has no status on the disk: until it is let go
    the record of the gripper says where it is, and after that it is a part on the table."""
    place, status, why = goal.place, found.status, found.why
    off_mm, off_deg, height_mm = found.off or (None, None, None)
    if goal.between:
        if status not in (PlaceStatus.CLAIMED, PlaceStatus.FREE):
            context.cell.log.record(
                "laid_down",
                cycle=context.cycle,
                label=place.part,
                status=str(status),
                times=world.regrasps,
                off_mm=off_mm,
                off_deg=off_deg,
                why=why,
                world_from_part=goal.poses[0] if found.pose is None else found.pose,
                outline=goal.outline,
            )
        return
    context.placing.statuses.put(place.name, status, off_mm, off_deg, why)
    context.cell.log.record(
        "place",
        cycle=context.cycle,
        place=place.name,
        label=place.part,
        status=str(status),
        off_mm=off_mm,
        off_deg=off_deg,
        height_mm=height_mm,
        tolerance_mm=place.settings.tolerance_mm,
        tolerance_deg=place.settings.tolerance_deg,
        why=why,
        outline=goal.outline,
    )
