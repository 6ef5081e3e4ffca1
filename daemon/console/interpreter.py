"""The operators' command language: one interpreter for terminal, socket, one-shot commands and scripts.

Here: finding the command that was meant, help, permission, the record of who said what, and turning what went wrong
into one line. What each command does is in daemon/commands/; how text travels is in daemon/doors/socket.py.
"""

from __future__ import annotations

import contextlib
import difflib
import inspect
import shlex
import textwrap
import traceback
from collections.abc import Awaitable, Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from daemon.console.context import ANSWERABLE, CommandContext
from daemon.console.phrases import means_stop
from daemon.errors import FacetdError, printable
from daemon.upkeep import journal

Grade = Literal["look", "move", "change"]
DONE, NOT_DONE, NOT_UNDERSTOOD = 0, 1, 2


class CommandError(FacetdError):
    """A command that cannot be done: one line for the operator; status 1 (not now) or 2 (not understood)."""

    def __init__(self, text: str, status: int = NOT_DONE) -> None:
        super().__init__(text)
        self.status = status


@dataclass(frozen=True)
class Answer:
    """What a command has to say: lines of text for people, the same as JSON values, and whether it was done."""

    text: str
    data: dict[str, Any] = field(default_factory=dict)
    status: int = DONE


class Door(Protocol):
    """Where an operator stands: the door's name, who it is, what is allowed there, and how to speak with them."""

    name: str
    who: str
    may: Literal["look", "all"]
    asks: bool
    """Whether questions can be put to somebody; without it they are taken as answered by yes."""

    async def say(self, text: str) -> None:
        """Show some lines now, before the answer."""

    async def ask(self, question: str) -> str:
        """Put a question and wait for the answer; empty when the operator went away."""

    async def fetch(self, path: str) -> bytes:
        """The content of a file of the operator's, on the machine they sit at. Raises CommandError."""

    async def terminal(self, typed: Callable[[bytes], None]) -> None:
        """Give every key to `typed`, as it is pressed, until control-] or until the operator goes away. Raises
        CommandError where they sit at no terminal."""

    def show(self, data: bytes) -> None:
        """Bytes onto the operator's terminal, as they are; only in terminal mode."""

    def notice(self, text: str) -> None:
        """Lines that nobody there asked for; returns at once."""


Handler = Callable[[CommandContext, list[str], Door], Awaitable[Answer]]
Choices = Callable[[CommandContext], Iterable[str]]


def no_choices(_: CommandContext) -> Iterable[str]:
    """Nothing to complete with."""
    return ()


@dataclass(frozen=True)
class Command:
    """One word of the language. grade: what it does to the world, which decides who may say it and what is recorded."""

    name: str
    usage: str
    summary: str
    run: Handler
    grade: Grade = "look"
    details: str = ""
    at_once: bool | frozenset[str] = False
    """Heard also while the same operator's last command is still being done; or only with one of these words."""
    choices: Choices = no_choices
    """What the first argument can be, for completion and for suggestions."""
    most: int | None = None
    """How many words may follow at most; None: the handler looks itself."""


def command(
    usage: str,
    grade: Grade = "look",
    most: int | None = 0,
    at_once: bool | frozenset[str] = False,
    choices: Choices = no_choices,
) -> Callable[[Handler], Command]:
    """Make a handler the command that its usage begins with. `help` shows the handler's docstring: its first line in
    the list, the rest where help of that command is asked for.
    """

    def made(run: Handler) -> Command:
        first, _, rest = (inspect.getdoc(run) or "").partition("\n")
        summary = first[:1].lower() + first[1:].removesuffix(".")
        details = textwrap.indent(rest.strip("\n"), "  ")
        return Command(usage.split()[0], usage, summary, run, grade, details, at_once, choices, most)

    return made


