"""The states in which a part is found and chosen: survey, choose, second_view. See world.py for what a handler is."""

from __future__ import annotations

from typing import Literal

from daemon.arrays import Array
from daemon.pick import fusion, viewpoints
from daemon.pick.following import Target, beside
from daemon.pick.looking import Look
from daemon.pick.outcome import Outcome
from daemon.pick.plan import Plan, other_view, plan_part
from daemon.pick.seen import NEIGHBOUR_MM, Seen, facings, is_own, merged, same_place, seen_parts, unconfirmed
from daemon.pick.transitions import Event
from daemon.pick.world import PickContext, SuspectError, WorldModel, look, skip, travel
from daemon.vision.geometry import Polyhedron
from daemon.vision.look import outlines

MOST_OLD = 3
"""How often a table is looked at again because looks got old; after that the guard has its say."""


async def survey(context: PickContext, world: WorldModel) -> Literal[Event.SEEN, Event.NOTHING]:
    """Look at the table from each survey view until one shows a part that can be named and was not skipped; where
    none shows any part, from the last ones, too."""
    settings = context.settings
    world.target, world.found = None, []
    for number, view in enumerate((*settings.surveys, *settings.last_surveys), start=1):
        if number > len(settings.surveys) and (world.left(context) or world.skipped):
            break
        await travel(context, world, view.pose(context.cell.tool_from_cyclopean), f"survey {number}")
        assert context.mover.at is not None
        seen = await context.lit_look(context.mover.at, f"survey {number}")
        world.found = merged(world.found, seen_parts(seen))
        world.unmatched += all(outlines(seen.scene.view))
        _settle_question(context, world)
        if any(part.named for part in world.left(context)):
            return Event.SEEN
    if not world.found and world.unmatched and world.outcome is Outcome.EMPTY:
        world.outcome = Outcome.UNKNOWN
        world.why = "outlines in both images, but no facet: light, focus, a knocked camera?"
    return Event.SEEN if world.left(context) else Event.NOTHING


def _settle_question(context: PickContext, world: WorldModel) -> None:
    """Looks at one part disagreed: do the others still lie where they lay before it was approached?"""
    before, world.questioned = world.questioned, None
    if before is None:
        return
    moved = beside(before, world.found, context.recogniser.shape, context.cell, context.settings.doubt)
    who = fusion.suspect(moved, 0.0, context.settings.epipolar_limit_px)
    context.decide(f"suspect: {who}", "the whole table was looked at again, and held against the look before")
    if who == "unclear":
        raise SuspectError("a part moved, or the cameras were knocked: with no other part in view it cannot be told")
    if who != "part":
        raise SuspectError(f"other parts seem to have moved as well; suspect: {who}")


async def choose(
    context: PickContext, world: WorldModel
) -> Literal[Event.CHOSEN, Event.DOUBTFUL, Event.STALE, Event.NONE_LEFT]:
    """The first part, in order, that can be had; each that cannot is skipped and named."""
    world.target = None
    for part in world.left(context):
        if world.old_looks < MOST_OLD and _is_old(context, part.look):
            world.old_looks += 1
            return Event.STALE
        shape = context.recogniser.shape(part.label)
        if not part.named or shape is None:
            if _may_look_again(context, world, part):
                world.doubtful = part
                return Event.DOUBTFUL
            candidates = part.taken_for.candidates
            outcome = Outcome.AMBIGUOUS if candidates else Outcome.UNKNOWN
            fits = " or ".join(candidates) or "nothing that was taught"
            skip(context, world, outcome, part, f"fits {fits}: {part.taken_for.reason}")
            continue
        side_view = _side_view(context, world, part)
        plan = _planned(context, world, part, shape, side_view)
        if isinstance(plan, str):
            barred = any(p.lone and same_place(p.centre, part.centre, NEIGHBOUR_MM) for p in world.found)
            if barred and _may_look_again(context, world, part):
                world.doubtful = part
                return Event.DOUBTFUL
            skip(context, world, Outcome.UNREACHABLE, part, plan)
            continue
        sure = part.taken_for.confidence
        world.target = world.last_target = Target(
            part.label, shape, part.world_from_part, plan, part.look, side_view=side_view, confidence=sure
        )
        context.decide(
            f"pick {part.label}",
            f"{context.settings.order}: confidence {sure:.2f}; grasp {plan.grasp.width_mm:.0f} mm wide, "
            f"tilted {plan.grasp.tilt_deg:g} degrees, contacts {plan.grasp.slip_deg:.0f} degrees off square",
        )
        return Event.CHOSEN
    return Event.NONE_LEFT


def _is_old(context: PickContext, look: Look) -> bool:
    """Whether a look is too old to begin an approach on."""
    return context.cell.clock() - look.taken_s > context.settings.limits.max_look_age_s / 2


def _may_look_again(context: PickContext, world: WorldModel, part: Seen) -> bool:
    """Whether a part that lies here may be looked at from one more side."""
    looks = sum(same_place(part.centre, centre) for centre in world.looked_again)
    return looks < context.settings.views_of_doubtful


def _side_view(context: PickContext, world: WorldModel, part: Seen) -> Array | None:
    """(3, 3) how the tool was turned in the look that named the part, for one that looks along its approaches do
    not show, and where the arm can look at it so from every stand-off; None: look along the approach."""
    if not world.sides_unseen(part.centre):
        return None
    view: Array = part.look.reading.world_from_tool[:3, :3]
    distances = (*context.settings.stops.stand_offs_mm, context.settings.verify_mm)
    poses = [viewpoints.look_pose(view, part.centre, d, context.cell.tool_from_cyclopean) for d in distances]
    return view if all(context.mover.allows(pose) for pose in poses) else None


def _planned(
    context: PickContext, world: WorldModel, part: Seen, shape: Polyhedron, side_view: Array | None
) -> Plan | str:
    """The best grasp that can be reached past the neighbours, or why there is none."""
    return plan_part(
        shape,
        part.world_from_part,
        [other.corners for other in world.found if other is not part and not is_own(other, part)],
        context.settings,
        context.cell.tool_from_cyclopean,
        context.mover.allows,
        facings(part),
        world.sides_unseen(part.centre) if side_view is None else (),
    )


async def second_view(context: PickContext, world: WorldModel) -> Literal[Event.SEEN]:
    """Look at a part that could not be named from where its candidates differ most, or from another side; at one
    that has a name, whether what bars the way to it shows again."""
    part, tool_from_cyclopean = world.doubtful, context.cell.tool_from_cyclopean
    assert part is not None
    world.looked_again.append(part.centre)
    pose, why = other_view(part, context.recogniser.shape, world.eyes, tool_from_cyclopean, context.mover.allows)
    context.decide(f"another view of {part.label}", "does what bars the way show again?" if part.named else why)
    if pose is None:
        return Event.SEEN
    world.eyes.append((pose @ tool_from_cyclopean)[:3, 3])
    await travel(context, world, pose, "another view", part.look)
    seen = await look(context, world, "another view")
    if part.named:
        gone = unconfirmed(world.found, seen, part.centre)
        world.found = [p for p in world.found if p not in gone]
    world.found = merged(world.found, seen_parts(seen))
    return Event.SEEN
