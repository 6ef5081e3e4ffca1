"""Serial console: an operator at a terminal on a tty. line_editor.py handles typing, the console package meaning.

The port is opened again when it went away. Nothing here waits for a slow terminal: what it does not take yet is queued.
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
from daemon.console.interpreter import CommandError, CommandResult, Interpreter
from daemon.console.stop_words import ends_in_stop
from daemon.errors import NOT_UNDERSTOOD
from daemon.frontends.client import LONGEST_FILE, files_begun
from daemon.frontends.command_queue import CROWDED, CommandQueue, Interrupt
from daemon.frontends.line_editor import ASK_SIZE, EditorKey, LineEditor, to_terminal
from daemon.store.outside import FileError, read_file

PROMPT, ASKED = "facetd> ", "? "
BUSY = ""
"""No prompt while a command is being done; what is typed ahead is shown."""
GREETING = "facetd console. `help` leads on;\ncontrol-C stops the arm."
"""No line longer than the narrowest terminal: its width is asked for with this."""
LEAVE, STOP = b"\x1d", b"\x03"
"""Control-] and control-C: what terminal mode does not pass on."""
KILL_LINE = b"\x15"
RETRY_S = 5.0
QUEUE_LIMIT = 256 * 1024


class SerialFrontend:
    """The Frontend at a serial terminal, and its life. Commands are done one by one; control-C is heard at once."""

    name = "terminal"
    asks = True

    def __init__(
        self,
        settings: SerialTerminalSettings,
        interpreter: Interpreter,
        interrupt: Interrupt,
        trouble: Callable[[str | None], None],
    ) -> None:
        """trouble: told in one line when the port cannot be had, None when it can."""
        self.who = f"operator at {settings.device}"
        self.may: Literal["look", "all"] = settings.may
        self.shown: int | None = None
        self._settings, self._trouble, self._notices = settings, trouble, interpreter.context.notices
        self._queue = CommandQueue(interpreter, self, interrupt, self._show_question)
        self._editor = LineEditor(PROMPT, partial(_complete, interpreter))
        self._port: serial.Serial | None = None
        self._out: deque[bytes] = deque()
        self._lost = asyncio.Event()
        self._keys: Callable[[bytes], None] | None = None
        self._unshown = self._read_before = False
        """Whether a question is put that is not shown yet; whether something was read before the loop had called."""
        self._taken: list[str] = []
        """What of the line being typed stood there when a question came: a stop may be amid it."""
        self._left = asyncio.Event()

    async def run(self) -> None:
        """Serve the terminal until cancelled."""
        try:
            while True:
                if self._open():
                    self._trouble(None)
                    self._write(ASK_SIZE + b"\r\n" + to_terminal(GREETING) + self._editor.show_prompt())
                    self._notices.listen(self)
                    await self._lost.wait()
                await asyncio.sleep(RETRY_S)
        finally:
            self._close()

    async def say(self, text: str) -> None:
        self.notice(text)

    async def ask(self, question: str) -> str:
        """Put a question and wait for the line that answers it; empty after control-C or when the port is gone."""
        return await self._queue.ask(question)

    async def fetch(self, path: str) -> bytes:
        """A file on this machine: behind a serial terminal there is no other."""
        try:
            return await asyncio.to_thread(read_file, Path(path), LONGEST_FILE)
        except FileError as error:
            raise CommandError(str(error), NOT_UNDERSTOOD) from None

    async def terminal(self, typed: Callable[[bytes], None]) -> None:
        """Keys go to `typed`, past the line editor, until control-] or until the port is gone."""
        self._keys, self._left = typed, asyncio.Event()
        try:
            await self._left.wait()
        finally:
            self._keys = None

    def show(self, data: bytes) -> None:
        self._write(data)

    @property
    def columns(self) -> int:
        """As the terminal says; the last is left free, where some terminals wrap by themselves."""
        return self._editor.columns - 1

    @property
    def rows(self) -> int | None:
        return self._editor.rows

    def notice(self, text: str) -> None:
        """Lines above the one being typed, which is drawn again: answers, and faults that nobody asked for."""
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
        self._lost.clear()
        self._queue.gone = False
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
        self._out.clear()
        self._notices.leave(self)
        self._queue.leave()
        self._lost.set()
        self._left.set()

    def _readable(self) -> None:
        assert self._port is not None
        try:
            data = os.read(self._port.fileno(), 4096)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data and self._read_before:
            # What it was called for was read meanwhile; for a terminal that is gone it is called again.
            self._read_before = False
            return
        if not data:
            self._trouble(f"console.tty: {self._settings.device}: the terminal is gone")
            self._close()
            return
        if self._keys is not None:
            self._raw(data)
            return
        typed = self._editor.feed(data)
        self._write(typed.echo)
        for event in typed.events:
            self._hear(event)

    def _raw(self, data: bytes) -> None:
        """Keys in terminal mode: only control-] and control-C are ours."""
        keys, leave, _ = data.partition(LEAVE)
        if STOP in data:
            self._queue.beside(self._stop)
        elif self._keys is not None and keys:
            self._keys(keys)
        if leave:
            self._left.set()

    def _hear(self, event: str | EditorKey) -> None:
        if isinstance(event, str) and ends_in_stop(self._taken, event):
            event = "stop"
        self._taken.clear()
        if event is EditorKey.INTERRUPT:
            self._queue.beside(self._stop)
        elif event == "" and (self._unshown or not self._queue.asking):
            self._write(ASK_SIZE + self._editor.show_prompt())  # whoever sits down and presses Enter
        elif isinstance(event, str) and not self._unshown and self._queue.answer(event):
            pass
        elif isinstance(event, str) and not self._queue.has_room_for(event):
            self.notice(CROWDED)
        elif isinstance(event, str):
            self._queue.take(event, self._answered)
            self._set_prompt()

    async def _answered(self, answer: CommandResult) -> None:
        self._set_prompt()
        self.notice(answer.text)

    async def _stop(self) -> None:
        self.notice(await self._queue.stop(self.who))

    def _show_question(self, question: str | None) -> None:
        if question is not None:
            self._hear_what_came_before()
        self._set_prompt()
        if question is not None:
            self._taken += filter(None, [self._editor.text])
            self._editor.feed(KILL_LINE)  # what was typed for something else is no answer
            self.notice(question)

    def _hear_what_came_before(self) -> None:
        """What was typed by now, and nobody had time to read, was typed before the question is shown: no answer."""
        self._unshown = True
        with contextlib.suppress(OSError, serial.SerialException):  # a terminal that is gone is told by its reader
            if self._port is not None and self._port.in_waiting:
                self._read_before = True
                self._readable()
        self._unshown = False

    def _set_prompt(self) -> None:
        asked = self._queue.asking
        self._editor.prompt = ASKED if asked else BUSY if self._queue.busy else PROMPT
        self._editor.remember = not asked

    def _write(self, data: bytes) -> None:
        if self._port is None or not data or sum(map(len, self._out)) > QUEUE_LIMIT:
            return
        self._out.append(data)
        self._writable()

    def _writable(self) -> None:
        assert self._port is not None
        loop, handle = asyncio.get_running_loop(), self._port.fileno()
        try:
            while self._out:
                count = os.write(handle, self._out[0])
                if count < len(self._out[0]):
                    self._out[0] = self._out[0][count:]
                else:
                    self._out.popleft()
            loop.remove_writer(handle)
        except BlockingIOError:
            loop.add_writer(handle, self._writable)
        except OSError:
            self._out.clear()
            loop.remove_writer(handle)


def _complete(interpreter: Interpreter, typed: str) -> list[str]:
    """Every line that the typed one may become; files are this machine's."""
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
