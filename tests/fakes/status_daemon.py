"""A fake daemon for the dashboard: answers `status`, sends notices, records messages."""

from __future__ import annotations

import asyncio
import contextlib
import json
from pathlib import Path
from typing import Any


class StatusDaemon:
    """Answers at a socket until closed."""

    def __init__(self, path: Path, run: Path) -> None:
        self.path, self.status = path, {"state": "idle", "run": str(run), "picked": 2, "tried": 3, "troubles": {}}
        self.heard: list[dict[str, Any]] = []
        self._writers: list[asyncio.StreamWriter] = []
        self._server: asyncio.Server | None = None

    async def open(self) -> None:
        """Begin to answer."""
        self._server = await asyncio.start_unix_server(self._serve, self.path)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.append(writer)
        while line := await reader.readline():
            self.heard.append(json.loads(line))
            if "do" in self.heard[-1]:
                self._write(writer, {"done": {"text": "", "data": self.status, "status": 0}})

    def tell(self, text: str) -> None:
        """Send a notice to every connection."""
        for writer in self._writers:
            self._write(writer, {"notice": text})

    def _write(self, writer: asyncio.StreamWriter, message: dict[str, Any]) -> None:
        writer.write(json.dumps(message).encode() + b"\n")

    async def close(self) -> None:
        """Close all connections, as a daemon that ends does."""
        assert self._server is not None
        self._server.close()
        for writer in self._writers:
            writer.close()
            with contextlib.suppress(ConnectionError):
                await writer.wait_closed()
        self._writers.clear()
        await self._server.wait_closed()
        self.path.unlink(missing_ok=True)
