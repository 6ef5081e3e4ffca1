"""The operators' socket: JSON objects, one a line, in both directions. daemon/console/ interprets the commands.

From an operator:
{"do": TEXT, "frontend": NAME, "asks": BOOL, "id": ID, "waits": BOOL, "size": [COLUMNS, ROWS], "block": ID}
  Run a command of one line. It is refused while another runs, unless it waits. size: of the terminal, ROWS null for no
  paging. block: lines with the same ID were pasted together, and run one after the other, up to the first that fails.
{"answer": TEXT, "id": ID}, {"interrupt": true}, {"complete": TEXT}
{"notices": true}
  Send unsolicited messages, too.
{"file": BASE64, "more": BOOL} or {"no_file": WHY}
  The answer to a fetch.
{"keys": TEXT}, {"leave": true}
  At the controller's terminal.

To an operator:
{"say": TEXT}, {"notice": TEXT}, {"done": {text, data, status}, "id": ID}, {"fetch": PATH}, {"options": [LINE, ...]}
{"ask": QUESTION, "id": ID}, {"unasked": ID}
  A question; it is withdrawn.
{"terminal": BOOL}, {"show": TEXT}
  Begin and end of the controller's terminal; its output in between, one character a byte.
{"stopped": TEXT}
  The answer to an interrupt, and to a stop that was given as an answer.
{"stopping": true}
  Repeated before `stopped`, while the controller has answered the stop but not confirmed it, or still reports whether
  the arm is at rest.

The kernel reports who the operator is (rights.py: and what they may do); what a client says of itself does not count.
Beyond the limit of connections, a few more are accepted for one message each, a stop.
"""

import asyncio
import base64
import contextlib
import json
import os
import re
import select
import socket
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
from msgspec import UNSET, UnsetType

from daemon.console.interpreter import CommandResult, Interpreter
from daemon.console.stop_words import means_stop
from daemon.console.text_layout import LOWEST, NARROWEST, WIDEST
from daemon.errors import NOT_DONE, NOT_UNDERSTOOD, CommandError, printable, visible
from daemon.frontends.client import LONGEST_FILE
from daemon.frontends.command_queue import CROWDED, CommandQueue, Interrupt
from daemon.frontends.line_editor import COLUMNS
from daemon.frontends.rights import FrontendError, May, Peer, Rights, peer_of

LONGEST_MESSAGE = 64 * 1024
LONE_SURROGATE = re.compile(r"\\u[dD][c-fC-F]")
COMMAND_TEXT = re.compile(r'"(?:do|answer)"\s*:\W*(.*)', re.DOTALL)
MOST_UNREAD = 256 * 1024
"""Bytes sent but unread, beyond which notices to an operator are dropped."""
MOST_BACKLOG = 16_000_000
"""Bytes sent but unread, beyond which the connection is closed."""
MOST_EACH, MOST_TOGETHER, MOST_TO_STOP = 32, 256, 128
"""Connections of one user, of all, and beyond those, for a stop. Together far below the unit's limit of descriptors."""
WAITING = 16
"""Connections accepted in one turn of the loop: few enough that none pushes out one for a stop before that is read."""
FIRST_MESSAGE_S, IDLE_S, STOP_S = 30.0, 600.0, 5.0
"""Seconds of silence before the connection is closed: of a client that never sent anything; of one that waits for
neither answers nor notices, or does not read them; of one that came only to stop, or is closing."""
SHOWN = ("say", "ask", "notice", "stopped")


class SocketMessage(msgspec.Struct):
    """A message from a client."""

    do: str | UnsetType = UNSET
    frontend: str | UnsetType = UNSET
    door: str | UnsetType = UNSET
    """The earlier name of `frontend`."""
    asks: bool | UnsetType = UNSET
    id: int | str | UnsetType | None = UNSET
    size: tuple[int, int | None] | UnsetType = UNSET
    block: int | str | UnsetType | None = UNSET
    waits: bool = False
    answer: str | UnsetType = UNSET
    interrupt: bool | UnsetType = UNSET
    complete: str | UnsetType = UNSET
    notices: bool | UnsetType = UNSET
    file: str | UnsetType = UNSET
    more: bool = False
    no_file: str | UnsetType = UNSET
    keys: str | UnsetType = UNSET
    leave: bool | UnsetType = UNSET


