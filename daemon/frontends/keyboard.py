"""Read standard input in a thread: line by line for commands and answers, as a stop may come at any moment; or key by
key, for the controller's own terminal.

Keys are sent as they are pressed. Two have a meaning here: control-] leaves, control-C stops the arm.
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
"""Held while this module changes the terminal's mode, and from the test for waiting input until it is read: another
reader could take the key in between, and the read would block for ever."""


class InputLines:
    """Lines of standard input, a terminal or a pipe, read by a thread from construction to close(). A line that stops
    the arm goes to `stop` at once, and waiting lines are dropped. Another answers the question that was shown before
    it, or waits for its turn as a command."""

    def __init__(self, stop: Callable[[str], None], say: Callable[[str], None]) -> None:
        """say: shows each waiting line that is dropped."""
        self._stop, self._say = stop, say
        self.waiting: SimpleQueue[str | None] = SimpleQueue()
        """Lines that answer no question, in order; None at the end of input."""
        self.stopped = self._ended = False
        """_ended: whether the input ended."""
        self._question: str | None = None
        self._shown: str | None = None
        self._answers: SimpleQueue[str] = SimpleQueue()
        self._partial = b""
        self._refused = False
        """Whether what still comes is not done, by control-C at a pipe: it was written before anybody pressed that."""
        self._handing_over = threading.Lock()
        self._interrupted_input: list[str] = []
        """Parts of the line being typed that questions interrupted: they answer none, and may contain a stop."""
        self._closed, self._wake = threading.Event(), os.eventfd(0)
        self._thread = threading.Thread(target=self._read, name="lines", daemon=True)
        self._thread.start()

    def __enter__(self) -> InputLines:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def answer(self, question: str) -> str:
        """The line typed after the question was shown; empty at the end of input and after a stop."""
        while not self._answers.empty():
            self._answers.get()
        self._question = question
        os.eventfd_write(self._wake, 1)
        try:
            return "" if self._ended else self._answers.get()
        finally:
            self._question = None

    def drop(self) -> None:
        """Drop the waiting lines and report them; at a pipe also those that are still to come."""
        with self._handing_over:
            self._refused, dropped = not sys.stdin.isatty(), self._dropped()
        self._report_dropped(dropped)

    def close(self) -> None:
        """Stop reading, after a stop that is being sent is done."""
        self._closed.set()
        os.eventfd_write(self._wake, 1)
        self._thread.join()
        os.close(self._wake)

    def _read(self) -> None:
        handle = sys.stdin.fileno()
        while not self._closed.is_set():
            ready = select.select([handle, self._wake], [], [])[0]
            if self._wake in ready:
                os.eventfd_read(self._wake)
                self._show_question(handle)
            elif (data := _read_lines(handle)) is None:
                self._closed.wait(POLL_S)
            elif data:
                self._take(data)
            else:
                self._end(os.isatty(handle))

    def _show_question(self, handle: int) -> None:
        """Show the question, if there is one. Input from before does not answer it."""
        question = self._question
        if question is None:
            return
        if may_read_lines(handle):
            self._take(unread_input())
        self._interrupted_input.append(self._partial.decode("utf-8", "replace"))
        self._partial = b""
        print(question, end=" ", flush=True)
        self._shown = question

    def _take(self, data: bytes) -> None:
        *lines, self._partial = (self._partial + data).replace(b"\r", b"\n").split(b"\n")
        for line in lines:
            self._take_line(line.decode("utf-8", "replace").strip())

    def _take_line(self, line: str) -> None:
        stops = ends_in_stop(self._interrupted_input, line)
        self._interrupted_input.clear()
        if stops:
            self.stopped, dropped = True, self._dropped()
            self._stop(line)
            self._answers.put("")
            self._report_dropped(dropped)
        elif self._question is not None and self._shown is self._question:
            self._answers.put(line)
        else:
            with self._handing_over:
                if not self._refused:
                    self.waiting.put(line)
                    return
            self._report_dropped([line])

    def _dropped(self) -> list[str]:
        """Remove and return the waiting lines; the end of input stays."""
        dropped: list[str] = []
        with contextlib.suppress(Empty):
            while (line := self.waiting.get_nowait()) is not None:
                dropped.append(line)
            self.waiting.put(None)
        return dropped

    def _report_dropped(self, dropped: list[str]) -> None:
        for line in filter(None, dropped):
            self._say(f"not done: {line}")

    def _end(self, more_may_come: bool) -> None:
        """Handle the end of input. A pipe ends for good; after control-D a terminal may still send a stop."""
        if self._partial:
            self._take(b"\n")
        self._ended = not more_may_come
        self._answers.put("")
        self.waiting.put(None)
        if more_may_come:
            self._closed.wait(POLL_S)  # one that was hung up is at its end for ever
        else:
            self._closed.set()


def unread_input() -> bytes:
    """Read all input typed at this terminal so far, the unfinished line too: it was typed before a question and cannot
    answer it, but it may be a stop. Empty where this is no terminal."""
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


def _read_lines(handle: int) -> bytes | None:
    """Read the input that waits for a reader of lines; None without any, or where it is for another reader."""
    with _MODE:
        return _read_from(handle) if may_read_lines(handle) and select.select([handle], [], [], 0)[0] else None


def _read_from(handle: int) -> bytes:
    """Read what has come; empty at the end, and where the terminal is closed."""
    try:
        return os.read(handle, 4096)
    except OSError:
        return b""


def may_read_lines(handle: int) -> bool:
    """Whether this process may read lines here: not in the background of a terminal (it would be stopped), nor while
    RawKeyboard or a pager reads it key by key."""
    if not os.isatty(handle):
        return True
    with contextlib.suppress(OSError):  # no terminal of our own session keeps nobody from reading
        if os.tcgetpgrp(handle) != os.getpgrp():
            return False
    return bool(termios.tcgetattr(handle)[3] & termios.ICANON)


class RawKeyboard:
    """Sends every key to `send` as a socket message, control-C to `stop`, until close(). Needs a terminal."""

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
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._read, name="keyboard", daemon=True)
        self._thread.start()

    def show(self, text: str) -> None:
        """Show the controller's output, one character a byte."""
        sys.stdout.write(text)
        sys.stdout.flush()

    def close(self) -> None:
        """Restore the terminal's mode; safe to call twice."""
        self._closed.set()
        self._thread.join()
        with _MODE:
            termios.tcsetattr(self._handle, termios.TCSADRAIN, self._before)

    def _read(self) -> None:
        while not self._closed.is_set():
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
