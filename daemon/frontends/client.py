"""The client of the daemon's socket: connect, send a command, receive the answer. daemon/ctl.py shows it to people.

It imports little, so that `facetctl status` starts fast. It has its own time limit for a stop: a daemon that hangs
cannot report that it hangs.
"""

from __future__ import annotations

import base64
import contextlib
import json
import select
import shlex
import shutil
import socket
import struct
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daemon.console.stop_words import withdraws_permission
from daemon.errors import STOP_UNANSWERED, FacetdError
from daemon.store.folders import socket_candidates
from daemon.store.outside import FileError, read_file

if TYPE_CHECKING:
    from daemon.frontends.keyboard import RawKeyboard

POLL_S = 0.1
LONGEST_PIECE = 256 * 1024
"""Bytes read at a time."""
PIECE = 32 * 1024
"""Bytes of a file in one message."""
LONGEST_FILE = 8_000_000
"""Bytes of the largest file that an operator may send."""
STOP_ANSWER_S = 2.0
"""How long a stop may have neither an answer nor a sign that the daemon waits for the controller. After that the client
sends the operator to the emergency stop. The daemon itself reports when the controller does not confirm in time."""
ALIVE_S = 0.5
"""How long after STOP_ANSWER_S a daemon may take to answer anything; one that answers nothing hangs."""
LATE_ANSWER_S = 5.0
"""How long after STOP_ANSWER_S the client waits for a daemon that does not hang: it answers within 4 s."""
MOST_FILES = 200
"""The most file names offered as completions."""
CONNECT_S = 2.0
"""How long a daemon may take to accept a connection. One that hangs does not accept it once its queue is full."""
EMERGENCY = "PRESS THE EMERGENCY STOP"
UNANSWERED = f"{EMERGENCY}: no answer to the stop for {STOP_ANSWER_S:g} s"


class DaemonUnreachableError(FacetdError):
    """No daemon answers: which sockets were tried, and what to do."""


class StopUnansweredError(DaemonUnreachableError):
    """No daemon answered a stop: the operator must press the emergency stop."""


