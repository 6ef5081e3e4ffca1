"""The states in which a part is found and chosen: survey, choose, second_view. See world.py for what a handler is."""

from collections import Counter
from collections.abc import Sequence
from typing import Literal

import numpy as np

from daemon import frames
from daemon.arm import CameraMounting, InWorld, Reach
from daemon.arrays import Array
from daemon.events.codes import BY_UNNAMED, CauseCode, DecisionCode, suspected
from daemon.events.outcomes import Outcome
from daemon.pick import pose_fusion
from daemon.pick.following import Target, chi_squares_of_others
from daemon.pick.fused_objects import outlines_of
from daemon.pick.looks import Look
from daemon.pick.outcome import PickResult
from daemon.pick.planning import (
    MOST_GRASPS,
    Destination,
    Gain,
    NoPlan,
    PartHypothesis,
    Plan,
    deviation,
    distinct_hypotheses,
    farthest_viewpoint,
    hypotheses_in_words,
    hypotheses_of,
    next_best,
    plan_to_place,
    reachable_poses,
    then_in_words,
    untaught_hypothesis,
    viewpoints_round,
)
from daemon.pick.pose_fusion import CHI_SQUARE_6
from daemon.pick.recogniser import PartRecogniser
from daemon.pick.seen import NEIGHBOUR_MM, ObservedPart, apart_mm, facings, is_facet_of, missing_parts, same_place
from daemon.pick.set_down import look_at_unseen
from daemon.pick.settings import Settings
from daemon.pick.transitions import PickEvent
from daemon.pick.world import (
    MOVE_ERRORS,
    InformationGain,
    PickContext,
    SuspectError,
    WorldModel,
    look,
    reraise_if_all_refused,
    skip,
    travel,
)
from daemon.store.place_file import BIN
from daemon.store.place_status import AT_PLACE_MM
from daemon.vision.geometry import Polyhedron, StereoRig
from daemon.vision.health import cause_of_nothing
from daemon.vision.values import Cause

SIDES_DEG = (20, 35)
"""How much a look leans that is to show what others hide: of facets of parts that touch most are found from there
(tests/bench/long/looks.py)."""
LIES_THERE_MM, LIES_THERE_DEG = 5.0, 10.0
"""A part that a survey shows this near to a free place, and turned like this, lies at it: surveys err by less."""
THERE_MM, THERE_DEG = 0.5, 0.1
"""How far from a survey position an arm may be that is there."""
MOST_STALE = 3
"""How often a table is looked at again because looks got old; after that the guard has its say."""


async def survey(context: PickContext, world: WorldModel) -> Literal[PickEvent.SEEN, PickEvent.NOTHING]:
    """Look at the table from each survey view until one shows a part that can be named and was not skipped; where
    none shows any part, from the last ones, too."""
    settings = context.settings
    world.target, world.found, world.looks, world.ghosts = None, [], [], []
    await look_at_unseen(context, world)
    for number, view in enumerate((*settings.surveys, *settings.last_surveys), start=1):
        if number > len(settings.surveys) and (world.left(context) or world.skipped):
            break
        pose = view.pose(context.cell.mounting)
        if not await _is_at(context, pose):
            await travel(context, world, pose, f"survey {number}")
        assert context.mover.belief.resting_reading is not None
        world.look_count += 1
        seen = await context.look_exposed(context.mover.belief.resting_reading, f"survey {number}")
        await world.add_look(context, seen)
        if any(part.named for part in world.left(context)):
            await _resolve_disagreement(context, world)
            return PickEvent.SEEN
    await _resolve_disagreement(context, world)
    if world.result.outcome is Outcome.EMPTY and not world.found:
        _explain_empty_table(world)
    elif world.result.outcome is Outcome.EMPTY:
        _explain_parts_at_places(context, world)
    return PickEvent.SEEN if world.left(context) else PickEvent.NOTHING


