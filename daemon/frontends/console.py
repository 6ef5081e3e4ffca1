"""`facetctl console`: send lines from this terminal, or from a pipe, to the daemon."""

import shutil
import sys

from daemon.console.text_layout import NARROWEST, fold
from daemon.errors import DONE, STOP_UNANSWERED
from daemon.frontends.client import DaemonLink, despite_full_disk
from daemon.frontends.keyboard import InputLines


def converse(link: DaemonLink) -> int:
    """Send lines until end of input or `quit`; returns the status of the last. At a terminal, notices appear above the
    prompt.

    From a pipe, raises DaemonUnreachableError where the daemon ends or hangs; at a terminal the prompt reconnects.
    """
    if sys.stdin.isatty() and sys.stdout.isatty():
        import asyncio

        from daemon.frontends.console_prompt import ConsolePrompt

        status = asyncio.run(ConsolePrompt(link).run())
        if (doing := link.running_job()) is not None:
            _say(f"{doing} goes on without this console. `facetctl stop` stops the arm, `facetctl status` shows it.")
        return status
    return send_piped(link)


def send_piped(link: DaemonLink) -> int:
    """Send one line after the other, each when the one before is done. A stop is sent as soon as it is read; lines
    before it that still wait are dropped. Control-C stops the arm and drops waiting lines, too."""
    status, stops = DONE, [DONE]

    def stop(text: str) -> None:
        done = link.stop_separately(text, "console", _say)
        stops.append(STOP_UNANSWERED * (done["status"] == STOP_UNANSWERED))
        _say(done["text"])

    with InputLines(stop, _say) as typed:
        while True:
            try:
                line = typed.waiting.get()
                if line is None or line in ("quit", "exit"):
                    return max(status, *stops)
                done = link.do(line, "console", _say, typed.answer if sys.stdin.isatty() else None)
            except KeyboardInterrupt:
                reported = link.interrupt(_say)
                typed.drop()
                _say(reported)
                continue
            if "interrupted" in done:
                typed.drop()
            if done["text"]:
                _say(done["text"])
            status = int(done["status"])


def _say(text: str) -> None:
    columns = shutil.get_terminal_size().columns if sys.stdout.isatty() else 0
    with despite_full_disk():
        print("\n".join(fold(text, columns)) if columns > NARROWEST else text, flush=True)