class DaemonLink:
    """One connection to the running daemon."""

    def __init__(self, path: Path | None = None) -> None:
        """Connect to path, or to the first usual socket. Raises DaemonUnreachableError, StopUnansweredError."""
        self._path = path
        self._paths = [path] if path is not None else socket_candidates()
        self._keyboard: RawKeyboard | None = None
        self._open()

    def _open(self) -> None:
        self._lines, self._partial = deque[bytes](), list[bytes]()
        """Received data: complete lines, and the parts of an incomplete one."""
        self._stops = 0
        """How many control-C the daemon has not answered yet."""
        self._unanswered_s: float | None = None
        """Since when (monotonic) a stop, by control-C or as a command, has no answer."""
        self._sent_to_emergency_stop = False
        """Whether the operator was sent to the emergency stop."""
        self._alive = False
        """Whether the daemon has sent anything since then."""
        self._partly_sent = False
        """Whether only a part of a message was sent."""
        try:
            self.socket = _connect(self._paths)
        except KeyboardInterrupt:
            raise StopUnansweredError(f"{EMERGENCY}: the stop was not sent; no daemon has answered yet") from None

    def close(self) -> None:
        self.socket.close()

    def running_job(self) -> str | None:
        """The job that the daemon is running, asked on a separate connection. None: no job, or no answer within 1 s."""
        with contextlib.suppress(DaemonUnreachableError, OSError, ValueError), _connect(self._paths) as line:
            line.settimeout(1.0)
            line.sendall(b'{"do": "status", "frontend": "console"}\n')
            with line.makefile("rb") as file:
                for message in map(json.loads, file):
                    if "done" in message:
                        return (message["done"].get("data") or {}).get("doing")
        return None

    def stop_separately(self, text: str, frontend: str, say: Callable[[str], None]) -> dict[str, Any]:
        """Send a stop on a separate connection, whatever this one waits for. Returns what `do` returns."""
        try:
            with DaemonLink(self._path) as another:
                return another.do(text, frontend, say)
        except DaemonUnreachableError as error:
            answer = str(stop_unanswered(error))
            return {"text": answer, "data": {"error": answer}, "status": STOP_UNANSWERED}

    def reconnect(self) -> None:
        """Connect to the daemon that runs now, after the previous one ended. Raises DaemonUnreachableError."""
        self.close()
        self._open()

    def __enter__(self) -> DaemonLink:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def do(
        self, text: str, frontend: str, say: Callable[[str], None], ask: Callable[[str], str] | None = None
    ) -> dict[str, Any]:
        """Send one command, show what the daemon sends until the answer, and return {text, data, status}. Control-C
        stops the arm; then the result also has {interrupted: True}, and the caller sends no further command by itself.

        A stop without an answer within STOP_ANSWER_S is reported, and the status says so whatever follows. ask: asks a
        person; without it each question counts as answered by yes. Raises DaemonUnreachableError when the daemon
        disconnects; StopUnansweredError where that was a stop.
        """
        columns = shutil.get_terminal_size().columns
        self._sent_to_emergency_stop = self._alive = False
        if withdraws_permission(text):
            self._unanswered_s = time.monotonic()
        try:
            self._send({"do": text, "frontend": frontend, "asks": ask is not None, "size": [columns, None]})
            done = self._listen(text, say, ask)
        except DaemonUnreachableError as error:
            raise stop_unanswered(error) if self._unanswered_s is not None else error from None
        finally:
            self._unanswered_s = None
            self._end_terminal()
        return done | ({"status": STOP_UNANSWERED} if self._sent_to_emergency_stop else {})

    def _listen(self, text: str, say: Callable[[str], None], ask: Callable[[str], str] | None) -> dict[str, Any]:
        done: dict[str, Any] | None = None
        messages, pressed = self._messages(say), {}
        while done is None or self._stops:
            try:
                message = next(messages, None)
                if message is None:
                    raise DaemonUnreachableError("the daemon ended before it answered; check it: `facetctl status`")
                done = message.get("done", done)
                self._stops = max(0, self._stops - ("stopped" in message))
                if self._stops == 0 and ("stopped" in message or (withdraws_permission(text) and done is not None)):
                    self._unanswered_s = None
                for line in (message.get("say"), message.get("stopped")):
                    if line is not None:
                        say(line)
                self._controller_terminal(message)
                if "ask" in message and ask is not None:
                    self._send({"answer": ask(message["ask"]), "id": message.get("id")})
                if "fetch" in message:
                    for piece in file_in_pieces(str(message["fetch"]), [text]):
                        self._send(piece)
            except KeyboardInterrupt:
                self._stop()
                messages, pressed = self._messages(say), {"interrupted": True}
        return done | pressed

    def options(self, typed: str) -> list[str]:
        """Completions of the line typed so far."""
        self._send({"complete": typed})
        return next((list(m["options"]) for m in self._messages() if "options" in m), [])

    def interrupt(self, say: Callable[[str], None]) -> str:
        """Stop the arm, as control-C does; returns the daemon's answer. Raises StopUnansweredError."""
        try:
            self._stop()
            answer = None
            for message in self._messages(say):
                if "say" in message:
                    say(message["say"])
                if "stopped" in message:
                    answer = str(message["stopped"])
                    break
        except DaemonUnreachableError as error:
            raise stop_unanswered(error) from None
        if answer is None:
            raise stop_unanswered(DaemonUnreachableError("the daemon ended before it answered"))
        self._stops, self._unanswered_s = 0, None
        return answer

    def _stop(self) -> None:
        self._stops += 1
        if self._unanswered_s is None:
            self._unanswered_s = time.monotonic()
        self._send_in_time({"interrupt": True}, STOP_ANSWER_S)

    def _send_in_time(self, message: dict[str, Any], seconds: float) -> None:
        _limit_sending(self.socket, seconds)
        self._send(message)
        _limit_sending(self.socket, 0.0)

    def _controller_terminal(self, message: dict[str, Any]) -> None:
        """Show the controller's own terminal here while the daemon connects it."""
        if message.get("terminal") is True:
            from daemon.frontends.keyboard import RawKeyboard

            self._keyboard = RawKeyboard(self._send, self._stop)
        elif message.get("terminal") is False:
            self._end_terminal()
        elif "show" in message and self._keyboard is not None:
            self._keyboard.show(str(message["show"]))

    def _end_terminal(self) -> None:
        if self._keyboard is not None:
            self._keyboard.close()
        self._keyboard = None

    def _send(self, message: dict[str, Any]) -> None:
        begin = b"\n" if self._partly_sent else b""  # control-C cut the previous message: end its line
        self._partly_sent = True
        try:
            self.socket.sendall(begin + json.dumps(message).encode() + b"\n")
        except OSError:
            raise DaemonUnreachableError("the daemon closed the connection") from None
        self._partly_sent = False

    def _messages(self, say: Callable[[str], None] = print) -> Iterator[dict[str, Any]]:
        """Messages of the daemon until it disconnects. say: shows a late answer. Raises StopUnansweredError."""
        while True:
            while self._lines:
                message = json.loads(self._lines.popleft())
                if "stopping" in message and self._unanswered_s is not None:
                    self._unanswered_s = time.monotonic()
                yield message
            self._wait(say)
            try:
                data = self.socket.recv(LONGEST_PIECE)
            except OSError:
                return
            if not data:
                return
            self._alive |= self._sent_to_emergency_stop
            first, *others = data.split(b"\n")
            self._partial.append(first)
            for piece in others:
                self._lines.append(b"".join(self._partial))
                self._partial = [piece]

    def _wait(self, say: Callable[[str], None]) -> None:
        """Wait until there is something to read."""
        while True:
            late_s = (LATE_ANSWER_S if self._alive else ALIVE_S) if self._sent_to_emergency_stop else 0.0
            limit_s, since_s = STOP_ANSWER_S + late_s, self._unanswered_s
            # The thread that reads keys may send a stop meanwhile: poll its clock.
            left_s = POLL_S if since_s is None else max(0.0, since_s + limit_s - time.monotonic())
            if self.socket.fileno() < 0 or select.select([self.socket], [], [], min(left_s, POLL_S))[0]:
                return
            if since_s is None or left_s > POLL_S:
                continue
            if self._sent_to_emergency_stop:
                raise StopUnansweredError(f"{EMERGENCY}: no answer to the stop for {limit_s:g} s; facetd hangs")
            self._sent_to_emergency_stop = True
            say(UNANSWERED)
            self._send_in_time({"complete": ""}, ALIVE_S)  # the daemon answers this at once, whatever it waits for


