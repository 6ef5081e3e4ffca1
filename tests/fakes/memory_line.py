"""Connect the simulated controller in the same process, on the event loop's clock, without pty or thread."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterator

from drivers.simcell.controller.core import Controller
from drivers.val2.dialect import Dialect
from drivers.val2.errors import PortError


class MemoryLine:
    """Serves one controller like PtyServer; `open` (Link's open_port) opens a port to it."""

    port = "memory"

    def __init__(self, controller: Controller, loop: asyncio.AbstractEventLoop) -> None:
        """loop: its clock is the controller's."""
        self._controller, self._loop = controller, loop
        self._open: MemoryPort | None = None
        self._timer: asyncio.TimerHandle | None = None
        self.unplugged = False

    def now_s(self) -> float:
        return self._loop.time()

    @contextlib.contextmanager
    def controller(self) -> Iterator[Controller]:
        """Context: the controller at the present moment, to read or change it."""
        self._controller.tick(self.now_s())
        yield self._controller
        self.turn()

    def open(
        self, path: str, dialect: Dialect, on_bytes: Callable[[bytes], None], on_lost: Callable[[PortError], None]
    ) -> MemoryPort:
        """A port to the controller; one at a time. Raises PortError."""
        if self.unplugged or self._open is not None:
            raise PortError(f"{path}: {'no such port' if self.unplugged else 'in use by another program'}")
        self._open = MemoryPort(self, on_bytes, on_lost)
        self.turn()
        return self._open

    def unplug(self) -> None:
        """Unplug the adapter; `unplugged = False` plugs it in again."""
        self.unplugged = True
        if self._open is not None:
            lost, self._open = self._open, None
            lost.on_lost(PortError(f"{self.port}: the port is gone"))

    def forget(self, port: MemoryPort) -> None:
        if self._open is port:
            self._open = None

    def typed(self, port: MemoryPort, data: bytes) -> None:
        """Pass bytes of a port to the controller. Raises PortError where the port is not open."""
        if self._open is not port:
            raise PortError(f"{self.port}: the port is closed")
        self._controller.receive(data, self.now_s())
        self.turn()

    def turn(self, moment_s: float = 0.0) -> None:
        """Advance the controller's time, pass on its output, and schedule the next event."""
        now_s = max(moment_s, self.now_s())
        self._controller.tick(now_s)
        printed = self._controller.output(now_s)
        if printed and self._open is not None:
            self._loop.call_soon(self._open.hear, printed)
        if self._timer is not None:
            self._timer.cancel()
        next_s = self._controller.next_moment_s()
        self._timer = None if next_s is None else self._loop.call_at(next_s, self.turn, next_s)

    def stop(self) -> None:
        """No more timers; safe to call twice."""
        if self._timer is not None:
            self._timer.cancel()
        self._open = None


class MemoryPort:
    """An open end of the line."""

    def __init__(
        self, line: MemoryLine, on_bytes: Callable[[bytes], None], on_lost: Callable[[PortError], None]
    ) -> None:
        self._line, self._on_bytes, self.on_lost = line, on_bytes, on_lost
        self._closed = False

    def write(self, data: bytes) -> None:
        """Send all of data. Raises PortError."""
        self._line.typed(self, data)

    def overtake(self) -> None:
        """Do nothing: no bytes wait here."""

    def close(self) -> None:
        """Close; safe to call twice."""
        self._closed = True
        self._line.forget(self)

    def hear(self, data: bytes) -> None:
        """Receive the controller's output."""
        if not self._closed:
            self._on_bytes(data)
