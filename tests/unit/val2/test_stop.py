"""The stop on the line: whichever byte of it is spoiled, whatever the controller makes of the word. Simulated time."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drivers.puma560 import READY_RAD, forward
from drivers.simcell.arm import SimulatedArm
from drivers.simcell.controller import Controller, LineFault, Machine, Manners, Mishap
from drivers.simcell.controller.commands import Ask, bare
from drivers.simcell.controller.expressions import MonitorError
from drivers.simcell.controller.monitor import MONITOR_COMMANDS
from drivers.val2.dialect import Dialect
from drivers.val2.errors import ControllerError, LinkError, NoAnswer, Preempted, StopWordRefused
from drivers.val2.link import BRAKES_S, Link
from drivers.val2.location import location_from_matrix
from drivers.val2.wire import ControllerQuestion
from tests.fakes.memory_line import MemoryLine
from tests.fakes.simulated_time import SimulatedLoop
from tests.fakes.waiting import until_so

FAR = location_from_matrix(forward(READY_RAD + np.radians([90, -20, 5, 0, 10, 0])))
SPOILED = ["flip", "drop", "double", "insert"]


def at_simulated_time(story: Coroutine[Any, Any, Any]) -> Any:
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        return runner.run(story)


async def under_way(dialect: Dialect | None = None, **manners: Any) -> tuple[Controller, MemoryLine, Link]:
    """An arm that is on a way of some 20 s, and a link that told it."""
    loop = asyncio.get_running_loop()
    controller = Controller(Machine(SimulatedArm(joints_rad=READY_RAD), Manners(**manners)))
    line = MemoryLine(controller, loop)
    link = Link(line.port, dialect, clock=loop.time, open_port=line.open)
    await link.open()
    await link.command("SPEED 5")
    moving = asyncio.create_task(link.move(FAR))
    moving.add_done_callback(lambda task: task.exception())
    await asyncio.sleep(1.0)
    assert not controller.machine.at_rest()
    return controller, line, link


@pytest.mark.parametrize("prompt", ["start", "end"])
@pytest.mark.parametrize("harm", SPOILED)
@pytest.mark.parametrize("after", range(0, 16, 2))
def test_whichever_byte_of_a_stop_is_spoiled_the_arm_rests_as_soon_as_without(
    prompt: Any, harm: Any, after: int
) -> None:
    async def story() -> float:
        controller, line, link = await under_way(prompt_after_move=prompt)
        controller.faults.line.append(LineFault("to_controller", harm, after=after))
        told_s = line.now_s()
        await link.stop_motion()
        assert controller.machine.at_rest()
        return controller.arm.rests_s - told_s

    assert at_simulated_time(story()) < 0.5


@pytest.mark.parametrize("prompt", ["start", "end"])
def test_a_stop_that_is_lost_whole_is_followed_by_another(prompt: Any) -> None:
    async def story() -> float:
        controller, line, link = await under_way(prompt_after_move=prompt)
        controller.faults.line.append(LineFault("to_controller", "drop", count=40))
        told_s = line.now_s()
        await link.stop_motion()
        return controller.arm.rests_s - told_s

    assert at_simulated_time(story()) < 3 * Dialect().resync_s


@pytest.mark.parametrize("seed", range(6))
def test_a_stop_on_a_noisy_line_is_tried_until_rest_is_seen(seed: int) -> None:
    async def story() -> None:
        controller, _, link = await under_way()
        controller.faults.seed_noise(seed, rate=0.02)
        for _ in range(20):
            try:
                await link.stop_motion()
                break
            except LinkError:
                continue
        assert controller.machine.at_rest()
        controller.faults.noise_rate = 0.0
        await link.stop_motion()
        assert (await link.where()).location is not None

    at_simulated_time(story())


@pytest.mark.parametrize("prompt", ["start", "end"])
def test_a_word_that_the_controller_does_not_know_is_no_stop_even_when_the_arm_has_come_to_rest(prompt: Any) -> None:
    async def story() -> None:
        controller, line, link = await under_way(Dialect(abort_word="HALT"), prompt_after_move=prompt)
        told_s = line.now_s()
        with pytest.raises(LinkError) as problem:
            await link.stop_motion()
        assert not controller.machine.at_rest(), "told while the arm still moves"
        if prompt == "start":
            assert line.now_s() - told_s < 0.5
            assert list(controller.lines).count("HALT") == 4, "at once, and no try after it was refused twice"
            assert str(problem.value) == "the controller does not accept HALT (it answers `*Illegal command*`)"
        controller.tick(line.now_s() + 60.0)
        await asyncio.sleep(60.0)
        assert controller.machine.at_rest()
        with pytest.raises(StopWordRefused):
            await link.stop_motion()
        assert not link.permission.stop_tests

    at_simulated_time(story())


def test_an_arm_that_still_moves_after_the_word_was_taken_is_told_again(monkeypatch: pytest.MonkeyPatch) -> None:
    typed: list[float] = []

    def deaf(machine: Machine) -> None:
        typed.append(machine.now_s)

    monkeypatch.setitem(MONITOR_COMMANDS, "ABORT", bare(deaf))

    async def story() -> None:
        controller, _, link = await under_way()
        with pytest.raises(NoAnswer, match="still moves after ABORT"):
            await link.stop_motion()
        assert len(typed) >= 10
        assert max(np.diff(typed)) < Dialect().resync_s
        assert not controller.machine.at_rest()

    at_simulated_time(story())


def test_the_stop_is_proven_by_the_answer_to_its_word_and_again_after_the_line_was_opened_anew() -> None:
    async def story() -> None:
        loop = asyncio.get_running_loop()
        line = MemoryLine(Controller(Machine(SimulatedArm(joints_rad=READY_RAD))), loop)
        link = Link(line.port, clock=loop.time, open_port=line.open)
        await link.open()
        assert not link.permission.stop_tests
        await link.test_stop()
        assert link.permission.stop_tests
        await link.open()
        assert not link.permission.stop_tests
        link.dialect = replace(link.dialect, abort_word="HALT")
        with pytest.raises(StopWordRefused, match="Illegal command"):
            await link.test_stop()
        assert not link.permission.stop_tests

    at_simulated_time(story())


def test_a_controller_that_refuses_where_has_taken_the_stop_and_cannot_confirm_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refused(_: Machine, __: str = "") -> None:
        raise MonitorError("*Encoder fault*")

    async def story() -> None:
        controller, _, link = await under_way()
        monkeypatch.setitem(MONITOR_COMMANDS, "WHERE", refused)
        with pytest.raises(ControllerError, match=r"WHERE is refused \(`\*Encoder fault\*`: remove the cause"):
            await link.stop_motion()
        assert controller.machine.at_rest()
        assert link.permission.stop_tests

    at_simulated_time(story())


def refuses_where_without_a_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    """As some controllers do: before CAL they do not know where the arm is, and say so."""
    usual = MONITOR_COMMANDS["WHERE"]

    def where(machine: Machine, arguments: str) -> Any:
        if not machine.calibrated:
            raise MonitorError("*Not calibrated*")
        return usual(machine, arguments)

    monkeypatch.setitem(MONITOR_COMMANDS, "WHERE", where)


@pytest.mark.parametrize("breaks", [True, False])
def test_a_controller_that_has_no_zero_and_takes_the_stop_has_confirmed_it_so_that_cal_can_follow(
    breaks: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rest could never be seen without WHERE: the stop was not confirmed for ever, and CAL needs the stop tried."""
    refuses_where_without_a_zero(monkeypatch)

    async def story() -> None:
        controller, _, link = await under_way(Dialect(break_after_move=breaks))
        controller.mishap(Mishap.POWER_CYCLED)
        await link.close()
        await link.open()
        await link.power_up()
        controller.machine.arm_power = True
        assert await link.stop_motion() is None
        await link.close()
        await link.open()
        await link.test_stop()
        with pytest.raises(ControllerError, match=r"\*Not calibrated\*"):
            await link.move(FAR)
        assert controller.machine.at_rest()
        await link.calibrate()
        assert await link.stop_motion() is not None

    at_simulated_time(story())


