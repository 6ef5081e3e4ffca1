"""The link under random orders, aborts, line faults and mishaps: it never hangs, never moves twice for one order, and
whatever goes wrong comes out as a LinkError with the arm where an order sent it, or stopped on the way.
"""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np
import pytest

from drivers.simcell.controller import LineFault, Manners, Mishap
from drivers.simcell.history import MotionRecord
from drivers.val2.dialect import Dialect
from drivers.val2.errors import LinkError
from drivers.val2.link import Link
from drivers.val2.location import Location
from tests.fakes.arm_line import MakesLine
from tests.fakes.in_time import lived

PLACES = [
    Location(520.0, 0.0, -100.0, 0.0, 80.0, 0.0),
    Location(540.0, 20.0, -150.0, 5.0, 75.0, 5.0),
    Location(500.0, -60.0, -50.0, -5.0, 70.0, 0.0),
]
QUICK = Dialect(resync_s=0.15, typing_s=0.15, answer_s=0.4, motion_s=0.8, stall_s=0.1)
RECOVERABLE = [Mishap.POWER_LOST, Mishap.EMERGENCY_STOP, Mishap.ENVELOPE_ERROR, Mishap.POWER_CYCLED]
PATIENCE_S = 20.0


class Scene:
    """One random run."""

    def __init__(self, cell: Any, link: Link, seed: int) -> None:
        self.cell, self.link = cell, link
        self.rng = np.random.default_rng(seed)
        self.orders = 0

    def motions(self) -> int:
        """How often the arm set out; CAL is none of the orders."""
        with self.cell.server.controller() as controller:
            return sum(isinstance(event, MotionRecord) and event.by != "CAL" for event in controller.machine.history)

    async def order(self) -> None:
        """One random order, perhaps with an abort coming in between; LinkErrors are what is expected of it."""
        actions: list[Callable[[], Awaitable[Any]]] = [self.go, self.go, self.go_straight, self.link.where, self.hand]
        action = asyncio.ensure_future(actions[self.rng.integers(len(actions))]())
        if self.rng.random() < 0.3:
            await asyncio.sleep(self.rng.uniform(0, 0.25))
            await asyncio.gather(self.link.stop_motion(), action, return_exceptions=True)
        outcome = (await asyncio.gather(action, return_exceptions=True))[0]
        assert outcome is None or not isinstance(outcome, BaseException) or isinstance(outcome, LinkError), outcome

    async def go(self) -> None:
        self.orders += 1
        place = PLACES[self.rng.integers(len(PLACES))]
        await self.link.move(place)
        await self.link.wait_until_at_rest(place)

    async def go_straight(self) -> None:
        self.orders += 1
        place = PLACES[self.rng.integers(len(PLACES))]
        await self.link.move(place, straight=True)
        await self.link.wait_until_at_rest(place)

    async def hand(self) -> None:
        await self.link.set_hand(closed=True)

    def harm(self) -> None:
        """Something goes wrong with the next order, or nothing."""
        faults, rng = self.cell.faults, self.rng
        kind = rng.integers(6)
        if kind == 0:
            way, harm = rng.choice(["to_host", "to_controller"]), rng.choice(["drop", "double", "flip", "insert"])
            faults.line.append(LineFault(way, harm, after=int(rng.integers(200)), count=int(rng.integers(1, 4))))
        elif kind == 1:
            faults.mute_answers = int(rng.integers(1, 3))
        elif kind == 2:
            faults.in_move.append((float(rng.uniform(0, 1)), RECOVERABLE[rng.integers(len(RECOVERABLE))]))
        elif kind == 3:
            faults.refusals.append("*Location out of range*")

    async def put_right(self) -> None:
        """What an operator does: faults end, power on, questions answered, calibrated, ready."""
        faults = self.cell.faults
        faults.line.clear(), faults.in_move.clear(), faults.refusals.clear()
        faults.mute_answers = 0
        for _ in range(6):
            with self.cell.server.controller() as controller:
                controller.machine.arm_power = True
            try:
                if self.link.question is not None:
                    await self.link.power_up(("Y", "Y"))
                await self.link.calibrate()
                return
            except LinkError:
                continue
        raise AssertionError("the link did not come back")


@pytest.mark.parametrize("prompt", ["start", "end"])
@pytest.mark.parametrize("seed", range(8))
def test_whatever_happens_no_order_moves_twice_and_the_link_comes_back(
    timed_line: MakesLine, seed: int, prompt: Any
) -> None:
    async def scene() -> None:
        cell = timed_line(Manners(prompt_after_move=prompt, calibration_s=1.0), time_scale=40.0)
        async with cell.link(QUICK) as link:
            run = Scene(cell, link, seed)
            for _ in range(6):
                run.harm()
                await asyncio.wait_for(run.order(), PATIENCE_S)
                await asyncio.wait_for(run.put_right(), PATIENCE_S)
                assert run.motions() <= run.orders
            await link.move(PLACES[0])
            there = await link.wait_until_at_rest(PLACES[0], 5.0)
            np.testing.assert_allclose(there.location.values()[:3], PLACES[0].values()[:3], atol=0.01)

    lived(scene())
