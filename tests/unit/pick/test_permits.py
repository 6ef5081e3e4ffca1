"""The line's permits in a pick: every move waits for the one it needs, and no other waits."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon.arm import RefusedError
from daemon.events.pick_order import OrderStep, PickOrder
from daemon.pick.cycle import LINE_PERMITS
from daemon.pick.transitions import PickState
from daemon.signals.input_form import FORMS, InputForm
from daemon.signals.packml import PackMLState
from daemon.signals.production_line import ProductionLine
from daemon.signals.settings import SignalSettings
from tests.fakes.fake_cell import World, cycle_of, one_part
from tests.fakes.waiting import until_so

NUMBERS = {"permit_pick": 1001, "permit_place": 1002, "cycle_start": 1003}


class Inputs:
    """Each role is on, or off for its next reading only."""

    def __init__(self, *off_next: str) -> None:
        self.off_next, self.read = set(off_next), []

    async def set_outputs(self, numbers: Any) -> None:
        """No output here."""

    work_valves = set_outputs

    async def ask_input(self, text: str) -> str:
        role = next(role for role, number in NUMBERS.items() if str(number) in text)
        self.read.append(role)
        if role in self.off_next:
            self.off_next.discard(role)
            return "0"
        return "-1"


def with_line(world: World, inputs: Inputs, form: bool = True) -> Any:
    cycle = cycle_of(world)
    signals = {role: SignalSettings(number=number, role=role) for role, number in NUMBERS.items()}  # type: ignore[arg-type]
    kept = InputForm(FORMS[0], "0", "-1") if form else None
    cycle.production_line = ProductionLine(signals, inputs, kept, lambda: 0.0, lambda *_, **__: None)
    return cycle


def one_cube() -> World:
    world = World(np.random.default_rng(0))
    world.put("cube", 500, 0, 0.4)
    return world


def test_every_move_of_a_pick_waits_for_its_permit_and_goes_on_once_it_is_there() -> None:
    """A permit is asked for before each move and each closing or opening of the gripper, in the state it is made in."""
    world, inputs = one_cube(), Inputs("permit_pick", "permit_place")
    cycle = with_line(world, inputs)
    end = asyncio.run(cycle.pick())
    assert end.outcome == "picked"
    waited = 4  # off, and once more after the wait, as the arm was seen where it was: for each of the two
    needed = {"permit_pick": 0, "permit_place": 0}
    state = PickState.SURVEY
    for record in world.records:
        if record["kind"] == "state":
            state = PickState(record["to"])
        elif record["kind"] in ("move", "hand") and LINE_PERMITS.get(state) in needed:
            needed[LINE_PERMITS[state]] += 1
    assert inputs.read.count("permit_pick") + inputs.read.count("permit_place") == sum(needed.values()) + waited
    assert needed["permit_pick"] > 4
    assert needed["permit_place"] >= 2


def test_the_way_home_and_moves_by_an_operator_need_no_permit() -> None:
    assert {PickState.HOME, PickState.IDLE, PickState.PAUSED, PickState.FAULT}.isdisjoint(LINE_PERMITS)
    inputs = Inputs()
    cycle = with_line(one_cube(), inputs)
    asyncio.run(cycle.go("home"))
    assert inputs.read == []


def test_a_stop_ends_the_wait_for_a_permit() -> None:
    class Off(Inputs):
        async def ask_input(self, text: str) -> str:
            await asyncio.sleep(0)
            self.read.append(text)
            return "0"

    async def story() -> Any:
        inputs = Off()
        cycle = with_line(one_cube(), inputs)
        pick = asyncio.create_task(cycle.pick())
        await until_so(lambda: len(inputs.read) >= 2)
        assert cycle.status()["waits_for"] == "the permit to pick (permit_pick)"
        await cycle.supervisor.stop()
        end = await pick
        return end, cycle

    end, cycle = asyncio.run(story())
    assert end.outcome == "aborted"
    assert cycle.status()["waits_for"] is None


def test_no_pick_begins_where_nobody_has_found_how_inputs_are_read() -> None:
    cycle = with_line(one_cube(), Inputs(), form=False)
    with pytest.raises(RefusedError, match="`signal find permit_pick` at a console"):
        asyncio.run(cycle.pick())


def test_an_auto_that_waits_for_a_line_without_a_signal_for_it_is_refused() -> None:
    cycle = cycle_of(one_cube())
    with pytest.raises(RefusedError, match="role cycle_start or part_present"):
        asyncio.run(cycle.begin_auto(PickOrder(on_signal=True)))


def test_an_auto_brings_one_part_for_each_start() -> None:
    async def story() -> Any:
        world, inputs = one_cube(), Inputs("cycle_start")
        world.put("pyramid", 560, 90, 0.2)
        cycle = with_line(world, inputs)
        auto = asyncio.create_task(cycle.auto(PickOrder(on_signal=True)))
        await until_so(lambda: cycle.ends and cycle.production_line.waits_for)
        assert len(cycle.ends) == 1, "the start is still on: it asked for one"
        cycle.auto_off()
        return await auto

    assert [end.outcome for end in asyncio.run(story())] == ["picked"]


def test_a_job_on_signal_brings_the_part_of_its_next_step_for_each_start() -> None:
    async def story() -> Any:
        world, inputs = one_cube(), Inputs("cycle_start")
        world.put("pyramid", 560, 90, 0.2)
        cycle = with_line(world, inputs)
        steps = OrderStep("pyramid"), OrderStep("cube")
        auto = asyncio.create_task(cycle.auto(PickOrder(2, job="kit", steps=steps, whole=steps, on_signal=True)))
        await until_so(lambda: cycle.ends and cycle.production_line.waits_for)
        assert [end.label for end in cycle.ends] == ["pyramid"], "the start is still on: it asked for one"
        inputs.off_next.add("cycle_start")
        return await auto

    assert [(end.label, end.outcome) for end in asyncio.run(story())] == [("pyramid", "picked"), ("cube", "picked")]


@pytest.mark.parametrize("busy", [False, True])
@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("waits", [False, True])
def test_packml_says_at_work_of_a_job_that_may_move_the_arm_and_no_longer_waits_for_the_line(
    busy: bool, moves: bool, waits: bool
) -> None:
    cycle: Any = cycle_of(one_part())
    permission = SimpleNamespace(blocked=False, enabled=True)
    cycle.supervisor = SimpleNamespace(busy=busy, job_moves=moves, permission=permission)
    cycle.production_line = SimpleNamespace(waits_to_begin=waits, done=True)
    assert cycle.packml is (PackMLState.EXECUTE if busy and moves and not waits else PackMLState.COMPLETE)


@pytest.mark.parametrize("asks", ["wanted", "brought"])
def test_a_line_that_can_no_longer_be_read_ends_an_auto_with_the_arm_stopped_and_a_fault(asks: str) -> None:
    world = one_cube()
    cycle = with_line(world, Inputs())

    async def unreadable(*_: object) -> bool:
        raise OSError("the input module is gone")

    setattr(cycle.production_line, asks, unreadable)
    ends = asyncio.run(cycle.auto(PickOrder(3, on_signal=asks == "wanted")))
    assert [end.outcome for end in ends] == ([] if asks == "wanted" else ["picked"])
    assert cycle.supervisor.fault_text == "signals: the input module is gone"
    assert [name for name, _ in world.wire].count("abort") == 1
    assert cycle.state == "fault"
