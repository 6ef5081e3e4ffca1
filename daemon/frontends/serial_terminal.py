"""Serial console: an operator at a terminal on a tty. line_editor.py handles keys, daemon/console/ commands.

It opens the port again after it was lost. It never waits for a slow terminal: output that does not fit is queued.
"""

import asyncio
import contextlib
import os
import termios
from collections import deque
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Literal

import serial

from daemon.config import SerialTerminalSettings
from daemon.console.interpreter import CommandResult, Interpreter
from daemon.console.stop_words import ends_in_stop
from daemon.errors import NOT_UNDERSTOOD, CommandError
from daemon.frontends.client import LONGEST_FILE, files_begun
from daemon.frontends.command_queue import CROWDED, CommandQueue, Interrupt
from daemon.frontends.line_editor import ASK_SIZE, EditorKey, LineEditor, to_terminal
from daemon.store.outside import FileError, read_file

PROMPT, ASKED = "facetd> ", "? "
BUSY = ""
"""No prompt while a command runs; characters typed ahead are shown."""
GREETING = "facetd console. `help` leads on;\ncontrol-C stops the arm."
"""No line longer than the narrowest terminal: the terminal's width is still unknown."""
LEAVE, STOP = b"\x1d", b"\x03"
"""Control-] and control-C, which terminal mode does not pass on."""
KILL_LINE = b"\x15"
RETRY_S = 5.0
QUEUE_LIMIT = 256 * 1024