async def _is_at(context: PickContext, pose: Array) -> bool:
    """Whether the arm stands there already, as its controller says now: in step mode nobody is asked about no move."""
    at = context.mover.belief.resting_reading
    if at is None or context.mover.dry or apart_mm(at.world_from_tool[:3, 3], pose[:3, 3]) > THERE_MM:
        return False
    if np.degrees(frames.angle_between(at.world_from_tool, pose)) > THERE_DEG:
        return False
    await context.mover.still_there("survey")
    return True


def _explain_empty_table(world: WorldModel) -> None:
    """A table on which nothing was found is empty, unless both cameras have outlines there that do not fit one another
    and are not those of a pattern."""
    odd = [seen for seen in world.looks if all(seen.scene.view.outlines)]
    if odd and all(cause_of_nothing(seen.taken.images) is Cause.PATTERNED for seen in odd):
        world.result = PickResult(Outcome.EMPTY, "no part shows on the patterned table", None)
    elif odd:
        why = "outlines in both images, but no facet: light, focus, a knocked camera?"
        world.result = PickResult(Outcome.UNKNOWN, why, CauseCode.UNMATCHED_OUTLINES)


def _explain_parts_at_places(context: PickContext, world: WorldModel) -> None:
    """If every wanted part already lies at its place, say so as the result."""
    lying = [
        f"{part.label} lies at {goal.description}"
        for part in world.found
        if context.order.wants(part.label) and (goal := world.place_of(context, part)) is not None
    ]
    if lying:
        world.result = PickResult(Outcome.EMPTY, f"nothing to pick: {', '.join(lying)} already", None)


async def _resolve_disagreement(context: PickContext, world: WorldModel) -> None:
    """Where looks at one part disagreed, check whether the others still lie where they lay before the approach.

    Where there are no others, check the part itself.
    """
    before, world.before_disagreement = world.before_disagreement, None
    if before is None:
        return
    await context.mover.still_there("the look at the whole table")

    async def moved(parts: list[ObservedPart]) -> list[float]:
        shape_of, rig, doubt = context.recogniser.shape, context.cell.rig, context.settings.doubt
        return await context.cell.compute(chi_squares_of_others, parts, world.found, shape_of, rig, doubt)

    others, itself = [await moved(parts) for parts in before]
    if not others and itself and max(itself) <= CHI_SQUARE_6:
        context.decide(
            "approach it again",
            "looked at again from the first viewpoint, the part has not moved",
            DecisionCode.PLANNED_AGAIN,
        )
        return
    who = pose_fusion.suspect(others)
    why = "the whole table was looked at again and compared with the look before"
    context.decide(f"suspect: {who}", why, suspected(who))
    if who == "unclear":
        raise SuspectError(
            "a part moved, or the cameras were knocked: with no other part in view facetd cannot tell which. "
            "`calibrate verify`, or put a second part on the table",
            who,
        )
    if who != "part":
        raise SuspectError(f"other parts seem to have moved as well; likely cause: {who}; `calibrate verify`", who)