class SocketServer:
    """Listens at a path; each connection is one operator."""

    def __init__(self, path: Path, rights: Rights, interpreter: Interpreter, interrupt: Interrupt) -> None:
        self.path, self._rights, self._interpreter, self._interrupt = path, rights, interpreter, interrupt
        self._server: asyncio.Server | None = None
        self._operators: dict[asyncio.Task[None], int] = {}
        """User id of each connection."""
        self._to_stop: dict[asyncio.Task[None], None] = {}
        """Connections beyond the limits, oldest first."""

    async def open(self) -> None:
        """Bind the socket, with the group and mode of rights.py. Raises FrontendError."""
        if len(os.fsencode(self.path)) > 100:
            raise FrontendError(f"{self.path}: too long for a socket's path; set folders.runtime to a shorter one")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._take_over()
            before = os.umask(0o177)
            try:
                self._server = await asyncio.start_unix_server(
                    self._admit, self.path, limit=LONGEST_MESSAGE, backlog=WAITING
                )
            finally:
                os.umask(before)
            try:
                self._give_to(self._rights.group)
                os.chmod(self.path, self._rights.mode)
            except (FrontendError, OSError):
                await self.close()
                raise
        except OSError as error:
            raise FrontendError(f"{self.path}: cannot listen here: {error.strerror or error}") from None

    def _give_to(self, group: int) -> None:
        """Change the socket's group only where it differs: the unit's system call filter allows no chown."""
        if os.stat(self.path).st_gid == group:
            return
        try:
            os.chown(self.path, -1, group)
        except OSError as error:
            what = f"{self.path}: cannot be given to console.group: {error.strerror}"
            raise FrontendError(f"{what}; make it the daemon's own group (`systemctl edit facetd`, Group=)") from None

    async def close(self) -> None:
        """Close the socket and every connection; safe to call twice."""
        if self._server is None:
            return
        self._server.close()
        self._server = None
        self.path.unlink(missing_ok=True)
        tasks = [*self._operators, *self._to_stop]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _take_over(self) -> None:
        """Remove the socket of a dead daemon. Raises FrontendError where one lives, or the file is no socket."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
            probe.setblocking(False)  # a hanging daemon accepts no connection, but is alive
            try:
                probe.connect(str(self.path))
            except FileNotFoundError:
                return
            except BlockingIOError:
                pass
            except ConnectionRefusedError:
                if not self.path.is_socket():
                    raise FrontendError(f"{self.path}: is no socket; move it away, facetd puts one there") from None
                self.path.unlink()
                return
        raise FrontendError(f"{self.path}: another facetd answers there; stop it first")

    async def _admit(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        peer = peer_of(writer.get_extra_info("socket"))
        may = self._rights.of(peer)
        operator = SocketFrontend(reader, writer, self._interpreter, self._interrupt, peer, may or "look")
        try:
            if may is None:
                await operator.refuse("permission denied: your user is in neither console.group nor console.look_group")
            elif self._crowded(peer):
                self._drop_oldest(task)
                await operator.listen_for_a_stop()
            else:
                self._operators[task] = peer.user
                await operator.listen()
        except (ConnectionError, TimeoutError, asyncio.CancelledError):
            pass
        finally:
            operator.leave()
            await _close(writer)
            self._operators.pop(task, None)
            self._to_stop.pop(task, None)

    def _crowded(self, peer: Peer) -> bool:
        return len(self._operators) >= MOST_TOGETHER or Counter(self._operators.values())[peer.user] >= MOST_EACH

    def _drop_oldest(self, newest: asyncio.Task[None]) -> None:
        """Close the oldest of the connections that wait: a client that came to stop sends that at once."""
        for oldest in list(self._to_stop)[: len(self._to_stop) - MOST_TO_STOP + 1]:
            del self._to_stop[oldest]
            oldest.cancel()
        self._to_stop[newest] = None


class SocketFrontend:
    """One connection: the Frontend that commands see."""

    def __init__(
        self,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        interpreter: Interpreter,
        interrupt: Interrupt,
        peer: Peer,
        may: May,
    ) -> None:
        self._reader, self._writer, self._interpreter = reader, writer, interpreter
        self.name, self.asks, self.who, self.may = "socket", False, str(peer), may
        self.shown: int | None = None
        self.columns: int = COLUMNS
        self.rows: int | None = None
        self._has_sent = self._gets_notices = False
        self._queue = CommandQueue(interpreter, self, interrupt, self._show_question, self._send_stopping)
        self._file: asyncio.Future[bytes] | None = None
        self._content = bytearray()
        self._typed: Callable[[bytes], None] | None = None
        self._terminal_left = asyncio.Event()

    async def listen(self) -> None:
        """Serve the operator until they disconnect, or are silent for long and wait for nothing."""
        while line := await self._next_line():
            self._has_sent = True
            try:
                self._handle(parse_message(line))
            except ValueError as error:
                # Do not wait until they read this: their next line may be a stop.
                self._write({"done": _as_json(CommandResult(f"not a message: {error}", {}, 2))})
        if _still_receives(self._writer.get_extra_info("socket")):  # its input ended, it waits for answers
            self._interpreter.context.notices.leave(self)
            self._queue.input_ended()
            self._terminal_left.set()
        else:
            self.leave()
        await self._queue.end()

    async def listen_for_a_stop(self) -> None:
        """Serve a connection beyond the limits, for a stop only. Raises TimeoutError where it sends nothing."""
        message = SocketMessage()
        with contextlib.suppress(ValueError):
            async with asyncio.timeout(STOP_S):
                message = parse_message(await self._reader.readline())
        if message.interrupt is UNSET and not (isinstance(message.do, str) and means_stop(message.do)):
            await self.refuse("too many connections: close some (`stop` and control-C still work)")
            return
        self._handle(message)
        await self._queue.end()

    async def refuse(self, why: str) -> None:
        """Say why this connection serves nothing else."""
        await self._send({"done": _as_json(CommandResult(why, {"error": why}, NOT_DONE))})

    def leave(self) -> None:
        """The operator disconnected: their command goes on, questions to them get an empty answer."""
        self._interpreter.context.notices.leave(self)
        self._queue.leave()
        self._terminal_left.set()
        if self._file is not None and not self._file.done():
            self._file.set_exception(CommandError("the operator disconnected"))

    async def say(self, text: str) -> None:
        """Send lines now, without waiting until they are read: a moving arm may be the sender."""
        self._write({"say": text})

    def notice(self, text: str) -> None:
        """Send an unsolicited message."""
        if self._writer.transport.get_write_buffer_size() < MOST_UNREAD:
            self._write({"notice": text})

    async def ask(self, question: str) -> str:
        return await self._queue.ask(question)

    async def fetch(self, path: str) -> bytes:
        """Read a file on the operator's machine. Raises CommandError."""
        if self._queue.disconnected:
            raise CommandError("the operator disconnected")
        self._file, self._content = asyncio.get_running_loop().create_future(), bytearray()
        await self._send({"fetch": path})
        return await self._file

    async def terminal(self, typed: Callable[[bytes], None]) -> None:
        """Pass keys to `typed` until the operator leaves."""
        if not self.asks:
            raise CommandError("this works only at a terminal", NOT_UNDERSTOOD)
        self._terminal_left.clear()
        self._typed = typed
        await self._send({"terminal": True})
        try:
            await self._terminal_left.wait()
        finally:
            self._typed = None
            self._write({"terminal": False})  # this may follow a stop, which must not wait until it is read

    def show(self, data: bytes) -> None:
        self._write({"show": data.decode("latin-1")})

    async def _next_line(self) -> bytes:
        while True:
            try:
                async with asyncio.timeout(IDLE_S if self._has_sent else FIRST_MESSAGE_S):
                    return await self._reader.readline()
            except ValueError:
                await self._send({"done": _as_json(CommandResult("the message is too long", {}, 2))})
                return b""
            except TimeoutError:
                if not (self._gets_notices or self._queue.busy or self._queue.asking):
                    return b""

    def _handle(self, message: SocketMessage) -> None:
        if message.interrupt is not UNSET or (isinstance(message.keys, str) and "\x03" in message.keys):
            self._queue.start_now(self._stop)
        elif isinstance(message.do, str):
            self._take_command(message.do if means_stop(message.do) else printable(message.do, names=True), message)
        elif isinstance(message.answer, str):
            if self._interpreter.withdraws(message.answer):
                self._queue.take(message.answer, self._stopped)
            elif message.id == self._queue.question:
                answer = printable(message.answer)
                if not self._queue.answer(answer) and self._queue.asking:
                    self._queue.take(answer, self._shown)
        elif isinstance(message.file, str) or isinstance(message.no_file, str):
            self._take_file(message.file, message.no_file, message.more)
        elif isinstance(message.keys, str):
            if self._typed is not None:
                self._typed(message.keys.encode("latin-1", "replace"))
        elif message.leave is not UNSET:
            self._terminal_left.set()
        elif isinstance(message.complete, str):
            self._write({"options": self._interpreter.complete(message.complete)})
        elif message.notices is not UNSET:
            if not self._gets_notices:
                self._interpreter.context.notices.listen(self)
            self._gets_notices = True
        else:
            raise ValueError("it has none of the keys do, answer, file, keys, leave, interrupt, complete, notices")

    def _take_command(self, text: str, message: SocketMessage) -> None:
        stops = self._interpreter.means_stop(text)
        if self._queue.busy and not message.waits and not stops and not self._interpreter.at_once(text):
            raise ValueError("the last command is still running")
        if not self._queue.has_room_for(text):
            raise ValueError(CROWDED)
        if not stops and len(message.do.strip().splitlines() if isinstance(message.do, str) else ()) > 1:
            raise ValueError("a command is one line")
        name = message.door if message.frontend is UNSET else message.frontend
        self.name = self.name if name is UNSET else printable(name[:20])
        self.asks = self.asks if message.asks is UNSET else message.asks
        if message.size is not UNSET:
            columns, rows = message.size
            self.columns, self.rows = min(max(columns, NARROWEST), WIDEST), None if rows is None else max(rows, LOWEST)
        number = {} if message.id is UNSET else {"id": message.id}

        async def answered(answer: CommandResult) -> None:
            await self._send({"done": _as_json(answer), **number})

        self._queue.take(text, answered, None if message.block is UNSET else message.block)

    def _take_file(self, piece: str | UnsetType, no_file: str | UnsetType, more: bool) -> None:
        """Take one part of a fetched file, or the reason why it cannot be sent."""
        if self._file is None or self._file.done():
            return
        if piece is UNSET:
            self._file.set_exception(CommandError(printable(str(no_file)), NOT_UNDERSTOOD))
            return
        self._content += base64.b64decode(piece, validate=True)
        if len(self._content) > LONGEST_FILE:
            self._file.set_exception(CommandError(f"a file may have {LONGEST_FILE // 1_000_000} MB at most"))
        elif not more:
            self._file.set_result(bytes(self._content))

    async def _stop(self) -> None:
        await self._send({"stopped": await self._queue.stop(f"{self.who}, {self.name}")})

    async def _shown(self, answer: CommandResult) -> None:
        await self.say(answer.text)

    async def _stopped(self, answer: CommandResult) -> None:
        await self._send({"stopped": answer.text})

    def _send_stopping(self) -> None:
        self._write({"stopping": True})

    def _show_question(self, question: str | None) -> None:
        number = self._queue.question
        self._write({"unasked": number} if question is None else {"ask": question, "id": number})

    def _write(self, message: dict[str, Any]) -> None:
        if self._writer.transport.get_write_buffer_size() > MOST_BACKLOG:
            self._writer.transport.abort()
        elif not self._queue.disconnected:
            printable_message = message | {key: visible(message[key]) for key in SHOWN if key in message}
            self._writer.write(json.dumps(printable_message, default=str).encode() + b"\n")

    async def _send(self, message: dict[str, Any]) -> None:
        self._write(message)
        try:
            async with asyncio.timeout(IDLE_S):
                await self._writer.drain()
        except TimeoutError:
            self._writer.transport.abort()
        except ConnectionError:
            pass


