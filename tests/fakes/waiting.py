"""Waiting for a condition, never for a time: seconds only say when a test gives up."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import TypeVar

PATIENCE_S = 240.0
"""With four busy processes everything takes several times as long; a condition that never comes costs this once."""
POLL_S, LOOP_POLL_S = 0.05, 0.01
Found = TypeVar("Found")


def until(holds: Callable[[], Found], what: str = "the condition", seconds: float = PATIENCE_S) -> Found:
    """Wait in a thread; returns what at last was true."""
    deadline_s = time.monotonic() + seconds
    while not (found := holds()):
        assert time.monotonic() < deadline_s, f"{what} did not come in {seconds:g} s"
        time.sleep(POLL_S)
    return found


async def until_so(holds: Callable[[], Found], what: str = "the condition") -> Found:
    """Wait in an event loop, real or simulated: in simulated time a poll costs nothing."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not (found := holds()):
        assert time.monotonic() < deadline_s, f"{what} did not come in {PATIENCE_S:g} s"
        await asyncio.sleep(LOOP_POLL_S)
    return found
