"""The arm of a cell that has none (recorded pairs): everything about it is refused in one clear line.

Honours daemon/arm/workcell.py's Robot, and what the console asks of an arm besides.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager

import numpy as np
from numpy.typing import NDArray

from daemon.arm.workcell import Reading

Array = NDArray[np.float64]


class CellError(Exception):
    """The cell cannot be had as configured: what, where, what to do."""


class NoArm:
    """A cell without an arm (recorded pairs): it is looked from where the world's origin is, and nothing moves."""

    heard_s: float | None = None
    question: str | None = None
    aside = stopped_on_opening = False

    async def open(self) -> None:
        """Nothing to open."""

    async def close(self) -> None:
        """Nothing to close."""

    async def check(self) -> None:
        """There is nothing to check."""

    async def where(self) -> Reading:
        """The origin."""
        return Reading(np.eye(4), np.zeros(6))

    async def move(self, world_from_tool: Array, *, straight: bool, speed_pct: float, timeout_s: float) -> Reading:
        """Refused."""
        raise CellError("this cell is recorded: there is no arm to move")

    async def hand(self, closed: bool) -> None:
        """Refused."""
        raise CellError("this cell is recorded: there is no gripper")

    async def abort(self) -> None:
        """Nothing moves."""

    def reachable(self, world_from_tool: Array, joints_rad: Array) -> Array | None:
        """Nowhere."""
        return None

    def between(self, joints_rad: Array, to_rad: Array, share: float) -> Array:
        """Where it stands."""
        return np.eye(4)

    def frames(self, joints_rad: Array) -> Array:
        """No links: all of it is where it stands."""
        return np.tile(np.eye(4), (len(joints_rad), 8, 1, 1))

    def along(self, world_from_tool: Array, joints_rad: Array) -> Array:
        """No way."""
        return np.full((len(world_from_tool), 6), np.nan)

    async def power_up(self, replies: Sequence[str]) -> list[str]:
        """Refused."""
        raise CellError("this cell is recorded: there is no controller")

    async def calibrate(self, reply: str) -> list[str]:
        """Refused."""
        raise CellError("this cell is recorded: there is no controller")

    async def monitor(self, text: str) -> list[str]:
        """Refused."""
        raise CellError("this cell is recorded: there is no controller")

    def terminal(self, show: Callable[[bytes], None]) -> AbstractAsyncContextManager[Callable[[bytes], None]]:
        """Refused."""
        raise CellError("this cell is recorded: there is no controller")
