"""The states in which a part is approached, look by look: stop_n, looking, estimating. See world.py for what a handler
is."""

from typing import Literal

import numpy as np

from daemon import frames
from daemon.arm import OnHand, OutOfReachError
from daemon.arrays import Array
from daemon.events.codes import CauseCode, DecisionCode, suspected
from daemon.events.outcomes import Outcome
from daemon.pick import pose_fusion
from daemon.pick.following import (
    NEAR_MM,
    Target,
    chi_squares_of_others,
    expected_at,
    fit_target,
    other_parts,
    sighting_of,
)
from daemon.pick.looks import whole_look
from daemon.pick.planning import is_certain_enough, next_stand_off, same_grasp, side_that_shows_turn
from daemon.pick.pose_fusion import CHI_SQUARE_6
from daemon.pick.seen import SAME_PLACE_MM, same_place, seen_parts
from daemon.pick.transitions import PickEvent
from daemon.pick.world import (
    MOVE_ERRORS,
    PickContext,
    SuspectError,
    WorldModel,
    look,
    plan_again,
    skip,
    travel,
    unreachable,
)
from daemon.store.place_file import pattern_of

VERTICAL = np.array([0.0, 0.0, 1.0])
SAME_SIDE_RAD = 0.3
"""A look from a direction that differs by more is one from another side, and no straight way leads there."""


async def stop_n(context: PickContext, world: WorldModel) -> Literal[PickEvent.THERE, PickEvent.UNREACHABLE]:
    """Go to the next stand-off."""
    target, settings = world.the_target(), context.settings
    distance = next_stand_off(target.sightings, settings.doubt, settings.stops)
    pose = context.cell.mounting.look_pose(target.look_rotation, target.centre, distance)
    try:
        await _come_nearer(context, world, pose, f"stand-off {distance:g} mm")
    except MOVE_ERRORS as error:
        await unreachable(context, world, error)
        return PickEvent.UNREACHABLE
    return PickEvent.THERE


async def _come_nearer(context: PickContext, world: WorldModel, pose: Array, purpose: str) -> None:
    """Go there straight once the part was seen, so that it stays in view; by joints where the wrist cannot follow the
    line, as through joint 5 at 0."""
    target = world.the_target()
    turned = frames.angle_between(pose, target.look.reading.world_from_tool)
    straight = bool(target.sightings) and turned < SAME_SIDE_RAD
    try:
        await travel(context, world, pose, purpose, target.look, straight)
    except OutOfReachError:
        if not straight:
            raise
        await travel(context, world, pose, purpose, target.look)


async def looking(
    context: PickContext, world: WorldModel
) -> Literal[PickEvent.LOOKED, PickEvent.ELSEWHERE, PickEvent.LOST]:
    """Look, and find the target again."""
    target = world.the_target()
    expected = expected_at(target.label, target.shape, target.world_from_part, target.confidence, target.estimate)
    seen = await look(context, world, "approach", expected)
    target.looked_before, target.look, target.looks = target.look, seen, target.looks + 1
    fit = seen.tracked or await context.cell.compute(fit_target, target, seen)
    if fit is not None:
        target.sightings.append(sighting_of(seen, fit, context.cell.rig, context.settings.doubt))
        return PickEvent.LOOKED
    near = [part for part in seen_parts(seen) if same_place(part.centre, target.centre, NEAR_MM)]
    if any(part.label == target.label for part in near):
        return await _plan_again_or_skip(
            context, world, "its corners are not where the look before measured them", DecisionCode.MOVED_BETWEEN_LOOKS
        )
    world.failures += 1
    world.disagreements["not found at the expected position"] += 1
    why = f"not seen where it was at look {target.looks}"
    if len(world.unseen_directions_of(target.centre)) >= context.settings.views_of_doubtful:
        skip(context, world, Outcome.LOST, target, why, DecisionCode.NOT_SEEN_AGAIN)
        return PickEvent.LOST
    world.unseen_directions.append((target.centre, seen.world_from_cyclopean[:3, 3] - target.centre))
    code = DecisionCode.NOT_SEEN_AGAIN
    context.decide(f"approach {target.label} from another side", why, code, label=target.label)
    return PickEvent.ELSEWHERE


async def _plan_again_or_skip(
    context: PickContext, world: WorldModel, why: str, code: DecisionCode
) -> Literal[PickEvent.ELSEWHERE, PickEvent.LOST]:
    """The target does not lie as expected: plan again, or skip it."""
    return PickEvent.ELSEWHERE if await plan_again(context, world, Outcome.LOST, why, code) else PickEvent.LOST


