"""docs/COMMANDS.md, made from the table of commands, their docstrings, and the options of the tool's own jobs."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator

from daemon import ctl, main
from daemon.cli import commission
from daemon.commands import every_command
from daemon.console.interpreter import ConsoleCommand
from daemon.errors import DONE, NOT_DONE, NOT_UNDERSTOOD, STOP_UNANSWERED

GRADES = {
    "look": "looks only",
    "move": "may move the arm, or takes its permission away",
    "change": "changes what the cell knows",
}
LINE = "| --- | --- |"
HEAD = f"""# Commands: reference

This page is made from the code, as `help` and `--help` are: `make docs` writes it, and a test fails when it is out of
date. The [operator's pages](operate/README.md) say when to use what.

## How to give a command

- At the prompt of `facetctl console` and at a serial terminal: `pick cube`. Tab completes.
- From a shell: `facetctl pick cube`. `--json` makes the answer a JSON object; `--socket PATH` names another daemon.
- The first three letters or more are enough where no other command begins so.
- A word in capitals stands for what you type. `[...]` may be left out. `a|b` means one of both.
- A command marked *at once* does not wait for the one before it. `stop` and control-C wait for nothing.

Exit status of `facetctl`:

| status | meaning |
| --- | --- |
| {DONE} | done |
| {NOT_DONE} | not done: refused, or missed |
| {NOT_UNDERSTOOD} | not understood, or no daemon there |
| {STOP_UNANSWERED} | nobody answered a stop: **press the emergency stop** |

`facetd` ends with status 2 when a device is missing (systemd starts it again), and with 78 when configuration,
calibration or model cannot be used (systemd does not).
"""


def document() -> str:
    """The page as text."""
    commands = every_command("simulated")
    tool, jobs = ctl._parser([*ctl.OFFLINE.values(), ctl.TRAIN])
    parts = [HEAD, "## Commands of the daemon\n", "| command | what it does |", LINE]
    parts += [f"| [`{one.name}`](#{one.name}) | {sentence(one.summary)} |" for one in commands]
    parts += ["", *(described(one) for one in commands)]
    parts += ["## Jobs of `facetctl`, without the daemon\n", "| job | what it does |", LINE]
    parts += [
        f"| `facetctl {usage.replace('|', chr(92) + '|')}` | {_cell(sentence(text))} |"
        for usage, text in ctl.OWN.values()
    ]
    parts += [f"| [`facetctl {name}`](#facetctl-{name}) | {_about(tool, name)} |" for name in jobs]
    parts += ["", *(block for name, parser in jobs.items() for block in options(name, parser))]
    parts += [*options("facetctl commission", commission._parser(), program="")]
    parts += [*options("facetd", main.parser(), program="")]
    return "\n".join(parts)


def described(command: ConsoleCommand) -> str:
    """One command of the daemon's: what help of it says."""
    lines = [f"### {command.name}\n", f"`{command.usage}`\n", f"{sentence(command.summary)}\n"]
    if command.details:
        lines.append(f"```text\n{command.details}\n```\n")
    now = command.at_once
    words = "" if isinstance(now, bool) else f" with {', '.join(f'`{word}`' for word in sorted(now))}"
    marks = [GRADES[command.grade]]
    marks += [f"at once{words}"] if now else []
    marks += [f"also: {', '.join(f'`{alias}`' for alias in command.aliases)}"] if command.aliases else []
    return "\n".join([*lines, f"*{'; '.join(marks)}.*\n"])


def options(name: str, parser: argparse.ArgumentParser, program: str = "facetctl ") -> Iterator[str]:
    """A job's arguments as a table; of a job of several kinds a table each."""
    kinds = next((a.choices for a in parser._actions if isinstance(a, argparse._SubParsersAction)), {})
    told = shown(parser)
    yield f"### {program}{name}\n"
    if told:
        yield "| argument | meaning |\n" + LINE
        yield "\n".join(f"| `{_cell(named(row))}` | {_cell(sentence(row.help or ''))} |" for row in told) + "\n"
    for kind, inner in kinds.items():
        yield from options(f"{name} {kind}", inner, program)


def shown(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    """The arguments that the references show; a job's kinds are apart."""
    rows = [action for action in parser._actions if not isinstance(action, argparse._SubParsersAction)]
    return [row for row in rows if row.help != argparse.SUPPRESS and "--help" not in row.option_strings]


def named(action: argparse.Action) -> str:
    """--out FILE, or DIR."""
    meta = action.metavar or (None if action.nargs == 0 else action.dest.upper())
    if isinstance(meta, tuple):
        meta = " ".join(meta)
    if action.choices:
        meta = "{" + ",".join(map(str, action.choices)) + "}"
    return f"{action.option_strings[-1]} {meta or ''}".strip() if action.option_strings else str(meta)


def _about(parser: argparse.ArgumentParser, name: str) -> str:
    group = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    return _cell(sentence(next((str(c.help) for c in group._choices_actions if c.dest == name and c.help), "")))


def _cell(text: str) -> str:
    return re.sub(r"(?<!\\)\|", r"\\|", text)


def sentence(text: str) -> str:
    """Help text as it begins a sentence, on one line."""
    text = " ".join(text.split()).replace(" (default: %(default)s)", "")
    first = text.partition(" ")[0].rstrip(",:;")
    return f"{text[:1].upper()}{text[1:]}" if first.isalpha() else text