def _still_receives(connection: socket.socket) -> bool:
    """Whether the other end, which sends nothing more, can still receive."""
    poll = select.poll()
    poll.register(connection.fileno(), 0)
    return not poll.poll(0)


async def _close(writer: asyncio.StreamWriter) -> None:
    """Close the connection; data on its way has STOP_S to be read."""
    writer.close()
    with contextlib.suppress(ConnectionError, TimeoutError, asyncio.CancelledError):
        async with asyncio.timeout(STOP_S):
            await writer.wait_closed()
    writer.transport.abort()


def parse_message(line: bytes) -> SocketMessage:
    """Parse one line. A line that is no message but means a stop counts as a stop. Raises ValueError."""
    text = line.decode("utf-8", "replace")
    command_text = COMMAND_TEXT.search(text)
    if means_stop(text):
        return SocketMessage(do="stop")
    try:
        if LONE_SURROGATE.search(text):  # in a file name that is no UTF-8; msgspec refuses it
            return msgspec.convert(json.loads(text), type=SocketMessage)
        return msgspec.json.decode(text, type=SocketMessage)
    except (msgspec.MsgspecError, RecursionError, ValueError) as error:
        if command_text is not None and means_stop(command_text[1]):
            return SocketMessage(do="stop")
        raise ValueError(str(error)) from None


def _as_json(answer: CommandResult) -> dict[str, Any]:
    return {"text": visible(answer.text), "data": answer.data, "status": answer.status}
