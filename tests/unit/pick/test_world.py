"""What a pick knows: fused where a stop is heard meanwhile, and no pick goes on and on."""

from __future__ import annotations

import asyncio
import re
import threading
from collections import Counter
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.arm import FixtureBox
from daemon.events.codes import CauseCode
from daemon.events.outcomes import Outcome
from daemon.pick import world as world_room
from daemon.pick.outcome import PickResult, Skipped
from daemon.pick.seen import SAME_PLACE_MM
from daemon.pick.settings import Settings
from daemon.pick.world import MOST_LOOKS, MOST_S, InformationGain, WorldModel, skip
from daemon.vision.values import Recognition
from tests.fakes.fake_cell import World, cycle_of, one_part


def test_a_pick_whose_looks_never_agree_ends_and_says_what_disagreed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both cameras frozen under fresh noise, so that each look has all parts elsewhere: 62 looks in 95 s, and on."""
    world = World(np.random.default_rng(0))
    world.labels["cube"] = Recognition("unknown", 0.0, 0.0, 0.0, None, False, "nothing like it was taught")
    monkeypatch.setattr(world_room, "MOST_LOOKS", 7)

    def before(name: str) -> None:
        if name == "see":
            x_mm, y_mm = world.rng.uniform((440, -100), (600, 100))
            world.put("cube", x_mm, y_mm, 0.4)

    world.before = before
    cycle = cycle_of(world)
    end = asyncio.run(cycle.pick())
    assert 7 <= len(world.said("look")) < 11
    assert (cycle.state, end.outcome) == ("idle", "unsure")
    assert re.search(
        r"given up after \d+ looks and \d+ s of looking and computing: \d+ of \d+ parts were not seen again", end.why
    )
    assert "perhaps a camera repeats its picture" in end.why


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
        monkeypatch.setattr(world_room, "fuse_objects", known)
        model, context = WorldModel([]), cycle._context(cycle.recogniser)
        taking = asyncio.create_task(model.add_look(context, await cycle.look()))
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
        "choose": ("find", "plan_to_place"),
        "second_view": ("find", "next_best"),
        "estimating": ("approach", "same_grasp"),
        "verify": ("take", "shows_in_gripper"),
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


def clocked(now_s: float) -> Any:
    return SimpleNamespace(cell=SimpleNamespace(clock=lambda: now_s))


@pytest.mark.parametrize(
    ("taken", "now_s", "over"),
    [
        (MOST_LOOKS - 1, 100.0 + MOST_S + 7.0 - 0.1, False),
        (MOST_LOOKS, 108.0, True),
        (0, 100.0 + MOST_S + 7.0, True),
    ],
)
def test_a_pick_is_too_long_by_its_looks_or_by_its_time_beside_motion(taken: int, now_s: float, over: bool) -> None:
    world = WorldModel([], began_s=100.0, moved_s=7.0, look_count=taken)
    told = world.give_up_reason(clocked(now_s))
    assert (told is not None) == over
    if told is not None:
        beside_s = now_s - 107.0
        assert told == (
            f"given up after {taken} looks and {beside_s:.0f} s of looking and computing: "
            "the looks agree, but do not show what lies there"
        )


def test_what_disagreed_most_often_is_told_first_and_cameras_are_named_where_parts_did_not_show_again() -> None:
    odd = Counter({"rarely": 1, "often": 5, "twice": 2})
    world = WorldModel([], look_count=MOST_LOOKS, seen_again=(4, 3), disagreements=odd)
    told = world.give_up_reason(clocked(0.0))
    assert told is not None
    assert told.partition(": ")[2] == (
        "3 of 7 parts were not seen again where the look before measured them; often (5 times); twice (2 times); "
        "perhaps a camera repeats its picture, or was knocked: `doctor`, `calibrate verify`"
    )
    told = WorldModel([], look_count=MOST_LOOKS, seen_again=(4, 0), disagreements=odd).give_up_reason(clocked(0.0))
    assert told is not None
    assert told.endswith(": often (5 times); twice (2 times)")


def at(x_mm: float, label: str = "cube", **more: Any) -> Any:
    centre = np.array([x_mm, 0.0, -280.0])
    return SimpleNamespace(label=label, named=label != "unknown", centre=centre, **more)


def test_what_is_left_is_wanted_not_skipped_and_at_no_place_that_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(world_room, "in_pick_order", lambda found, order: sorted(found, key=lambda p: p.centre[0]))
    cube, other, nameless, gone, placed = at(500.0), at(400.0, "pyramid"), at(300.0, "unknown"), at(600.0), at(700.0)
    skipped = [Skipped("cube", gone.centre + 3.0, Outcome.LOST, "why")]
    taken = SimpleNamespace(taken=lambda: [SimpleNamespace(centre=placed.centre + 5.0)])
    context: Any = SimpleNamespace(
        settings=SimpleNamespace(order="nearest"),
        order=SimpleNamespace(wants=lambda label: label == "cube"),
        placing=taken,
    )
    world = WorldModel(skipped, found=[cube, other, nameless, gone, placed])
    assert world.left(context) == [nameless, cube]


def test_a_part_that_is_left_alone_is_remembered_where_it_was_seen_and_told_with_the_reason() -> None:
    decided: list[tuple[Any, ...]] = []
    context: Any = SimpleNamespace(decide=lambda *words, **fields: decided.append((*words, fields)))
    world, part = WorldModel([]), at(500.0)
    skip(context, world, Outcome.UNSURE, part, "1.5 mm predicted", CauseCode.UNCERTAIN)
    (one,) = world.skipped
    assert (one.label, one.outcome, one.why) == ("cube", Outcome.UNSURE, "1.5 mm predicted")
    np.testing.assert_array_equal(one.centre, part.centre)
    assert world.result == PickResult(Outcome.UNSURE, "cube: 1.5 mm predicted", CauseCode.UNCERTAIN)
    assert decided == [("skip cube", "unsure: 1.5 mm predicted", CauseCode.UNCERTAIN, {"label": "cube"})]


def test_what_a_look_brought_is_kept_and_logged_with_the_number_of_the_look() -> None:
    logged: list[tuple[str, dict[str, Any]]] = []
    log = SimpleNamespace(record=lambda kind, **fields: logged.append((kind, fields)))
    context: Any = SimpleNamespace(cell=SimpleNamespace(log=log), cycle=7)
    gained = InformationGain("it", "one thing", "another", 1.5, 0.5, 1.2, 3.0)
    world = WorldModel([], looks=[cast(Any, None)] * 3)
    world.tell(context, gained)
    assert world.gained == [gained]
    assert logged == [("gained", {"cycle": 7, "look": 3, **vars(gained)})]


@given(st.lists(st.tuples(st.floats(-100.0, 100.0), st.floats(-1.0, 1.0)), max_size=6), st.floats(-100.0, 100.0))
def test_the_sides_a_part_was_not_seen_from_are_those_of_looks_at_its_place(
    unseen: list[tuple[float, float]], here_mm: float
) -> None:
    directions = [(np.array([x, 0.0, 0.0]), np.array([0.0, away, 1.0])) for x, away in unseen]
    world = WorldModel([], unseen_directions=directions)
    found = world.unseen_directions_of(np.array([here_mm, 0.0, 0.0]))
    assert [side[1] for side in found] == [away for x, away in unseen if abs(x - here_mm) < SAME_PLACE_MM]