def file_in_pieces(path: str, commands: Iterable[str]) -> Iterator[dict[str, Any]]:
    """Answer a fetch: send a file that one of these commands names, and no other."""
    try:
        if not any(path in _words(text) for text in commands):
            raise FileError(f"{path}: not sent: the command does not name this file")
        content = read_file(Path(path).expanduser(), LONGEST_FILE)
    except FileError as error:
        yield {"no_file": str(error)}
        return
    for start in range(0, max(len(content), 1), PIECE):
        piece = base64.b64encode(content[start : start + PIECE]).decode()
        yield {"file": piece, "more": start + PIECE < len(content)}


def files_begun(typed: str) -> list[str] | None:
    """Completions of the line typed so far where its last word is a file name after --mesh; else None."""
    before, space, begun = typed.rpartition(" ")
    if not space or not before.endswith(" --mesh"):
        return None
    folder, _, name = begun.rpartition("/")
    found: list[str] = []
    with contextlib.suppress(OSError, RuntimeError, ValueError):
        for path in sorted(Path(f"{folder}/" if "/" in begun else ".").expanduser().iterdir())[:MOST_FILES]:
            if path.name.startswith(name or "") and (name.startswith(".") or not path.name.startswith(".")):
                found.append(begun[: len(begun) - len(name)] + path.name + ("/" if path.is_dir() else ""))
    return [f"{before} {one}" for one in found if " " not in one]


def _words(text: str) -> list[str]:
    try:
        return shlex.split(text, comments=True)
    except ValueError:
        return []


@contextlib.contextmanager
def despite_full_disk() -> Iterator[None]:
    """Ignore a full disk behind standard output: a stop goes on, and flushing at exit reports the error."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError:
        pass


def stop_unanswered(error: DaemonUnreachableError) -> StopUnansweredError:
    """The same error as a StopUnansweredError, for an operator who wanted to stop the arm."""
    if isinstance(error, StopUnansweredError):
        return error
    return StopUnansweredError(f"{EMERGENCY}: the stop was not answered; {error}")


def _limit_sending(connection: socket.socket, seconds: float) -> None:
    """Limit the time that sending may take; 0: no limit."""
    whole = int(seconds)
    limit = struct.pack("@ll", whole, int((seconds - whole) * 1e6))
    with contextlib.suppress(OSError):
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)


def _connect(paths: list[Path]) -> socket.socket:
    refused = []
    for path in paths:
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        _limit_sending(connection, CONNECT_S)
        try:
            connection.connect(str(path))
        except PermissionError:
            connection.close()
            raise DaemonUnreachableError(
                f"{path}: no permission; your user must be in the socket's group (facetd)"
            ) from None
        except BlockingIOError:
            connection.close()
            raise DaemonUnreachableError(
                f"{path}: facetd has not answered for {CONNECT_S:g} s: it hangs; `systemctl restart facetd`"
            ) from None
        except OSError:
            connection.close()
            refused.append(str(path))
        except BaseException:
            connection.close()
            raise
        else:
            _limit_sending(connection, 0.0)
            return connection
    where = " nor ".join(refused)
    raise DaemonUnreachableError(
        f"no daemon answers at {where}; start it (`systemctl start facetd`, or `facetd --sim` to try it)"
    )
