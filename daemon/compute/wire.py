"""What passes between the daemon and its worker process: frames on a socket, large arrays in shared memory.

A frame is a kind, a number and a pickled value. The worker is the daemon's own child, and both ends are one version of
one program; nothing of a frame is ever written to a disk.
"""

import io
import mmap
import os
import pickle
import struct
from collections.abc import Callable
from enum import IntEnum
from typing import Any

from daemon.compute.calls import ByReference

HEADER = struct.Struct("!BIQ")
"""Kind, number, and how many bytes of pickled value follow."""
SHARED_BYTES = 64 << 20
"""Of shared memory; only what was written to is ever taken. Two pairs of 5 megapixels are 20 MB; what does not fit goes
through the socket."""
LARGE_BYTES = 1 << 16
"""An array of at least so many goes through shared memory."""


class Kind(IntEnum):
    """Of a frame."""

    READY = 0
    """From the worker: it has started."""
    DROP = 1
    """The daemon has no use any more for the value of that number."""
    KEEP = 2
    """The value of that number."""
    CALL = 3
    """A function and its arguments. One of the next two answers it."""
    RESULT = 4
    ERROR = 5


class SharedMemory:
    """Memory of both processes, for arrays on their way from the daemon to its worker."""

    def __init__(self, descriptor: int | None = None) -> None:
        """descriptor: of one that the other process made."""
        self.descriptor = os.memfd_create("facetd-pictures") if descriptor is None else descriptor
        if descriptor is None:
            os.ftruncate(self.descriptor, SHARED_BYTES)
        self._bytes = mmap.mmap(self.descriptor, SHARED_BYTES)
        self._used = 0

    def clear(self) -> None:
        """All that was put is taken."""
        self._used = 0

    def put(self, raw: memoryview) -> tuple[int, int] | None:
        """Where it lies: offset and length; None where there is no room for it."""
        start, end = self._used, self._used + raw.nbytes
        if end > SHARED_BYTES:
            return None
        self._bytes[start:end] = raw
        self._used = end
        return start, raw.nbytes

    def take(self, place: tuple[int, int]) -> bytearray:
        """A copy of what lies there."""
        start, length = place
        return bytearray(memoryview(self._bytes)[start : start + length])

    def close(self) -> None:
        """Let go of it; the worker may still have it."""
        self._bytes.close()
        os.close(self.descriptor)


def pickled(value: object, number_of: Callable[[ByReference], int | None], shared: SharedMemory | None = None) -> bytes:
    """A frame's content. number_of: of what passes by number, None where its value is wanted; shared: for large arrays.
    Raises what cannot be pickled raises."""
    places = list[tuple[int, int]]()

    def in_band(buffer: pickle.PickleBuffer) -> bool:
        raw = buffer.raw()
        place = None if shared is None or raw.nbytes < LARGE_BYTES else shared.put(raw)
        if place is not None:
            places.append(place)
        return place is None

    class Pickler(pickle.Pickler):
        def persistent_id(self, part: object) -> int | None:
            return number_of(part) if isinstance(part, ByReference) else None

    content = io.BytesIO()
    Pickler(content, protocol=5, buffer_callback=in_band).dump(value)
    return pickle.dumps((places, content.getvalue()), protocol=5)


def unpickled(content: bytes, value_of: Callable[[int], object], shared: SharedMemory | None = None) -> Any:
    """What `pickled` was given. value_of: of a number."""

    class Unpickler(pickle.Unpickler):
        def persistent_load(self, number: int) -> object:
            return value_of(number)

    places, pickle_bytes = pickle.loads(content)
    buffers = [] if shared is None else [shared.take(place) for place in places]
    return Unpickler(io.BytesIO(pickle_bytes), buffers=buffers).load()


def frame(kind: Kind, number: int = 0, content: bytes = b"") -> bytes:
    """One frame, whole."""
    return HEADER.pack(kind, number, len(content)) + content