class Console:
    """The interpreter. One for the whole daemon; `context` is what the commands work with."""

    def __init__(self, context: CommandContext, commands: Iterable[Command]) -> None:
        self.context = context
        self.commands = {command.name: command for command in commands}
        helper = Command(
            "help", "help [COMMAND]", "this list, or all about one command", self._help, choices=self._names
        )
        self.commands["help"] = helper

    async def interpret(self, text: str, door: Door) -> Answer:
        """Do what one line says. What an operator can cause is not raised: it comes back as an Answer with a status."""
        if means_stop(text):
            return await self._stop(text, door)
        try:
            words = shlex.split(text, comments=True)
        except ValueError as error:
            return _trouble(CommandError(f"{text.strip()}: {error}", NOT_UNDERSTOOD))
        if not words:
            return Answer("")
        try:
            command = self._find(words[0])
            self._check_door(command, door)
            if command.grade != "look":
                self.context.log.record("command", who=door.who, door=door.name, text=text.strip())
            if command.most is not None:
                no_more(words[1:], command.most, command.usage)
            return await command.run(self.context, words[1:], door)
        except CommandError as problem:
            return _trouble(problem)
        except ANSWERABLE as error:
            return Answer(_one_line(error), {"error": _one_line(error), "why": type(error).__name__}, NOT_DONE)
        except Exception as error:
            return _own_fault(error)

    async def _stop(self, text: str, door: Door) -> Answer:
        """The arm first; no line is too odd for it, and a log that cannot be written keeps nobody from it."""
        try:
            answer = await self.commands["stop"].run(self.context, [], door)
        except Exception as error:
            answer = _own_fault(error, "NOT CONFIRMED: press the emergency stop; ")
        with contextlib.suppress(Exception):
            self.context.log.record("command", who=door.who, door=door.name, text=printable(text.strip()))
        return answer

    def at_once(self, text: str) -> bool:
        """Whether a line is for now, even while the last command is still being done."""
        words = text.split()
        command = self._meant(words)
        if command is None or isinstance(command.at_once, bool):
            return command is not None and command.at_once is True
        return len(words) > 1 and words[1] in command.at_once

    def is_stop(self, text: str) -> bool:
        """Whether a line, whatever it is typed for, is to stop the arm."""
        return means_stop(text)

    @property
    def stops(self) -> int:
        """How often the arm was stopped or disabled: a command that was typed before the last of them is void."""
        return self.context.cycle.supervisor.stops

    def complete(self, typed: str) -> list[str]:
        """Every line that the one typed so far may become."""
        words = typed.split(" ")
        if len(words) == 1:
            return [name for name in sorted(self.commands) if name.startswith(words[0])]
        if len(words) == 2 and words[0] in self.commands:
            choices = self.commands[words[0]].choices(self.context)
            return [f"{words[0]} {choice}" for choice in sorted(choices) if choice.startswith(words[1])]
        return []

    def moves(self, text: str) -> bool:
        """Whether a line is about moving the arm."""
        command = self._meant(text.split())
        return command is not None and command.grade == "move"

    def _meant(self, words: list[str]) -> Command | None:
        try:
            return self._find(words[0]) if words else None
        except CommandError:
            return None

    def _find(self, word: str) -> Command:
        """The command of that name, or the only one that begins so."""
        name = word.lower()
        if name in self.commands:
            return self.commands[name]
        begun = [c for c in self.commands if c.startswith(name)] if len(name) >= 3 else []
        if len(begun) == 1:
            return self.commands[begun[0]]
        close = begun or difflib.get_close_matches(name, self.commands, 3, 0.6)
        hint = f"did you mean {either(close)}?" if close else "`help` lists what there is"
        raise CommandError(f"{word}: no such command; {hint}", NOT_UNDERSTOOD)

    def _check_door(self, command: Command, door: Door) -> None:
        if command.grade != "look" and door.may == "look" and command.name not in ("stop", "abort", "pause"):
            raise CommandError(f"{command.name}: this {door.name} may only look; use another door", NOT_DONE)

    def _names(self, _: CommandContext) -> Iterable[str]:
        return self.commands

    async def _help(self, _: CommandContext, words: list[str], __: Door) -> Answer:
        if words:
            command = self._find(words[0])
            text = f"{command.usage}\n  {command.summary}"
            return Answer(text + (f"\n{command.details}" if command.details else ""), {"usage": command.usage})
        width = max(len(c.usage) for c in self.commands.values() if len(c.usage) <= 24)
        lines = []
        for command in self.commands.values():
            if len(command.usage) > width:
                lines += [command.usage, " " * (width + 2) + command.summary]
            else:
                lines.append(f"{command.usage:<{width}}  {command.summary}")
        lines.append("help COMMAND tells more. Control-C stops the arm.")
        return Answer("\n".join(lines), {"commands": {c.name: c.summary for c in self.commands.values()}})


def one_of(words: list[str], place: int, choices: Iterable[str], what: str, usage: str) -> str:
    """The word at a place, which must be one of the choices. Raises CommandError with what was probably meant."""
    known = sorted(choices)
    if len(words) <= place:
        raise CommandError(f"{what} is missing: {usage}" + (f" ({', '.join(known)})" if known else ""), NOT_UNDERSTOOD)
    word = words[place]
    if word in known:
        return word
    close = difflib.get_close_matches(word, known, 1) or [k for k in known if k.startswith(word)]
    hint = f"did you mean {close[0]}?" if len(close) == 1 else f"known: {', '.join(known) or 'none'}"
    raise CommandError(f"{word}: no such {what}; {hint}", NOT_UNDERSTOOD)


def no_more(words: list[str], count: int, usage: str) -> None:
    """Raise CommandError where there are more words than the command takes."""
    if len(words) > count:
        raise CommandError(f"{words[count]}: one word too many; usage: {usage}", NOT_UNDERSTOOD)


def number(word: str, what: str, low: int, high: int) -> int:
    """A whole number within bounds. Raises CommandError."""
    if not word.isdecimal() or not low <= int(word) <= high:
        raise CommandError(f"{what}: expected a whole number from {low} to {high}, found {word}", NOT_UNDERSTOOD)
    return int(word)


def either(names: list[str]) -> str:
    """['a', 'b', 'c'] -> 'a, b or c'."""
    return " or ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]


def _own_fault(error: Exception, before: str = "") -> Answer:
    journal.tell("trouble", traceback.format_exc(), journal.ERROR)
    told = f"{before}a fault in facetd itself: {type(error).__name__}: {_one_line(error)}; please send a `bundle`"
    return Answer(told, {"error": told, "why": "internal"}, NOT_DONE)


def _trouble(problem: CommandError) -> Answer:
    return Answer(str(problem), {"error": str(problem)}, problem.status)


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
