"""`facetctl console`: what is typed at this terminal, or comes through a pipe, is said to the daemon."""

from __future__ import annotations

import contextlib
import shutil
import sys
import threading
from queue import Empty, SimpleQueue

from daemon.console.pages import NARROWEST, fold
from daemon.console.stop_words import means_stop
from daemon.doors.client import DaemonLink, NotThereError


def converse(link: DaemonLink) -> int:
    """Lines until end of input or `quit`; gives the status of the last. At a terminal the prompt listens meanwhile.

    Raises NotThereError where the daemon goes away from a pipe; at a terminal it is sought again.
    """
    if sys.stdin.isatty() and sys.stdout.isatty():
        import asyncio

        from daemon.doors.listening_prompt import ListeningPrompt

        return asyncio.run(ListeningPrompt(link).run())
    return _piped(link)


def _piped(link: DaemonLink) -> int:
    """One line after the other, each when the one before is done; but a stop is said as soon as it comes, and what came
    before it and still waits is dropped. Control-C stops the arm, and drops what waits as well.
    """
    typed = _Typed()
    threading.Thread(target=typed.read, args=(link,), daemon=True, name="standard input").start()
    status = 0
    while True:
        try:
            line = typed.lines.get()
            if line is None or line.strip() in ("quit", "exit"):
                return status
            done = link.do(line, "console", _say, typed.answer if sys.stdin.isatty() else None)
        except KeyboardInterrupt:
            typed.drop()
            _say(link.interrupt())
            continue
        if "interrupted" in done:
            typed.drop()
        if done["text"]:
            _say(done["text"])
        status = int(done["status"])


class _Typed:
    """Lines of standard input that wait to be said, None at its end. Read on a thread of its own: nobody knows when a
    stop comes. A line that was typed before a question was shown does not answer it."""

    def __init__(self) -> None:
        self.lines: SimpleQueue[str | None] = SimpleQueue()
        self._answers: SimpleQueue[str] = SimpleQueue()
        self._asked, self._over = threading.Event(), False

    def read(self, link: DaemonLink) -> None:
        """To its end; a stop is said beside whatever the link is waiting for, and takes its question away."""
        for line in map(str.rstrip, sys.stdin):
            if not means_stop(line):
                (self._answers if self._asked.is_set() else self.lines).put(line)
                continue
            self.drop()
            try:
                with link.beside() as another:
                    _say(another.do(line, "console", _say)["text"])
            except NotThereError as error:
                print(f"facetctl: {error}", file=sys.stderr, flush=True)
            self._answers.put("")
        self._over = True
        self._answers.put("")
        self.lines.put(None)

    def drop(self) -> None:
        """What was typed before a stop, and waits, is not said any more; but the end is the end."""
        over = False
        with contextlib.suppress(Empty):
            while True:
                line = self.lines.get_nowait()
                over = over or line is None
                if line is not None:
                    _say(f"not done: {line}")
        if over:
            self.lines.put(None)

    def answer(self, question: str) -> str:
        """The next line, as the answer to what is asked."""
        _say(question)
        while not self._answers.empty():
            self._answers.get()
        self._asked.set()
        try:
            return "" if self._over else self._answers.get()
        finally:
            self._asked.clear()


def _say(text: str) -> None:
    columns = shutil.get_terminal_size().columns if sys.stdout.isatty() else 0
    print("\n".join(fold(text, columns)) if columns > NARROWEST else text, flush=True)