def test_an_arm_whose_controller_lost_its_zero_on_the_way_is_not_said_to_be_stopped_before_its_brakes_hold_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    refuses_where_without_a_zero(monkeypatch)

    async def story() -> None:
        controller, line, link = await under_way(power_up=())
        await link.stop_motion()
        await link.command("SPEED 100")
        moving = asyncio.create_task(link.move(FAR))
        moving.add_done_callback(lambda task: task.exception())
        await asyncio.sleep(0.6)
        with line.controller():
            controller.mishap(Mishap.POWER_CYCLED)
        assert not controller.machine.at_rest()
        told_s = line.now_s()
        assert await link.stop_motion() is None
        assert line.now_s() - told_s >= BRAKES_S

    at_simulated_time(story())


def test_a_stop_amid_cal_of_a_controller_that_refuses_where_until_then_ends_it_and_is_confirmed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    refuses_where_without_a_zero(monkeypatch)

    async def story() -> None:
        controller, _, link = await under_way()
        controller.machine.calibrated = False
        await link.stop_motion()
        calibrating = asyncio.create_task(link.calibrate())
        await asyncio.sleep(2.0)
        assert await link.stop_motion() is None
        with pytest.raises(Preempted):
            await calibrating
        await asyncio.sleep(60.0)
        assert not controller.machine.calibrated

    at_simulated_time(story())