async def choose(
    context: PickContext, world: WorldModel
) -> Literal[PickEvent.CHOSEN, PickEvent.DOUBTFUL, PickEvent.STALE, PickEvent.NONE_LEFT]:
    """Choose the first part, in order, that can be picked; skip and name the others. A pick that would go on without
    end also ends here."""
    world.target = None
    given_up = world.give_up_reason(context)
    if given_up is not None:
        world.result = PickResult(Outcome.UNSURE, given_up, DecisionCode.GIVEN_UP)
        context.decide("give up", given_up, DecisionCode.GIVEN_UP)
        return PickEvent.NONE_LEFT
    for part in world.left(context):
        age_s = context.cell.clock() - part.look.taken_s
        if world.stale_looks < MOST_STALE and age_s > context.settings.limits.max_look_age_s / 2:
            world.stale_looks += 1
            return PickEvent.STALE
        shape = context.recogniser.shape(part.label)
        if not part.named or shape is None:
            if _may_look_again(context, world, part):
                world.doubtful = part
                return PickEvent.DOUBTFUL
            candidates = part.recognition.candidates
            outcome = Outcome.AMBIGUOUS if candidates else Outcome.UNKNOWN
            fits = " or ".join(candidates) or "nothing that was taught"
            code = BY_UNNAMED.get(str(part.recognition.cause), CauseCode.ALIKE if candidates else CauseCode.NOT_TAUGHT)
            skip(context, world, outcome, part, f"fits {fits}: {part.recognition.reason}", code)
            continue
        destination = destination_of(context, world, part)
        if isinstance(destination, str):
            skip(context, world, Outcome.FULL, part, destination, CauseCode.PLACES_FULL)
            continue
        neighbours = [other for other in world.found if other is not part]
        ways = context.settings, context.cell.mounting, context.mover.reach
        unseen = world.unseen_directions_of(part.centre)
        looks, most = [*world.looks], max(1, MOST_GRASPS - world.regrasps)
        side_view, plan = await context.cell.compute(
            _plan_with_side_view, part, shape, neighbours, unseen, *ways, context.cell.rig, destination, looks, most
        )
        if isinstance(plan, NoPlan):
            barred = any(p.lone and same_place(p.centre, part.centre, NEIGHBOUR_MM) for p in world.found)
            if barred and _may_look_again(context, world, part):
                world.doubtful = part
                return PickEvent.DOUBTFUL
            skip(context, world, Outcome.UNREACHABLE, part, plan.why, plan.code)
            continue
        sure = part.recognition.confidence
        world.target = world.last_target = Target(
            part.label,
            shape,
            part.world_from_part,
            plan,
            part.look,
            side_view=side_view,
            confidence=sure,
            seen_at=part.centre,
        )
        context.decide(
            f"pick {part.label}",
            f"{context.settings.order}: confidence {sure:.2f}; grasp {plan.grasp.description}{then_in_words(plan)}",
            DecisionCode.CHOSEN,
            label=part.label,
            grasps=plan.grasps,
            **plan.grasp.figures,
        )
        return PickEvent.CHOSEN
    return PickEvent.NONE_LEFT


def destination_of(context: PickContext, world: WorldModel, part: ObservedPart) -> Destination | str | None:
    """Where a named part belongs; None: over the bin; in words why it cannot go anywhere. A place where something shows
    that nobody brought is left alone."""
    table = context.placing
    ordered = context.order.place(part.label)
    if ordered == BIN or not table.has(part.label):
        return None
    free = []
    for goal in table.free(part.label, ordered):
        off = deviation(goal, part.world_from_part)
        if off.off_mm < LIES_THERE_MM and off.off_deg < LIES_THERE_DEG:
            return f"it lies at place {goal.place.name} already: `place check {goal.place.name}`"
        lying = [p for p in world.found if p is not part and same_place(p.centre, goal.centre, AT_PLACE_MM)]
        if not lying:
            free.append(goal)
    if not free:
        unusable = [table.unusable[p.name] for p in table.places.of(part.label) if p.name in table.unusable]
        return "; ".join(["none of its places is free", *unusable[:1]])
    return Destination(free, [goal.corners for goal in table.taken()], [goal.corners for goal in table.goals.values()])


def _may_look_again(context: PickContext, world: WorldModel, part: ObservedPart) -> bool:
    """Whether a part that lies here may be looked at from one more side."""
    looks = sum(same_place(part.centre, centre) for centre in world.looked_again)
    return looks < context.settings.views_of_doubtful


def _side_view(
    part: ObservedPart, unseen: Sequence[Array], settings: Settings, mounting: CameraMounting, reach: Reach
) -> Array | None:
    """(3, 3) how the tool was turned in the look that named the part, for one that looks along its approaches do
    not show, and where the arm can look at it so from every stand-off; None: look along the approach. Fixed cameras
    look while the arm is out of their view."""
    if isinstance(mounting, InWorld):
        return mounting.out_of_view[:3, :3]
    if not unseen:
        return None
    view: Array = part.look.reading.world_from_tool[:3, :3]
    distances = (*settings.stops.stand_offs_mm, settings.verify_mm)
    poses = [mounting.look_pose(view, part.centre, d) for d in distances]
    return view if reach.allows_each(np.stack(poses)).all() else None


