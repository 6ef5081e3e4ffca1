"""Read files safely: regular files only, inside their folder, up to a limit in bytes; else FileError."""

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import BinaryIO

import msgspec

from daemon.errors import FacetdError

READ_ONLY = os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
"""Opening never waits for the writer of a FIFO, and no terminal becomes the daemon's controlling terminal."""
JSON_ERRORS = (msgspec.MsgspecError, RecursionError, UnicodeDecodeError)
"""Exceptions that decoding JSON may raise, whatever the bytes."""
PIECE = 1 << 20


class FileError(FacetdError):
    """A file cannot be used: which file, what is wrong."""


def read_file(path: Path, most_bytes: int) -> bytes:
    """Read a file that a person named. Raises FileError."""
    with open_file(path) as file:
        return _all_of(file, path, most_bytes)


def read_below(folder: Path, name: object, most_bytes: int) -> bytes:
    """Read a file that another file names; it must be inside `folder`. Raises FileError."""
    with open_below(folder, name) as file:
        return _all_of(file, folder / str(name), most_bytes)


@contextlib.contextmanager
def open_file(path: Path) -> Iterator[BinaryIO]:
    """Open a regular file, or a link to one, for reading. Raises FileError."""
    with _as_file_error(path):
        _check_regular(os.stat(path), path)
        handle = os.open(path, READ_ONLY)
    with os.fdopen(handle, "rb") as file:
        _check_regular(os.fstat(handle), path)
        yield file


@contextlib.contextmanager
def open_below(folder: Path, name: object) -> Iterator[BinaryIO]:
    """Open a regular file by its name relative to a folder, following no link. Raises FileError."""
    path = folder / str(name)
    parts = PurePosixPath(name).parts if isinstance(name, str) else ()
    if not parts or parts[0] == "/" or ".." in parts or "\0" in str(name):
        raise FileError(f"{folder}: {name!r}: expected the name of a file in this folder")
    with _as_file_error(path):
        here = os.open(folder, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            for part in parts[:-1]:
                below = os.open(part, os.O_PATH | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC, dir_fd=here)
                os.close(here)
                here = below
            _check_regular(os.stat(parts[-1], dir_fd=here, follow_symlinks=False), path)
            handle = os.open(parts[-1], READ_ONLY | os.O_NOFOLLOW, dir_fd=here)
        finally:
            os.close(here)
    with os.fdopen(handle, "rb") as file:
        _check_regular(os.fstat(handle), path)
        yield file


def open_to_append(path: str, flags: int) -> int:
    """An `opener` (see open()) for appending to a regular file, never to a device or a FIFO. Raises OSError."""
    handle = os.open(path, flags | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC, 0o644)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise OSError(errno.EINVAL, "not a regular file", path)
    return handle


def _check_regular(status: os.stat_result, path: Path) -> None:
    """Check before opening, as opening alone affects some devices, and after. Raises FileError."""
    if not stat.S_ISREG(status.st_mode):
        raise FileError(f"{path}: cannot be read: not a regular file")


def _all_of(file: BinaryIO, path: Path, most_bytes: int) -> bytes:
    pieces: list[bytes] = []
    with _as_file_error(path):
        size = os.fstat(file.fileno()).st_size
        while size <= most_bytes and (piece := file.read(PIECE)):  # it may be longer than its status says
            pieces.append(piece)
            size = max(size, sum(map(len, pieces)))
    if size > most_bytes:
        raise FileError(f"{path}: too large: {size / 1e6:.3g} MB; the limit is {most_bytes / 1e6:.3g} MB")
    return b"".join(pieces)


@contextlib.contextmanager
def _as_file_error(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError:  # a name with a zero byte
        raise FileError(f"{str(path)!r}: not a file's name") from None


def fill_standard_files() -> None:
    """Open /dev/null for each closed standard file. Otherwise the next file opened would take its number, say the arm's
    line, and a library's warning would be sent to the controller."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
