"""The arm over VAL II: when somebody else's words are over, and what is asked and told again after them."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from daemon.arm import Beliefs, MoveCommand, StopRefusedError
from daemon.cell.val2_arm import ENDED, NO_ZERO, Val2Arm
from drivers.puma560 import READY_RAD, ArmGeometry
from drivers.simcell.arm import SimulatedArm
from drivers.simcell.controller import Controller, Faults, Machine, Manners, Mishap, instructions
from drivers.simcell.controller.commands import Ask
from drivers.simcell.controller.expressions import MonitorError
from drivers.simcell.controller.manners import VAL_II_ASKS
from drivers.simcell.controller.monitor import MONITOR_COMMANDS
from drivers.val2.conversation import Unconditional
from drivers.val2.dialect import Dialect
from drivers.val2.errors import LinkError
from drivers.val2.link import Link
from tests.fakes.arm_line import QUICK, ArmLine, line_in_time
from tests.fakes.memory_line import MemoryLine
from tests.fakes.simulated_time import SimulatedLoop
from tests.fakes.waiting import until_so

BENT = READY_RAD + np.radians([20.0, 0.0, 0.0, 0.0, 30.0, 0.0])


@pytest.fixture
def runner() -> Iterator[asyncio.Runner]:
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        yield runner


@pytest.fixture
def line(runner: asyncio.Runner) -> ArmLine:
    hand: list[bool] = []
    faults = Faults()
    controller = Controller(Machine(SimulatedArm(joints_rad=BENT), Manners(calibration_s=20.0), hand.append, faults))
    return line_in_time(controller, faults, hand, 10.0, runner.get_loop())


def arm_of(link: Link, geometry: ArmGeometry) -> Val2Arm:
    """One that nobody withholds motion from."""
    arm: Any = Val2Arm(link, geometry, Beliefs(link.clock, Mock()))
    arm.permission = link.permission = Unconditional()
    return arm


@asynccontextmanager
async def arm_on(line: ArmLine) -> AsyncIterator[Val2Arm]:
    async with line.link() as link:
        yield arm_of(link, ArmGeometry())


def moving(line: ArmLine) -> bool:
    with line.server.controller() as controller:
        return not controller.arm.at_rest(controller.now_s)


def test_a_motion_typed_at_the_monitor_is_over_when_the_arm_rests_and_nobody_else_asks_meanwhile(
    runner: asyncio.Runner, line: ArmLine
) -> None:
    async def story() -> None:
        async with arm_on(line) as arm:
            await arm.monitor("SPEED 4")
            task = asyncio.create_task(arm.monitor("DO READY"))
            await until_so(lambda: moving(line))
            assert arm.aside
            await task
            assert not moving(line)
            assert not arm.aside

    runner.run(story())
    np.testing.assert_allclose(line.joints(), READY_RAD, atol=1e-6)


def test_a_controllers_terminal_that_is_left_while_the_arm_moves_is_over_when_it_rests(
    runner: asyncio.Runner, line: ArmLine
) -> None:
    async def story() -> None:
        async with arm_on(line) as arm:
            await arm.monitor("SPEED 4")
            async with arm.terminal(lambda _: None, print) as send:
                send(b"DO READY\r")
                await until_so(lambda: moving(line))
            assert not moving(line)

    runner.run(story())


async def typed_in_a_line(arm: Val2Arm, line: ArmLine) -> None:
    await arm.monitor("SPEED 100")
    await arm.monitor("DO SPEED 300 ALWAYS")
    await arm.monitor("TOOL TRANS(0,0,50,0,0,0)")


async def typed_at_the_terminal(arm: Val2Arm, line: ArmLine) -> None:
    async with arm.terminal(lambda _: None, print) as send:
        send(b"SPEED 100\rDO SPEED 300 ALWAYS\rTOOL TRANS(0,0,50,0,0,0)\r")
        await asyncio.sleep(0.3)


async def line_reopened(arm: Val2Arm, line: ArmLine) -> None:
    await arm.close()
    switched_on_again(line)
    await arm.open()


async def calibrated(arm: Val2Arm, line: ArmLine) -> None:
    await arm.calibrate("Y")
    switched_on_again(line)


async def stopped(arm: Val2Arm, line: ArmLine) -> None:
    await arm.stop_motion()
    switched_on_again(line)


def switched_on_again(line: ArmLine) -> None:
    """Full speed, and the bare wrist; and a program that begins by itself."""
    with line.server.controller() as controller:
        controller.machine.speed_percent = 100.0
        controller.machine.program_speed(300.0, always=True)
        controller.arm.tool = np.eye(4)


@pytest.mark.parametrize("meanwhile", [typed_in_a_line, typed_at_the_terminal, line_reopened, calibrated, stopped])
def test_speed_and_tool_are_told_again_after_whatever_may_have_changed_them(
    runner: asyncio.Runner, line: ArmLine, meanwhile: Any
) -> None:
    tool = np.eye(4)
    tool[2, 3] = 130.0

    async def story() -> None:
        async with line.link() as link:
            arm = arm_of(link, ArmGeometry(flange_from_tool=tool))
            here = (await arm.where()).world_from_tool
            await arm.move(MoveCommand(here, False, 20.0, "test"), lambda _: None, 20.0)
            await meanwhile(arm, line)
            await arm.where()
            await arm.move(MoveCommand(here, False, 20.0, "test"), lambda _: None, 20.0)

    runner.run(story())
    with line.server.controller() as controller:
        assert (controller.machine.speed_percent, controller.machine.program_percent) == (20.0, 100.0)
        np.testing.assert_allclose(controller.arm.tool, tool, atol=1e-6)


def test_a_speed_that_others_set_between_two_moves_is_not_that_of_the_next(
    runner: asyncio.Runner, line: ArmLine
) -> None:
    """By the pendant, or from another terminal: nothing of it was typed on our line."""

    async def story() -> None:
        async with arm_on(line) as arm:
            here = (await arm.where()).world_from_tool
            for _ in range(2):
                await arm.move(MoveCommand(here, True, 10.0, "test"), lambda _: None, 20.0)
                with line.server.controller() as controller:
                    assert controller.machine.speed_percent == 10.0
                    assert controller.machine.program_percent == 100.0
                    controller.machine.speed_percent = 100.0
                    controller.machine.program_speed(300.0, always=True)

    runner.run(story())


@pytest.mark.parametrize("said", ["*Illegal command*", "*Invalid argument*"])
def test_a_controller_whose_programs_have_no_speed_is_moved_all_the_same(
    runner: asyncio.Runner, line: ArmLine, monkeypatch: pytest.MonkeyPatch, said: str
) -> None:
    def refused(machine: Machine, arguments: str) -> None:
        raise MonitorError(said)

    monkeypatch.setitem(instructions.INSTRUCTIONS, "SPEED", refused)

    async def story() -> None:
        async with arm_on(line) as arm:
            here = (await arm.where()).world_from_tool
            await arm.move(MoveCommand(here, False, 20.0, "test"), lambda _: None, 20.0)

    runner.run(story())
    with line.server.controller() as controller:
        assert controller.machine.speed_percent == 20.0


def test_nobody_else_asks_the_controller_anything_during_a_cal(runner: asyncio.Runner, line: ArmLine) -> None:
    async def story() -> None:
        async with arm_on(line) as arm:
            task = asyncio.create_task(arm.calibrate("Y"))
            await asyncio.sleep(0.5)
            assert arm.aside
            assert not task.done()
            await arm.stop_motion()
            with pytest.raises(Exception, match="stopped"):
                await task
            assert not arm.aside

    runner.run(story())


def test_a_place_to_reckon_from_is_where_the_arm_came_to_rest_not_one_on_its_way(
    runner: asyncio.Runner, line: ArmLine
) -> None:
    async def story() -> None:
        async with arm_on(line) as arm:
            await arm.monitor("SPEED 10")
            await arm.link.command("DO READY")
            reading = await arm.wait_until_at_rest()
            assert not moving(line)
            np.testing.assert_allclose(reading.joints_rad, READY_RAD, atol=1e-4)

    runner.run(story())


def test_an_arm_that_goes_on_moving_gives_no_place_to_reckon_from(
    runner: asyncio.Runner, line: ArmLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.cell.val2_arm.REST_S", 0.2)

    async def story() -> None:
        async with arm_on(line) as arm:
            await arm.monitor("SPEED 1")
            await arm.where()
            await arm.link.command("DO READY")
            with pytest.raises(LinkError, match="not at rest within"):
                await arm.wait_until_at_rest()
            await arm.stop_motion()

    runner.run(story())


def test_whether_the_arm_rests_is_asked_of_the_controller_now(runner: asyncio.Runner, line: ArmLine) -> None:
    async def story() -> None:
        async with arm_on(line) as arm:
            await arm.monitor("SPEED 4")
            assert await arm.at_rest()
            await arm.link.command("DO READY")
            assert moving(line)
            assert not await arm.at_rest()
            await arm.stop_motion()
            assert await arm.at_rest()
            with line.server.controller() as controller:
                controller.mishap(Mishap.POWER_CYCLED)
            await arm.link.close()
            await arm.link.open()
            assert arm.question is not None
            assert await arm.at_rest(), "it was switched off and on, and asks"

    runner.run(story())


def test_a_stop_the_controller_refuses_is_told_in_the_houses_own_error(runner: asyncio.Runner, line: ArmLine) -> None:
    async def story() -> None:
        async with line.link(replace(QUICK, abort_word="HALT")) as link:
            arm = arm_of(link, ArmGeometry())
            for word in (arm.test_stop, arm.stop_motion):
                with pytest.raises(StopRefusedError, match=r"HALT \(it answers `\*Illegal command\*`\)"):
                    await word()
            assert not arm.permission.stop_tests

    runner.run(story())


@pytest.mark.parametrize("typed", ["a line", "at the terminal"])
def test_a_program_that_only_pauses_does_not_run_on_behind_the_daemon(
    typed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two WHERE agreed while it waited: control-C was told that nothing moves, and the program went on."""

    async def story() -> None:
        loop = asyncio.get_running_loop()
        controller = Controller(Machine(SimulatedArm(joints_rad=BENT)))
        line = MemoryLine(controller, loop)
        goes_on: list[asyncio.TimerHandle] = []

        def pausing(machine: Machine, _: str) -> None:
            goes_on.append(loop.call_later(10.0, lambda: machine.move_joints(READY_RAD)))

        def stopped(machine: Machine, _: str) -> None:
            machine.stop("ABORT", by_others=False)
            for timer in goes_on:
                timer.cancel()

        monkeypatch.setitem(MONITOR_COMMANDS, "EXECUTE", pausing)
        monkeypatch.setitem(MONITOR_COMMANDS, "ABORT", stopped)
        link = Link(line.port, clock=loop.time, open_port=line.open)
        await link.open()
        arm = arm_of(link, ArmGeometry())
        if typed == "a line":
            await arm.monitor("EXEC PROG")
        else:
            async with arm.terminal(lambda _: None, print) as send:
                send(b"EXEC PROG\r")
                await asyncio.sleep(1.0)
        assert await arm.at_rest()
        await asyncio.sleep(20.0)
        assert np.allclose(controller.arm.joints_at(loop.time()), BENT)

    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        runner.run(story())


