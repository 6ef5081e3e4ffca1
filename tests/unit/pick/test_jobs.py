"""Jobs on the fake cell: the parts that are ordered, in the order that is asked for, and no other."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.events.pick_order import OrderStep, PickOrder
from daemon.pick.place_table import PlaceTable
from daemon.store.place_file import CellPlaces
from daemon.store.place_status import PlaceStatus, PlaceStatuses
from daemon.store.recovery_state import RecoveryState, after
from tests.fakes.fake_cell import World, cycle_of
from tests.unit.pick.test_order import some
from tests.unit.pick.test_set_down import Story, measured, nest

__all__ = ["measured"]
CUBE, PYRAMID, PRISM = OrderStep("cube"), OrderStep("pyramid"), OrderStep("triangular_prism")


def job(*steps: OrderStep, **options: Any) -> PickOrder:
    return PickOrder(sum(step.count for step in steps), job="kit", steps=steps, whole=steps, **options)


def brought(ends: list[Any]) -> list[str]:
    return [end.label for end in ends if end.outcome == "picked"]


def test_a_job_brings_its_parts_in_turn_and_leaves_the_others() -> None:
    world = some(4)
    cycle = cycle_of(world)
    ends = asyncio.run(cycle.auto(job(PRISM, CUBE)))
    assert brought(ends) == ["triangular_prism", "cube"]
    assert set(world.lying) == {"pyramid", "pentagonal_prism"}
    assert cycle.pick_order is None
    assert [r["target"] for r in world.said("cycle_start")] == ["triangular_prism", "cube"]


def test_in_any_order_whatever_is_wanted_is_brought_and_nothing_else() -> None:
    world = some(4)
    ends = asyncio.run(cycle_of(world).auto(job(PRISM, CUBE, in_turn=False)))
    assert sorted(brought(ends)) == ["cube", "triangular_prism"]
    assert set(world.lying) == {"pyramid", "pentagonal_prism"}


def test_a_job_that_lacks_a_part_stops_and_is_resumed_when_the_part_is_there() -> None:
    world = some(1)
    cycle = cycle_of(world)
    ends = asyncio.run(cycle.auto(job(PYRAMID, CUBE)))
    assert [end.outcome for end in ends] == ["empty"]
    assert not cycle.status()["auto"]
    assert cycle.pick_order == job(PYRAMID, CUBE), "nothing of it is lost"
    world.put("pyramid", 430, 100, 0.4)
    assert brought(asyncio.run(cycle.auto(cycle.pick_order))) == ["pyramid", "cube"]
    assert cycle.pick_order is None


def test_a_job_that_skips_leaves_out_what_is_not_there() -> None:
    world = some(1)
    cycle = cycle_of(world)
    ends = asyncio.run(cycle.auto(job(PYRAMID, CUBE, skip=True)))
    assert [end.outcome for end in ends] == ["empty", "picked"]
    assert cycle.pick_order is None


def test_a_job_that_waits_looks_again_until_the_part_has_come() -> None:
    world = some(1)
    cycle = cycle_of(world)

    async def scene() -> list[Any]:
        task = asyncio.create_task(cycle.auto(job(PYRAMID, CUBE, every_s=0.01)))
        while not world.said("cycle_end"):
            await asyncio.sleep(0)
        world.put("pyramid", 430, 100, 0.4)
        return await task

    assert brought(asyncio.run(scene())) == ["pyramid", "cube"]


def test_a_job_is_done_as_often_as_it_was_ordered() -> None:
    world = some(2)
    steps = (CUBE, PYRAMID)
    ends = asyncio.run(cycle_of(world).auto(PickOrder(4, job="kit", steps=steps, whole=steps, times=2, skip=True)))
    assert brought(ends) == ["cube", "pyramid"]
    assert len(ends) == 4, "and each step of the second time was looked for"


@pytest.mark.parametrize(("place", "status"), [("nest", PlaceStatus.RIGHT), ("bin", PlaceStatus.FREE)])
def test_a_step_goes_to_its_own_place(tmp_path: Path, place: str, status: PlaceStatus) -> None:
    """And not to the first that is free."""
    nearer, there = nest("nearer", (430.0, -320.0, -300.0)), nest(tolerance_mm=4.0, tolerance_deg=4.0)
    story = Story(tmp_path, (there,))
    table = PlaceTable(CellPlaces(places=(nearer, there)), PlaceStatuses(tmp_path))
    story.cycle.use_places(table)
    ends = asyncio.run(story.cycle.auto(job(OrderStep("cube", 1, place))))
    assert [end.outcome for end in ends] == ["picked"]
    assert (table.status("nearer"), table.status("nest")) == (PlaceStatus.FREE, status)


@pytest.mark.parametrize("after_parts", [0, 1, 2])
def test_the_recovery_file_says_what_is_left_as_the_cycle_does(after_parts: int) -> None:
    world = some(3)
    cycle = cycle_of(world)
    state = RecoveryState("a")

    async def scene() -> None:
        task = asyncio.create_task(cycle.auto(job(CUBE, PYRAMID, PRISM)))
        while sum(r["event"] == "binned" for r in world.said("state")) < after_parts or not world.said("move"):
            await asyncio.sleep(0)
        await cycle.supervisor.stop()
        await task

    asyncio.run(scene())
    for record in world.records:
        state = after(state, record["kind"], record)
    assert state.auto == cycle.pick_order
    assert cycle.pick_order is not None
    assert cycle.pick_order.count == 3 - after_parts


def test_how_long_the_rest_takes_is_as_the_last_parts_took() -> None:
    world = some(3)
    cycle = cycle_of(world)
    told: list[Any] = []
    world.before = lambda name: told.append(cycle.status()["left_s"]) if name == "move" else None
    ends = asyncio.run(cycle.auto(PickOrder(3)))
    assert told[0] is None, "nothing was picked yet"
    assert [left for left in told if left][-1] == pytest.approx(np.median([end.seconds for end in ends[:2]]))


def test_a_part_that_was_in_the_gripper_belongs_to_no_step() -> None:
    world: World = some(1)
    cycle = cycle_of(world)
    cycle.recover("bin", True, job(CUBE))
    cycle.supervisor.resume()
    cycle.holding(True)
    assert cycle.pick_order is not None
    ends = asyncio.run(cycle.auto(cycle.pick_order))
    assert [end.outcome for end in ends] == ["emptied", "picked"]