async def estimating(
    context: PickContext, world: WorldModel
) -> Literal[PickEvent.UNSURE, PickEvent.SURE, PickEvent.DOUBT, PickEvent.ELSEWHERE, PickEvent.LOST, PickEvent.GAVE_UP]:
    """Compare the look with the one before, fuse all looks, and decide whether the pose is known well enough to
    grasp."""
    target, settings = world.the_target(), context.settings
    chi = 0.0
    if len(target.sightings) > 1:
        chi = pose_fusion.disagreement(target.sightings[-2], target.sightings[-1], settings.doubt)
    if chi > CHI_SQUARE_6 and await _diagnose_disagreement(context, world, target, chi) == "unclear":
        return PickEvent.DOUBT
    estimate = pose_fusion.fuse(target.sightings, settings.doubt)
    target.estimate, target.world_from_part = estimate, estimate.world_from_part
    plan = await context.cell.compute(same_grasp, target.shape, target.world_from_part, target.plan, settings)
    if plan is None:
        why = "the planned grasp does not fit the pose in which the part lies"
        return await _plan_again_or_skip(context, world, why, DecisionCode.PLANNED_AGAIN)
    target.plan = plan
    context.cell.log.record(
        "estimate",
        cycle=context.cycle,
        stop=target.looks,
        label=target.label,
        world_from_part=estimate.world_from_part,
        covariance=estimate.covariance,
        predicted_mm=estimate.predicted_mm,
        predicted_deg=estimate.predicted_deg,
        chi2=chi,
    )
    free_axis = _free_axis(target)
    if context.mover.dry or is_certain_enough(estimate, len(target.sightings), settings.stops, free_axis):
        return PickEvent.SURE
    if target.looks < settings.stops.most_looks:
        await _choose_side_view(context, target, free_axis)
        return PickEvent.UNSURE
    why = f"{estimate.predicted_mm:.2f} mm, {estimate.predicted_deg:.2f} degrees predicted after {target.looks} looks"
    if is_certain_enough(estimate, len(target.sightings), settings.stops, VERTICAL):
        hidden = f"facetd cannot see its turn about the vertical {_where_turn_is_hidden(context, target)}"
        why += f"; {hidden}{_any_turn_hint(target)}"
    skip(context, world, Outcome.UNSURE, target, why, CauseCode.UNCERTAIN)
    return PickEvent.GAVE_UP


async def _choose_side_view(context: PickContext, target: Target, free_axis: Array | None) -> None:
    """Choose the side to look from next, where looks along the approach cannot settle how the part lies."""
    cell, mounting = context.cell, context.cell.mounting
    if target.side_view is not None or not isinstance(mounting, OnHand) or cell.alone is not None:
        return
    known = target.shape, target.sightings, target.look_rotation, context.settings, mounting, cell.rig
    side = await cell.compute(side_that_shows_turn, *known, context.mover.reach, free_axis)
    if side is None:
        return
    target.side_view = side
    leans_deg = np.degrees(np.arccos(np.clip(-(side @ mounting.tool_from_cyclopean[:3, 2])[2], -1.0, 1.0)))
    why = f"its turn does not show along the approach, but from {leans_deg:.0f} degrees off the vertical"
    context.decide(f"look at {target.label} from a side", why, DecisionCode.LOOKED_AGAIN, label=target.label)


def _where_turn_is_hidden(context: PickContext, target: Target) -> str:
    """From where the turn of the target does not show, in words."""
    if not isinstance(context.cell.mounting, OnHand):
        return "with the fixed cameras"
    if context.cell.alone is not None:
        return "along the approach, and with one camera it looks from no other side"
    return "from any side in reach" if target.side_view is None else "well enough, not even from a side"


def _any_turn_hint(target: Target) -> str:
    """What a person can do for a part that is to go to a place, in words."""
    if target.way is None:
        return ""
    name = target.way.goal.place.name
    return f": set `any_turn: true` for place {pattern_of(name)} if the part may lie there turned any way"


def _free_axis(target: Target) -> Array | None:
    """(3,) world, the axis about which the turn of a part does not matter; None: its turn matters. It must neither to
    the fingers nor where the part is brought."""
    if not target.plan.grasp.any_turn:
        return None
    if target.way is None:
        return VERTICAL
    axis = target.way.goal.axis
    return None if axis is None else np.asarray(target.world_from_part[:3, :3] @ axis.direction)


async def _diagnose_disagreement(
    context: PickContext, world: WorldModel, target: Target, chi: float
) -> Literal["part", "unclear"]:
    """Two looks disagree: which is suspect? Where the part moved, the newest look alone counts from now on; where that
    does not show from here, the whole table is to be looked at. Raises SuspectError where the cell is to blame, and
    MovedByOthersError where somebody moved the arm."""
    assert target.looked_before is not None
    settings, recogniser, compute = context.settings, context.recogniser, context.cell.compute
    await context.mover.still_there(f"looks {target.looks - 1} and {target.looks} disagree")
    before, now = [await whole_look(compute, recogniser, seen) for seen in (target.looked_before, target.look)]
    old, new = other_parts(target, before), other_parts(target, now)
    moved = await compute(chi_squares_of_others, old, new, recogniser.shape, context.cell.rig, settings.doubt)
    who = "camera" if now.epipolar_px > settings.epipolar_limit_px else pose_fusion.suspect(moved)
    text = f"looks {target.looks - 1} and {target.looks} disagree (chi-square {chi:.0f}; the limit is {CHI_SQUARE_6:g})"
    context.decide(f"suspect: {who}", text, suspected(who), label=target.label, chi2=chi)
    world.disagreements["two looks at the part differ by more than their errors allow"] += 1
    if who in ("camera", "hand-eye") or target.restarts:
        raise SuspectError(f"{text}; likely cause: {who}; `calibrate verify`", who)
    target.restarts += 1
    del target.sightings[:-1]
    if who == "part":
        return "part"
    world.disagreement_count += 1
    if world.disagreement_count > settings.tries:  # the look at the table showed each time that nothing else had moved
        often = f"{world.disagreement_count} approaches in one pick, and nothing else moved"
        raise SuspectError(f"{text}, {often}; likely cause: hand-eye; `calibrate verify`", "hand-eye")
    itself = [p for p in world.found if same_place(p.centre, target.centre, 2 * SAME_PLACE_MM)]
    world.before_disagreement = [p for p in world.found if p not in itself], itself
    return "unclear"
