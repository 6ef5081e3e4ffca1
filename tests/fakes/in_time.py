"""Work done on a loop whose clock goes on by itself while everything waits: hours take the time of what is done."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

from drivers.simcell.simulated_time import SimulatedLoop

T = TypeVar("T")


def lived(work: Coroutine[Any, Any, T]) -> T:
    """What the work gives."""
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        return runner.run(work)
