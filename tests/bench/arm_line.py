"""How long the arm's line takes at a true 9600 baud: each command, what of it is the link's own, an abort, and a pick.

`python -m tests.bench arm_line`. The link's own is what would be left on an infinitely fast line: waiting for silence
after a dot, for a doubled character after an echo, and computing. The pick is one of a simulated cell in simulated
time: what computes takes the cell's time (tests/fakes/whole_daemon.py), so that only ratios of one run say anything.
"""

from __future__ import annotations

import asyncio
import statistics
import sys
import time
from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import ExitStack
from functools import partial
from typing import Any
from unittest.mock import patch

import numpy as np

from drivers.puma560 import READY_RAD
from drivers.simcell.arm import SimulatedArm
from drivers.simcell.controller import Controller, Machine, PtyServer
from drivers.val2 import commands
from drivers.val2.conversation import ControllerAnswer, Conversation
from drivers.val2.dialect import Dialect
from drivers.val2.link import Link, MoveStart, NextMove
from drivers.val2.location import Location
from drivers.val2.wire import Where
from tests.fakes.memory_line import MemoryLine
from tests.fakes.paced_line import PacedPort
from tests.fakes.whole_daemon import Story

ROUNDS = 5
BYTES_PER_S = 960.0
PLACES = [Location(520.0, 0.0, -100.0, 0.0, 80.0, 0.0), Location(522.0, 1.0, -101.0, 0.0, 80.0, 0.0)]


async def measure(server: PtyServer) -> None:
    """Print the table."""
    records: list[dict[str, Any]] = []
    link = Link(server.port, Dialect(), on_wire=records.append)
    await link.open()
    await link.move(PLACES[0])
    await link.wait_until_at_rest(PLACES[0])
    print(f"{'what':<34}{'median s':>10}{'bytes':>7}{'serial s':>10}{'link s':>9}")
    for name, ask in questions(link).items():
        seconds, counts = [], []
        for k in range(ROUNDS):
            before, began_s = len(records), time.perf_counter()
            await ask(k)
            seconds.append(time.perf_counter() - began_s)
            counts.append(wire_bytes(records[before:]))
            await link.wait_until_at_rest(PLACES[k % 2]) if name.startswith("DO MOVE") else await link.where()
        median_s, serial_s = statistics.median(seconds), statistics.median(counts) / BYTES_PER_S
        count = f"{statistics.median(counts):.0f}"
        print(f"{name:<34}{median_s:>10.3f}{count:>7}{serial_s:>10.3f}{median_s - serial_s:>9.3f}")
    for straight in (False, True):
        gaps = [await rest_to_last_byte(link, records, PLACES[(k + 1) % 2], straight) for k in range(ROUNDS)]
        name = f"rest to a {'straight' if straight else 'joint'} move's last byte"
        print(f"{name:<34}{statistics.median(gaps):>10.3f}   worst {max(gaps):.3f}")
    halts, confirmed = [], []
    for k in range(ROUNDS):
        halt_s, rest_s = await abort_in_mid_move(link, server, k)
        halts.append(halt_s)
        confirmed.append(rest_s)
    print(f"{'abort() to the arm braking':<34}{statistics.median(halts):>10.3f}   worst {max(halts):.3f}")
    print(f"{'abort() to rest, confirmed':<34}{statistics.median(confirmed):>10.3f}   worst {max(confirmed):.3f}")
    await link.close()


def questions(link: Link) -> dict[str, Callable[[int], Awaitable[Any]]]:
    """What is timed; each is given the round's number."""
    return {
        "WHERE": lambda k: link.where(),
        "SPEED": lambda k: link.command("SPEED 50"),
        "DO MOVE TRANS(...) to its prompt": lambda k: link.move(PLACES[k % 2]),
        "DO MOVES by a variable, likewise": lambda k: link.move(PLACES[k % 2], straight=True),
        "two agreeing WHERE": lambda k: link.still(5.0),
    }


def wire_bytes(records: list[dict[str, Any]]) -> int:
    """Bytes that took the line's time: all that came, and what was sent while nothing came (line ends)."""
    heard = sum(len(record["bytes"]) for record in records if record["way"] == "in")
    return heard + sum(record["bytes"] == "\r" for record in records)


async def rest_to_last_byte(link: Link, records: list[dict[str, Any]], place: Location, straight: bool) -> float:
    """Seconds from an arm at rest until its next move was typed to the last byte."""
    before, began_s = len(records), link.clock()
    await link.move(place, start=MoveStart(50.0, lambda where: None), straight=straight)
    await link.wait_until_at_rest(place)
    sent = [record for record in records[before:] if record["way"] == "out"]
    line = next(k for k, record in enumerate(sent) if record["bytes"].startswith("DO MOVE"))
    return float(sent[line + 1]["t_s"]) - began_s