@pytest.mark.parametrize("typed", ["a line", "at the terminal"])
@pytest.mark.parametrize("swings", [1, 1000])
def test_a_program_that_moves_the_arm_on_and_on_is_ended_soon_and_one_motion_may_end(
    typed: str, swings: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It went on for a minute after the terminal was closed, and then the brakes were blamed."""

    async def story() -> tuple[float, list[str]]:
        loop = asyncio.get_running_loop()
        controller = Controller(Machine(SimulatedArm(joints_rad=BENT)))
        line = MemoryLine(controller, loop)
        swinging: list[asyncio.TimerHandle] = []

        def swing(machine: Machine, left: int) -> None:
            machine.now_s = loop.time()
            machine.move_joints(READY_RAD if left % 2 else BENT)
            if left > 1:
                swinging.append(loop.call_later(machine.arm.rests_s - loop.time(), swing, machine, left - 1))

        def stopped(machine: Machine, _: str) -> None:
            machine.stop("ABORT", by_others=False)
            for timer in swinging:
                timer.cancel()

        monkeypatch.setitem(MONITOR_COMMANDS, "EXECUTE", lambda machine, _: swing(machine, swings))
        monkeypatch.setitem(MONITOR_COMMANDS, "ABORT", stopped)
        told: list[str] = []
        arm = arm_of(Link(line.port, clock=loop.time, open_port=line.open), ArmGeometry())
        await arm.open()
        await arm.link.command("SPEED 30")
        began_s = loop.time()
        if typed == "a line":
            told += await arm.monitor("EXEC PROG")
        else:
            async with arm.terminal(lambda _: None, told.append) as send:
                send(b"EXEC PROG\r")
                await asyncio.sleep(0.1)
                assert not controller.machine.at_rest()
        took_s = loop.time() - began_s
        assert await arm.at_rest()
        before = controller.arm.joints_at(loop.time())
        assert swings > 1 or np.allclose(before, READY_RAD)
        await asyncio.sleep(20.0)
        assert np.array_equal(controller.arm.joints_at(loop.time()), before)
        return took_s, told

    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        took_s, told = runner.run(story())
    assert took_s < 7.0
    assert told == ([ENDED] if swings > 1 else [])


def test_a_terminal_that_is_left_while_the_controller_has_no_zero_is_left_without_a_fault(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refused(_: Machine, __: str = "") -> None:
        raise MonitorError("*Not calibrated*")

    monkeypatch.setitem(MONITOR_COMMANDS, "WHERE", refused)

    async def story() -> int:
        line = MemoryLine(Controller(Machine(SimulatedArm(joints_rad=BENT))), asyncio.get_running_loop())
        arm = arm_of(Link(line.port, clock=line.now_s, open_port=line.open), ArmGeometry())
        await arm.open()
        async with arm.terminal(lambda _: None, print) as send:
            send(b"STATUS\r")
            await asyncio.sleep(1.0)
        assert await arm.check() == f"{NO_ZERO} (it says `*Not calibrated*`)", "it answers: the line stays open"
        return arm.permission.stop_tests

    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        assert runner.run(story())


def test_a_terminal_that_is_left_with_a_question_open_answers_none_and_leaves_an_arm_of_which_nobody_knows() -> None:
    """It may be a program's, with the arm on its way: control-C was told that nothing moves."""

    async def story() -> None:
        controller = Controller(Machine(SimulatedArm(joints_rad=BENT)))
        line = MemoryLine(controller, asyncio.get_running_loop())
        link = Link(line.port, clock=line.now_s, open_port=line.open)
        await link.open()
        arm = arm_of(link, ArmGeometry())
        async with arm.terminal(lambda _: None, print):
            controller.mishap(Mishap.POWER_CYCLED)
            await asyncio.sleep(1.0)
        assert controller.question == link.question == "Load VAL-II from floppy (Y/N)?"
        assert not await arm.at_rest()
        await arm.power_up(["Y", "Y"])
        await arm.test_stop()
        assert await arm.at_rest()

    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        runner.run(story())


def test_a_question_found_on_opening_is_one_of_power_up_by_its_words_alone() -> None:
    """A program that somebody left asking: the arm was said to be at rest, and `robot power-up` sent it on its way."""

    async def story(asks: tuple[str, ...]) -> tuple[bool, bool, list[str]]:
        controller = Controller(Machine(SimulatedArm(joints_rad=BENT), Manners(power_up=asks), cold=True))
        line = MemoryLine(controller, asyncio.get_running_loop())
        arm = arm_of(Link(line.port, clock=line.now_s, open_port=line.open), ArmGeometry())
        with contextlib.suppress(LinkError):
            await arm.open()
        rests = not arm.asks_whether_to_move and await arm.at_rest()
        return arm.asks_whether_to_move, rests, list(controller.lines)

    for asks, may_move in ((VAL_II_ASKS, False), (("Another part (Y/N)?",), True), (("Go on?",), True)):
        with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
            assert runner.run(story(asks)) == (may_move, not may_move, [])


def test_the_yes_to_a_programs_question_is_over_when_the_arm_rests_and_the_program_is_ended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def story() -> None:
        controller = Controller(Machine(SimulatedArm(joints_rad=BENT)))
        line = MemoryLine(controller, asyncio.get_running_loop())

        def asking(machine: Machine, _: str) -> Iterator[Ask]:
            yield Ask("Another part?")
            machine.move_joints(READY_RAD)

        monkeypatch.setitem(MONITOR_COMMANDS, "EXECUTE", asking)
        arm = arm_of(Link(line.port, clock=line.now_s, open_port=line.open), ArmGeometry())
        await arm.open()
        with pytest.raises(LinkError, match="Another part"):
            await arm.monitor("EXEC PROG")
        await arm.power_up(["Y"])
        assert controller.machine.at_rest()
        assert np.allclose(controller.arm.joints_at(line.now_s()), READY_RAD)
        assert arm.permission.stop_tests

    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        runner.run(story())


def test_what_a_person_types_at_the_terminal_is_paced_as_what_we_type() -> None:
    async def story() -> list[str]:
        controller = Controller(Machine(SimulatedArm(joints_rad=BENT), Manners(lost_within_s=0.005)))
        line = MemoryLine(controller, asyncio.get_running_loop())
        slowly = Dialect(character_pause_s=0.01)
        arm = arm_of(Link(line.port, slowly, clock=line.now_s, open_port=line.open), ArmGeometry())
        await arm.open()
        async with arm.terminal(lambda _: None, print) as send:
            send(b"SPEED 20\rSPE")
            send(b"ED 30\r")
        return [text for text in controller.lines if text.startswith("S")]

    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        assert runner.run(story()) == ["SPEED 20", "SPEED 30"]
