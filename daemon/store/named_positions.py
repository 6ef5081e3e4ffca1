"""Positions of the arm that operators have named: places.jsonl, a line for each time one was kept or dropped.

The last line of a name is the one that counts; those before it are its history, of which the older half goes when the
file has become large. A line that lost its end when the power failed is passed over. A name whose last line holds no
position any more has none. The file keeps the name that earlier releases gave it.
"""

from __future__ import annotations

import errno
import json
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
from daemon.store.files import write_atomically
from daemon.store.outside import FileError, open_to_append, read_file

LARGEST_BYTES = 4_000_000

Four = tuple[float, float, float, float]


class NamedPositionsError(FileError):
    """The file of positions cannot be written."""


class _PositionLine(msgspec.Struct):
    v: int
    t: Annotated[str, Meta(max_length=40)]
    who: str
    name: str
    world_from_tool: tuple[Four, Four, Four, Four] | None


@dataclass(frozen=True, eq=False)
class NamedPosition:
    """When, by whom, and where: world_from_tool (4, 4) mm; None where the name was dropped."""

    name: str
    kept: str
    who: str
    world_from_tool: Array | None


class NamedPositions:
    """The positions of one cell. One writer: the daemon."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "places.jsonl"

    def history(self, name: str | None = None) -> list[NamedPosition]:
        """Everything that was kept and dropped, oldest first. Raises FileError."""
        try:
            lines = read_file(self.path, LARGEST_BYTES).splitlines()
        except FileError:
            if not os.path.lexists(self.path):
                return []
            raise
        read = [one for line in lines if (one := _read(line)) is not None]
        return [one for one in read if name in (None, one.name)]

    def now(self) -> dict[str, Array]:
        """Name -> world_from_tool (4, 4) mm. Raises FileError."""
        last = {one.name: one.world_from_tool for one in self.history()}
        return {name: pose for name, pose in last.items() if pose is not None}

    def keep(self, name: str, world_from_tool: Array | None, who: str) -> None:
        """Give a position its name, from now on; None: drop the name. Raises NamedPositionsError."""
        line = {
            "v": 1,
            "t": datetime.now(UTC).isoformat(timespec="seconds"),
            "who": who,
            "name": name,
            "world_from_tool": None if world_from_tool is None else np.asarray(world_from_tool, float).tolist(),
        }
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            if self.path.is_file() and self.path.stat().st_size > LARGEST_BYTES // 2:
                self._shorten()
            with open(self.path, "ab", buffering=0, opener=open_to_append) as file:
                length = file.tell()
                try:
                    torn = length > 0 and not self._ends_whole()
                    content = (b"\n" if torn else b"") + json.dumps(line).encode() + b"\n"
                    if file.write(content) != len(content):
                        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                    os.fsync(file.fileno())
                except OSError:
                    file.truncate(length)
                    raise
        except OSError as error:
            raise NamedPositionsError(f"{self.path}: not kept: {error.strerror or error}") from None

    def _shorten(self) -> None:
        """Long before it is too large to be read: what counts stays, and the newer half of the rest."""
        lines = read_file(self.path, LARGEST_BYTES).splitlines()
        read = [(line, one) for line in lines if (one := _read(line)) is not None]
        last = {one.name: k for k, (_, one) in enumerate(read)}
        counts = {k for k in last.values() if read[k][1].world_from_tool is not None}
        kept = [line for k, (line, _) in enumerate(read) if k in counts or k >= len(read) // 2]
        write_atomically(self.path, b"".join(line + b"\n" for line in kept))

    def _ends_whole(self) -> bool:
        with self.path.open("rb") as file:
            file.seek(-1, os.SEEK_END)
            return file.read(1) == b"\n"


def _read(line: bytes) -> NamedPosition | None:
    try:
        one = msgspec.json.decode(line, type=_PositionLine)
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError):
        return None
    pose = None if one.world_from_tool is None else np.array(one.world_from_tool, float)
    if pose is not None and frames.not_rigid(pose) is not None:
        pose = None  # what is damaged on the disk is no position to go to
    return NamedPosition(one.name, one.t, one.who, pose)
