"""Positions of the arm that operators have named: places.jsonl, a line for each time one was stored or dropped.

The last line of a name counts; earlier ones are its history, whose older half is removed once the file is large.
Readers skip a line that a power failure cut short. A name whose last line has no position is dropped. The file
keeps the name that earlier releases gave it.
"""

import errno
import os
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from daemon import frames
from daemon.arrays import Array
from daemon.store.files import failing_as, write_atomically
from daemon.store.outside import JSON_ERRORS, FileError, open_to_append, read_file

LARGEST_BYTES = 4_000_000

Four = tuple[float, float, float, float]


class _PositionLine(msgspec.Struct):
    v: int
    t: Annotated[str, Meta(max_length=40)]
    who: str
    name: str
    world_from_tool: tuple[Four, Four, Four, Four] | None


@dataclass(frozen=True, eq=False)
class NamedPosition:
    """A position, when and by whom it was stored; world_from_tool (4, 4) mm, None where the name was dropped."""

    name: str
    kept: str
    who: str
    world_from_tool: Array | None


class NamedPositions:
    """The positions of one cell. One writer: the daemon."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "places.jsonl"

    def history(self, name: str | None = None) -> list[NamedPosition]:
        """Every position stored or dropped, oldest first. name: of this name only. Raises FileError."""
        try:
            lines = read_file(self.path, LARGEST_BYTES).splitlines()
        except FileError:
            if not os.path.lexists(self.path):
                return []
            raise
        read = [one for line in lines if (one := _read(line)) is not None]
        return [one for one in read if name in (None, one.name)]

    def now(self) -> dict[str, Array]:
        """The valid positions: name -> world_from_tool (4, 4) mm. Raises FileError."""
        last = {one.name: one.world_from_tool for one in self.history()}
        return {name: pose for name, pose in last.items() if pose is not None}

    def keep(self, name: str, world_from_tool: Array | None, who: str) -> None:
        """Store a position under a name; None: drop the name. Raises FileError."""
        rows = None if world_from_tool is None else np.asarray(world_from_tool, float).tolist()
        line = _PositionLine(1, datetime.now(UTC).isoformat(timespec="seconds"), who, name, rows)
        with failing_as(FileError, f"{self.path}: not kept"):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            if self.path.is_file() and self.path.stat().st_size > LARGEST_BYTES // 2:
                self._shorten()
            with open(self.path, "ab", buffering=0, opener=open_to_append) as file:
                length = file.tell()
                try:
                    torn = length > 0 and not self._ends_in_newline()
                    content = (b"\n" if torn else b"") + msgspec.json.encode(line) + b"\n"
                    if file.write(content) != len(content):
                        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                    os.fsync(file.fileno())
                except OSError:
                    file.truncate(length)
                    raise

    def _shorten(self) -> None:
        """Keep the lines that count and the newer half of the others, long before the file is too large to read."""
        lines = read_file(self.path, LARGEST_BYTES).splitlines()
        read = [(line, one) for line in lines if (one := _read(line)) is not None]
        last = {one.name: k for k, (_, one) in enumerate(read)}
        counts = {k for k in last.values() if read[k][1].world_from_tool is not None}
        kept = [line for k, (line, _) in enumerate(read) if k in counts or k >= len(read) // 2]
        write_atomically(self.path, b"".join(line + b"\n" for line in kept))

    def _ends_in_newline(self) -> bool:
        with self.path.open("rb") as file:
            file.seek(-1, os.SEEK_END)
            return file.read(1) == b"\n"


def _read(line: bytes) -> NamedPosition | None:
    try:
        one = msgspec.json.decode(line, type=_PositionLine)
    except JSON_ERRORS:
        return None
    pose = None if one.world_from_tool is None else np.array(one.world_from_tool, float)
    if pose is not None and frames.not_rigid(pose) is not None:
        pose = None  # damaged on the disk: never a target for the arm
    return NamedPosition(one.name, one.t, one.who, pose)
