"""The link and the whole simulated cell in one process, on simulated time: no pty, no thread, no waiting."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.puma560 import READY_RAD, forward
from drivers.simcell.arm import SimulatedArm
from drivers.simcell.cell import SimulatedCell
from drivers.simcell.controller import Controller, Faults, LineFault, Machine, Mishap
from drivers.val2.errors import ControllerError, PortError, Preempted
from drivers.val2.link import Link
from drivers.val2.location import Location, location_from_matrix
from tests.fakes.arm_line import ready
from tests.fakes.memory_line import MemoryLine
from tests.fakes.simulated_time import SimulatedLoop

TRUTH = Path(__file__).parents[3] / "etc" / "simcell.yaml"


def at_simulated_time(story: Coroutine[Any, Any, Any]) -> Any:
    """Run a story; what it gives."""
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        return runner.run(story)


def line_to(controller: Controller) -> tuple[MemoryLine, Link]:
    """A line in memory to a controller, and a link that will use it."""
    loop = asyncio.get_running_loop()
    line = MemoryLine(controller, loop)
    return line, Link(line.port, clock=loop.time, open_port=line.open)


def test_ten_minutes_of_moves_pass_in_the_time_their_work_takes() -> None:
    async def story() -> tuple[float, int]:
        controller = Controller(Machine(SimulatedArm(joints_rad=READY_RAD)))
        _, link = line_to(controller)
        await link.open()
        await link.command("SPEED 20")
        moves = 0
        while controller.now_s < 600.0:
            target = Location(520.0, 40.0 * (moves % 5), -100.0, 0.0, 80.0, 10.0 * (moves % 3))
            await link.move(target)
            await link.wait_until_at_rest(target)
            moves += 1
        await link.close()
        return asyncio.get_running_loop().time(), moves

    began_s = time.monotonic()
    passed_s, moves = at_simulated_time(story())
    assert passed_s >= 600.0
    assert moves > 50
    assert time.monotonic() - began_s < 60.0


def test_a_conversation_repeats_itself_byte_for_byte_and_second_for_second() -> None:
    async def story() -> list[dict[str, Any]]:
        records: list[dict[str, Any]] = []
        faults = Faults(line=[LineFault("to_controller", "flip", after=40)])
        loop = asyncio.get_running_loop()
        line = MemoryLine(Controller(Machine(SimulatedArm(joints_rad=READY_RAD), faults=faults)), loop)
        link = Link(line.port, clock=loop.time, on_wire=records.append, open_port=line.open)
        await link.open()
        target = location_from_matrix(forward(READY_RAD + np.radians([10, -20, 5, 0, 10, 0])))
        await link.move(target)
        await link.wait_until_at_rest(target)
        await link.close()
        return records

    first, second = at_simulated_time(story()), at_simulated_time(story())
    assert first == second
    assert len(first) > 10


def test_an_abort_stops_the_arm_and_whoever_waits_for_it() -> None:
    async def story() -> float:
        controller = Controller(Machine(SimulatedArm(joints_rad=READY_RAD)))
        line, link = line_to(controller)
        await link.open()
        await link.command("SPEED 5")
        target = location_from_matrix(forward(READY_RAD + np.radians([90, -20, 5, 0, 10, 0])))
        await link.move(target)
        waiting = asyncio.create_task(link.wait_until_at_rest(target))
        await asyncio.sleep(1.0)
        told_s = line.now_s()
        await link.stop_motion()
        with pytest.raises(Preempted):
            await waiting
        assert controller.machine.at_rest()
        return controller.arm.rests_s - told_s

    assert 0.0 < at_simulated_time(story()) < 0.5


def test_a_lost_line_and_a_mishap_are_told_as_on_a_real_one() -> None:
    async def story() -> None:
        controller = Controller(Machine(SimulatedArm(joints_rad=READY_RAD)))
        line, link = line_to(controller)
        await link.open()
        with pytest.raises(PortError, match="in use"):
            await Link(line.port, open_port=line.open).open()
        with line.controller() as held:
            held.mishap(Mishap.EMERGENCY_STOP)
        with pytest.raises(ControllerError, match="Emergency stop"):
            await ready(link)
        line.unplug()
        with pytest.raises(PortError, match="gone"):
            await link.where()
        line.unplugged = False
        await link.open()
        assert (await link.where()).joints_deg == pytest.approx(np.degrees(READY_RAD), abs=1e-3)
        line.stop()

    at_simulated_time(story())


def test_the_whole_cell_lives_in_simulated_time() -> None:
    async def story() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, SimulatedLoop)
        cell = SimulatedCell(TRUTH, seed=1, loop=loop)
        assert isinstance(cell.server, MemoryLine)
        link = Link(cell.port, clock=loop.time, open_port=cell.server.open)
        await link.open()
        cell.camera.open()
        cell.world.stand("cube", 0, 520.0, 0.0, 0.0)
        cell.motion_monitor.motion_permitted(loop.time(), True)
        target = Location(520.0, 0.0, 60.0, 0.0, 90.0, 0.0)
        await ready(link)
        await link.move(target)
        await link.wait_until_at_rest(target)
        asked_s = loop.time()
        pair = await asyncio.to_thread(cell.camera.grab, asked_s, 1.0)
        assert pair.left.taken_s > asked_s
        assert pair.left.pixels.max() > 100
        await link.move(Location(520.0, 0.0, -320.0, 0.0, 90.0, 0.0))
        await link.stop_motion()
        await asyncio.sleep(3600.0)
        assert {violation.rule for violation in cell.violations()} == {"step too long"}
        await link.close()
        cell.stop()

    at_simulated_time(story())


def test_a_wait_that_nothing_can_end_is_an_error_and_no_hang() -> None:
    async def story() -> None:
        await asyncio.Event().wait()

    with pytest.raises(RuntimeError, match="everybody waits"):
        at_simulated_time(story())


@pytest.mark.timeout(20)
@pytest.mark.parametrize("days", [1.0, 194.0, 195.0, 3650.0])
def test_timers_end_however_long_it_has_run(days: float) -> None:
    """Seconds have fewer digits left after the point the more there are: past 2^24 of them, no nanoseconds."""

    async def wait() -> float:
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        for k in range(1000):
            await asyncio.sleep(0.01 + k * 1e-5)
        async with asyncio.timeout(0.3):
            await asyncio.sleep(0.1)
        return loop.time() - began_s

    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        runner.get_loop().sleep(days * 86_400.0)  # type: ignore[attr-defined]
        assert runner.run(wait()) == pytest.approx(0.01 * 1000 + 1e-5 * 499_500 + 0.1, rel=1e-3)
