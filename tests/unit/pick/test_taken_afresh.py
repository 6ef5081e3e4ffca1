"""What a pick goes by on its way is what holds at that moment: a look that is not too old, the speed for where a step
ends, the time that the gripper needs for what it does, the place where the arm is now."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.arm.motion import MovedByOthersError
from daemon.pick.grippers.suction import SuctionCup
from daemon.pick.pose_fusion import disagreement
from daemon.pick.settings import Settings
from daemon.pick.transitions import PickEvent, PickState
from daemon.pick.world import PickContext, SuspectError, WorldModel, travel
from tests.fakes.fake_cell import World, cycle_of, one_part
from tests.fakes.pick_steps import begun, brought_to, step

CUP = Settings(gripper=SuctionCup(dwell_s=0.4, blow_off_s=0.2), hand_s=0.3)
"""A cup needs longer to take hold than to let go."""


@pytest.mark.parametrize(("state", "side"), [(PickState.STOP_N, False), (PickState.FINAL, True)])
def test_by_a_look_that_got_old_no_part_is_approached(state: PickState, side: bool) -> None:
    """Somebody may have pushed the part since: neither a stand-off is gone to, nor round to the side of the grasp."""
    fake = one_part()
    context, world = begun(fake)
    brought_to(state, context, world)
    target = world.the_target()
    target.side_view = target.look_rotation if side else None
    fake.now_s = target.look.taken_s + context.settings.limits.max_look_age_s + 1.0
    sent = len(fake.wire)
    assert step(context, world, state) is PickEvent.UNREACHABLE
    assert fake.said("refusal")[-1]["rule"] == "stale_look"
    assert len(fake.wire) == sent


def test_each_step_towards_a_part_is_as_fast_as_where_it_ends_allows() -> None:
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.FINAL, context, world)
    context.mover.limits = replace(context.mover.limits, max_step_mm=80.0)
    for up_mm, slower in ((200.0, False), (-200.0, True)):
        pose = fake.at.copy()
        pose[2, 3] += up_mm
        sent = len(fake.said("move"))
        asyncio.run(travel(context, world, pose, "a way", straight=True))
        speeds = [r["speed_pct"] for r in fake.said("move")[sent:]]
        assert len(set(speeds)) > 1
        assert speeds == sorted(speeds, reverse=slower)


def timed(context: PickContext, monkeypatch: pytest.MonkeyPatch) -> list[tuple[bool, float]]:
    """How long the gripper is waited for, each time it works; closed, s."""
    waited: list[tuple[bool, float]] = []

    async def works(closed: bool, hand_s: float) -> None:
        waited.append((closed, hand_s))
        await context.mover.cell.robot.set_gripper(closed)

    monkeypatch.setattr(context.mover, "work_gripper", works)
    return waited


def test_a_cup_is_waited_for_as_long_as_it_needs_to_take_hold_and_to_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lifted too early a part stays behind, and moved on too early it goes along."""
    context, world = begun(one_part())
    brought_to(PickState.CLOSING, context, world)
    waited = timed(context, monkeypatch)
    context = replace(context, settings=replace(context.settings, gripper=CUP.gripper, hand_s=CUP.hand_s))
    assert step(context, world, PickState.CLOSING) is PickEvent.CLOSED
    assert waited == [(True, 0.4)]
    step(context, world, PickState.RETREAT)
    step(context, world, PickState.BIN)
    assert waited == [(True, 0.4), (False, 0.3)]


@pytest.mark.parametrize(("closed", "hand_s"), [(True, 0.4), (False, 0.3)])
def test_a_cup_that_a_person_works_is_waited_for_as_long(closed: bool, hand_s: float) -> None:
    cycle = cycle_of(one_part(), CUP)
    asked: list[tuple[bool, float]] = []

    async def works(*what: Any) -> None:
        asked.append(what)

    cycle.supervisor.mover.work_gripper = works
    asyncio.run(cycle.set_gripper(closed))
    assert asked == [(closed, hand_s)]


