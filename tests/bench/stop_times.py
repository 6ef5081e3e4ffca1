"""How long a stop takes from the daemon's decision to a braking arm, and until two readings prove that it rests.

usage: python -m tests.bench stop_times
Simulated time: the line carries no more characters a second than its baud rate, nothing else of this computer counts.
The moment of each stop is drawn at random, from the first letter of a move's line until the arm is nearly there.
"""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import replace

import numpy as np

from drivers.puma560 import READY_RAD
from drivers.simcell.arm import SimulatedArm
from drivers.simcell.controller import Controller, Manners
from drivers.simcell.controller.memory_line import MemoryLine
from drivers.simcell.history import StopRecord
from drivers.simcell.simulated_time import SimulatedLoop
from drivers.val2.dialect import Dialect
from drivers.val2.errors import LinkError
from drivers.val2.link import Link, Start
from drivers.val2.location import Location
from tests.fakes.paced_line import paced

BAUDS = (1200, 2400, 4800, 9600, 19200)
STOPS = 16
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
    controller = Controller(SimulatedArm(joints_rad=np.array(READY_RAD)), manners)
    line = MemoryLine(controller, loop)
    link = Link("memory", dialect, clock=loop.time, open_port=paced(line))
    await link.open()
    await link.move(NEAR)
    await link.rest(NEAR)

    async def there() -> None:
        with contextlib.suppress(LinkError):
            await link.move(FAR, start=Start(PERCENT, lambda where: None))
            await link.rest(FAR)

    moving = asyncio.create_task(there())
    await asyncio.sleep(wait_s)
    said_s = loop.time()
    at_work = controller.arm.rests_s > said_s
    await link.abort()
    rest_s = loop.time()
    await moving
    await link.close()
    line.stop()
    stops = [event for event in controller.machine.history if isinstance(event, StopRecord)]
    braked_s = next(stop.began_s for stop in stops if stop.began_s > said_s)
    return (braked_s - said_s, rest_s - said_s) if at_work else None


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
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
