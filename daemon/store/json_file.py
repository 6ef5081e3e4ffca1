"""Read and write small JSON files in the state folder, each one structure."""

import os
from pathlib import Path
from typing import TypeVar

import msgspec

from daemon.store.files import failing_as, write_atomically
from daemon.store.outside import JSON_ERRORS, FileError, read_file

T = TypeVar("T")
LARGEST_BYTES = 4_000_000


def read_json(path: Path, kind: type[T], mend: str) -> T | None:
    """Read a file; None where it does not exist. mend: what to do about an unreadable one. Raises FileError."""
    if not os.path.lexists(path):
        return None
    try:
        return msgspec.json.decode(read_file(path, LARGEST_BYTES), type=kind)
    except FileError as error:
        raise FileError(f"{error}; {mend}") from None
    except JSON_ERRORS as error:
        raise FileError(f"{path}: cannot be read: {error}; {mend}") from None


def write_json(path: Path, value: msgspec.Struct) -> None:
    """Write a file that read_json reads. Raises FileError: then the old file is in place."""
    with failing_as(FileError, f"{path}: not written"):
        write_atomically(path, msgspec.json.encode(value))
