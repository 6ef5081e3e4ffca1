"""`facetctl console`: a prompt on this terminal, with completion and history, that speaks with the daemon."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
from pathlib import Path

from daemon.doors.client import DaemonLink, NotThereError
from daemon.doors.lineedit import fold

HISTORY_LINES = 1000


def converse(link: DaemonLink) -> int:
    """Read lines until end of input or `quit`. Control-C stops the arm, also while a command is being done.

    At a terminal a daemon that went away is sought again, and nothing is said twice: who typed it decides anew. Raises
    NotThereError elsewhere.
    """
    interactive = sys.stdin.isatty()
    if interactive:
        _prepare(link)
        print("`help` lists the commands; control-C stops the arm; control-D leaves.")
    status = 0
    while True:
        try:
            line = input("facetd> " if interactive else "")
        except EOFError:
            if interactive:
                print()
            return status
        except KeyboardInterrupt:
            line = None
        if line is not None and line.strip() in ("quit", "exit"):
            return status
        try:
            status = _said(link, line, interactive)
        except NotThereError as error:
            if not interactive:
                raise
            _seek(link, error)


def _said(link: DaemonLink, line: str | None, interactive: bool) -> int:
    """Say a line, or (None) stop the arm; gives the status. Raises NotThereError."""
    if line is None:
        print(f"\n{link.interrupt()}")
        return 0
    done = link.do(line, "console", _say, _ask if interactive else None)
    if done["text"]:
        _say(done["text"])
    return int(done["status"])


def _seek(link: DaemonLink, error: NotThereError) -> None:
    """Say that the daemon is gone, and find the next one if it is there already."""
    _say(str(error))
    try:
        link.connect_again()
    except NotThereError as gone:
        _say(str(gone))
    else:
        _say("A daemon answers again: see its `status`, then say anew what is still wanted.")


def _say(text: str) -> None:
    columns = shutil.get_terminal_size().columns if sys.stdout.isatty() else 0
    print("\n".join(fold(text, columns)) if columns > 20 else text, flush=True)


def _ask(question: str) -> str:
    with contextlib.suppress(EOFError):
        return input(f"{question} ")
    return ""


def _prepare(link: DaemonLink) -> None:
    """History that outlives the session, completion that asks the daemon."""
    try:
        import readline
    except ImportError:
        return
    history = Path(os.environ.get("XDG_STATE_HOME", Path.home() / ".local" / "state")) / "facetctl-history"
    with contextlib.suppress(OSError):
        history.parent.mkdir(parents=True, exist_ok=True)
        readline.read_history_file(history)

    def keep() -> None:
        with contextlib.suppress(OSError):
            readline.set_history_length(HISTORY_LINES)
            readline.write_history_file(history)

    import atexit

    atexit.register(keep)
    options: list[str] = []

    def complete(text: str, state: int) -> str | None:
        if state == 0:
            typed = readline.get_line_buffer()[: readline.get_endidx()]
            start = readline.get_begidx()
            options[:] = [f"{option[start:]} " for option in link.complete(typed)]
        return options[state] if state < len(options) else None

    readline.set_completer_delims(" ")
    readline.set_completer(complete)
    readline.parse_and_bind("tab: complete")
