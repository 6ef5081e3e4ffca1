"""The keyboard of whoever sits at this terminal, or the pipe in its place: line by line, for what waits and may ask, as
a stop may come at any moment; and key by key, for the time in which they talk to the controller itself.

Keys go out as they are pressed, in a thread; what comes back is shown as it comes. What keys mean is not known here,
but for two: control-] leaves, control-C stops the arm.
"""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any

from daemon.console.stop_words import ends_in_stop

LEAVE, STOP = b"\x1d", b"\x03"
POLL_S = 0.1
_MODE = threading.Lock()
"""Held while this terminal changes its mode, and from seeing that something waits in it until that is read: a key that
another reader has taken meanwhile would be waited for, for ever."""


class InputLines:
    """The lines of standard input, a terminal's or a pipe's, read from construction to close() as they come, in a
    thread: nobody knows when a stop does. One that means to stop goes to `stop` at once, and what waits is dropped;
    another answers the question that was shown before it, where one stands, or else waits to be said in its turn."""

    def __init__(self, stop: Callable[[str], None], say: Callable[[str], None]) -> None:
        """say: told of what waited and is not done."""
        self._stop, self._say = stop, say
        self.waiting: SimpleQueue[str | None] = SimpleQueue()
        """What was typed for nobody's question, in its order; None where the input ends."""
        self.stopped = self._ended = False
        """Whether a stop was typed; whether nothing more comes."""
        self._question: str | None = None
        self._shown: str | None = None
        self._answers: SimpleQueue[str] = SimpleQueue()
        self._begun = b""
        self._taken: list[str] = []
        """What of the line being typed stood there when questions came: it answers none, and a stop may be amid it."""
        self._over, self._wake = threading.Event(), os.eventfd(0)
        self._thread = threading.Thread(target=self._read, name="lines", daemon=True)
        self._thread.start()

    def __enter__(self) -> InputLines:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def answer(self, question: str) -> str:
        """The line typed after a question was shown; empty at the end of input, and where it was to stop."""
        while not self._answers.empty():
            self._answers.get()
        self._question = question
        os.eventfd_write(self._wake, 1)
        try:
            return "" if self._ended else self._answers.get()
        finally:
            self._question = None

    def drop(self) -> None:
        """What waits is not said any more, and told so."""
        self._tell_dropped(self._dropped())

    def close(self) -> None:
        """Listen no longer, once a stop that is being said was."""
        self._over.set()
        os.eventfd_write(self._wake, 1)
        self._thread.join()
        os.close(self._wake)

    def _read(self) -> None:
        handle = sys.stdin.fileno()
        while not self._over.is_set():
            ready = select.select([handle, self._wake], [], [])[0]
            if self._wake in ready:
                os.eventfd_read(self._wake)
                self._put(handle)
            elif (data := _waits_at(handle)) is None:
                self._over.wait(POLL_S)
            elif data:
                self._take(data)
            else:
                self._end(os.isatty(handle))

    def _put(self, handle: int) -> None:
        """Show the question, if there is one: what was typed by now was not for it."""
        question = self._question
        if question is None:
            return
        if _gives_lines(handle):
            self._take(typed_by_now())
        self._taken.append(self._begun.decode("utf-8", "replace"))
        self._begun = b""
        print(question, end=" ", flush=True)
        self._shown = question

    def _take(self, data: bytes) -> None:
        *lines, self._begun = (self._begun + data).replace(b"\r", b"\n").split(b"\n")
        for line in lines:
            self._hear(line.decode("utf-8", "replace").strip())

    def _hear(self, line: str) -> None:
        stops = ends_in_stop(self._taken, line)
        self._taken.clear()
        if stops:
            self.stopped, dropped = True, self._dropped()
            self._stop(line)
            self._answers.put("")
            self._tell_dropped(dropped)
        elif self._question is not None and self._shown is self._question:
            self._answers.put(line)
        else:
            self.waiting.put(line)

    def _dropped(self) -> list[str]:
        """What waits, taken away; but the end is the end."""
        dropped: list[str] = []
        with contextlib.suppress(Empty):
            while (line := self.waiting.get_nowait()) is not None:
                dropped.append(line)
            self.waiting.put(None)
        return dropped

    def _tell_dropped(self, dropped: list[str]) -> None:
        for line in filter(None, dropped):
            self._say(f"not done: {line}")

    def _end(self, more_may_come: bool) -> None:
        """The end of a pipe is the last of it; behind control-D a terminal may still say stop."""
        if self._begun:
            self._take(b"\n")
        self._ended = not more_may_come
        self._answers.put("")
        self.waiting.put(None)
        if more_may_come:
            self._over.wait(POLL_S)  # one that was hung up is at its end for ever
        else:
            self._over.set()


