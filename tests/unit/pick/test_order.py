"""An `auto on N` that is cut off knows what is left of it, and so does the log that a restart reads."""

from __future__ import annotations

import asyncio
from typing import Any

import numpy as np
import pytest

from daemon.events.pick_order import PickOrder
from daemon.pick.outcome import CycleEnd
from drivers.simcell import parts
from tests.fakes.fake_cell import World, cycle_of
from tests.fakes.waiting import PATIENCE_S, until_so

SPOTS = ((430, -100), (430, 100), (590, -90), (590, 90))


def some(count: int) -> World:
    world = World(np.random.default_rng(0))
    for label, (x, y) in list(zip(parts.TAUGHT, SPOTS, strict=True))[:count]:
        world.put(label, x, y, 0.4)
    return world


def cut_off(world: World, cycle: Any, after: int, how: str, **options: Any) -> None:
    """Begin auto, and cut it off when so many parts are in the bin."""

    async def scene() -> None:
        task = asyncio.create_task(cycle.auto(PickOrder(**options)))
        while sum(r["event"] == "binned" for r in world.said("state")) < after:
            await asyncio.sleep(0)
        await getattr(cycle.supervisor, how)()
        await task

    asyncio.run(scene())


@pytest.mark.parametrize("how", ["stop", "abort", "disable"])
def test_what_is_left_of_an_auto_that_was_stopped_is_known_and_taking_it_up_brings_just_that(how: str) -> None:
    world = some(4)
    cycle = cycle_of(world)
    cut_off(world, cycle, 1, how, count=3)
    assert cycle.pick_order == PickOrder(2, None)
    assert cycle.status()["left"] == PickOrder(2).json()
    assert not cycle.status()["auto"]
    cycle.supervisor.resume()
    cycle.supervisor.enable()
    cycle.holding(False)
    ends = asyncio.run(cycle.auto(cycle.pick_order))
    assert sum(end.outcome == "picked" for end in ends) == 2
    assert cycle.pick_order is None


def test_a_part_that_was_in_the_hand_counts_once_it_is_in_the_bin() -> None:
    world = some(2)
    cycle = cycle_of(world)
    cycle.recover("bin", True, PickOrder(2, None))
    cycle.supervisor.resume()
    cycle.holding(True)
    ends = asyncio.run(cycle.auto(cycle.pick_order))
    assert [end.outcome for end in ends] == ["emptied", "picked"]


def test_an_auto_that_came_to_its_end_leaves_nothing() -> None:
    for order in (PickOrder(count=1), PickOrder()):
        world = some(2)
        cycle = cycle_of(world)
        asyncio.run(cycle.auto(order))
        assert cycle.pick_order is None
        assert [record["on"] for record in world.said("auto")] == [True, False]


def test_auto_off_gives_up_what_is_left() -> None:
    world = some(2)
    cycle = cycle_of(world)
    cut_off(world, cycle, 1, "stop")
    assert cycle.pick_order == PickOrder(None, None)
    cycle.auto_off()
    assert cycle.pick_order is None
    assert [record["on"] for record in world.said("auto")] == [True, False]


def test_auto_off_gives_up_what_is_left_also_while_something_else_is_done() -> None:
    """It said that it is given up, and `auto resume` took it up."""
    world = some(2)
    cycle = cycle_of(world)
    cut_off(world, cycle, 1, "stop")
    world.before = lambda name: cycle.auto_off() if name == "where" else None
    asyncio.run(cycle.where())
    assert cycle.pick_order is None


def test_an_auto_that_waits_for_parts_is_over_as_soon_as_it_is_told_off() -> None:
    """It waited on, for an hour at most, and everything else was refused as `busy: auto`."""
    world = World(np.random.default_rng(0))
    cycle = cycle_of(world)

    async def scene() -> None:
        task = asyncio.create_task(cycle.auto(PickOrder(every_s=3600.0)))
        while not world.said("cycle_end"):
            await asyncio.sleep(0)
        cycle.auto_off()
        await asyncio.wait_for(task, PATIENCE_S)
        await cycle.go("home")

    asyncio.run(scene())
    assert cycle.pick_order is None


def test_auto_off_said_while_an_auto_is_being_cut_off_leaves_nothing_to_take_up() -> None:
    world = some(2)
    cycle = cycle_of(world)

    async def scene() -> None:
        task = asyncio.create_task(cycle.auto())
        while not world.said("move"):
            await asyncio.sleep(0)
        cycle.auto_off()
        await cycle.supervisor.stop()
        await task

    asyncio.run(scene())
    assert cycle.pick_order is None


def test_a_dry_auto_ends_after_one_pick_and_leaves_nothing_to_take_up() -> None:
    world = some(2)
    cycle = cycle_of(world)
    cycle.supervisor.dry(True)
    ends = asyncio.run(cycle.auto(PickOrder(2)))
    assert [end.outcome for end in ends] == ["dry"]
    assert (cycle.pick_order, cycle.status()["auto"], world.wire) == (None, False, [])


def test_an_auto_that_is_stopped_while_it_waits_for_parts_gives_what_it_brought() -> None:
    world = some(1)
    cycle = cycle_of(world)

    async def story() -> list[CycleEnd]:
        running = asyncio.create_task(cycle.auto(PickOrder(None, every_s=3600.0)))
        await until_so(lambda: [end.outcome for end in cycle.ends] == ["picked", "empty"])
        await cycle.supervisor.abort()
        return await running

    assert [end.outcome for end in asyncio.run(story())] == ["picked", "empty"]
    assert not cycle.status()["auto"]
