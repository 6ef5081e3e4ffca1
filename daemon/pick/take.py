"""The states from the blind stretch to the bin: final, closing, retreat, verify, bin, home. See world.py for what a
handler is."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from daemon import frames
from daemon.arm import BeliefSource, carried_part
from daemon.events.codes import CauseCode, DecisionCode
from daemon.events.outcomes import BROUGHT, Outcome
from daemon.pick.following import (
    CameraMount,
    Target,
    grasped_part,
    is_still_there,
    mount_of,
    shows_empty_gripper,
    shows_in_gripper,
    shows_release,
)
from daemon.pick.gripper_sensor import contradiction, gripper_pair, read_sensor, stop_if_contradicted, wait_for_hold
from daemon.pick.looks import CapturedPair, Look
from daemon.pick.outcome import InGripper, PickResult, not_looked_at, released
from daemon.pick.planning import Goal, final_approach, obstacles_of
from daemon.pick.seen import ObservedPart, same_place, seen_parts
from daemon.pick.set_down import measure
from daemon.pick.settings import Settings
from daemon.pick.transitions import PickEvent
from daemon.pick.world import MOVE_ERRORS, PickContext, WorldModel, look, skip, travel, unreachable

HAND_REACH_MM = 70.0
"""What is seen within this of the tool's centre point is in the hand, and not on the table."""
SEEN_OFF_MM = 20.0
"""How far off a part may be seen from the side on which it was grasped."""


async def final(
    context: PickContext, world: WorldModel
) -> Literal[PickEvent.THERE, PickEvent.DRY, PickEvent.UNREACHABLE]:
    """The blind stretch: to before the part, then around it, both straight."""
    target, settings = world.the_target(), context.settings
    stretch = final_approach(target.plan.grasp, target.centre, settings, context.cell.mounting)
    try:
        if target.side_view is not None:
            far_mm = settings.stops.stand_offs_mm[0]
            round_it = context.cell.mounting.approach_pose(stretch.at, target.centre, far_mm)
            await travel(context, world, round_it, "round to the approach", target.look)
        context.mover.check_through(stretch)  # the last look moved the grasp a little, and there is one way out of it
        await travel(context, world, stretch.before, "before the grasp", target.look, straight=True)
        await travel(context, world, stretch.at, "grasp", target.look, straight=True)
    except MOVE_ERRORS as error:
        await unreachable(context, world, error)
        return PickEvent.UNREACHABLE
    if context.mover.dry:
        world.result = PickResult(Outcome.DRY, f"{target.label} would be grasped now", None)
        return PickEvent.DRY
    return PickEvent.THERE


async def closing(context: PickContext, world: WorldModel) -> Literal[PickEvent.CLOSED]:
    """Close the gripper. From now on the guard includes the part, at the pose at which it should have been grasped."""
    target = world.the_target()
    await context.mover.set_gripper(closed=True, hand_s=context.settings.hand_time_s(closed=True))
    corners = frames.apply(target.tool_from_part, target.shape.corners_mm)
    load = carried_part(corners, f"{target.label} in the gripper")
    held = grasped_part(target, context.settings.doubt)
    context.mover.beliefs.learn(BeliefSource.COMMANDED, held_shape=load, grasped_part=held)
    await wait_for_hold(context)
    return PickEvent.CLOSED


async def retreat(context: PickContext, world: WorldModel) -> Literal[PickEvent.THERE]:
    """Straight up and back as planned, then to where the place was seen from."""
    target, settings, mounting = world.the_target(), context.settings, context.cell.mounting
    stretch = final_approach(target.plan.grasp, target.centre, settings, mounting)
    await travel(context, world, stretch.lifted, "lift", straight=True)
    await travel(context, world, stretch.back, "back off", straight=True)
    if target.side_view is not None:
        seen_from = mounting.look_pose(target.side_view, target.centre, settings.verify_mm)
        await travel(context, world, seen_from, "where it was seen from")
    return PickEvent.THERE


