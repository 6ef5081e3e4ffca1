"""Looking around: it ends, tells what each look brought, and is held by all that holds the arm."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.arm.belief import BeliefSource
from daemon.arm.operators import OperatorRefusedError, RefusedError
from daemon.arrays import Array
from daemon.pick import find, following
from daemon.pick.cycle import PickCycle
from daemon.pick.find import describe_parts
from daemon.pick.looks import CapturedPair
from daemon.pick.set_down import MOST_LOOKS
from daemon.pick.world import InformationGain, WorldModel
from daemon.vision.geometry import Polyhedron
from daemon.vision.refine import Fit
from daemon.vision.values import Recognition
from tests.fakes.fake_cell import World, cycle_of, one_part
from tests.fakes.in_time import lived
from tests.fakes.waiting import until_so

NAMELESS = Recognition("unknown", 0.9, 0.0, 0.0, None, False, "fits nothing taught")


def nameless() -> tuple[World, PickCycle]:
    """A cube whose facets nobody names, and the cycle before it, looking at it."""
    world = one_part()
    world.labels["cube"] = NAMELESS
    cycle = cycle_of(world)
    lived(cycle.go("survey"))
    world.wire.clear()
    return world, cycle


def moves(world: World) -> int:
    return sum(name == "move" for name, _ in world.wire)


def test_what_has_no_name_is_looked_at_from_so_many_places_and_each_look_tells_what_it_brought() -> None:
    world, cycle = nameless()
    known = lived(cycle.look_around(2))
    assert (len(known.looks), len(known.gained)) == (3, 2)
    told = world.said("gained")
    assert [record["look"] for record in told] == [2, 3]
    assert told[0]["before"] == told[0]["after"] == "not taught 100 %"
    assert told[0]["about"].endswith(" mm")
    places = [look.world_from_cyclopean[:3, 3] for look in known.looks]
    assert min(float(np.linalg.norm(a - b)) for k, a in enumerate(places) for b in places[:k]) > 100.0


def test_where_all_has_a_name_two_looks_from_other_sides_are_enough() -> None:
    world = one_part()
    cycle = cycle_of(world)
    lived(cycle.go("survey"))
    known = lived(cycle.look_around(5))
    assert [part.label for part in known.found] == ["cube"]
    assert len(known.looks) == 3
    told = world.said("gained")[0]
    assert told["about"] == "what they hide"
    assert [told[name] for name in ("bits_before", "bits_after", "expected", "seconds")] == [0.0] * 4, "nobody reckoned"


@pytest.mark.parametrize(
    ("labels", "told"),
    [
        (["cube", "pyramid", "cube", ""], "2 cube, 1 pyramid, 1 without a name"),
        (["cube"], "1 cube"),
        (["", ""], "2 without a name"),
        ([], "nothing"),
    ],
)
def test_what_was_found_is_told_by_name_and_how_many(labels: list[str], told: str) -> None:
    found: Any = [SimpleNamespace(label=label, named=bool(label)) for label in labels]
    assert describe_parts(found) == told


@pytest.mark.parametrize(
    ("found", "told"),
    [
        ([], ("nothing is there any more", 0.0)),
        ([("cube", 900.0)], ("nothing is there any more", 0.0)),
        ([("pyramid", 900.0), ("cube", 101.0)], ("cube 98.5 %", 0.0)),
        ([("cube", 900.0), ("", 101.0)], ("what it may be", 0.7)),
    ],
    ids=["nothing left", "only elsewhere", "named now", "without a name still"],
)
def test_what_a_look_brought_is_what_lies_now_where_the_part_was(
    found: list[tuple[str, float]], told: tuple[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    def lies(label: str, x_mm: float) -> Any:
        centre = np.array([x_mm, 200.0, 0.0])
        return SimpleNamespace(
            label=label, named=bool(label), centre=centre, recognition=SimpleNamespace(confidence=0.985)
        )

    async def compute(function: Any, *arguments: object) -> object:
        return function(*arguments)

    monkeypatch.setattr(find, "entropy_bits", lambda *_: 1.5)
    monkeypatch.setattr(find, "hypotheses_in_words", lambda _: "what it was taken for")
    monkeypatch.setattr(find, "_describe_hypotheses", lambda *_: ("what it may be", 0.7))
    gained: list[InformationGain] = []
    world: Any = SimpleNamespace(found=[lies(*one) for one in found], tell=lambda _, one: gained.append(one))
    settings = SimpleNamespace(limits=SimpleNamespace(table_z_mm=0.0))
    cell = SimpleNamespace(compute=compute, rig=None)
    context: Any = SimpleNamespace(cell=cell, recogniser=None, settings=settings)
    gain: Any = SimpleNamespace(bits=0.9, seconds=4.0)
    lived(find.record_gain(context, world, lies("", 100.0), [], gain))
    about = "what lies at 100, 200 mm"
    assert gained == [InformationGain(about, "what it was taken for", told[0], 1.5, told[1], 0.9, 4.0)]


def test_an_empty_table_is_looked_at_from_two_sides_more() -> None:
    world = World(np.random.default_rng(0))
    known = lived(cycle_of(world).look_around(5))
    assert (known.found, len(known.looks)) == ([], 3)


def test_a_place_the_arm_is_refused_is_left_for_the_next() -> None:
    world, cycle = nameless()
    world.reach_mm = 640.0
    known = lived(cycle.look_around(1))
    assert len(known.looks) == 2
    assert np.linalg.norm(world.at[:3, 3]) <= 640.0 + 1.0
    world.reach_mm = 100.0
    assert len(lived(cycle.look_around(1)).looks) == 1, "none is in reach: that is no fault"
    assert cycle.status()["fault"] is None


def test_it_may_not_start_where_a_pick_may_not() -> None:
    world, cycle = nameless()
    cycle.supervisor.latch("something")
    with pytest.raises(RefusedError):
        lived(cycle.look_around(1))
    assert moves(world) == 0


@pytest.mark.parametrize(
    ("held", "told"), [(True, "a part is in the gripper"), (None, "does not know whether the gripper holds a part")]
)
def test_with_a_part_in_the_hand_nothing_is_gone_round(held: bool | None, told: str) -> None:
    """The cameras see it; it was taken for a part that lies there, and the arm went round its own hand."""
    world, cycle = nameless()
    cycle.beliefs.learn(BeliefSource.COMMANDED, holding=held)
    with pytest.raises(RefusedError, match=told):
        lived(cycle.look_around(1))
    with pytest.raises(RefusedError, match=told):
        lived(cycle.walk_round(cycle.recogniser, 8, _told))
    assert moves(world) == 0
    cycle.holding(False)
    assert len(lived(cycle.look_around(1)).looks) == 2


async def _told(_line: str) -> None:
    """Nobody listens."""


def test_a_walk_round_sets_out_as_a_look_does_and_gives_what_it_saw(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[str] = []
    _, cycle = nameless()

    async def sets_out() -> None:
        done.append("set out")

    async def walks(_: object, count: int, __: object) -> tuple[str, list[str]]:
        done.append(f"walked {count}")
        return "a thing", ["a look"]

    monkeypatch.setattr(cycle, "_set_out_to_look", sets_out)
    monkeypatch.setattr("daemon.pick.cycle.look_from_around", walks)
    saw: Any = lived(cycle.walk_round(cycle.recogniser, 8, _told))
    assert saw == ("a thing", ["a look"])
    assert done == ["set out", "walked 8"]


def test_without_a_model_nothing_is_looked_for_and_the_arm_does_not_set_out() -> None:
    world, cycle = nameless()
    cycle.use(None)
    for act in (cycle.look, cycle.held_here, lambda: cycle.locate("cube")):
        with pytest.raises(RefusedError, match="there is no model"):
            lived(act())
    assert moves(world) == 0


def test_a_part_is_located_by_looks_from_sides_far_from_one_another(monkeypatch: pytest.MonkeyPatch) -> None:
    world = one_part()
    cycle = cycle_of(world)
    lived(cycle.go("survey"))
    monkeypatch.setattr(following, "_fit_where_expected", _shows_at)
    pose = lived(cycle.locate("cube"))
    looks = world.said("look")[1:]
    assert len(looks) == MOST_LOOKS
    rays = [np.array(look["world_from_cyclopean"])[:3, 3] - pose[:3, 3] for look in looks]
    rays = [ray / np.linalg.norm(ray) for ray in rays]
    assert max(float(a @ b) for k, a in enumerate(rays) for b in rays[:k]) < np.cos(np.radians(30.0))
    with pytest.raises(RefusedError, match="0 parts are recognised as pyramid"):
        lived(cycle.locate("pyramid"))


def _shows_at(_shape: Polyhedron, pose: Array, _turns: Array, taken: CapturedPair) -> Fit:
    """The edges of a part that show where it lies."""
    return Fit(frames.inverse(taken.world_from_cyclopean) @ pose, 1e-4 * np.eye(6), 0.1, 9)


def test_dry_it_looks_once_and_nothing_moves() -> None:
    world, cycle = nameless()
    cycle.supervisor.dry(True)
    known = lived(cycle.look_around(3))
    assert (len(known.looks), moves(world)) == (1, 0)


def test_a_stop_on_the_way_stops_the_arm_and_nothing_moves_after_it() -> None:
    world, cycle = nameless()
    stops = []

    def stop(name: str) -> None:
        if name == "moving" and not stops:
            stops.append(asyncio.get_running_loop().create_task(cycle.supervisor.stop()))

    async def around() -> None:
        with pytest.raises((asyncio.CancelledError, RefusedError)):
            await cycle.look_around(3)
        await asyncio.gather(*stops)

    world.before = stop
    lived(around())
    names = [name for name, _ in world.wire]
    assert "move" not in names[names.index("abort") :]
    assert cycle.status()["fault"] is not None


async def _waiting(cycle: PickCycle, key: str) -> None:
    while not cycle.status()[key]:
        await asyncio.sleep(0)


def test_a_pause_holds_it_before_its_next_move_until_resume() -> None:
    world, cycle = nameless()

    async def around() -> WorldModel:
        cycle.supervisor.hold.pause()
        work = asyncio.ensure_future(cycle.look_around(1))
        await until_so(lambda: world.said("look"))
        await asyncio.sleep(60.0)
        assert moves(world) == 0
        cycle.supervisor.resume()
        return await work

    assert len(lived(around()).looks) == 2
    assert moves(world) > 0


def test_step_by_step_a_move_that_is_refused_ends_it_and_is_not_sent() -> None:
    world, cycle = nameless()

    async def around() -> None:
        cycle.supervisor.hold.step(True)
        work = asyncio.ensure_future(cycle.look_around(2))
        await asyncio.wait_for(_waiting(cycle, "pending"), 30.0)
        cycle.supervisor.hold.refuse()
        with pytest.raises(OperatorRefusedError):
            await work

    lived(around())
    assert moves(world) == 0
