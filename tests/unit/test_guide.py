"""What the guide tells people to type is there to be typed: every command against the table of commands and the tools'
own options, every key against the configuration."""

from __future__ import annotations

import argparse
import ast
import dataclasses
import re
import shlex
import typing
from functools import cache
from pathlib import Path
from types import UnionType

import msgspec
import pytest

from daemon import ctl, main
from daemon.commands import every_command
from daemon.config import Config
from daemon.console.interpreter import ConsoleCommand
from daemon.console.phrases import NO, YES
from daemon.store import folders
from drivers.camera.settings import CameraSettings
from drivers.val2.dialect import Dialect

GUIDES = [
    folders.HOUSE / name
    for name in ("README.md", "deploy/README.md", "deploy/FIRST-DAY.md", "deploy/RUNS.md", "deploy/SAFETY.md")
] + sorted((folders.HOUSE / "docs" / "operate").glob("*.md"))
COMMANDS = {name: command for command in every_command("simulated") for name in (command.name, *command.aliases)}
SPAN, BLOCK = re.compile(r"`([^`\n]+)`"), re.compile(r"^ *```\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
NAMED_BLOCK = re.compile(r"^ *```\w+\n.*?^ *```$", re.MULTILINE | re.DOTALL)
"""YAML, drawings and others that nobody types."""
KEY = re.compile(
    r"(cell|cameras|arm|files|folders|pick|vision|console|log|health|simulated|recorded|metrics)((\.\w+)+)"
)


def spans(guide: Path) -> list[str]:
    text = NAMED_BLOCK.sub("", guide.read_text(encoding="utf-8"))
    blocks = [line.partition("  #")[0].strip() for block in BLOCK.findall(text) for line in block.splitlines()]
    return [span.strip() for span in SPAN.findall(BLOCK.sub("", text))] + [line for line in blocks if line]


def told(pattern: str) -> list[tuple[str, str]]:
    """(guide, what follows) of each span that begins so."""
    found = [(g.name, m[1]) for g in GUIDES for span in spans(g) if (m := re.fullmatch(pattern, span, re.DOTALL))]
    assert found
    return sorted(set(found))


@cache
def jobs() -> dict[str, argparse.ArgumentParser]:
    return dict(ctl._parser([*ctl.OFFLINE.values(), ctl.TRAIN])[1])


def placeholder(word: str) -> bool:
    """A word that stands for what a person puts there."""
    return word.isupper() or word.endswith("...") or "|" in word or word.startswith("[")


def check(command: ConsoleCommand, words: list[str]) -> str | None:
    """What is wrong with a command's arguments, as far as the table knows."""
    if command.most is not None and len(words) > command.most:
        return "too many words"
    first = words[0] if words else None
    if isinstance(command.choices, tuple) and command.choices and first is not None and not placeholder(first):
        return None if first in command.choices else f"{first} is none of {command.choices}"
    return None


def test_what_is_typed_at_the_prompt_is_a_command() -> None:
    wrong = []
    for guide, line in told(r"facetd> (.*)"):
        name, *words = shlex.split(line, comments=True)
        if name != "help" and (problem := check(COMMANDS[name], words) if name in COMMANDS else "no command"):
            wrong.append(f"{guide}: {line}: {problem}")
    assert wrong == []


def names() -> list[tuple[str, str]]:
    """Spans that begin with a command's own word."""
    begun = "|".join(sorted({*COMMANDS} - {*YES, *NO}, key=len, reverse=True)).replace("?", r"\?")
    return [(g, line) for g, line in told(rf"((?:{begun})(?: .*)?)")]


def test_every_command_named_in_the_text_is_one_with_words_that_it_knows() -> None:
    named, wrong = names(), []
    assert len(named) > 400
    for guide, line in named:
        name, *words = shlex.split(line, comments=True)
        if name in jobs() and job_problem([name, *words]) is None:
            continue
        problem = check(COMMANDS[name], [word for word in words if word not in ("--help", "--version")])
        if problem is not None:
            wrong.append(f"{guide}: `{line}`: {problem}")
    assert wrong == []


def job_problem(words: list[str]) -> str | None:
    """Which option or kind a job does not have."""
    parser = jobs()[words[0]]
    rest = words[1:]
    kinds = next((a for a in parser._actions if isinstance(a, argparse._SubParsersAction)), None)
    if kinds is not None and rest and rest[0] in kinds.choices:
        parser, rest = kinds.choices[rest[0]], rest[1:]
    elif kinds is not None and kinds.required:
        return f"no such kind of {words[0]}: {rest[:1]}"
    unknown = [word for word in rest if word.startswith("--") and word not in parser._option_string_actions]
    return f"no such option: {unknown}" if unknown else None


def tool_problem(line: str) -> str | None:
    """What is wrong with what follows `facetctl`: a job that needs no daemon, or a command of the daemon's."""
    try:
        words = shlex.split(line.replace("$(", "").replace(")", ""), comments=True)
    except ValueError:
        words = line.split()
    while words and words[0] in ("--json", "--socket"):
        words.pop(0)
    if not words or placeholder(words[0]) or words[0] in (*ctl.OWN, "--help", "--version", "help"):
        return None
    problems = []
    if words[0] in jobs():
        problems.append(job_problem(words))
    if words[0] in COMMANDS:
        problems.append(check(COMMANDS[words[0]], [w for w in words[1:] if not w.startswith("--")]))
    return None if None in problems else " and ".join(filter(None, problems)) or "no such command"


def test_every_line_for_the_tool_is_one_that_it_understands() -> None:
    lines = told(r"(?:sudo )?facetctl (.*)")
    assert len(lines) > 90
    assert [f"{guide}: facetctl {line}: {why}" for guide, line in lines if (why := tool_problem(line))] == []


def test_every_option_of_the_daemon_is_one(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main.main(["--help"])
    helped = capsys.readouterr().out
    typed = [(guide, word) for guide, line in told(r"facetd (--.*)") for word in line.split() if word.startswith("--")]
    assert [f"{guide}: facetd {word}" for guide, word in typed if word not in helped] == []


def keys_of(kind: object) -> dict[str, object]:
    """Fields of a section's type, whatever it is wrapped in."""
    if isinstance(kind, UnionType) or typing.get_origin(kind) in (typing.Union, typing.Annotated):
        found: dict[str, object] = {}
        for one in typing.get_args(kind):
            found.update(keys_of(one))
        return found
    if not isinstance(kind, type) or not (dataclasses.is_dataclass(kind) or issubclass(kind, msgspec.Struct)):
        return {}
    return dict(typing.get_type_hints(kind, include_extras=True))


def test_every_key_of_the_configuration_is_one() -> None:
    top = keys_of(typing.get_type_hints(Config)["values"])
    elsewhere = {"cameras": CameraSettings, "arm.dialect": Dialect}
    for guide in GUIDES:
        for span in spans(guide):
            named = KEY.fullmatch(span)
            if (
                named is None
                or (folders.HOUSE / span).exists()
                or span.endswith((".yaml", ".py", ".md", ".conf", ".txt"))
            ):
                continue
            path, known = [], top
            for word in span.split("."):
                assert word in known, f"{guide.name}: `{span}`: no such key"
                path.append(word)
                kind = elsewhere.get(".".join(path), known[word])
                known = keys_of(kind)


def test_every_file_and_target_named_is_there() -> None:
    makefile = (folders.HOUSE / "Makefile").read_text()
    control = (folders.HOUSE / "debian" / "control").read_text()
    for guide in GUIDES:
        for span in spans(guide):
            for target in re.findall(r"\bmake (?!-)([a-z][a-z-]*)", span):
                assert re.search(rf"^(extra-%|{target}):", makefile, re.MULTILINE), f"{guide.name}: {span}"
            for package in re.findall(r"\b(facetd(?:-[a-z]+)?)_", span):
                assert f"Package: {package}\n" in control, f"{guide.name}: {span}"
            for file in re.findall(r"\b(?:docs|deploy)/[\w./-]+\.\w+", span):
                assert (folders.HOUSE / file).exists(), f"{guide.name}: {span}"


TROUBLES = [*sorted((folders.HOUSE / "docs" / "operate").glob("*.md")),
            *(folders.HOUSE / "deploy" / name for name in ("FIRST-DAY.md", "FAULTS.md"))]  # fmt: skip
STANDS_FOR = re.compile(
    r"\.\.\.|[:;,()*'?\"]|-?\d+(?:\.\d+)?|\w+_\w+|\b(?:cube|pyramid|nest|tray|press|left|right|[A-Z]+)\b"
)
"""What divides a message as a page quotes it: punctuation, and what stands for something that changes."""
OF_OTHERS = {
    "Assertion failed for facetd.service",
    "... would exceed joint ...'s positive limit",
    "1 facet meets none of these sides",
}
"""Messages of systemd and LinuxCNC; and one that is composed of more than two texts."""


@cache
def texts() -> str:
    """Every text in the program, one a line, without marks; what is filled in divides it."""
    found = []
    for root in ("daemon", "drivers"):
        for file in sorted((folders.HOUSE / root).rglob("*.py")):
            nodes = ast.walk(ast.parse(file.read_text(encoding="utf-8")))
            found += [n.value for n in nodes if isinstance(n, ast.Constant) and isinstance(n.value, str)]
    return re.sub(r"[`*]", "", "\n".join(found))


def test_every_message_that_a_table_quotes_is_one_that_the_program_has() -> None:
    """A message that is reworded leaves pages behind on which nobody finds it any more."""
    unknown = []
    for guide in TROUBLES:
        for line in guide.read_text(encoding="utf-8").splitlines():
            cells = line.split("|")[1:4] if line.startswith("|") else []
            for span in SPAN.findall(" ".join(cells[2:] if guide.name == "FAULTS.md" else cells[:1])):
                if span in OF_OTHERS or span.partition(" ")[0] in {*COMMANDS, "facetctl", "journalctl"}:
                    continue
                for piece in STANDS_FOR.split(span):
                    words = piece.split()
                    halves = [(" ".join(words[:k]), " ".join(words[k:])) for k in range(len(words))]
                    if len(words) > 2 and not any(a in texts() and b in texts() for a, b in halves):
                        unknown.append(f"{guide.name}: {span}")
    assert unknown == []
