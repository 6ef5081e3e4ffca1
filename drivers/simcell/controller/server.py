"""Serve the simulated controller on a pseudo-terminal, at the line's baud rate, in scaled time, in a thread."""

from __future__ import annotations

import contextlib
import os
import select
import termios
import threading
import time
import tty
from collections.abc import Iterator
from types import TracebackType

from drivers.simcell.controller.core import Controller

BITS_PER_BYTE = 10
IDLE_S = 0.25
TICK_S = 0.001


class PtyServer:
    """Serves one controller until stopped. port: the path that a client opens.

    The slave side stays open, so that the line keeps its raw mode between clients.
    """

    def __init__(
        self, controller: Controller, baud: int = 9600, time_scale: float = 1.0, at_any_speed: bool = True
    ) -> None:
        """time_scale: controller seconds a real second, also for the line's pace.

        at_any_speed: whether a client may use another baud rate; else every byte is then garbled, as on a real line.
        """
        self._controller = controller
        self._speed = None if at_any_speed else getattr(termios, f"B{baud}")
        self._lock = threading.RLock()
        self._bytes_per_s = baud / BITS_PER_BYTE * time_scale
        self._time_scale, self._began_s = time_scale, time.monotonic()
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self._wake_read, self._wake_write = os.pipe()
        self._stopping = False
        self._incoming, self._outgoing = _Pace(self._bytes_per_s), _Pace(self._bytes_per_s)
        self._thread = threading.Thread(target=self._serve, name="val2-controller", daemon=True)
        self._thread.start()

    def now_s(self) -> float:
        return (time.monotonic() - self._began_s) * self._time_scale

    @contextlib.contextmanager
    def controller(self) -> Iterator[Controller]:
        with self._lock:
            self._controller.tick(self.now_s())
            yield self._controller
        if not self._stopping:
            os.write(self._wake_write, b"!")

    def stop(self) -> None:
        """End the thread and close the terminal; safe to call twice."""
        if self._stopping:
            return
        self._stopping = True
        os.write(self._wake_write, b"!")
        self._thread.join()
        for descriptor in (self._master, self._slave, self._wake_read, self._wake_write):
            os.close(descriptor)

    def __enter__(self) -> PtyServer:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.stop()

    def _serve(self) -> None:
        while not self._stopping:
            ready, _, _ = select.select([self._master, self._wake_read], [], [], self._pause_s())
            if self._wake_read in ready:
                os.read(self._wake_read, 4096)
            if self._master in ready:
                with contextlib.suppress(BlockingIOError):
                    self._incoming.put(self._carried(os.read(self._master, 4096)), time.monotonic())
            self._update()

    def _carried(self, data: bytes) -> bytes:
        """The bytes that arrive, garbled where the baud rates differ."""
        if self._speed in (None, termios.tcgetattr(self._slave)[4]):
            return data
        return bytes(byte ^ 0xA5 for byte in data)

    def _update(self) -> None:
        """Pass due bytes on, both ways."""
        real_s = time.monotonic()
        with self._lock:
            now_s = self.now_s()
            for byte in self._incoming.due(real_s):
                self._controller.receive(bytes([byte]), now_s)
            self._controller.tick(now_s)
            self._outgoing.put(self._controller.output(now_s), real_s)
        due = self._outgoing.due(real_s)
        if due:
            # A client that does not read loses bytes, as on a line without flow control.
            with contextlib.suppress(BlockingIOError):
                os.write(self._master, self._carried(due))

    def _pause_s(self) -> float:
        if self._incoming or self._outgoing:
            return TICK_S
        with self._lock:
            moment_s = self._controller.next_moment_s()
        if moment_s is None:
            return IDLE_S
        return min(IDLE_S, max(0.0, (moment_s - self.now_s()) / self._time_scale))


class _Pace:
    """A queue of bytes with a limited rate."""

    def __init__(self, bytes_per_s: float) -> None:
        self._bytes_per_s = bytes_per_s
        self._waiting = bytearray()
        self._since_s = 0.0

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def put(self, data: bytes, now_s: float) -> None:
        """Add bytes at a moment."""
        if not self._waiting:
            self._since_s = max(self._since_s, now_s)
        self._waiting += data

    def due(self, now_s: float) -> bytes:
        """Take the bytes that have arrived by now."""
        count = min(len(self._waiting), int((now_s - self._since_s) * self._bytes_per_s))
        due = bytes(self._waiting[:count])
        del self._waiting[:count]
        self._since_s += count / self._bytes_per_s
        return due
