"""An asyncio event loop on simulated time: while nothing is ready, the clock jumps to the next timer.

A program that uses the loop's clock runs through an hour in the time of its own work. Nothing waits for another thread:
jobs of an executor run at once, in turn.
"""

import asyncio
import selectors
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

from drivers.simcell.controller import Controller
from tests.fakes.memory_line import MemoryLine


class SimulatedLoop(asyncio.SelectorEventLoop):
    """For `asyncio.Runner(loop_factory=SimulatedLoop)`."""

    def __init__(self) -> None:
        self._now_s = 0.0
        super().__init__(_Jumping(self.sleep))
        # Timers due within this run now. After 2^24 s, 194 days, a float does not resolve asyncio's nanosecond, and the
        # loop would wait for zero time for ever.
        self._clock_resolution = 1e-6

    def time(self) -> float:
        return self._now_s

    def sleep(self, seconds: float) -> None:
        """Advance the clock for code that does not await; timers due meanwhile run afterwards."""
        self._now_s += seconds

    def serve(self, controller: Controller) -> MemoryLine:
        """A line to a controller that keeps this time."""
        return MemoryLine(controller, self)

    def run_in_executor(  # type: ignore[override]
        self, executor: Executor | None, func: Callable[..., Any], *args: Any
    ) -> asyncio.Future[Any]:
        """Run at once, on this thread."""
        done = self.create_future()
        try:
            done.set_result(func(*args))
        except Exception as error:
            done.set_exception(error)
        return done


class _Jumping(selectors.DefaultSelector):
    """A selector that advances the clock instead of waiting."""

    def __init__(self, sleep: Callable[[float], None]) -> None:
        super().__init__()
        self._sleep = sleep

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Ready files. Raises RuntimeError for a deadlock: no timer, and no file to wait for."""
        alone = len(self.get_map()) <= 1
        if timeout is None and alone:
            raise RuntimeError("deadlock: everybody waits, and no timer runs")
        found = super().select(0 if timeout is not None else None)
        if not found and timeout is not None:
            self._sleep(timeout)
        return found
