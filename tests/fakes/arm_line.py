"""A simulated controller on a pseudo-terminal in scaled time, links to it with a ledger, and its true state."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

from drivers.simcell.controller import Faults, PtyServer
from drivers.val2.link import Dialect, Link

QUICK = Dialect(resync_s=0.4, typing_s=0.4, answer_s=1.0, stall_s=0.3)


class ArmLine:
    """The controller's end of the line, the ledger of a link to it, and the commands to the gripper."""

    def __init__(self, server: PtyServer, faults: Faults, hand: list[bool]) -> None:
        self.server, self.faults, self.hand = server, faults, hand
        self.records: list[dict[str, Any]] = []

    @asynccontextmanager
    async def link(self, dialect: Dialect | None = None) -> AsyncIterator[Link]:
        """An open link; closed afterwards, and no task left behind."""
        link = Link(self.server.port, dialect or QUICK, on_wire=self.records.append)
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


MakesLine = Callable[..., ArmLine]
"""What the fixture `arm_line` gives: a controller as its manners say, on a line of its own."""
