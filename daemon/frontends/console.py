"""`facetctl console`: what is typed at this terminal, or comes through a pipe, is said to the daemon."""

import shutil
import sys

from daemon.console.text_layout import NARROWEST, fold
from daemon.errors import DONE, STOP_UNANSWERED
from daemon.frontends.client import DaemonLink, told_anyway
from daemon.frontends.keyboard import InputLines


def converse(link: DaemonLink) -> int:
    """Lines until end of input or `quit`; gives the status of the last. At a terminal the prompt listens meanwhile.

    Raises NotThereError where the daemon goes away from a pipe, or hangs at a stop; at a terminal it is sought again.
    """
    if sys.stdin.isatty() and sys.stdout.isatty():
        import asyncio

        from daemon.frontends.console_prompt import ConsolePrompt

        status = asyncio.run(ConsolePrompt(link).run())
        if (doing := link.doing_beside()) is not None:
            _say(f"{doing} goes on without this console. `facetctl stop` stops the arm, `facetctl status` shows it.")
        return status
    return _piped(link)


def _piped(link: DaemonLink) -> int:
    """One line after the other, each when the one before is done; but a stop is said as soon as it comes, and what came
    before it and still waits is dropped. Control-C stops the arm, and drops what waits as well.
    """
    status, beside = DONE, [DONE]

    def stop(text: str) -> None:
        done = link.stop_beside(text, "console", _say)
        beside.append(STOP_UNANSWERED * (done["status"] == STOP_UNANSWERED))
        _say(done["text"])

    with InputLines(stop, _say) as typed:
        while True:
            try:
                line = typed.waiting.get()
                if line is None or line in ("quit", "exit"):
                    return max(status, *beside)
                done = link.do(line, "console", _say, typed.answer if sys.stdin.isatty() else None)
            except KeyboardInterrupt:
                told = link.interrupt(_say)
                typed.drop()
                _say(told)
                continue
            if "interrupted" in done:
                typed.drop()
            if done["text"]:
                _say(done["text"])
            status = int(done["status"])


def _say(text: str) -> None:
    columns = shutil.get_terminal_size().columns if sys.stdout.isatty() else 0
    with told_anyway():
        print("\n".join(fold(text, columns)) if columns > NARROWEST else text, flush=True)
