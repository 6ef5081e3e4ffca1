"""What a pick goes by on its way is what holds at that moment: a look that is not too old, the speed for where a step
ends, the time that the gripper needs for what it does, the place where the arm is now."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.pick.settings import Settings
from daemon.pick.suction import SuctionCup
from daemon.pick.transitions import PickEvent, PickState
from daemon.pick.world import PickContext, travel
from tests.fakes.fake_cell import cycle_of, one_part
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
        await context.mover.cell.robot.hand(closed)

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
    asyncio.run(cycle.hand(closed))
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
