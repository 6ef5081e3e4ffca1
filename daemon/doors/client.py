"""The operator's side of the daemon's socket: connect, say, hear. What is shown to people is daemon/ctl.py's.

Light on purpose: `facetctl status` imports nothing heavier than this.
"""

from __future__ import annotations

import base64
import contextlib
import json
import shlex
import shutil
import socket
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daemon.errors import NOT_UNDERSTOOD, FacetdError
from daemon.store.outside import FileError, read_file
from daemon.store.places import socket_candidates

if TYPE_CHECKING:
    from daemon.doors.keyboard import Keyboard

PIECE = 32 * 1024
"""Bytes of a file in one message."""
LONGEST_FILE = 8_000_000
"""Bytes that an operator sends at most."""


class NotThereError(FacetdError):
    """No daemon answers: where it was sought, and what to do."""


class DaemonLink:
    """One connection to the running daemon."""

    def __init__(self, path: Path | None = None) -> None:
        """Connect to the socket at path, or to the first of the usual ones. Raises NotThereError."""
        self._path = path
        self._paths = [path] if path is not None else socket_candidates()
        self.socket = _connect(self._paths)
        self._file = self.socket.makefile("rwb")
        self._keyboard: Keyboard | None = None
        self._stops = 0
        """Control-C that the daemon has not yet answered."""

    def close(self) -> None:
        """Hang up."""
        with contextlib.suppress(OSError):
            self._file.close()
        self.socket.close()

    def stop_beside(self, text: str, door: str, say: Callable[[str], None]) -> dict[str, Any]:
        """Say a stop on a connection of its own, whatever is waited for on this one; gives what `do` does."""
        try:
            with DaemonLink(self._path) as another:
                return another.do(text, door, say)
        except NotThereError as error:
            return {"text": str(error), "data": {"error": str(error)}, "status": NOT_UNDERSTOOD}

    def connect_again(self) -> None:
        """To the daemon that runs now, after the one before went away. Raises NotThereError."""
        self.close()
        self.socket = _connect(self._paths)
        self._file = self.socket.makefile("rwb")
        self._stops = 0

    def __enter__(self) -> DaemonLink:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def do(
        self, text: str, door: str, say: Callable[[str], None], ask: Callable[[str], str] | None = None
    ) -> dict[str, Any]:
        """Say one command; show what comes meanwhile; give {text, data, status}. Control-C stops the arm; where it was
        pressed there is {interrupted: True} as well: whoever did that wants nothing further to be said by itself.

        ask: puts a question to somebody; without it questions are taken as answered by yes. Raises NotThereError when
        the daemon goes away.
        """
        columns = shutil.get_terminal_size().columns
        self._send({"do": text, "door": door, "asks": ask is not None, "size": [columns, None]})
        try:
            return self._listen(text, say, ask)
        finally:
            self._end_terminal()

    def _listen(self, text: str, say: Callable[[str], None], ask: Callable[[str], str] | None) -> dict[str, Any]:
        done: dict[str, Any] | None = None
        messages, pressed = self._messages(), {}
        while done is None or self._stops:
            try:
                message = next(messages, None)
                if message is None:
                    raise NotThereError("the daemon ended before it answered; `facetctl status` tells if it is back")
                done = message.get("done", done)
                for line in (message.get("say"), message.get("stopped")):
                    if line is not None:
                        say(line)
                self._stops = max(0, self._stops - ("stopped" in message))
                self._at_terminal(message)
                if "ask" in message and ask is not None:
                    self._send({"answer": ask(message["ask"]), "id": message.get("id")})
                if "fetch" in message:
                    for piece in file_in_pieces(str(message["fetch"]), [text]):
                        self._send(piece)
            except KeyboardInterrupt:
                self._stop()
                messages, pressed = self._messages(), {"interrupted": True}
        return done | pressed

    def options(self, typed: str) -> list[str]:
        """Every line that the typed one may become."""
        self._send({"complete": typed})
        return next((list(m["options"]) for m in self._messages() if "options" in m), [])

    def interrupt(self) -> str:
        """What control-C does: stop the arm; gives what the daemon says."""
        self._send({"interrupt": True})
        return next((str(m["stopped"]) for m in self._messages() if "stopped" in m), "")

    def _stop(self) -> None:
        self._stops += 1
        self._send({"interrupt": True})

    def _at_terminal(self, message: dict[str, Any]) -> None:
        """The controller's own terminal, shown here for a while."""
        if message.get("terminal") is True:
            from daemon.doors.keyboard import Keyboard

            self._keyboard = Keyboard(self._send, self._stop)
        elif message.get("terminal") is False:
            self._end_terminal()
        elif "show" in message and self._keyboard is not None:
            self._keyboard.show(str(message["show"]))

    def _end_terminal(self) -> None:
        if self._keyboard is not None:
            self._keyboard.close()
        self._keyboard = None

    def _send(self, message: dict[str, Any]) -> None:
        try:
            self._file.write(json.dumps(message).encode() + b"\n")
            self._file.flush()
        except (OSError, ValueError):
            raise NotThereError("the daemon hung up") from None

    def _messages(self) -> Iterator[dict[str, Any]]:
        while True:
            try:
                line = self._file.readline()
            except OSError:
                return
            if not line:
                return
            yield json.loads(line)


def file_in_pieces(path: str, commands: Iterable[str]) -> Iterator[dict[str, Any]]:
    """The answer to a fetch: a file that one of these commands itself names, and no other."""
    try:
        if not any(path in _words(text) for text in commands):
            raise FileError(f"{path}: not sent: the command does not name it")
        content = read_file(Path(path).expanduser(), LONGEST_FILE)
    except FileError as error:
        yield {"no_file": str(error)}
        return
    for start in range(0, max(len(content), 1), PIECE):
        piece = base64.b64encode(content[start : start + PIECE]).decode()
        yield {"file": piece, "more": start + PIECE < len(content)}


def _words(text: str) -> list[str]:
    try:
        return shlex.split(text, comments=True)
    except ValueError:
        return []


def _connect(paths: list[Path]) -> socket.socket:
    refused = []
    for path in paths:
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            connection.connect(str(path))
            return connection
        except PermissionError:
            connection.close()
            raise NotThereError(f"{path}: no permission; your user must be in the socket's group (facetd)") from None
        except OSError:
            connection.close()
            refused.append(str(path))
    where = " nor ".join(refused)
    raise NotThereError(
        f"no daemon answers at {where}; start it (`systemctl start facetd`, or `facetd --sim` to try it)"
    )
