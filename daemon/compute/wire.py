"""Frames between the daemon and its worker process on a socket; large arrays go through shared memory.

A frame is a kind, a number and a pickled value. The worker is the daemon's own child with the same version of the
program; no frame is ever written to a disk.
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
"""Kind, number, and length of the pickled value in bytes."""
SHARED_BYTES = 64 << 20
"""Size of the shared memory; only pages that were written use memory. Two pairs of 5 megapixels have 20 MB; what does
not fit goes through the socket."""
LARGE_BYTES = 1 << 16
"""Size from which an array goes through shared memory."""


class Kind(IntEnum):
    """Kind of a frame."""

    READY = 0
    """From the worker: it has started."""
    DROP = 1
    """The daemon no longer needs the value of this number."""
    KEEP = 2
    """Keep this value under this number."""
    CALL = 3
    """A function and its arguments; RESULT or ERROR answers it."""
    RESULT = 4
    ERROR = 5


class SharedMemory:
    """Memory shared by both processes, for arrays on their way to the worker."""

    def __init__(self, descriptor: int | None = None) -> None:
        """descriptor: of memory that the other process made; None: make it."""
        self.descriptor = os.memfd_create("facetd-pictures") if descriptor is None else descriptor
        if descriptor is None:
            os.ftruncate(self.descriptor, SHARED_BYTES)
        self._bytes = mmap.mmap(self.descriptor, SHARED_BYTES)
        self._used = 0

    def clear(self) -> None:
        """Free it all: everything was taken."""
        self._used = 0

    def put(self, raw: memoryview) -> tuple[int, int] | None:
        """Write bytes; returns offset and length, or None where there is no room."""
        start, end = self._used, self._used + raw.nbytes
        if end > SHARED_BYTES:
            return None
        self._bytes[start:end] = raw
        self._used = end
        return start, raw.nbytes

    def take(self, place: tuple[int, int]) -> bytearray:
        """Copy the bytes at this offset and length."""
        start, length = place
        return bytearray(memoryview(self._bytes)[start : start + length])

    def close(self) -> None:
        """Close it here; the worker may still use it."""
        self._bytes.close()
        os.close(self.descriptor)


def pickled(value: object, number_of: Callable[[ByReference], int | None], shared: SharedMemory | None = None) -> bytes:
    """Encode a frame's content. number_of: the number of a value that goes by reference, None to encode the value
    itself; shared: for large arrays. Raises the errors of pickle."""
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
    """Decode a frame's content. value_of: the value of a number."""

    class Unpickler(pickle.Unpickler):
        def persistent_load(self, number: int) -> object:
            return value_of(number)

    places, pickle_bytes = pickle.loads(content)
    buffers = [] if shared is None else [shared.take(place) for place in places]
    return Unpickler(io.BytesIO(pickle_bytes), buffers=buffers).load()


def frame(kind: Kind, number: int = 0, content: bytes = b"") -> bytes:
    """Encode one frame."""
    return HEADER.pack(kind, number, len(content)) + content