def typed_by_now() -> bytes:
    """All that was typed at this terminal and is not read yet, the line being typed as well: where somebody is asked
    something, it was for something else, and may be a stop. Nothing where this is no terminal."""
    if not sys.stdin.isatty():
        return b""
    handle = sys.stdin.fileno()
    with _MODE:
        before, mode = termios.tcgetattr(handle), termios.tcgetattr(handle)
        mode[3] &= ~termios.ICANON
        mode[6][termios.VMIN], mode[6][termios.VTIME] = 0, 0
        termios.tcsetattr(handle, termios.TCSANOW, mode)
        try:
            return _read_from(handle)
        finally:
            termios.tcsetattr(handle, termios.TCSANOW, before)


def _waits_at(handle: int) -> bytes | None:
    """What waits there for who reads lines; None where nothing does, or not for them."""
    with _MODE:
        return _read_from(handle) if _gives_lines(handle) and select.select([handle], [], [], 0)[0] else None


def _read_from(handle: int) -> bytes:
    """What came; nothing at the end, and where the terminal is gone."""
    try:
        return os.read(handle, 4096)
    except OSError:
        return b""


def _gives_lines(handle: int) -> bool:
    """Whether lines come here for us: not from a terminal that somebody else in front of us reads (we would be stopped
    for it), or that gives its keys one by one to whom they are meant for (RawKeyboard, a pager)."""
    if not os.isatty(handle):
        return True
    with contextlib.suppress(OSError):  # no terminal of our own session keeps nobody from reading
        if os.tcgetpgrp(handle) != os.getpgrp():
            return False
    return bool(termios.tcgetattr(handle)[3] & termios.ICANON)


class RawKeyboard:
    """From construction to close() every key goes to `send` as a socket message, control-C to `stop`.

    Needs a terminal.
    """

    def __init__(self, send: Callable[[dict[str, Any]], None], stop: Callable[[], None]) -> None:
        self._send, self._stop = send, stop
        self._handle = sys.stdin.fileno()
        self._before = termios.tcgetattr(self._handle)
        with _MODE:
            tty.setcbreak(self._handle)
            mode = termios.tcgetattr(self._handle)
            mode[0] &= ~(termios.ICRNL | termios.IXON)
            mode[3] &= ~(termios.ISIG | termios.IEXTEN)
            termios.tcsetattr(self._handle, termios.TCSANOW, mode)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._read, name="keyboard", daemon=True)
        self._thread.start()

    def show(self, text: str) -> None:
        """What the controller says, one character a byte."""
        sys.stdout.write(text)
        sys.stdout.flush()

    def close(self) -> None:
        """The terminal as it was before; safe to call twice."""
        self._over.set()
        self._thread.join()
        with _MODE:
            termios.tcsetattr(self._handle, termios.TCSADRAIN, self._before)

    def _read(self) -> None:
        while not self._over.is_set():
            if not select.select([self._handle], [], [], POLL_S)[0]:
                continue
            keys = os.read(self._handle, 1024)
            typed, leave, _ = keys.partition(LEAVE)
            if STOP in keys:
                self._stop()
            elif typed:
                self._send({"keys": typed.decode("latin-1")})
            if leave or not keys:
                self._send({"leave": True})
                return
