"""Manual pages in docs/man/ and the completion for bash, made from the same tables as `help` and `--help`."""

from __future__ import annotations

import argparse
import contextlib
import io
import textwrap
from collections.abc import Iterable, Iterator

from daemon import ctl, main
from daemon.commands import every_command
from daemon.errors import DONE, NOT_DONE, NOT_UNDERSTOOD, STOP_UNANSWERED
from daemon.service import BAD_CONFIGURATION
from tests.manuals.commands import named, sentence, shown

FILES = {
    "/etc/facetd/facetd.yaml": "settings; /usr/share/doc/facetd/docs/SETTINGS.md explains every key",
    "/var/lib/facetd": "runs, models, taught views, calibrations",
    "/run/facetd/facetd.sock": "the daemon's socket, for root and the group facetd",
    "/usr/share/doc/facetd": "installation, safety, the operator's pages",
}
STATUSES = {
    DONE: "done",
    NOT_DONE: "not done: refused, or missed",
    NOT_UNDERSTOOD: "not understood, or no daemon there",
    STOP_UNANSWERED: "nobody answered a stop: press the emergency stop",
}
DAEMON_STATUSES = {
    0: "ended on request",
    1: "a fault in the program",
    2: "a device is missing; systemd starts it again",
    BAD_CONFIGURATION: "configuration, calibration or model cannot be used; systemd does not start it again",
}


def facetctl() -> str:
    """The page facetctl(1)."""
    commands = every_command("simulated")
    _, jobs = ctl._parser([*ctl.OFFLINE.values(), ctl.TRAIN])
    lines = [*_head("facetctl", 1, "operate a facetd cell"), ".SH SYNOPSIS"]
    lines += [".B facetctl", "[\\-\\-socket PATH] [\\-\\-json] COMMAND...", ".SH DESCRIPTION"]
    lines += _text("Sends a command to the running daemon facetd(8) and prints its answer, or does a job without it.")
    lines += [".SH OWN COMMANDS", *_entries(ctl.OWN.values())]
    lines += [".SH COMMANDS OF THE DAEMON"]
    for command in commands:
        lines += _entries([(command.usage, command.summary)])
        lines += [".IP", ".nf", *_plain(command.details).splitlines(), ".fi"] if command.details else []
    lines += [".SH JOBS WITHOUT THE DAEMON"]
    for name, parser in jobs.items():
        lines += _job(name, parser)
    lines += [".SH EXIT STATUS", *_entries((str(number), text) for number, text in STATUSES.items())]
    lines += [".SH FILES", *_entries(FILES.items()), ".SH SEE ALSO", ".BR facetd (8)"]
    return "\n".join(lines) + "\n"


def facetd() -> str:
    """The page facetd(8)."""
    parser = main.parser()
    lines = [*_head("facetd", 8, "recognise parts by their facets and pick them"), ".SH SYNOPSIS", ".B facetd"]
    lines += ["[\\-\\-config FILE] [\\-\\-sim] [\\-\\-check]", ".SH DESCRIPTION"]
    lines += _text(f"{parser.description} systemd runs it as facetd.service; facetctl(1) talks to it.")
    lines += [".SH OPTIONS", *_entries((named(row), _help(row)) for row in shown(parser))]
    lines += [".SH EXIT STATUS", *_entries((str(number), text) for number, text in DAEMON_STATUSES.items())]
    lines += [".SH FILES", *_entries(FILES.items()), ".SH SEE ALSO", ".BR facetctl (1)"]
    return "\n".join(lines) + "\n"


def bash() -> str:
    """The completion for bash, as `facetctl completion bash` prints it."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        ctl.main(["completion", "bash"])
    return printed.getvalue()


def _head(name: str, section: int, purpose: str) -> list[str]:
    made = '.\\" Made from the code: make docs'
    return [made, f'.TH {name.upper()} {section} "" facetd', ".SH NAME", f"{name} \\- {purpose}"]


def _job(name: str, parser: argparse.ArgumentParser) -> Iterator[str]:
    kinds = next((a.choices for a in parser._actions if isinstance(a, argparse._SubParsersAction)), {})
    yield from (f".SS {_plain(f'facetctl {name}')}", *_text(sentence(parser.description or "")))
    yield from _entries((named(row), _help(row)) for row in shown(parser))
    for kind, inner in kinds.items():
        yield from _job(f"{name} {kind}", inner)


def _help(row: argparse.Action) -> str:
    return sentence(row.help or "")


def _entries(rows: Iterable[tuple[str, str]]) -> Iterator[str]:
    for name, text in rows:
        yield from (".TP", f"\\fB{_plain(name)}\\fR", *_text(sentence(text)))


def _text(text: str) -> list[str]:
    return [_plain(line) for line in textwrap.wrap(text, 80)]


def _plain(text: str) -> str:
    """Text in which troff sees no command."""
    lines = text.replace("\\", "\\e").replace("-", "\\-").splitlines()
    return "\n".join(f"\\&{line}" if line.startswith((".", "'")) else line for line in lines)
