"""Run a coroutine on simulated time, which jumps while everything waits."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

from tests.fakes.simulated_time import SimulatedLoop

T = TypeVar("T")


def lived(work: Coroutine[Any, Any, T]) -> T:
    """The result of the work."""
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        return runner.run(work)
