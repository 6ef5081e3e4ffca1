"""The keyboard of whoever sits at this terminal: the answer to a question; line by line, for a job that asks and waits,
as a stop may come at any moment; and key by key, for the time in which they talk to the controller itself.

Keys go out as they are pressed, in a thread; what comes back is shown as it comes. What keys mean is not known here,
but for two: control-] leaves, control-C stops the arm.
"""

from __future__ import annotations

import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any

from daemon.console.stop_words import means_stop

LEAVE, STOP = b"\x1d", b"\x03"
POLL_S = 0.1


def forget_what_was_typed() -> None:
    """A question is answered after it was shown: what waits at this terminal was typed for something else."""
    if sys.stdin.isatty():
        termios.tcflush(sys.stdin, termios.TCIFLUSH)


def answer_to(question: str) -> str:
    """The line typed here after a question was shown; empty at the end of input."""
    forget_what_was_typed()
    try:
        return input(f"{question} ")
    except EOFError:
        return ""


class Lines:
    """From construction to close() every line typed here that means to stop goes to `stop`, as it comes, in a thread;
    and another answers the question that was shown before it, if there is one. Needs a terminal."""

    def __init__(self, stop: Callable[[str], None]) -> None:
        self._stop = stop
        self._answers: SimpleQueue[str] = SimpleQueue()
        self._asked, self._over = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._read, name="lines", daemon=True)
        self._thread.start()

    def answer(self, question: str) -> str:
        """The line typed after a question was shown; empty at the end of input, and where it was to stop."""
        while not self._answers.empty():
            self._answers.get()
        forget_what_was_typed()
        print(question, end=" ", flush=True)
        self._asked.set()
        try:
            return "" if self._over.is_set() else self._answers.get()
        finally:
            self._asked.clear()

    def close(self) -> None:
        """Listen no longer; safe to call twice."""
        self._over.set()
        self._thread.join()

    def _read(self) -> None:
        handle = sys.stdin.fileno()
        while not self._over.is_set():
            if not select.select([handle], [], [], POLL_S)[0]:
                continue
            data = os.read(handle, 4096)
            line = data.decode("utf-8", "replace").strip()
            if means_stop(line):
                self._stop(line)
            if not data:
                self._over.set()
            if self._asked.is_set():
                self._answers.put("" if means_stop(line) else line)


class Keyboard:
    """From construction to close() every key goes to `send` as a message of doors/socket.py, control-C to `stop`.

    Needs a terminal.
    """

    def __init__(self, send: Callable[[dict[str, Any]], None], stop: Callable[[], None]) -> None:
        self._send, self._stop = send, stop
        self._handle = sys.stdin.fileno()
        self._before = termios.tcgetattr(self._handle)
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
