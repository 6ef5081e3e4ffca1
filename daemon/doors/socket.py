"""The operators' socket: JSON objects, one a line, both ways. What the words mean is the console's business.

Operator to daemon: {"do": TEXT, "door": NAME, "asks": BOOL, "id": ID, "waits": BOOL, "size": [COLUMNS, ROWS]}: a
command; where another is still being done it is refused, unless it waits; size: of the terminal, ROWS null where pages
are not turned there. {"answer": TEXT, "id": ID} {"interrupt": true} {"complete": TEXT}
{"notices": true}: tell me also what I do not ask for. {"file": BASE64, "more": BOOL} or {"no_file": WHY}, the answer to
a fetch; {"keys": TEXT} {"leave": true} at a terminal.
Daemon to operator: {"say": TEXT} {"ask": QUESTION, "id": ID} {"unasked": ID}: no answer is waited for any more.
{"fetch": PATH} {"done": {text, data, status}, "id": ID} {"notice": TEXT}
{"terminal": BOOL}, its beginning and end, {"show": TEXT} in between (one character a byte); {"options": [LINE, ...]};
{"stopped": TEXT}, the answer to an interrupt, and to a stop where an answer was asked for.
Who is speaking is what the kernel says of the other end, not what it says of itself.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import grp
import json
import os
import pwd
import re
import socket
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from daemon.console.interpreter import NOT_UNDERSTOOD, Answer, CommandError, Console
from daemon.console.pages import LOWEST, NARROWEST, WIDEST
from daemon.console.phrases import means_stop, printable
from daemon.doors.lineedit import COLUMNS
from daemon.doors.turns import Interrupt, Turns
from daemon.errors import FacetdError

LONGEST_MESSAGE = 64 * 1024
LONGEST_FILE = 8_000_000
SAID = re.compile(r'"(?:do|answer)"\s*:\s*"(.*)', re.DOTALL)
MOST_UNREAD = 256 * 1024
"""Bytes on their way to an operator beyond which notices are dropped: somebody there reads nothing."""


class DoorError(FacetdError):
    """A door cannot be opened: which, why, what to do."""


class SocketServer:
    """Listens at a path; every connection is one operator."""

    def __init__(self, path: Path, group: str | None, console: Console, interrupt: Interrupt) -> None:
        self.path, self._group, self._console, self._interrupt = path, group, console, interrupt
        self._server: asyncio.Server | None = None
        self._operators: set[asyncio.Task[None]] = set()

    async def open(self) -> None:
        """Bind the socket, 0660 and the group's. Raises DoorError."""
        if len(os.fsencode(self.path)) > 100:
            raise DoorError(f"{self.path}: too long for a socket's path; set folders.runtime to a shorter one")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._take_over()
            before = os.umask(0o117)
            try:
                self._server = await asyncio.start_unix_server(self._admit, self.path, limit=LONGEST_MESSAGE)
            finally:
                os.umask(before)
            if self._group is not None:
                os.chown(self.path, -1, grp.getgrnam(self._group).gr_gid)
        except KeyError:
            await self.close()
            raise DoorError(f"console.group: there is no group {self._group!r} on this machine") from None
        except OSError as error:
            raise DoorError(f"{self.path}: cannot listen here: {error.strerror or error}") from None

    async def close(self) -> None:
        """Let go of the path and of every operator; safe to call twice."""
        if self._server is None:
            return
        self._server.close()
        self._server = None
        self.path.unlink(missing_ok=True)
        for task in list(self._operators):
            task.cancel()
        await asyncio.gather(*self._operators, return_exceptions=True)

    def _take_over(self) -> None:
        """Remove the socket of a daemon that died. Raises DoorError where one is alive."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
            try:
                probe.connect(str(self.path))
            except FileNotFoundError:
                return
            except ConnectionRefusedError:
                self.path.unlink()
                return
        raise DoorError(f"{self.path}: another facetd answers there; stop it first")

    async def _admit(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._operators.add(task)
        operator = _Operator(reader, writer, self._console, self._interrupt)
        try:
            await operator.listen()
        except (ConnectionError, asyncio.CancelledError):
            pass
        finally:
            self._operators.discard(task)
            operator.leave()
            writer.close()
            with contextlib.suppress(ConnectionError, asyncio.CancelledError):
                await writer.wait_closed()


class _Operator:
    """One connection: the Door a command sees."""

    may: Literal["look", "all"] = "all"

    def __init__(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, console: Console, interrupt: Interrupt
    ) -> None:
        self._reader, self._writer, self._console = reader, writer, console
        self.name, self.asks, self.who = "socket", False, _who(writer.get_extra_info("socket"))
        self.columns: int = COLUMNS
        self.rows: int | None = None
        self._turns = Turns(console, self, interrupt, self._show_question)
        self._file: asyncio.Future[bytes] | None = None
        self._pieces: list[bytes] = []
        self._typed: Callable[[bytes], None] | None = None
        self._left = asyncio.Event()

    async def listen(self) -> None:
        """Serve the operator until they hang up."""
        while line := await self._next_line():
            try:
                self._hear(_message(line))
            except (ValueError, RecursionError) as error:
                await self._send({"done": _plain(Answer(f"not a message: {error}", {}, 2))})
        self.leave()
        await self._turns.end()

    def leave(self) -> None:
        """The operator is gone: what they asked for goes on, questions to them are answered by nothing."""
        self._console.context.notices.leave(self)
        self._turns.leave()
        self._left.set()
        if self._file is not None and not self._file.done():
            self._file.set_exception(CommandError("the operator went away"))

    async def say(self, text: str) -> None:
        """Show some lines now."""
        await self._send({"say": text})

    def notice(self, text: str) -> None:
        """Show what nobody there asked for."""
        if self._writer.transport.get_write_buffer_size() < MOST_UNREAD:
            self._write({"notice": text})

    async def ask(self, question: str) -> str:
        """Put a question and wait for the answer."""
        return await self._turns.ask(question)

    async def fetch(self, path: str) -> bytes:
        """A file at the operator's end. Raises CommandError."""
        if self._turns.gone:
            raise CommandError("the operator went away")
        self._file, self._pieces = asyncio.get_running_loop().create_future(), []
        await self._send({"fetch": path})
        return await self._file

    async def terminal(self, typed: Callable[[bytes], None]) -> None:
        """Keys go to `typed` until the operator leaves."""
        if not self.asks:
            raise CommandError("this works only at a terminal", NOT_UNDERSTOOD)
        self._left.clear()
        self._typed = typed
        await self._send({"terminal": True})
        try:
            await self._left.wait()
        finally:
            self._typed = None
            await self._send({"terminal": False})

    def show(self, data: bytes) -> None:
        """Bytes onto the operator's terminal."""
        self._write({"show": data.decode("latin-1")})

    async def _next_line(self) -> bytes:
        try:
            return await self._reader.readline()
        except ValueError:
            await self._send({"done": _plain(Answer("the message is too long", {}, 2))})
            return b""

    def _hear(self, message: dict[str, Any]) -> None:
        said = str(message.get("do", message.get("answer", "")))
        if "interrupt" in message or "\x03" in str(message.get("keys", "")):
            self._turns.beside(self._stop())
        elif "answer" in message and self._console.is_stop(said):
            self._turns.take(said, self._stopped)
        elif "do" in message:
            self._take(said if self._console.is_stop(said) else printable(said), message)
        elif "answer" in message:
            if message.get("id") in (None, self._turns.question):
                self._turns.answer(printable(said))
        elif "file" in message or "no_file" in message:
            self._take_file(message)
        elif "keys" in message:
            if self._typed is not None:
                self._typed(str(message["keys"]).encode("latin-1", "replace"))
        elif "leave" in message:
            self._left.set()
        elif "complete" in message:
            self._write({"options": self._console.complete(str(message["complete"]))})
        elif "notices" in message:
            self._console.context.notices.listen(self)
        else:
            raise ValueError("it holds neither do, answer, file, keys, leave, interrupt, complete nor notices")

    def _take(self, text: str, message: dict[str, Any]) -> None:
        for_now = self._console.is_stop(text) or self._console.at_once(text)
        if self._turns.busy and not message.get("waits") and not for_now:
            raise ValueError("the last command is still being done")
        self.name = printable(str(message.get("door", self.name))[:20])
        self.asks = bool(message.get("asks", self.asks))
        self.columns, self.rows = _size(message.get("size"), (self.columns, self.rows))
        number = {"id": message["id"]} if "id" in message else {}

        async def answered(answer: Answer) -> None:
            await self._send({"done": _plain(answer), **number})

        self._turns.take(text, answered)

    def _take_file(self, message: dict[str, Any]) -> None:
        """One piece of a file that was asked for, or why there is none."""
        if self._file is None or self._file.done():
            return
        if "no_file" in message:
            self._file.set_exception(CommandError(str(message["no_file"]), NOT_UNDERSTOOD))
            return
        self._pieces.append(base64.b64decode(str(message["file"]), validate=True))
        if sum(map(len, self._pieces)) > LONGEST_FILE:
            self._file.set_exception(CommandError(f"a file may have {LONGEST_FILE // 1_000_000} MB at most"))
        elif not message.get("more"):
            self._file.set_result(b"".join(self._pieces))

    async def _stop(self) -> None:
        await self._send({"stopped": await self._turns.stop(f"{self.who}, {self.name}")})

    async def _stopped(self, answer: Answer) -> None:
        await self._send({"stopped": answer.text})

    def _show_question(self, question: str | None) -> None:
        number = self._turns.question
        self._write({"unasked": number} if question is None else {"ask": question, "id": number})

    def _write(self, message: dict[str, Any]) -> None:
        if not self._turns.gone:
            self._writer.write(json.dumps(message, default=str).encode() + b"\n")

    async def _send(self, message: dict[str, Any]) -> None:
        with contextlib.suppress(ConnectionError):
            self._write(message)
            await self._writer.drain()


def _message(line: bytes) -> dict[str, Any]:
    """What came in one line. One that is no message and still means to stop is taken for that. Raises ValueError."""
    text = line.decode("utf-8", "replace")
    said = SAID.search(text)
    try:
        message = json.loads(text)
    except ValueError:
        if not means_stop(said[1] if said else text):
            raise
        return {"do": "stop"}
    if means_stop(text):
        return {"do": "stop"}
    if isinstance(message, dict):
        return message
    raise ValueError("not an object")


def _size(said: Any, before: tuple[int, int | None]) -> tuple[int, int | None]:
    """Columns and rows of a terminal, where a message says them."""
    match said:
        case [int(columns), int() | None as rows]:
            return min(max(columns, NARROWEST), WIDEST), None if rows is None else max(rows, LOWEST)
    return before


def _plain(answer: Answer) -> dict[str, Any]:
    return {"text": answer.text, "data": answer.data, "status": answer.status}


def _who(connection: socket.socket) -> str:
    """The user at the other end, by the kernel's word."""
    packed = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
    pid, uid, _ = struct.unpack("3i", packed)
    try:
        name = pwd.getpwuid(uid).pw_name
    except KeyError:
        name = f"uid {uid}"
    return f"{name} (process {pid})"
