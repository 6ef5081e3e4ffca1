"""How often somebody else's line on the arm's line is noticed, and how often noise is taken for one, at 9600 baud.

usage: python -m tests.bench others_typing
Simulated time. The other types at the line's own speed, as a program does, or as fast as a person, from a moment drawn
at random within a move's turn of the line; or so many bytes are dropped, doubled, flipped or inserted there.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable

import numpy as np

from drivers.puma560 import READY_RAD
from drivers.simcell.arm import SimulatedArm
from drivers.simcell.controller import Controller, Faults, LineFault, Machine
from drivers.val2.dialect import Dialect
from drivers.val2.errors import Disturbed, LinkError
from drivers.val2.link import Link, MoveStart
from drivers.val2.location import Location
from tests.fakes.memory_line import MemoryLine
from tests.fakes.paced_line import paced
from tests.fakes.simulated_time import SimulatedLoop

BAUD = 9600
STORIES = 100
TURN_S = 1.3
"""About what a move's turn of the line takes, from its first letter to its last prompt."""
LINES = ("SPEED 100", "DO DRIVE 1,40,50", "DO SPEED 300 ALWAYS", "WHERE", "CAL", "Y", "")
NEAR, FAR = Location(520.0, 0.0, -100.0, 0.0, 80.0, 0.0), Location(522.0, 1.0, -101.0, 0.0, 80.0, 0.0)
Act = Callable[[MemoryLine, Faults, np.random.Generator], Awaitable[None]]


def typed_beside_by(text: str, character_s: float) -> Act:
    """Another terminal types a line, a character each so many seconds."""

    async def act(line: MemoryLine, _: Faults, rng: np.random.Generator) -> None:
        await asyncio.sleep(rng.uniform(0.0, TURN_S))
        for byte in f"{text}\r".encode():
            with line.controller() as controller:
                controller.receive(bytes([byte]), controller.now_s)
            await asyncio.sleep(character_s)

    return act


def noise(harm: str, count: int) -> Act:
    """So many bytes in a row are harmed, one way or the other."""

    async def act(_: MemoryLine, faults: Faults, rng: np.random.Generator) -> None:
        way = "to_host" if rng.random() < 0.6 else "to_controller"
        faults.line.append(LineFault(way, harm, int(rng.integers(350 if way == "to_host" else 130)), count))  # type: ignore[arg-type]

    return act


async def story(act: Act, seed: int) -> str:
    """What two moves came to, during the first of which something happens: the error's name, or `nothing`."""
    loop = asyncio.get_running_loop()
    faults, rng = Faults(), np.random.default_rng(seed)
    line = MemoryLine(Controller(Machine(SimulatedArm(joints_rad=np.array(READY_RAD)), faults=faults)), loop)
    link = Link("memory", Dialect(baud=BAUD), clock=loop.time, open_port=paced(line))
    await link.open()
    await link.move(NEAR)
    await link.wait_until_at_rest(NEAR)
    happens = asyncio.ensure_future(act(line, faults, rng))
    came = "nothing"
    try:
        for place in (FAR, NEAR):
            await link.move(place, start=MoveStart(50.0, lambda where: None), straight=True)
            await link.wait_until_at_rest(place)
    except LinkError as error:
        came = "noticed" if isinstance(error, Disturbed) else type(error).__name__
    happens.cancel()
    await link.close()
    line.stop()
    return came


def shares(act: Act, stories: int = STORIES) -> Counter[str]:
    """What came of so many stories."""
    found: Counter[str] = Counter()
    for seed in range(stories):
        with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
            found[runner.run(story(act, seed))] += 1
    return found


def main() -> int:
    """Measure and print."""
    acts = {f"types {text!r}, a program": typed_beside_by(text, 10.0 / BAUD) for text in LINES}
    acts |= {f"types {text!r}, a person": typed_beside_by(text, 0.15) for text in LINES[:3]}
    acts |= {f"{harm} {n} bytes": noise(harm, n) for harm in ("drop", "double", "flip", "insert") for n in (1, 2, 3)}
    for name, act in acts.items():
        found = shares(act)
        others = ", ".join(f"{what} {count / STORIES:.1%}" for what, count in found.most_common() if what != "noticed")
        print(f"{name:<44} somebody else types: {found['noticed'] / STORIES:>6.1%}   {others}", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
