"""A fake daemon's socket, for tests of its clients: what it hears is kept, and a function answers.

Each connection has a thread. None outlives the test: close() waits for them and raises what one of them raised, so that
it fails the test that it belongs to.
"""

from __future__ import annotations

import contextlib
import json
import socket
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, Self

from tests.fakes.waiting import PATIENCE_S

Message = dict[str, Any]
Say = Callable[[Message], None]
DONE: Message = {"done": {"text": "well", "data": {}, "status": 0}}


class FakeDaemon:
    """Listens at once. To hang up, `answer` raises ConnectionError."""

    def __init__(self, path: Path, answer: Callable[[Message, Say], None] = lambda *_: None, most: int = 16) -> None:
        """most: after so many connections it takes nobody in."""
        self.path, self.heard, self._answer, self._most = path, list[Message](), answer, most
        self.hung_up = threading.Event()
        """Whether a connection has ended."""
        self._taken, self._closing = 0, False
        self._changed = threading.Condition()
        self._lines: list[socket.socket] = []
        self._listening = socket.socket(socket.AF_UNIX)
        self._listening.bind(str(path))
        self._listening.listen()
        self._pool = ThreadPoolExecutor(most + 1)
        self._serving: list[Future[None]] = [self._pool.submit(self._accept)]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _accept(self) -> None:
        for _ in range(self._most):
            try:
                line = self._listening.accept()[0]
            except OSError:  # closed
                return
            with self._changed:
                if self._closing:
                    line.close()
                    return
                self._lines.append(line)
                self._serving.append(self._pool.submit(self._serve, line))
                self._changed.notify_all()
        self.path.unlink()

    def _serve(self, line: socket.socket) -> None:
        def say(message: Message) -> None:
            line.sendall(json.dumps(message).encode() + b"\n")

        # The client may hang up between two lines of an answer, as it may on the real daemon.
        with line, line.makefile("rb") as file, contextlib.suppress(ConnectionError):
            for text in file:
                with contextlib.suppress(json.JSONDecodeError):
                    message = json.loads(text)
                    with self._changed:
                        self.heard.append(message)
                        self._changed.notify_all()
                    self._answer(message, say)
        self.hung_up.set()

    def says(self, **message: object) -> None:
        """Send a message to who came first."""
        with self._changed:
            assert self._changed.wait_for(lambda: self._lines, PATIENCE_S), "nobody came"
        self._lines[0].sendall(json.dumps(message).encode() + b"\n")

    def hears(self, wanted: Callable[[Message], object] = lambda _: True) -> Message:
        """Wait for a message of this kind after the last one that this returned."""
        with self._changed:
            assert self._changed.wait_for(lambda: any(map(wanted, self.heard[self._taken :])), PATIENCE_S), self.heard
            self._taken = next(k for k, m in enumerate(self.heard) if k >= self._taken and wanted(m)) + 1
            return self.heard[self._taken - 1]

    def close(self) -> None:
        """End, as a daemon that is killed does."""
        with self._changed:
            self._closing = True
            for end in (self._listening, *self._lines):
                with contextlib.suppress(OSError):  # its thread may have closed it
                    end.shutdown(socket.SHUT_RDWR)
        self._pool.shutdown()
        self._listening.close()
        self.path.unlink(missing_ok=True)
        for served in self._serving:
            served.result()
