"""How long a stop takes from the daemon's decision to a braking arm, and until two readings prove that it rests.

usage: python -m tests.bench stop_times
Simulated time: the line carries no more characters a second than its baud rate, nothing else of this computer counts.
The moment of each stop is drawn at random, from the first letter of a move's line until the arm is nearly there.
"""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import replace
from functools import partial

import numpy as np

from daemon.arm.stopping import ABORT_S, TRIES
from daemon.frontends.client import STOP_ANSWER_S
from daemon.frontends.command_queue import STOP_PENDING_EVERY_S
from drivers.puma560 import READY_RAD
from drivers.simcell.arm import SimulatedArm
from drivers.simcell.controller import Controller, Machine, Manners
from drivers.simcell.history import StopRecord
from drivers.val2.dialect import Dialect
from drivers.val2.errors import LinkError
from drivers.val2.link import Link, MoveStart
from drivers.val2.location import Location
from tests.fakes.memory_line import MemoryLine
from tests.fakes.paced_line import paced
from tests.fakes.simulated_time import SimulatedLoop
from tests.fakes.strange_controllers import draw, in_simulated_time, stop_of_a_drawn_one

BAUDS = (1200, 2400, 4800, 9600, 19200)
STOPS = 16
DRAWN = 30
PERCENT = 30.0
NEAR, FAR = Location(520.0, -250.0, -100.0, 0.0, 80.0, 0.0), Location(520.0, 250.0, -100.0, 0.0, 80.0, 0.0)
LINES = {
    "ABORT brakes": (Manners(), Dialect()),
    "ABORT brakes, no echo": (Manners(echo=False), Dialect(echo=False)),
    "prompt at the motion's end": (Manners(prompt_after_move="end"), Dialect()),
    "PANIC brakes (abort_word)": (Manners(stops_at_once=False), Dialect(abort_word="PANIC")),
}
"""How a controller behaves, and what facetd is told of it."""


async def stopped_after(manners: Manners, dialect: Dialect, wait_s: float) -> tuple[float, float] | None:
    """Seconds from the stop to the moment the arm brakes, and to rest, confirmed; None where nothing moved yet, or any
    more."""
    loop = asyncio.get_running_loop()
    controller = Controller(Machine(SimulatedArm(joints_rad=np.array(READY_RAD)), manners))
    line = MemoryLine(controller, loop)
    link = Link("memory", dialect, clock=loop.time, open_port=paced(line))
    await link.open()
    await link.move(NEAR)
    await link.wait_until_at_rest(NEAR)

    async def there() -> None:
        with contextlib.suppress(LinkError):
            await link.move(FAR, start=MoveStart(PERCENT, lambda where: None))
            await link.wait_until_at_rest(FAR)

    moving = asyncio.create_task(there())
    await asyncio.sleep(wait_s)
    said_s = loop.time()
    at_work = controller.arm.rests_s > said_s
    await link.stop_motion()
    rest_s = loop.time()
    await moving
    await link.close()
    line.stop()
    stops = [event for event in controller.machine.history if isinstance(event, StopRecord)]
    braked_s = next(stop.began_s for stop in stops if stop.began_s > said_s)
    return (braked_s - said_s, rest_s - said_s) if at_work else None


def drawn_ones() -> None:
    """Print, of controllers drawn at random at 9600 baud, when a stop is answered and confirmed, and when the alarm
    would sound."""
    print(f"\n{'controllers drawn, 9600 baud':<40}{'answered s':>11}{'confirmed s':>12}{'alarm s':>9}{'tried s':>9}")
    found = [in_simulated_time(partial(stop_of_a_drawn_one, replace(draw(k), baud=9600))) for k in range(DRAWN)]
    alarm_s = [max(ABORT_S, TRIES * stop.tried_s) for stop in found]
    times = np.array(
        [(stop.answered_s, stop.confirmed_s, s, stop.tried_s) for stop, s in zip(found, alarm_s, strict=True)]
    )
    for name, row in (("median", np.median(times, axis=0)), ("worst", times.max(axis=0))):
        print(f"{name:<40}{row[0]:>11.2f}{row[1]:>12.2f}{row[2]:>9.1f}{row[3]:>9.2f}")
    silent = sum(stop.answered_s + STOP_PENDING_EVERY_S > STOP_ANSWER_S for stop in found)
    early = sum(stop.confirmed_s > s for stop, s in zip(found, alarm_s, strict=True))
    late = sum(stop.confirmed_s > STOP_ANSWER_S for stop in found)
    print(
        f"of {DRAWN}: confirmed after {STOP_ANSWER_S:g} s: {late}; no sign before: {silent}; after the alarm: {early}"
    )


def main() -> int:
    """Measure and print."""
    print(
        f"{'':<28}{'baud':>6}{'stops':>7}{'to braking: median':>20}{'worst s':>9}{'to rest: median':>17}{'worst s':>9}"
    )
    for name, (manners, dialect) in LINES.items():
        for baud in BAUDS:
            rng = np.random.default_rng(baud)
            told = replace(dialect, baud=baud)
            typed_s = 350 * 10 / baud
            found = []
            for wait_s in rng.uniform(typed_s * 0.5, typed_s + 2.5, STOPS):
                with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
                    found.append(runner.run(stopped_after(manners, told, wait_s)))
            seen = np.array([one for one in found if one is not None])
            (brake, rest), (brakes, rests) = np.median(seen, axis=0), seen.max(axis=0)
            print(
                f"{name:<28}{baud:>6}{len(seen):>7}{brake:>20.3f}{brakes:>9.3f}{rest:>17.3f}{rests:>9.3f}", flush=True
            )
    drawn_ones()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