def test_a_small_move_starts_where_a_pendant_left_the_arm() -> None:
    """`jog z 10` is meant from where it stands, and not from where facetd brought it last."""
    fake = one_part()
    cycle = cycle_of(fake)
    by = np.array([0.0, 0.0, 10.0, 0.0, 0.0, 0.0])
    asyncio.run(cycle.jog(lambda at: frames.perturb(at, by), "jog z 10"))
    fake.at = moved = frames.perturb(fake.at, np.array([40.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    target = asyncio.run(cycle.jog(lambda at: frames.perturb(at, by), "jog z 10"))
    np.testing.assert_allclose(target, frames.perturb(moved, by), atol=1e-6)


def looked_twice(fake: World, others: list[str], meanwhile: Callable[[], None]) -> tuple[PickContext, WorldModel]:
    """Two looks at the cube, beside others; between the two something happens."""
    for label, y_mm in zip(others, (-70.0, 70.0), strict=False):
        fake.put(label, 560, y_mm, 0.4)
    context, world = begun(fake)
    brought_to(PickState.ESTIMATING, context, world)
    step(context, world, PickState.ESTIMATING)
    step(context, world, PickState.STOP_N)
    meanwhile()
    assert step(context, world, PickState.LOOKING) is PickEvent.LOOKED
    return context, world


def test_where_all_that_two_looks_show_seems_moved_the_cell_is_to_blame_and_no_part() -> None:
    fake = one_part()

    def all_moved() -> None:
        for label, pose in fake.lying.items():
            fake.lying[label] = frames.perturb(pose, np.array([5.0, 0.0, 0.0, 0.0, 0.0, 0.0]))

    context, world = looked_twice(fake, ["pyramid"], all_moved)
    with pytest.raises(SuspectError, match="likely cause: hand-eye"):
        step(context, world, PickState.ESTIMATING)


def test_an_arm_that_somebody_moved_is_asked_where_it_is_before_hand_eye_is_blamed() -> None:
    """All parts seem moved then, too, and nobody calibrates for it."""
    fake = one_part()

    def nudged() -> None:
        fake.at = frames.perturb(fake.at, np.array([8.0, 0.0, 0.0, 0.0, 0.0, 0.0]))

    context, world = looked_twice(fake, ["pyramid"], nudged)
    with pytest.raises(MovedByOthersError):
        step(context, world, PickState.ESTIMATING)
    assert not [r for r in fake.said("decision") if r["text"].startswith("suspect")]


def test_each_look_is_held_against_the_one_before_it_which_was_the_nearest_so_far() -> None:
    """The first one, from far away, errs by so much that a small push would not show."""
    fake = one_part()
    context, world = looked_twice(fake, [], lambda: None)
    for _ in range(2):
        assert step(context, world, PickState.ESTIMATING) in (PickEvent.SURE, PickEvent.UNSURE)
        step(context, world, PickState.STOP_N)
        assert step(context, world, PickState.LOOKING) is PickEvent.LOOKED
    first, *_, before, newest = world.the_target().sightings
    step(context, world, PickState.ESTIMATING)
    chi2, doubt = fake.said("estimate")[-1]["chi2"], context.settings.doubt
    assert chi2 == pytest.approx(disagreement(before, newest, doubt))
    assert chi2 != pytest.approx(disagreement(first, newest, doubt))


def test_a_part_is_lifted_straight_off_before_it_is_drawn_back() -> None:
    """Drawn back first it would scrape over the table, and push over what stands beside it."""
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.RETREAT, context, world)
    grasped, sent = fake.at.copy(), len(fake.said("move"))
    step(context, world, PickState.RETREAT)
    lift, *_ = fake.said("move")[sent:]
    by_mm = lift["target"][:3, 3] - grasped[:3, 3]
    np.testing.assert_allclose(by_mm, [0.0, 0.0, context.settings.lift_mm], atol=0.5)
    assert lift["how"] == "straight"


def test_from_the_moment_the_gripper_has_closed_the_part_in_it_is_guarded_as_it_was_grasped() -> None:
    """A gripper that closes makes void what was believed of it: what it holds is learnt behind that."""
    context, world = begun(one_part())
    brought_to(PickState.CLOSING, context, world)
    target = world.the_target()
    step(context, world, PickState.CLOSING)
    belief = context.mover.belief
    assert {capsule.name for capsule in belief.capsules} == {"cube in the gripper"}
    assert belief.grasped_part is not None
    np.testing.assert_allclose(belief.grasped_part.value.tool_from_part, target.tool_from_part)
    assert context.mover.bounds.capsules == (*context.mover.limits.capsules, *belief.capsules)