def test_a_stop_that_waits_for_a_lost_line_comes_first_when_it_is_opened_again_and_does_not_keep_it_shut() -> None:
    async def story() -> None:
        controller, _, link = await under_way()
        await link.close()
        opening = asyncio.create_task(link.open())
        await asyncio.sleep(0.0)
        await until_so(lambda: link.connected)
        await link.stop_motion()
        await opening
        assert controller.machine.at_rest()
        assert (await link.where()).joints_deg

    at_simulated_time(story())


def test_a_controller_that_was_switched_off_in_a_stop_is_believed_once_its_brakes_hold_the_arm_and_no_later() -> None:
    async def story() -> float:
        controller, line, link = await under_way()
        told_s = line.now_s()
        stopping = asyncio.create_task(link.stop_motion())
        await asyncio.sleep(0.0)
        controller.mishap(Mishap.POWER_CYCLED)
        assert await stopping is None
        assert link.question is not None
        assert not link.permission.stop_tests
        return line.now_s() - told_s

    assert 0.5 < at_simulated_time(story()) < 1.0


def test_an_arm_exactly_where_it_was_sent_is_there_and_at_rest_however_little_it_may_be_off() -> None:
    exact = Dialect(same_place_mm=0.0, same_place_deg=0.0, arrived_mm=0.0, arrived_deg=0.0)

    async def story() -> None:
        loop = asyncio.get_running_loop()
        line = MemoryLine(Controller(Machine(SimulatedArm(joints_rad=READY_RAD))), loop)
        link = Link(line.port, exact, clock=loop.time, open_port=line.open)
        await link.open()
        await link.move(FAR)
        there = (await link.still(60.0)).location
        await link.move(there)
        assert (await link.wait_until_at_rest(there)).location == there

    at_simulated_time(story())


def test_a_question_that_is_asked_again_is_no_power_up_and_no_sign_that_the_arm_rests() -> None:
    async def story() -> None:
        _, _, link = await under_way()

        async def asks(session: Any, talk: Any, before: bytes) -> ControllerQuestion:
            return ControllerQuestion(b"", "Are you sure (Y/N)?")

        link._type_stop = asks
        with pytest.raises(NoAnswer):
            await link.stop_motion()

    at_simulated_time(story())