async def verify(
    context: PickContext, world: WorldModel
) -> Literal[PickEvent.GONE, PickEvent.MEASURED, PickEvent.MISSED]:
    """Look whether the gripper holds the part, or at least whether the part has left its place and lies nowhere else. A
    look may err, so a gripper that seems to have missed opens over the bin, as one that holds the part does. A part
    that has a place is measured in the gripper; one that does not show there well enough goes to the bin."""
    target, seen = world.the_target(), await look(context, world, "verify")

    mount = mount_of(context.cell)
    words, code = await context.cell.compute(_judged, target, seen, world.found, context.settings, mount)
    sensor = await read_sensor(context, "lifted")
    stop_if_contradicted(context, contradiction(target.label, sensor, words, code is None))
    if code is None:
        why = f"{target.label} {words}"
        world.result = PickResult(Outcome.RELEASED, why, None)
        return await where_to(context, target, seen, why)
    world.failures += 1
    world.result = PickResult(Outcome.MISSED, f"{target.label} {words}", code)
    why = f"{world.result.why}; the gripper opens over the bin, because this look may be wrong"
    context.decide("missed", why, code, label=target.label)
    if world.failures >= context.settings.tries:
        skip(context, world, Outcome.MISSED, target, f"{words} after {world.failures} tries", code)
    await release_over_bin(context, world)
    return PickEvent.MISSED


async def where_to(
    context: PickContext, target: Target, seen: Look, why: str
) -> Literal[PickEvent.GONE, PickEvent.MEASURED]:
    """Whether a part in the gripper goes to the bin or to its place, where its edges show well enough how it is held;
    why: what speaks for its being there."""
    event: Literal[PickEvent.GONE, PickEvent.MEASURED] = PickEvent.GONE
    code: CauseCode | DecisionCode = DecisionCode.IN_GRIPPER
    text = "bring it to the bin"
    if target.way is not None:
        goal = target.way.goal
        target.measured_in_gripper = await measure(context, target, seen.taken)
        if goal.between and is_blocked(goal, seen):
            why, code = f"{why}; something lies where the part was to be laid on the table", CauseCode.NO_WAY_TO_PLACE
        elif target.measured_in_gripper is None:
            text, code = "bring it to the bin, not to its place", DecisionCode.NOT_MEASURED
            why = f"{why}; its edges in the gripper do not show how it is held"
        else:
            event, text = PickEvent.MEASURED, f"bring it to {goal.description}"
    context.decide(text, why, code, label=target.label)
    return event


def _judged(
    target: Target, seen: Look, found: Sequence[ObservedPart], settings: Settings, mount: CameraMount
) -> tuple[str, DecisionCode | None]:
    """What a look says of the part, and, where that speaks against its being in the hand, the cause. found: what lay
    there before."""
    if shows_in_gripper(target, seen.taken, mount, settings.doubt):
        return "shows in the gripper", None
    hand = seen.reading.world_from_tool[:3, 3]
    on_table = [p for p in seen_parts(seen) if not same_place(p.centre, hand, HAND_REACH_MM)]
    left = any(same_place(p.centre, target.centre, settings.gone_mm + SEEN_OFF_MM) for p in on_table)
    if left or is_still_there(target, seen):
        return "still lies there", DecisionCode.STILL_THERE
    if knocked_away(found, target, on_table):
        return "was knocked away", DecisionCode.KNOCKED_AWAY
    if shows_empty_gripper(seen.taken, mount, settings.gripper):
        return "is gone from where it lay, and the gripper is empty", DecisionCode.CAME_BACK_EMPTY
    return "is gone from where it lay", None


def is_blocked(goal: Goal, seen: Look) -> bool:
    """Whether a look shows something on the table where a part is to be placed."""
    hand, corners = seen.reading.world_from_tool[:3, 3], goal.corners[:, :2]
    middle = corners.mean(axis=0)
    reach_mm = float(np.linalg.norm(corners - middle, axis=1).max())
    others = [p.corners for p in seen_parts(seen) if not same_place(p.centre, hand, HAND_REACH_MM)]
    return not obstacles_of(others).free(middle, reach_mm)