def _plan_with_side_view(
    part: ObservedPart,
    shape: Polyhedron,
    neighbours: Sequence[ObservedPart],
    unseen: Sequence[Array],
    settings: Settings,
    mounting: CameraMounting,
    reach: Reach,
    rig: StereoRig,
    destination: Destination | None = None,
    looks: Sequence[Look] = (),
    most: int = 1,
) -> tuple[Array | None, Plan | NoPlan]:
    """The viewing direction (None: along the approach) and the best grasp that can be reached past the part's
    neighbours, or why there is none. unseen: see WorldModel.sides_unseen. If no one grasp brings the part to its place:
    the first of at most so many; looks: at the table that it lies on in between."""
    side_view = _side_view(part, unseen, settings, mounting, reach)
    beside = [other.corners for other in neighbours if not is_facet_of(other, part)]
    arm, away = (settings, mounting, reach.allows_each, rig), unseen if side_view is None else ()
    pose = part.world_from_part
    plan, _ = plan_to_place(shape, pose, beside, *arm, destination, facings(part), away, looks, most)
    return side_view, plan


def next_unnamed_part(context: PickContext, world: WorldModel) -> ObservedPart | None:
    """What has no name and may be looked at again, what was looked at least first; None: nothing."""

    def looks(part: ObservedPart) -> int:
        return sum(same_place(part.centre, centre) for centre in world.looked_again)

    some = [part for part in world.left(context) if not part.named and _may_look_again(context, world, part)]
    return min(some, key=looks, default=None)


async def second_view(context: PickContext, world: WorldModel) -> Literal[PickEvent.SEEN]:
    """Look at a part that could not be named from where a look is expected to settle most for its time; at one that has
    a name, from far of all looks before, whether what bars the way to it shows again."""
    part, cell = world.doubtful, context.cell
    assert part is not None
    world.looked_again.append(part.centre)
    looked = {id(one): one for one in (*world.looks, part.look)}.values()
    before, poses, gains = await cell.compute(
        _next_views,
        part,
        [other for other in world.found if other is not part],
        np.array([one.world_from_cyclopean[:3, 3] for one in looked]),
        context.recogniser,
        context.settings,
        cell.rig,
        cell.mounting,
        context.mover.reach,
    )
    for gain in gains:
        why = (
            "is the facet that blocks the grasp really there?"
            if part.named
            else f"{hypotheses_in_words(before)}: {gain.bits:.2f} bits of information expected"
        )
        context.decide(f"another view of {part.label}", why, DecisionCode.ANOTHER_VIEW, label=part.label)
        try:
            await travel(context, world, poses[gain.place], "another view", part.look)
        except MOVE_ERRORS as error:
            reraise_if_all_refused(error)
            continue
        break
    else:
        why = "no other view of it is in reach"
        context.decide(f"another view of {part.label}", why, DecisionCode.ANOTHER_VIEW, label=part.label)
        return PickEvent.SEEN
    if context.mover.dry:
        return PickEvent.SEEN
    seen = await look(context, world, "another view")
    if part.named:
        world.ghosts += [p.centre for p in missing_parts(world.found, seen, part.centre)]
    await world.add_look(context, seen)
    if before:
        await record_gain(context, world, part, before, gain)
    return PickEvent.SEEN


def describe_parts(parts: Sequence[ObservedPart]) -> str:
    """`2 cube, 1 pyramid, 1 without a name`, or `nothing`."""
    named = Counter(part.label for part in parts if part.named)
    nameless = sum(not part.named for part in parts)
    texts = [f"{count} {label}" for label, count in sorted(named.items())]
    return ", ".join([*texts, *([f"{nameless} without a name"] if nameless else [])]) or "nothing"


