"""A controller's line in memory that carries no more characters a second than its baud rate, on the loop's clock."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from drivers.val2.dialect import Dialect
from drivers.val2.errors import PortError
from tests.fakes.memory_line import MemoryLine, MemoryPort

CHARACTER_BITS = 10


class PacedPort:
    """An open end of a memory line (Link's open_port), both ways one character after the other."""

    def __init__(
        self,
        line: MemoryLine,
        path: str,
        dialect: Dialect,
        on_bytes: Callable[[bytes], None],
        on_lost: Callable[[PortError], None],
    ) -> None:
        self._loop, self._character_s = asyncio.get_event_loop(), CHARACTER_BITS / dialect.baud
        self._on_bytes, self._free_s = on_bytes, {"in": 0.0, "out": 0.0}
        self._waiting: list[asyncio.TimerHandle] = []
        self._port: MemoryPort = line.open(path, dialect, self._heard, on_lost)

    def write(self, data: bytes) -> None:
        """See Port."""
        self._waiting = [timer for timer in self._waiting if timer.when() > self._loop.time()]
        self._waiting += self._one_by_one("out", data, self._port.write)

    def overtake(self) -> None:
        """What waits to go out never does."""
        for timer in self._waiting:
            timer.cancel()
        self._waiting, self._free_s["out"] = [], self._loop.time()

    def close(self) -> None:
        """See Port."""
        self.overtake()
        self._port.close()

    def _heard(self, data: bytes) -> None:
        self._one_by_one("in", data, self._on_bytes)

    def _one_by_one(self, way: str, data: bytes, carry: Callable[[bytes], None]) -> list[asyncio.TimerHandle]:
        timers = []
        for k in range(len(data)):
            self._free_s[way] = max(self._free_s[way], self._loop.time()) + self._character_s
            timers.append(self._loop.call_at(self._free_s[way], carry, data[k : k + 1]))
        return timers


def paced(line: MemoryLine) -> Callable[..., PacedPort]:
    """What opens such a port to the line, in place of the line's own `open`."""
    return lambda path, dialect, on_bytes, on_lost: PacedPort(line, path, dialect, on_bytes, on_lost)