def knocked_away(found: Sequence[ObservedPart], target: Target, on_table: list[ObservedPart]) -> bool:
    """Whether a part of the same name now lies where no part lay before."""
    others = [p.centre for p in found if not same_place(p.centre, target.centre)]
    alike = [p.centre for p in on_table if p.label == target.label]
    return any(not any(same_place(now, before) for before in others) for now in alike)


async def over_bin(
    context: PickContext, world: WorldModel
) -> Literal[PickEvent.BINNED, PickEvent.DROPPED, PickEvent.STILL_HELD, PickEvent.DRY]:
    """Let go above the bin; of a part that this pick grasped, look into the gripper before and after. What a pick
    brings counts as picked only where the two together show that the part left the gripper there."""
    target = world.target
    await travel(context, world, context.settings.bin.pose(), "bin")
    before, lost = await gripper_pair(context, target), await read_sensor(context, "over the bin") is False
    await _open_gripper(context)
    if context.mover.dry:
        world.result = PickResult(Outcome.DRY, "dry run: the part in the gripper would be released now", None)
        return PickEvent.DRY
    world.gripper_opened = True
    if target is not None:
        world.result = not_looked_at(target.label, "above the bin")
    sensor = await read_sensor(context, "let go")
    if target is None:
        stop_if_contradicted(context, contradiction("what it held", sensor, "was let go", False))
        return PickEvent.BINNED
    after = await gripper_pair(context, target)
    mount = mount_of(context.cell)
    above, opened = await context.cell.compute(_shown_in_gripper, target, before, after, mount, context.settings)
    if opened is not InGripper.PART:
        stop_if_contradicted(context, contradiction(target.label, sensor, "is in it no longer", False))
    if lost and above is InGripper.PART:
        stop_if_contradicted(context, contradiction(target.label, False, "was in it above the bin", True))
    above = InGripper.EMPTY if lost else above
    world.gripper_opened = False
    world.result = result = released(target.label, above, opened)
    context.cell.log.record("release", cycle=context.cycle, label=target.label, above=above, opened=opened)
    context.decide(result.outcome, result.why, result.code or DecisionCode.PICKED, label=target.label)
    if opened is InGripper.PART:
        context.mover.beliefs.learn(BeliefSource.OBSERVED, holding=True)
        return PickEvent.STILL_HELD
    return PickEvent.DROPPED if above is InGripper.EMPTY else PickEvent.BINNED


def _shown_in_gripper(
    target: Target, before: CapturedPair | None, after: CapturedPair | None, mount: CameraMount, settings: Settings
) -> tuple[InGripper, InGripper]:
    """What pairs from before the gripper opened and after show in it. Both are needed to tell that the target was."""
    above = opened = InGripper.UNCLEAR
    if after is not None and shows_in_gripper(target, after, mount, settings.doubt):
        opened = InGripper.PART
    if before is not None and after is not None and shows_release(target, before, after, mount, settings.doubt):
        above = InGripper.PART
    elif before is not None and shows_empty_gripper(before, mount, settings.gripper):
        above = InGripper.EMPTY
    return above, opened


async def release_over_bin(context: PickContext, world: WorldModel, purpose: str = "bin") -> None:
    """Open the gripper above the bin: nowhere else does a pick open it, but at the place of a part that it grasped."""
    await travel(context, world, context.settings.bin.pose(), purpose)
    await _open_gripper(context)


async def _open_gripper(context: PickContext) -> None:
    """Open the gripper, if the arm is still where it came to rest above the bin."""
    await context.mover.still_there("the gripper is to open above the bin")
    await context.mover.set_gripper(closed=False, hand_s=context.settings.hand_time_s(closed=False))


async def home(context: PickContext, world: WorldModel) -> Literal[PickEvent.THERE]:
    """Move home, unless the next pick begins at once."""
    world.target, world.going_home = None, True
    if context.order.count == 1 or world.result.outcome not in BROUGHT:
        await travel(context, world, context.settings.home.pose(), "home")
    return PickEvent.THERE
