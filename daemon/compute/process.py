"""The worker process: `python -m daemon.compute.process DAEMON SOCKET MEMORY`, the daemon's pid and two inherited
descriptors.

It runs one request after the other. It ends when the daemon ends, however that happens, and leaves processor and memory
to it: lower priority, and killed first where memory is short.
"""

import contextlib
import ctypes
import faulthandler
import os
import pickle
import resource
import signal
import socket
import sys
import traceback
from dataclasses import dataclass
from pathlib import Path

from daemon.compute.calls import ByReference
from daemon.compute.wire import HEADER, Kind, SharedMemory, frame, pickled, unpickled
from daemon.errors import FacetdError

NICE = 5
"""Priority below the daemon's."""
FIRST_TO_GO = 500
"""Added to the daemon's oom_score_adj: the kernel kills the worker before the process that stops the arm."""
MOST_MB = 512
"""Limit of its own memory (RLIMIT_DATA): a calculation that needs more fails, and the daemon keeps its memory."""
PR_SET_PDEATHSIG = 1


class WorkerError(FacetdError):
    """Type and text of a calculation's error that cannot be pickled."""


@dataclass(frozen=True)
class Unusable:
    """In place of a value that could not be unpickled: each request that uses it fails with this error."""

    error: BaseException


def serve(connection: socket.socket, shared: SharedMemory) -> None:
    """Answer requests until the daemon closes the connection."""
    kept = dict[int, object]()
    numbers = dict[int, int]()

    def value_of(number: int) -> object:
        value = kept[number]
        if isinstance(value, Unusable):
            raise value.error
        return value

    def number_of(value: ByReference) -> int | None:
        return numbers.get(id(value))

    connection.sendall(frame(Kind.READY))
    with connection.makefile("rb") as stream:
        while header := stream.read(HEADER.size):
            kind, number, length = HEADER.unpack(header)
            content = stream.read(length)
            if kind == Kind.DROP:
                numbers.pop(id(kept.pop(number)), None)
            elif kind == Kind.KEEP:
                try:
                    kept[number] = unpickled(content, value_of, shared)
                except Exception as error:
                    kept[number] = Unusable(error)
                numbers[id(kept[number])] = number
            else:
                connection.sendall(_answer(content, value_of, number_of, shared))


def _answer(content: bytes, value_of, number_of, shared: SharedMemory) -> bytes:  # type: ignore[no-untyped-def]
    try:
        function, arguments = unpickled(content, value_of, shared)
        return frame(Kind.RESULT, content=pickled(function(*arguments), number_of))
    except Exception as error:
        if not isinstance(error, FacetdError):
            error.add_note("".join(traceback.format_exception(error)))
        return frame(Kind.ERROR, content=pickled(_portable(error), number_of))


def _portable(error: Exception) -> Exception:
    """The error, or its text where it cannot be pickled."""
    with contextlib.suppress(Exception):
        if str(pickle.loads(pickle.dumps(error))) == str(error):
            return error
    return WorkerError(f"{type(error).__name__}: {error}")


def give_way(daemon: int) -> None:
    """Lower the priority, limit the memory, ignore the daemon's signals, and end when the daemon ends."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):  # these are for the daemon
        signal.signal(number, signal.SIG_IGN)
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != daemon:
        os._exit(0)
    with contextlib.suppress(OSError):  # a sandbox may forbid it: then it has the daemon's priority
        os.nice(NICE)
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_DATA, (MOST_MB << 20, MOST_MB << 20))
    score = Path("/proc/self/oom_score_adj")
    with contextlib.suppress(OSError):
        score.write_text(str(min(int(score.read_text()) + FIRST_TO_GO, 1000)), encoding="ascii")


def main() -> None:
    """See the module."""
    faulthandler.enable()
    daemon, descriptor, memory = (int(word) for word in sys.argv[1:4])
    give_way(daemon)
    connection = socket.socket(fileno=descriptor)
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):
        serve(connection, SharedMemory(memory))
    os._exit(0)


if __name__ == "__main__":
    main()
