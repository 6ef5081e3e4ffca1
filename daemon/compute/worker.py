"""The daemon's side of a worker process: start it, send it calculations, restart it where it ends or takes too long."""

from __future__ import annotations

import asyncio
import itertools
import os
import signal
import socket
import subprocess
import sys
import weakref
from collections.abc import Callable
from typing import Any

from daemon.compute.calls import ByReference, ComputeError, Result
from daemon.compute.wire import HEADER, Kind, SharedMemory, frame, pickled, unpickled

STARTED_S = 120.0
"""Time limit of a worker's start: it loads its program from a disk that may be slow."""
OF_THE_DAEMON = ("NOTIFY_SOCKET", "WATCHDOG_PID", "WATCHDOG_USEC")
"""Environment variables from systemd for the daemon only."""
MEMORY_GIVEN_BACK = {"MALLOC_ARENA_MAX": "1", "MALLOC_MMAP_THRESHOLD_": "1048576", "MALLOC_TRIM_THRESHOLD_": "16777216"}
"""One arena for all threads, and large arrays returned to the system: otherwise glibc keeps the memory of old pictures.
As tame_malloc."""


class Worker:
    """A Compute with a process of its own, which runs one calculation after the other.

    name: what it computes, for people; within_s: a calculation that takes longer is given up. A calculation that is
    given up or cancelled ends with its process. idle_s: a process that has nothing to do for so long is ended; None: it
    is kept, and where it ends the next is started at once, so that nobody waits for it.
    """

    def __init__(self, name: str, within_s: float, idle_s: float | None = None) -> None:
        self.name, self.within_s, self.idle_s = name, within_s, idle_s
        self._end_of_idleness: asyncio.TimerHandle | None = None
        self._turn = asyncio.Lock()
        self._process: _Process | None = None
        self._prepared: ByReference | None = None
        self._numbers = _Numbers()
        self._closed = False

    async def __call__(self, function: Callable[..., Result], /, *args: Any) -> Result:
        """See Compute."""
        async with self._turn:
            process = self._running()
            try:
                result: Result = await process.ask(function, args, self.within_s)
            except (asyncio.CancelledError, ComputeError, MemoryError) as error:
                self._end_process()
                if not self._closed and self.idle_s is None:
                    self._running()
                if isinstance(error, MemoryError):
                    raise _failed(self.name, "ran out of memory") from error
                raise
            finally:
                if self._process is not None and self.idle_s is not None:
                    idle_over = asyncio.get_running_loop().call_later
                    self._end_of_idleness = idle_over(self.idle_s, self._end_process)
            return result

    def prepare(self, value: ByReference) -> None:
        """Send a value that the next requests will need: to this process, and to later ones."""
        self._prepared = value
        self._running().keep(value)

    @property
    def pid(self) -> int | None:
        """Its process's id; None where none runs."""
        return None if self._process is None else self._process.popen.pid

    def close(self) -> None:
        """End the process, whatever it runs, and start no other."""
        self._closed = True
        self._end_process()

    def _running(self) -> _Process:
        if self._end_of_idleness is not None:
            self._end_of_idleness.cancel()
        if self._closed:
            raise ComputeError(f"{self.name}: not computed, the daemon is ending")
        if self._process is None:
            self._process = _Process(self.name, self._numbers)
            if self._prepared is not None:
                self._process.keep(self._prepared)
        return self._process

    def _end_process(self) -> None:
        if self._process is not None:
            self._process.end()
            self._process = None


class _Numbers:
    """Numbers of values that go by reference, for as long as they exist."""

    def __init__(self) -> None:
        self.values = weakref.WeakValueDictionary[int, ByReference]()
        self._by_value = weakref.WeakKeyDictionary[ByReference, int]()
        self._next = itertools.count(1)

    def of(self, value: ByReference) -> int:
        if value not in self._by_value:
            number = self._by_value[value] = next(self._next)
            self.values[number] = value
        return self._by_value[value]


class _Process:
    """One worker process, and the numbers of the values that it has."""

    def __init__(self, name: str, numbers: _Numbers) -> None:
        self._name, self._numbers = name, numbers
        self._shared, self._held, self._ready = SharedMemory(), set[int](), False
        self._unsent = bytearray()
        self._writer: asyncio.StreamWriter | None = None
        self._ours, theirs = socket.socketpair()
        passed = theirs.fileno(), self._shared.descriptor
        environment = {key: value for key, value in os.environ.items() if key not in OF_THE_DAEMON}
        self.popen = subprocess.Popen(
            [sys.executable, "-P", "-m", "daemon.compute.process", str(os.getpid()), *map(str, passed)],
            pass_fds=passed,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            env=environment | MEMORY_GIVEN_BACK,
            start_new_session=True,  # a terminal's control-C is for the daemon
        )
        theirs.close()
        self._opening = asyncio.create_task(self._open(), name=f"open the worker: {name}")

    async def _open(self) -> asyncio.StreamReader:
        reader, self._writer = await asyncio.open_connection(sock=self._ours)
        self._write(bytes(self._unsent))
        return reader

    def _write(self, content: bytes) -> None:
        if self._writer is None:
            self._unsent += content
        else:
            self._writer.write(content)

    def keep(self, value: ByReference) -> int:
        """Send a value, once; returns its number."""
        number = self._numbers.of(value)
        if number not in self._held:
            content = pickled(value, lambda part: None if part is value else self.keep(part), self._shared)
            self._write(frame(Kind.KEEP, number, content))
            self._held.add(number)
        return number

    async def ask(self, function: Callable[..., object], args: tuple[Any, ...], within_s: float) -> Any:
        """Return or raise what the function does. Raises ComputeError, after which the process must be ended."""
        self._shared.clear()
        for number in self._held - set(self._numbers.values):
            self._held.remove(number)
            self._write(frame(Kind.DROP, number))
        self._write(frame(Kind.CALL, content=pickled((function, args), self.keep, self._shared)))
        try:
            reader = await self._opening
            if not self._ready:
                async with asyncio.timeout(STARTED_S):
                    await self._frame(reader)
                self._ready = True
            async with asyncio.timeout(within_s):
                kind, content = await self._frame(reader)
        except TimeoutError:
            what = f"took longer than {within_s:g} s" if self._ready else "did not start"
            raise _failed(self._name, what) from None
        except (EOFError, ConnectionError):
            raise _failed(self._name, await asyncio.to_thread(self._how_it_ended)) from None
        answer = unpickled(content, self._numbers.values.__getitem__)
        if kind == Kind.ERROR:
            raise answer
        return answer

    async def _frame(self, reader: asyncio.StreamReader) -> tuple[Kind, bytes]:
        kind, _, length = HEADER.unpack(await reader.readexactly(HEADER.size))
        return Kind(kind), await reader.readexactly(length)

    def _how_it_ended(self) -> str:
        try:
            status = self.popen.wait(1.0)
        except subprocess.TimeoutExpired:
            return "closed its line"
        return f"was ended by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"

    def end(self) -> None:
        """Kill it now."""
        self.popen.kill()
        self._opening.cancel()
        if self._writer is None:
            self._ours.close()
        else:
            self._writer.close()
        self._shared.close()
        asyncio.get_running_loop().run_in_executor(None, self.popen.wait)


def _failed(name: str, what: str) -> ComputeError:
    return ComputeError(f"{name}: the process that computes it {what}. It is started again: try once more")
