"""A simulated controller on a line in scaled time, links to it with a ledger, and its true state: a pseudo-terminal in
real time, or a line in memory on simulated time, which carries as many characters a second."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any

from drivers.simcell.controller import Controller, Faults, PtyServer
from drivers.val2.dialect import Dialect
from drivers.val2.link import Link
from drivers.val2.port import OpenPort
from drivers.val2.wire import Where
from tests.fakes.memory_line import MemoryLine
from tests.fakes.paced_line import PacedPort
from tests.fakes.simulated_time import SimulatedLoop

QUICK = Dialect(resync_s=0.4, typing_s=0.4, answer_s=1.0, stall_s=0.3)


class ArmLine:
    """The controller's end of the line, the ledger of a link to it, and the commands to the gripper."""

    def __init__(
        self,
        server: PtyServer | MemoryLine,
        faults: Faults,
        hand: list[bool],
        clock: Callable[[], float] = time.monotonic,
        open_port: OpenPort | None = None,
    ) -> None:
        """clock, open_port: for the links (None: Link's defaults)."""
        self.server, self.faults, self.hand = server, faults, hand
        self._clock, self._opens = clock, {} if open_port is None else {"open_port": open_port}
        self.records: list[dict[str, Any]] = []

    def closed_link(self, dialect: Dialect, **more: Any) -> Link:
        """A link that is not open yet. more: further arguments of Link."""
        opens: Any = self._opens
        return Link(self.server.port, dialect, self._clock, self.records.append, **opens, **more)

    @asynccontextmanager
    async def link(self, dialect: Dialect | None = None) -> AsyncIterator[Link]:
        """Context: an open link; afterwards it is closed, and no task may be left."""
        link = self.closed_link(dialect or QUICK)
        await link.open()
        try:
            yield link
        finally:
            await link.close()
            assert asyncio.all_tasks() == {asyncio.current_task()}

    def joints(self) -> Any:
        """(6,) rad, now."""
        with self.server.controller() as controller:
            return controller.arm.joints_at(controller.now_s)

    def sent(self) -> str:
        """Everything typed so far."""
        return "".join(record["bytes"] for record in self.records if record["way"] == "out")


class ScaledLoop:
    """An event loop whose clock runs a controller faster by a factor."""

    def __init__(self, loop: asyncio.AbstractEventLoop, scale: float) -> None:
        self._loop, self._scale = loop, scale
        self.call_soon = loop.call_soon

    def time(self) -> float:
        return self._loop.time() * self._scale

    def call_at(self, when_s: float, do: Callable[..., object], *arguments: Any) -> asyncio.TimerHandle:
        return self._loop.call_at(when_s / self._scale, do, *arguments)


def line_in_time(
    controller: Controller,
    faults: Faults,
    hand: list[bool],
    time_scale: float,
    loop: asyncio.AbstractEventLoop | None = None,
) -> ArmLine:
    """A line on a SimulatedLoop (None: the running one), as fast as a pseudo-terminal of that scale."""
    loop = loop or asyncio.get_running_loop()
    assert isinstance(loop, SimulatedLoop)
    scaled: Any = ScaledLoop(loop, time_scale)
    line = MemoryLine(controller, scaled)

    def opened(path: str, dialect: Dialect, *heard: Any) -> PacedPort:
        return PacedPort(line, path, replace(dialect, baud=round(dialect.baud * time_scale)), *heard)

    opens: Any = opened
    return ArmLine(line, faults, hand, loop.time, opens)


MakesLine = Callable[..., ArmLine]
"""The type of the fixtures `arm_line` and `timed_line`: makes a controller with given manners on its own line."""


async def ready(link: Link) -> Where:
    """Move to the ready pose, and wait until the arm is at rest."""
    await link.command("DO READY")
    await link.command("DO BREAK", timeout_s=60.0)
    return await link.still(60.0)
