"""An event loop on simulated time: while nobody has anything to do, the clock jumps to the next timer.

A program that takes its clock from the loop lives through an hour in as long as its own work takes. Nothing waits for
another thread: what is given to an executor is done at once, in its turn.
"""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any


class SimulatedLoop(asyncio.SelectorEventLoop):
    """See the module. For `asyncio.Runner(loop_factory=SimulatedLoop)`."""

    def __init__(self) -> None:
        self._now_s = 0.0
        super().__init__(_Jumping(self.sleep))
        # What is due within that is due now. Of asyncio's nanosecond nothing is left after 2^24 s, 194 days: a timer
        # that is due to the bit would then be waited for, for no time, for ever.
        self._clock_resolution = 1e-6

    def time(self) -> float:
        """Simulated seconds."""
        return self._now_s

    def sleep(self, seconds: float) -> None:
        """Let time pass for somebody who does not await: whatever falls due meanwhile comes afterwards."""
        self._now_s += seconds

    def run_in_executor(  # type: ignore[override]
        self, executor: Executor | None, func: Callable[..., Any], *args: Any
    ) -> asyncio.Future[Any]:
        """Done at once, on this thread."""
        done = self.create_future()
        try:
            done.set_result(func(*args))
        except Exception as error:
            done.set_exception(error)
        return done


class _Jumping(selectors.DefaultSelector):
    """Waits for nothing: it lets the time pass that it was to wait."""

    def __init__(self, sleep: Callable[[float], None]) -> None:
        super().__init__()
        self._sleep = sleep

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """What is there to be read. Raises RuntimeError where there is nothing left that could ever come."""
        alone = len(self.get_map()) <= 1
        if timeout is None and alone:
            raise RuntimeError("everybody waits, and no timer runs")
        found = super().select(0 if timeout is not None else None)
        if not found and timeout is not None:
            self._sleep(timeout)
        return found
