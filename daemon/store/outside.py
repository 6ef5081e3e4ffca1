"""The one way to read a file from outside: no device, no FIFO, nothing outside its folder, and no more than it may be.

Every room that reads files says how large one may be and what its content must be; all that can be wrong with it is a
FileError. What the bytes mean is the caller's.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import BinaryIO

from daemon.errors import FacetdError

PLAINLY = os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
"""A FIFO without a writer does not hold up who opens it, and no terminal becomes the daemon's own."""
PIECE = 1 << 20


class FileError(FacetdError):
    """A file cannot be used: which, what is wrong with it. Each kind of file has its own below this one."""


def read_file(path: Path, most_bytes: int) -> bytes:
    """The whole content of a file that somebody named. Raises FileError."""
    with open_file(path) as file:
        return _all_of(file, path, most_bytes)


def read_below(folder: Path, name: object, most_bytes: int) -> bytes:
    """The whole content of a file that another file names, which must lie in its folder. Raises FileError."""
    with open_below(folder, name) as file:
        return _all_of(file, folder / str(name), most_bytes)


@contextlib.contextmanager
def open_file(path: Path) -> Iterator[BinaryIO]:
    """A regular file, or a link to one, for reading. Raises FileError."""
    with _told(path):
        if not stat.S_ISREG(os.stat(path).st_mode):  # before it is opened: that alone does something to a device
            raise FileError(f"{path}: cannot be read: not a regular file")
        handle = os.open(path, PLAINLY)
    with os.fdopen(handle, "rb") as file:
        _check_regular(file, path)
        yield file


@contextlib.contextmanager
def open_below(folder: Path, name: object) -> Iterator[BinaryIO]:
    """A regular file in a folder, by its name relative to it; no link is followed on the way. Raises FileError."""
    path = folder / str(name)
    parts = PurePosixPath(name).parts if isinstance(name, str) else ()
    if not parts or parts[0] == "/" or ".." in parts or "\0" in str(name):
        raise FileError(f"{folder}: {name!r}: expected the name of a file in this folder")
    with _told(path):
        here = os.open(folder, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            for part in parts[:-1]:
                below = os.open(part, os.O_PATH | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC, dir_fd=here)
                os.close(here)
                here = below
            if not stat.S_ISREG(os.stat(parts[-1], dir_fd=here, follow_symlinks=False).st_mode):
                raise FileError(f"{path}: cannot be read: not a regular file")
            handle = os.open(parts[-1], PLAINLY | os.O_NOFOLLOW, dir_fd=here)
        finally:
            os.close(here)
    with os.fdopen(handle, "rb") as file:
        _check_regular(file, path)
        yield file


def open_to_append(path: str, flags: int) -> int:
    """An `opener` (see open()) for a regular file of ours that is added to: no device, and no FIFO that nobody reads.
    Raises OSError."""
    handle = os.open(path, flags | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC, 0o644)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise OSError(errno.EINVAL, "not a regular file", path)
    return handle


def _check_regular(file: BinaryIO, path: Path) -> None:
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        raise FileError(f"{path}: cannot be read: not a regular file")


def _all_of(file: BinaryIO, path: Path, most_bytes: int) -> bytes:
    pieces: list[bytes] = []
    with _told(path):
        size = os.fstat(file.fileno()).st_size
        while size <= most_bytes and (piece := file.read(PIECE)):  # it may be longer than it says
            pieces.append(piece)
            size = max(size, sum(map(len, pieces)))
    if size > most_bytes:
        raise FileError(f"{path}: too large: {_megabytes(size)}, at most {_megabytes(most_bytes)} are read")
    return b"".join(pieces)


def _megabytes(count: int) -> str:
    return f"{count / 1e6:.3g} MB"


@contextlib.contextmanager
def _told(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError:  # a name with a zero byte
        raise FileError(f"{str(path)!r}: not a file's name") from None


def fill_standard_files() -> None:
    """Where one of them is closed, the next file opened would take its number: the arm's line, say, and a library's
    warning would be typed to the controller."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