class SerialFrontend:
    """The frontend of a serial terminal. Commands run one by one; control-C works at once."""

    name = "terminal"
    asks = True

    def __init__(
        self,
        settings: SerialTerminalSettings,
        interpreter: Interpreter,
        interrupt: Interrupt,
        trouble: Callable[[str | None], None],
    ) -> None:
        """trouble: called with one line when the port cannot be opened, with None when it can."""
        self.who = f"operator at {settings.device}"
        self.may: Literal["look", "all"] = settings.may
        self.shown: int | None = None
        self._settings, self._trouble, self._notices = settings, trouble, interpreter.context.notices
        self._queue = CommandQueue(interpreter, self, interrupt, self._show_question)
        self._editor = LineEditor(PROMPT, partial(_complete, interpreter))
        self._port: serial.Serial | None = None
        self._output: deque[bytes] = deque()
        self._port_lost = asyncio.Event()
        self._key_sink: Callable[[bytes], None] | None = None
        self._unshown = self._read_before = False
        """Whether a question is open but not shown yet; whether data was read before the loop called for it."""
        self._interrupted_input: list[str] = []
        """Parts of the line being typed that questions interrupted: they may contain a stop."""
        self._terminal_left = asyncio.Event()

    async def run(self) -> None:
        """Serve the terminal until cancelled."""
        try:
            while True:
                if self._open():
                    self._trouble(None)
                    self._write(ASK_SIZE + b"\r\n" + to_terminal(GREETING) + self._editor.show_prompt())
                    self._notices.listen(self)
                    await self._port_lost.wait()
                await asyncio.sleep(RETRY_S)
        finally:
            self._close()

    async def say(self, text: str) -> None:
        self.notice(text)

    async def ask(self, question: str) -> str:
        """Ask a question and wait for the answer; empty after control-C or when the port is lost."""
        return await self._queue.ask(question)

    async def fetch(self, path: str) -> bytes:
        """Read a file of this machine: a serial terminal has none of its own."""
        try:
            return await asyncio.to_thread(read_file, Path(path), LONGEST_FILE)
        except FileError as error:
            raise CommandError(str(error), NOT_UNDERSTOOD) from None

    async def terminal(self, typed: Callable[[bytes], None]) -> None:
        """Pass keys to `typed`, past the line editor, until control-] or until the port is lost."""
        self._key_sink, self._terminal_left = typed, asyncio.Event()
        try:
            await self._terminal_left.wait()
        finally:
            self._key_sink = None

    def show(self, data: bytes) -> None:
        self._write(data)

    @property
    def columns(self) -> int:
        """The width that the terminal reports, less one: some terminals wrap in the last column."""
        return self._editor.columns - 1

    @property
    def rows(self) -> int | None:
        return self._editor.rows

    def notice(self, text: str) -> None:
        """Print lines above the line being typed, and draw that again."""
        self._write(self._editor.notice(text) if text else self._editor.show_prompt())

    def _open(self) -> bool:
        settings = self._settings
        try:
            self._port = serial.Serial(
                settings.device, settings.baud, timeout=0, xonxoff=settings.flow_control, exclusive=True
            )
        except (serial.SerialException, OSError, ValueError, termios.error) as error:
            self._trouble(f"console.tty: {settings.device}: {_reason(error)}")
            return False
        os.set_blocking(self._port.fileno(), False)
        self._port_lost.clear()
        self._queue.disconnected = False
        asyncio.get_running_loop().add_reader(self._port.fileno(), self._readable)
        return True

    def _close(self) -> None:
        if self._port is not None:
            loop = asyncio.get_running_loop()
            loop.remove_reader(self._port.fileno())
            loop.remove_writer(self._port.fileno())
            with contextlib.suppress(OSError, serial.SerialException):
                self._port.close()
        self._port = None
        self._output.clear()
        self._notices.leave(self)
        self._queue.leave()
        self._port_lost.set()
        self._terminal_left.set()

    def _readable(self) -> None:
        assert self._port is not None
        try:
            data = os.read(self._port.fileno(), 4096)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data and self._read_before:
            # The data was read before this call; for a lost terminal the loop calls again.
            self._read_before = False
            return
        if not data:
            self._trouble(f"console.tty: {self._settings.device}: the terminal is gone")
            self._close()
            return
        if self._key_sink is not None:
            self._raw(data)
            return
        typed = self._editor.feed(data)
        self._write(typed.echo)
        for event in typed.events:
            self._handle(event)

    def _raw(self, data: bytes) -> None:
        """Pass on keys in terminal mode, except control-] and control-C."""
        keys, leave, _ = data.partition(LEAVE)
        if STOP in data:
            self._queue.start_now(self._stop)
        elif self._key_sink is not None and keys:
            self._key_sink(keys)
        if leave:
            self._terminal_left.set()

    def _handle(self, event: str | EditorKey) -> None:
        begun, self._interrupted_input = self._interrupted_input, []
        if event is EditorKey.INTERRUPT:
            self._queue.start_now(self._stop)
        if isinstance(event, EditorKey):
            return
        line = "stop" if ends_in_stop(begun, event) else event
        if line == "" and (self._unshown or not self._queue.asking):
            self._write(ASK_SIZE + self._editor.show_prompt())  # Enter at an idle terminal
        elif self._unshown or not self._queue.answer(line):
            if self._queue.has_room_for(line):
                self._queue.take(line, self._answered)
                self._set_prompt()
            else:
                self.notice(CROWDED)

    async def _answered(self, answer: CommandResult) -> None:
        self._set_prompt()
        self.notice(answer.text)

    async def _stop(self) -> None:
        self.notice(await self._queue.stop(self.who))

    def _show_question(self, question: str | None) -> None:
        if question is not None:
            self._read_earlier_input()
        self._set_prompt()
        if question is not None:
            self._interrupted_input += filter(None, [self._editor.text])
            self._editor.feed(KILL_LINE)  # text typed before the question is no answer
            self.notice(question)

    def _read_earlier_input(self) -> None:
        """Read input that was typed before the question is shown: it does not answer it."""
        self._unshown = True
        with contextlib.suppress(OSError, serial.SerialException):  # the reader reports a lost terminal
            if self._port is not None and self._port.in_waiting:
                self._read_before = True
                self._readable()
        self._unshown = False

    def _set_prompt(self) -> None:
        asked = self._queue.asking
        self._editor.prompt = ASKED if asked else BUSY if self._queue.busy else PROMPT
        self._editor.remember = not asked

    def _write(self, data: bytes) -> None:
        if self._port is None or not data or sum(map(len, self._output)) > QUEUE_LIMIT:
            return
        self._output.append(data)
        self._writable()

    def _writable(self) -> None:
        assert self._port is not None
        loop, handle = asyncio.get_running_loop(), self._port.fileno()
        try:
            while self._output:
                count = os.write(handle, self._output[0])
                if count < len(self._output[0]):
                    self._output[0] = self._output[0][count:]
                else:
                    self._output.popleft()
            loop.remove_writer(handle)
        except BlockingIOError:
            loop.add_writer(handle, self._writable)
        except OSError:
            self._output.clear()
            loop.remove_writer(handle)


def _complete(interpreter: Interpreter, typed: str) -> list[str]:
    """Completions of the line typed so far; file names are those of this machine."""
    files = files_begun(typed)
    return interpreter.complete(typed) if files is None else files


def _reason(error: Exception) -> str:
    text = str(error)
    if "exclusively lock" in text or "busy" in text:
        return "in use by another program (a getty?); stop it or name another port"
    if "No such file" in text:
        return "no such port; is the adapter plugged in?"
    if "ermission denied" in text:
        return "permission denied; is the daemon's user in the group dialout?"
    return text