async def abort_in_mid_move(link: Link, server: PtyServer, k: int) -> tuple[float, float]:
    """Seconds from abort() until the controller braked, and until the link knew where the arm stands."""
    await link.command("SPEED 5")
    await link.move(Location(560.0, -60.0 if k % 2 else 60.0, -150.0, 5.0, 75.0, 0.0))
    began_s = server.now_s()
    aborting = asyncio.create_task(link.stop_motion())
    natural_s = server_rests_s(server)
    while server_rests_s(server) == natural_s:
        await asyncio.sleep(0.0005)
    halt_s = server.now_s() - began_s
    await aborting
    rest_s = server.now_s() - began_s
    await link.command("SPEED 100")
    return halt_s, rest_s


def server_rests_s(server: PtyServer) -> float:
    """When the motion under way will end."""
    with server.controller() as controller:
        return controller.arm.rests_s


async def never_ahead(link: Link, then: NextMove) -> Where:
    """In place of a preamble ahead: WHERE alone."""
    return await link.where()


async def _unasked(link: Link, talk: Conversation, lines: Any, start: MoveStart | None) -> None:
    """In place of the preamble: what a link sends that believes what it knows."""
    session, known = link._open_session, getattr(link, "speed_believed", None)
    if start is not None and known != start.speed_pct:
        await session.ask(talk, commands.speed(start.speed_pct), (), link.dialect.answer_s)
        link.speed_believed = start.speed_pct  # type: ignore[attr-defined]
    for line in lines[:-1]:
        await session.ask(talk, line, (), link.dialect.answer_s)


async def _two_readings(link: Link, _: Location, timeout_s: float | None = None, then: NextMove | None = None) -> Where:
    """In place of one reading at the very place: two that agree."""
    await link._break(timeout_s or link.dialect.motion_s)
    return await link.still(timeout_s or link.dialect.motion_s)


WAYS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "no preamble ahead": {"_preamble_ahead": never_ahead},
    "nothing asked, speed believed": {"_before_move": _unasked, "rest": _two_readings},
}
"""How a pick's moves are told; the last as it was before an arm was asked."""


def pick(instead: dict[str, Any]) -> tuple[float, float, Counter[str]]:
    """Seconds of a pick on a line at 9600 baud, those of its commands but BREAK, and how often each was typed."""
    typed: Counter[str] = Counter()
    on_line_s = 0.0
    ask, opened = Conversation.ask, MemoryLine.open

    async def counted(talk: Conversation, command: str, *rest: Any, **how: Any) -> ControllerAnswer:
        nonlocal on_line_s
        began_s = talk.clock()
        answer = await ask(talk, command, *rest, **how)
        on_line_s += 0.0 if command == "DO BREAK" else talk.clock() - began_s
        typed[command.partition(" ")[0]] += 1
        return answer

    def paced(line: MemoryLine, *about: Any) -> PacedPort:
        unpaced: Any = type("Unpaced", (), {"open": staticmethod(partial(opened, line))})
        return PacedPort(unpaced, *about)

    with ExitStack() as patches:
        for name, instead_of_it in instead.items():
            patches.enter_context(patch.object(Link, name, instead_of_it))
        patches.enter_context(patch.object(Conversation, "ask", counted))
        patches.enter_context(patch.object(MemoryLine, "open", paced))
        story = Story(parts=True)
        try:
            for text, wait_s in (("enable", 3.0), ("go home", 25.0)):
                story.sockets[0].say(text)
                story.wait(wait_s)
            typed.clear()
            on_line_s, began_s = 0.0, story.now_s
            story.sockets[0].say("pick cube")
            story.wait_for(story.sockets[0], 200.0)
            assert story.texts[-1].startswith("picked"), story.texts[-1]
            return story.now_s - began_s, on_line_s, typed
        finally:
            story.close()


def picks() -> None:
    """Print a pick's time, told each way."""
    print(f"\n{'a pick, simulated, 9600 baud':<34}{'s':>8}{'ratio':>8}{'line s':>8}   commands")
    first_s = 0.0
    for name, instead in WAYS.items():
        seconds, on_line_s, typed = pick(instead)
        first_s = first_s or seconds
        count = ", ".join(f"{word} {n}" for word, n in typed.most_common())
        print(f"{name:<34}{seconds:>8.1f}{seconds / first_s:>8.3f}{on_line_s:>8.1f}   {count}", flush=True)


def main() -> int:
    """Measure and print."""
    with PtyServer(Controller(Machine(SimulatedArm(joints_rad=np.array(READY_RAD))))) as server:
        asyncio.run(measure(server))
    picks()
    return 0


if __name__ == "__main__":
    sys.exit(main())