def asking(machine: Machine, _: str) -> Iterator[Ask]:
    """A person's program: a motion of some seconds, and, while it lasts, a question that takes nothing but y or n."""
    machine.move_joints(READY_RAD + np.radians([90, -20, 5, 0, 10, 0]))
    while ((yield Ask("Another part (Y/N)?")) or "").strip()[:1] not in ("Y", "N"):
        pass


@pytest.mark.parametrize("typed", ["a line", "at the terminal"])
def test_a_program_that_asks_whether_to_go_on_is_no_controller_that_was_switched_off(
    typed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its question, asked again, was taken for one of power-up: the stop was called confirmed, and the arm went on."""
    monkeypatch.setitem(MONITOR_COMMANDS, "EXECUTE", asking)

    async def story() -> None:
        loop = asyncio.get_running_loop()
        controller = Controller(Machine(SimulatedArm(joints_rad=READY_RAD)))
        line = MemoryLine(controller, loop)
        link = Link(line.port, clock=loop.time, open_port=line.open)
        await link.open()
        await link.command("SPEED 5")
        if typed == "a line":
            with pytest.raises(ControllerError, match="Another part"):
                await link.command("EXEC PROG")
        else:
            async with link.terminal(lambda _: None) as send:
                send(b"EXEC PROG\r")
                await asyncio.sleep(1.0)
        assert not controller.machine.at_rest()
        assert await link.stop_motion() is not None
        assert controller.machine.at_rest()

    at_simulated_time(story())


def test_a_controller_switched_off_after_a_person_typed_is_stopped_by_way_of_its_questions() -> None:
    async def story() -> None:
        controller, _, link = await under_way()
        async with asyncio.timeout(60.0), link.terminal(lambda _: None):
            controller.mishap(Mishap.POWER_CYCLED)
            await asyncio.sleep(0.1)
        assert link.question is not None
        assert await link.stop_motion() is not None
        assert (link.question, link.permission.stop_tests) == (None, True)
        assert not controller.machine.arm_power

    at_simulated_time(story())


def test_a_stop_amid_the_yes_to_a_question_does_not_say_it() -> None:
    """What makes a half-typed command an error made `Y!!` of it, and CAL began."""

    async def story() -> None:
        loop = asyncio.get_running_loop()
        controller = Controller(Machine(SimulatedArm(joints_rad=READY_RAD)))
        line = MemoryLine(controller, loop)
        link = Link(line.port, clock=loop.time, open_port=line.open)
        await link.open()
        calibrating = asyncio.create_task(link.calibrate())
        while controller.half_typed != "Y":
            await asyncio.sleep(0.0005)
        assert await link.stop_motion() is not None
        assert not any(text.startswith("Y") for text in controller.lines)
        with pytest.raises(Preempted):
            await calibrating

    at_simulated_time(story())


@pytest.mark.parametrize("harm", ["flip", "drop", "double"])
def test_an_answer_that_was_spoiled_leaves_the_question_and_no_letter_for_the_next_command(harm: Any) -> None:
    """`YWHERE` was taken for the yes, and the question behind it for nobody's."""

    async def story() -> None:
        loop = asyncio.get_running_loop()
        controller = Controller(Machine(SimulatedArm(joints_rad=READY_RAD), cold=True))
        line = MemoryLine(controller, loop)
        link = Link(line.port, clock=loop.time, open_port=line.open)
        await link.open()
        asked = link.question
        controller.faults.line.append(LineFault("to_host", harm))
        with pytest.raises(LinkError):
            await link.power_up(("Y",))
        with pytest.raises(ControllerError, match="the controller asks"):
            await link.where()
        assert (link.question, controller.question, controller.half_typed) == (asked, asked, "")
        assert not any("WHERE" in text for text in controller.lines)

    at_simulated_time(story())
