"""What a pick knows: fused where a stop is heard meanwhile, and no pick goes on and on."""

from __future__ import annotations

import asyncio
import re
import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daemon.arm import FixtureBox
from daemon.pick import world as world_room
from daemon.pick.settings import Settings
from daemon.pick.world import MOST_S, WorldModel
from daemon.vision.values import Recognition
from tests.fakes.fake_cell import World, cycle_of, one_part


def test_a_pick_whose_looks_never_agree_ends_and_says_what_disagreed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both cameras frozen under fresh noise, so that each look has all parts elsewhere: 62 looks in 95 s, and on."""
    world = World(np.random.default_rng(0))
    world.labels["cube"] = Recognition("unknown", 0.0, 0.0, 0.0, None, False, "nothing like it was taught")
    monkeypatch.setattr(world_room, "MOST_LOOKS", 7)

    def before(name: str) -> None:
        if name == "see":
            world.put("cube", *world.rng.uniform((440, -100), (600, 100)), 0.4)

    world.before = before
    cycle = cycle_of(world)
    end = asyncio.run(cycle.pick())
    assert 7 <= len(world.said("look")) < 11
    assert (cycle.state, end.outcome) == ("idle", "unsure")
    assert re.search(r"given up after \d+ looks and \d+ s beside motion: \d+ of \d+ parts did not show again", end.why)
    assert "does a camera repeat itself" in end.why


@pytest.mark.parametrize("known", [True, False])
def test_the_walls_of_a_fixture_that_the_cell_knows_are_nothing_to_pick(known: bool) -> None:
    world = World(np.random.default_rng(0))
    world.labels["cube"] = Recognition("unknown", 0.0, 0.0, 0.0, None, False, "nothing like it was taught")
    world.put("cube", 520.0, 0.0, 0.4)
    wall = FixtureBox("fixture plate, box 1", (-30.0, -30.0, 0.0), (30.0, 30.0, 60.0), (520.0, 0.0, -300.0), 22.9)
    settings = Settings()
    settings = replace(settings, limits=replace(settings.limits, keep_out=(wall,) if known else ()))
    cycle = cycle_of(world, settings)
    end = asyncio.run(cycle.pick())
    assert end.outcome == ("empty" if known else "unknown"), end.why
    assert bool(end.skipped) is not known


def test_a_pick_that_takes_too_long_beside_its_motion_ends() -> None:
    world = one_part()
    cycle = cycle_of(world)
    waited = iter([MOST_S])

    def before(name: str) -> None:
        if name == "see":
            world.now_s += next(waited, 0.0)

    world.before = before
    end = asyncio.run(cycle.pick())
    assert (end.outcome, end.label) == ("unsure", None)
    assert "given up after 1 looks and 3" in end.why
    world.before = lambda _: None
    assert asyncio.run(cycle.pick()).outcome == "picked"


def test_waiting_for_leave_to_move_is_not_the_picks_time() -> None:
    world = one_part()

    def before(name: str) -> None:
        world.now_s += MOST_S * (name == "move")

    world.before = before
    cycle = cycle_of(world)
    cycle = cycle_of(world, replace(cycle.settings, limits=replace(cycle.settings.limits, max_look_age_s=1e6)))
    assert asyncio.run(cycle.pick()).outcome == "picked"


def test_the_loop_goes_on_while_looks_are_fused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stop said meanwhile was heard when it was over: after seconds."""
    beaten = threading.Event()

    def known(looks: Any, *_: Any) -> list[Any]:
        assert beaten.wait(20), "the loop stood still"
        return []

    async def story() -> None:
        cycle = cycle_of(World(np.random.default_rng(0)))
        monkeypatch.setattr(world_room, "known", known)
        model, context = WorldModel([]), cycle._context(cycle.recogniser)  # type: ignore[arg-type]
        taking = asyncio.create_task(model.take_in(context, await cycle.look()))
        await asyncio.sleep(0)
        for _ in range(20):
            await asyncio.sleep(0)
        assert not taking.done()
        beaten.set()
        await taking

    asyncio.run(story())


@pytest.mark.parametrize("state", ["choose", "second_view", "estimating", "verify"])
def test_the_loop_goes_on_while_a_pick_reckons(state: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Grasps, ways and hypotheses are reckoned beside the loop as well."""
    where, name = {
        "choose": ("find", "plan_part"),
        "second_view": ("find", "next_best"),
        "estimating": ("approach", "regrasp"),
        "verify": ("take", "in_hand"),
    }[state]
    room = __import__(f"daemon.pick.{where}", fromlist=[name])
    reckon, threads = getattr(room, name), list[bool]()

    def watched(*args: Any) -> Any:
        threads.append(threading.current_thread() is threading.main_thread())
        return reckon(*args)

    monkeypatch.setattr(room, name, watched)
    world = one_part()
    if state == "second_view":
        world.labels["cube"] = Recognition("unknown", 0.0, 0.0, 0.0, None, False, "nothing like it was taught")
    asyncio.run(cycle_of(world).pick())
    assert threads
    assert not any(threads)
