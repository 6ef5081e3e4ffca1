"""Arrays in one .npz, the same bytes for the same arrays, and never a pickle.

In: arrays by name. Out: bytes, and back. What the arrays mean is said by whoever packs them.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]
UNREADABLE = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    EOFError,
    KeyError,
    MemoryError,
    NotImplementedError,
    OSError,
    OverflowError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,
)
EPOCH = (1980, 1, 1, 0, 0, 0)  # every member's time stamp: the same model is the same bytes


class ArchiveError(ValueError):
    """The bytes are not such an archive, or not a whole one: one line."""


def pack(arrays: Arrays) -> bytes:
    """The arrays as numpy.savez_compressed writes them, but with fixed time stamps and in order of name."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(arrays):
            member = io.BytesIO()
            np.lib.format.write_array(member, np.ascontiguousarray(arrays[name]), allow_pickle=False)
            info = zipfile.ZipInfo(f"{name}.npy", EPOCH)
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, member.getvalue())
    return out.getvalue()


def unpack(content: bytes) -> Arrays:
    """The arrays in an archive. Raises ArchiveError; object arrays (pickles) are refused unopened."""
    if not zipfile.is_zipfile(io.BytesIO(content)):  # numpy would suggest to unpickle it
        raise ArchiveError("not an archive of arrays, or cut short")
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as archive:
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise ArchiveError("a single array, not an archive")
            return {name: archive[name] for name in archive.files}
    except ArchiveError:
        raise
    except UNREADABLE as error:
        raise ArchiveError(f"not an archive of arrays, or cut short or damaged: {one_line(error)}") from None


def one_line(error: Exception) -> str:
    """An exception's text without line breaks, cut to 200 characters."""
    return " ".join(str(error).split())[:200] or type(error).__name__
