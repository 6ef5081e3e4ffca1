"""Follow the daemon: its status and notices at the socket, its run as it is written. The daemon may end and restart."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
from pathlib import Path
from typing import Any

from daemon.dashboard.state import DashboardState
from daemon.events.records import LONGEST_LINE, record_of
from daemon.store.folders import socket_candidates
from daemon.store.outside import FileError, open_below, read_below
from daemon.store.pictures import LARGEST_BYTES
from daemon.store.runs import RUN

STATUS_S, RECONNECT_S, READ_S = 1.0, 1.0, 0.25
"""Periods of the status request, of the search for a daemon, and of reading its run."""
TAIL_BYTES = 4_000_000
"""Bytes read of a run in progress: enough for the last picks."""
LONGEST_MESSAGE = 4_000_000
HELLO, STATUS = b'{"notices": true}\n', b'{"do": "status places", "frontend": "dashboard"}\n'
"""All that is ever sent to the daemon."""


async def follow_daemon(now: DashboardState, run: RunFollower, socket_path: Path | None) -> None:
    """Keep `now` up to date for ever. socket_path None: the daemon's usual places."""
    await asyncio.gather(_follow_socket(now, run, socket_path), _follow_run(run))


async def _follow_socket(now: DashboardState, run: RunFollower, socket_path: Path | None) -> None:
    while True:
        for path in [socket_path] if socket_path else socket_candidates():
            with contextlib.suppress(OSError, ValueError):
                reader, writer = await asyncio.open_unix_connection(path, limit=LONGEST_MESSAGE)
                try:
                    await _converse(now, run, reader, writer)
                finally:
                    writer.close()
        now.answered(None)
        await asyncio.sleep(RECONNECT_S)


async def _converse(
    now: DashboardState, run: RunFollower, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
) -> None:
    """Exchange messages until the daemon closes the connection."""
    writer.write(HELLO + STATUS)
    requests = asyncio.create_task(_request_status(writer))
    try:
        while line := await reader.readline():
            message = json.loads(line)
            if "notice" in message:
                now.noticed(str(message["notice"]))
            if "done" in message:
                data: dict[str, Any] = message["done"].get("data") or {}
                now.answered(data)
                if data.get("run"):
                    run.go_to(Path(str(data["run"])))
    finally:
        requests.cancel()


async def _request_status(writer: asyncio.StreamWriter) -> None:
    while True:
        await asyncio.sleep(STATUS_S)
        writer.write(STATUS)


async def _follow_run(run: RunFollower) -> None:
    while True:
        run.read()
        await asyncio.sleep(READ_S)


class RunFollower:
    """Reads the records added to the daemon's current run."""

    def __init__(self, now: DashboardState) -> None:
        self._now = now
        self.folder: Path | None = None
        self._at, self._rest = 0, b""

    def go_to(self, folder: Path) -> None:
        """Switch to a run, unless it is the one already followed."""
        if folder == self.folder:
            return
        self.folder, self._at, self._rest = folder, 0, b""
        self._now.began(folder.name)
        with contextlib.suppress(FileError, OSError), open_below(folder, RUN) as file:
            self._take(file.readline(LONGEST_LINE))
            self._at = max(file.tell(), os.fstat(file.fileno()).st_size - TAIL_BYTES)

    def read(self) -> None:
        """Read what was written since the last call."""
        if self.folder is None:
            return
        with contextlib.suppress(FileError, OSError), open_below(self.folder, RUN) as file:
            if os.fstat(file.fileno()).st_size <= self._at:
                return
            file.seek(self._at)
            content = file.read(TAIL_BYTES)
            self._at = file.tell()
            *lines, self._rest = (self._rest + content).split(b"\n")
            self._rest = self._rest[: LONGEST_LINE + 1]
            for line in lines:
                self._take(line)

    def _take(self, line: bytes) -> None:
        with contextlib.suppress(ValueError):  # half a line where reading began, or a line of another program
            self._now.recorded(record_of(line))

    def expects(self, seq: int, camera: str) -> bool:
        """Whether the record of one of the last looks names this image."""
        return bool(self._now.pictures.get(seq, {}).get(camera))

    def picture(self, seq: int, camera: str) -> bytes | None:
        """The file of an image of one of the last looks; None where it is not in the run's folder."""
        name = self._now.pictures.get(seq, {}).get(camera)
        if self.folder is None or not name:
            return None
        try:
            return read_below(self.folder, name, LARGEST_BYTES)
        except FileError:
            return None
