"""The link to controllers with manners drawn at random, each on a line at its own pace: asked, moved, stopped. In
simulated time."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from daemon.arm.stopping import ABORT_S, TRIES
from daemon.cell.val2_arm import belongs_together
from daemon.frontends.client import STOP_ANSWER_S
from daemon.frontends.command_queue import STOP_PENDING_EVERY_S
from drivers.puma560 import forward
from drivers.simcell.arm import SimulatedArm
from drivers.simcell.controller import Controller, Machine, Manners
from drivers.simcell.history import StopRecord
from drivers.val2.dialect import SLOWEST_BAUD, Dialect
from drivers.val2.errors import NoAnswer
from drivers.val2.link import Link
from drivers.val2.location import apart, location_from_matrix
from tests.fakes.strange_controllers import PacedLine, dialect_of, draw, in_simulated_time, stop_of_a_drawn_one

HEARD_WITHIN_S = 1.0
"""Of the stop, at most: the half line that may stand before it, and the word, at the slowest pace and speed."""


@pytest.mark.parametrize("seed", range(30))
def test_it_is_asked_moved_and_stopped_on_its_way(seed: int) -> None:
    strange = draw(seed)

    async def story() -> None:
        arm = SimulatedArm(strange.geometry, np.radians(strange.joints_deg))
        controller = Controller(Machine(arm, strange.manners))
        line = PacedLine(controller, asyncio.get_running_loop(), strange.baud)
        clock = asyncio.get_running_loop().time
        link = Link("memory", dialect_of(strange), clock, open_port=line.open)
        link.belongs_together = partial(belongs_together, strange.geometry)
        await link.open()
        here = await link.where()
        np.testing.assert_allclose(here.joints_deg, strange.joints_deg, atol=0.02)
        near = location_from_matrix(forward(np.radians(strange.joints_deg + 5.0), strange.geometry))
        await link.command("SPEED 50")
        await link.move(near)
        assert apart((await link.wait_until_at_rest(near)).location, near)[0] < 0.2
        await link.command("SPEED 2")
        going = asyncio.ensure_future(link.move(here.location))
        await asyncio.sleep(1.5)
        asked_s = clock()
        place = await link.stop_motion()
        await asyncio.gather(going, return_exceptions=True)
        stops = [event for event in controller.machine.history.since(0)[1] if isinstance(event, StopRecord)]
        assert min(stop.began_s for stop in stops if stop.began_s > asked_s) < asked_s + HEARD_WITHIN_S
        assert place is not None
        assert controller.machine.at_rest()
        assert apart(place.location, here.location)[0] > 5.0
        await link.close()
        line.stop()

    in_simulated_time(story)


@pytest.mark.parametrize(("baud", "in_time"), [(SLOWEST_BAUD, True), (SLOWEST_BAUD // 2, False), (1200, False)])
def test_on_the_slowest_line_allowed_a_stop_is_confirmed_before_its_operator_is_sent_to_the_emergency_stop(
    baud: int, in_time: bool
) -> None:
    """Control-C while the pendant moves the arm: whether it rests is asked first. The controller has the usual
    manners."""

    async def story() -> None:
        controller = Controller(Machine(SimulatedArm(joints_rad=np.radians([0.0, 90.0, -90.0, 0.0, -30.0, 0.0]))))
        line = PacedLine(controller, asyncio.get_running_loop(), baud)
        clock = asyncio.get_running_loop().time
        link = Link("memory", Dialect(baud=baud), clock, open_port=line.open)
        await link.open()
        controller.machine.drive_by_pendant(np.radians([90.0, 90.0, -90.0, 0.0, -30.0, 0.0]))
        await asyncio.sleep(1.5)
        asked_s = clock()
        with pytest.raises(NoAnswer):
            await link.still(0.0, any_place=True)
        await link.stop_motion()
        assert controller.machine.at_rest()
        assert (clock() - asked_s < STOP_ANSWER_S) is in_time
        await link.close()
        line.stop()

    in_simulated_time(story)


def test_a_pace_that_is_too_quick_is_no_stop_and_is_told() -> None:
    """The limit bites: the same controller, told at full speed, does not hear the word."""
    strange = replace(draw(0), baud=9600)
    strange = replace(strange, manners=replace(strange.manners, lost_within_s=0.02, echo=False))

    async def story() -> None:
        controller = Controller(
            Machine(SimulatedArm(strange.geometry, np.radians(strange.joints_deg)), strange.manners)
        )
        line = PacedLine(controller, asyncio.get_running_loop(), strange.baud)
        quick = replace(dialect_of(strange), character_pause_s=0.0)
        link = Link("memory", quick, asyncio.get_running_loop().time, open_port=line.open)
        with pytest.raises(Exception, match=r"no prompt|no answer"):
            await link.open()
        line.stop()

    in_simulated_time(story)


STOPPED_WITHIN_S = 3.0
"""Of opening the line: deploy/SAFETY.md says so."""


@pytest.mark.parametrize("echo", [True, False])
@pytest.mark.parametrize("line_ends", ["cr", "lf"])
@pytest.mark.parametrize("pause_s", [0.0, 0.03])
def test_an_arm_at_work_behind_a_controller_that_gives_no_prompt_is_stopped_on_opening(
    echo: bool, line_ends: Any, pause_s: float
) -> None:
    """No prompt until the motion is over, perhaps no echo: what tells it from a dead one is what it says once it
    stops."""

    async def story() -> None:
        manners = Manners(echo=echo, line_editing=False, prompt_after_move="end", line_ends=line_ends)
        controller = Controller(
            Machine(SimulatedArm(joints_rad=np.radians([0.0, 90.0, -90.0, 0.0, -30.0, 0.0])), manners)
        )
        loop, end = asyncio.get_running_loop(), b"\n" if line_ends == "lf" else b"\r"
        line = PacedLine(controller, loop, 9600)
        controller.output(0.0)
        controller.receive(b"DO DRIVE 1,90,2" + end, 0.0)
        own = Dialect(echo=echo, cancel_line=b"", line_end=end, character_pause_s=pause_s, prompt_after_move="end")
        link = Link("memory", own, loop.time, open_port=line.open)
        opened_s = loop.time()
        await link.open()
        assert link.stopped_on_opening
        assert controller.arm.rests_s < opened_s + STOPPED_WITHIN_S
        assert (await link.where()).joints_deg[0] < 80.0
        await link.close()
        line.stop()

    in_simulated_time(story)


@pytest.mark.parametrize("seed", range(30))
def test_at_9600_baud_a_stop_is_answered_within_a_clients_patience_and_confirmed_before_the_alarm(seed: int) -> None:
    """Of these controllers 15 take longer than a client waits for a daemon that says nothing, 8 longer than 4 s."""
    stop = in_simulated_time(partial(stop_of_a_drawn_one, replace(draw(seed), baud=9600)))
    assert stop.answered_s + STOP_PENDING_EVERY_S < STOP_ANSWER_S
    assert stop.confirmed_s < max(ABORT_S, TRIES * stop.tried_s)
