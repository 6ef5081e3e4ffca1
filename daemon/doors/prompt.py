"""`facetctl console`: what is typed at this terminal, or comes through a pipe, is said to the daemon."""

from __future__ import annotations

import contextlib
import shutil
import sys

from daemon.console.pages import NARROWEST, fold
from daemon.doors.client import DaemonLink


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
    """One line after the other, each when the one before is done. Control-C stops the arm."""
    status = 0
    while True:
        try:
            line = input()
        except EOFError:
            return status
        except KeyboardInterrupt:
            _say(link.interrupt())
            continue
        if line.strip() in ("quit", "exit"):
            return status
        done = link.do(line, "console", _say, _ask if sys.stdin.isatty() else None)
        if done["text"]:
            _say(done["text"])
        status = int(done["status"])


def _say(text: str) -> None:
    columns = shutil.get_terminal_size().columns if sys.stdout.isatty() else 0
    print("\n".join(fold(text, columns)) if columns > NARROWEST else text, flush=True)


def _ask(question: str) -> str:
    with contextlib.suppress(EOFError):
        return input(f"{question} ")
    return ""