async def look_from_other_side(context: PickContext, world: WorldModel) -> bool:
    """Look at all that was found, or where the table is surveyed, from far of all looks before, for what was hidden;
    False where that cannot be."""
    survey = context.settings.surveys[0]
    middle = np.mean([part.centre for part in world.found] or [np.array(survey.centre_mm)], axis=0)
    poses = viewpoints_round(middle, context.cell.mounting, survey.distance_mm, tilts=SIDES_DEG)
    poses = await context.cell.compute(reachable_poses, poses, context.mover.reach)
    viewpoints = [context.cell.mounting.world_from_cyclopean_at(pose)[:3, 3] for pose in poses]
    before = [one.world_from_cyclopean[:3, 3] for one in world.looks]
    for place in farthest_viewpoint(middle, viewpoints, before):
        try:
            await travel(context, world, poses[place], "another side", world.looks[-1])
        except MOVE_ERRORS as error:
            reraise_if_all_refused(error)
            continue
        was = describe_parts(world.found)
        await world.add_look(context, await look(context, world, "another side"))
        world.tell(context, InformationGain("what they hide", was, describe_parts(world.found), 0.0, 0.0, 0.0, 0.0))
        return True
    return False


def _next_views(
    part: ObservedPart,
    others: Sequence[ObservedPart],
    viewpoints_before: Array,
    recogniser: PartRecogniser,
    settings: Settings,
    rig: StereoRig,
    mounting: CameraMounting,
    reach: Reach,
) -> tuple[Sequence[PartHypothesis], list[Array], list[Gain]]:
    """What a part may be; places it can be looked at from; these by their numbers, in the order in which to try them.
    viewpoints_before: (L, 3) from where it was looked at so far."""
    before = () if part.named else hypotheses_of(part, recogniser, settings.limits.table_z_mm)
    poses = reachable_poses(viewpoints_round(part.centre, mounting), reach)
    if not poses:
        return before, [], []
    return (
        before,
        poses,
        next_best(
            before or (untaught_hypothesis(part),),
            rig,
            part.centre,
            np.array([mounting.world_from_cyclopean_at(pose)[:3, 3] for pose in poses]),
            [reach.takes_s(pose, settings.travel_pct) + part.look.seconds for pose in poses],
            viewpoints_before,
            [ring for other in others for ring in outlines_of(other, recogniser)],
        ),
    )


async def record_gain(
    context: PickContext, world: WorldModel, part: ObservedPart, before: Sequence[PartHypothesis], gain: Gain
) -> None:
    """What the look has brought, to the log and to whoever asked."""
    compute, rig = context.cell.compute, context.cell.rig
    now = min(world.found, key=lambda p: apart_mm(p.centre, part.centre), default=None)
    if now is None or not same_place(now.centre, part.centre):
        after, bits = "nothing is there any more", 0.0
    elif now.named:
        after, bits = f"{now.label} {now.recognition.confidence:.1%}".replace("%", " %"), 0.0
    else:
        after, bits = await compute(
            _describe_hypotheses, now, context.recogniser, context.settings.limits.table_z_mm, rig
        )
    x, y, _ = part.centre
    about, bits_before = f"what lies at {x:.0f}, {y:.0f} mm", await compute(entropy_bits, before, rig)
    world.tell(
        context, InformationGain(about, hypotheses_in_words(before), after, bits_before, bits, gain.bits, gain.seconds)
    )


def _describe_hypotheses(
    part: ObservedPart, recogniser: PartRecogniser, table_z_mm: float | None, rig: StereoRig
) -> tuple[str, float]:
    """What a part without a name may be, in words, and the bits that are open."""
    hypotheses = hypotheses_of(part, recogniser, table_z_mm)
    return hypotheses_in_words(hypotheses), entropy_bits(hypotheses, rig)


def entropy_bits(hypotheses: Sequence[PartHypothesis], rig: StereoRig) -> float:
    """Bits that are open between hypotheses, those that look alike taken as one."""
    return distinct_hypotheses(hypotheses, rig).entropy
