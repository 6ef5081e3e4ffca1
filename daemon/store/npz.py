"""Pack arrays into the bytes of an .npz, the same bytes for the same arrays, and unpack them; never a pickle."""

import io
import math
import struct
import zipfile
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]
UNREADABLE = (
    zipfile.BadZipFile, zlib.error, struct.error, EOFError, KeyError, MemoryError, OSError, OverflowError, RuntimeError,
    SyntaxError, TypeError, ValueError,
)  # fmt: skip
"""Exceptions that zipfile and numpy raise for damaged archives."""
EPOCH = (1980, 1, 1, 0, 0, 0)  # time stamp of every member, so that equal models give equal bytes


class ArchiveError(ValueError):
    """The bytes are not an archive of arrays, or not a complete one: one line."""


def pack(arrays: Arrays) -> bytes:
    """Encode arrays as numpy.savez_compressed does, but with fixed time stamps and in order of name."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(arrays):
            member = io.BytesIO()
            np.lib.format.write_array(member, np.ascontiguousarray(arrays[name]), allow_pickle=False)
            info = zipfile.ZipInfo(f"{name}.npy", EPOCH)
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, member.getvalue())
    return out.getvalue()


def unpack(content: bytes, most_bytes: int) -> Arrays:
    """Decode an archive of at most most_bytes of arrays, never a pickle. Raises ArchiveError."""
    if not zipfile.is_zipfile(io.BytesIO(content)):
        raise ArchiveError("not an archive of arrays, or cut short")
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if sum(member.file_size for member in archive.infolist()) > most_bytes:
                raise ArchiveError(f"expands to more than {most_bytes / 1e6:.3g} MB")
            return {member.filename.removesuffix(".npy"): _array(archive, member) for member in archive.infolist()}
    except ArchiveError:
        raise
    except UNREADABLE as error:
        raise ArchiveError(f"not an archive of arrays, or cut short or damaged: {one_line(error)}") from None


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    """Decode one member; one that is not of its declared size raises ArchiveError."""
    with archive.open(member) as file:
        content = file.read(member.file_size + 1)
    if len(content) != member.file_size:
        raise ArchiveError("a member does not have its declared size")
    stream = io.BytesIO(content)
    version = np.lib.format.read_magic(stream)
    header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, kind = header(stream)
    if kind.hasobject or math.prod(shape) * kind.itemsize != len(content) - stream.tell():
        raise ArchiveError("an array of objects, or not of its declared size")
    stream.seek(0)
    return np.lib.format.read_array(stream, allow_pickle=False)


def one_line(error: Exception) -> str:
    """An exception's text without line breaks, cut to 200 characters."""
    return " ".join(str(error).split())[:200] or type(error).__name__
