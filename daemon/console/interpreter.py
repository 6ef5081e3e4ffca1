"""Interpreter of the command language: look-up by name, help, permission, records and errors of commands."""

import contextlib
import difflib
import inspect
import shlex
import traceback
from collections.abc import Callable, Coroutine, Iterable
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Protocol

from daemon import VERSION
from daemon.arm import operator_command
from daemon.console.aliases import JOBS, aliases_of
from daemon.console.context import ANSWERABLE, CommandContext
from daemon.console.phrases import is_no, is_yes
from daemon.console.stop_words import WITHDRAW, ends_as_a_stop, means_stop
from daemon.console.text_layout import fold, prose, table
from daemon.errors import DONE, NOT_DONE, NOT_UNDERSTOOD, CommandError, internal_error, one_line, printable
from daemon.events.codes import CauseCode, cause_of
from daemon.maintenance import journal
from daemon.quantities import shown, whole

Grade = Literal["look", "move", "change"]


@dataclass(frozen=True)
class CommandResult:
    """The result of a command: text for people, the same as JSON values, exit status."""

    text: str
    data: dict[str, Any] = field(default_factory=dict)
    status: int = DONE


class Frontend(Protocol):
    """An operator's terminal or connection: its name, who it is, their rights, and how to show and ask."""

    name: str
    who: str
    may: Literal["look", "all"]
    shown: int | None
    """The candidate model shown here last, which `accept` refers to."""

    @property
    def asks(self) -> bool:
        """Whether somebody can answer questions; without, they count as answered by yes."""

    @property
    def columns(self) -> int:
        """Width of its terminal."""

    @property
    def rows(self) -> int | None:
        """Height of its terminal; None where it is unknown or output is not paged."""

    async def say(self, text: str) -> None:
        """Show some lines now, before the answer."""

    async def ask(self, question: str) -> str:
        """Ask a question and wait for the answer; empty when the operator disconnected."""

    async def fetch(self, path: str) -> bytes:
        """The content of a file on the operator's computer. Raises CommandError."""

    async def terminal(self, typed: Callable[[bytes], None]) -> None:
        """Pass every key to `typed` until control-]. Raises CommandError where there is no terminal."""

    def show(self, data: bytes) -> None:
        """Write raw bytes to the operator's terminal; only in terminal mode."""

    def notice(self, text: str) -> None:
        """Show unsolicited lines; returns at once."""


CommandHandler = Callable[[CommandContext, list[str], Frontend], Coroutine[Any, Any, CommandResult]]
Choices = tuple[str, ...] | Callable[[CommandContext], Iterable[str]]
Further = Callable[[CommandContext, str], Iterable[str]]
Looks = Callable[[list[str]], bool]
TAKES_ANY_WORD = ("help", "here", "note", "operator", "place", "teach")
"""Commands whose words people choose: one that ends in `stop` behind them is no stop."""
HELP_WORDS, VERSION_WORDS = ("--help", "-h"), ("--version",)
FIRST_WIDTH = 9
RIGHTS = "deploy/README.md, Who may do what"
KEEPS_QUESTION = ("status", "help", "pause", "step", "confirm", "refuse")
MORE = "-- more (Enter, q) --"
MAX_QUESTIONS = 5
"""Largest number of times a question is repeated after an invalid answer."""
OF_THE_SHELL = (
    *("arm", "commission", "completion", "console", "dashboard", "demo", "export", "fleet", "recognise"),
    *("replay", "review", "runs", "script", "snap", "stream", "tail", "thesis"),
)
"""Subcommands of `facetctl` that are not commands of the daemon."""


def never(_: list[str]) -> bool:
    """Default of ConsoleCommand.looks: its grade holds for all arguments."""
    return False


def nothing_further(_: CommandContext, __: str) -> Iterable[str]:
    """Default of ConsoleCommand.further: no completion."""
    return ()


@dataclass(frozen=True)
class ConsoleCommand:
    """A command. grade: whether it only looks, moves, or changes something, which decides on rights and records."""

    name: str
    usage: str
    summary: str
    run: CommandHandler
    grade: Grade = "look"
    details: str = ""
    at_once: bool | frozenset[str] = False
    """Whether it runs while the operator's last command is still running; or the first arguments with which it does."""
    choices: Choices = ()
    """Values of the first argument, for completion and suggestions."""
    most: int | None = None
    """Largest number of arguments; None: the handler checks."""
    further: Further = nothing_further
    """Values of the second argument, for completion."""
    aliases: tuple[str, ...] = ()
    """Other names."""
    first: bool = False
    """Whether it is on the first screen of `help`."""
    looks: Looks = never
    """Whether it only looks with these arguments, whatever its grade."""

    def does(self, words: list[str]) -> Grade:
        return "look" if self.looks(words) else self.grade

    def offered(self, context: CommandContext) -> Iterable[str]:
        """Present values of the first argument."""
        return self.choices(context) if callable(self.choices) else self.choices

    def described(self, columns: int) -> str:
        """Its full help, for a terminal of that width."""
        also = prose(f"also: {', '.join(self.aliases)}", columns) if self.aliases else []
        lines = [*fold(self.usage, columns), *prose(self.summary, columns), *also, *prose(self.details, columns)]
        return "\n".join(lines)


def command(
    usage: str,
    grade: Grade = "look",
    most: int | None = 0,
    at_once: bool | frozenset[str] = False,
    choices: Choices = (),
    further: Further = nothing_further,
    aliases: tuple[str, ...] = (),
    first: bool = False,
    looks: Looks = never,
) -> Callable[[CommandHandler], ConsoleCommand]:
    """Decorator: make a handler a command, named by the first word of its usage; its docstring is the help."""

    def made(run: CommandHandler) -> ConsoleCommand:
        name, (prefix, _, details) = usage.split()[0], (inspect.getdoc(run) or "").partition("\n")
        summary, details = prefix[:1].lower() + prefix[1:].removesuffix("."), details.strip("\n")
        also = (*aliases, *aliases_of(name))
        return ConsoleCommand(
            name, usage, summary, run, grade, details, at_once, choices, most, further, also, first, looks
        )

    return made


def first_screen(commands: Iterable[ConsoleCommand]) -> str:
    """The screen of `help`: ten lines, for a new operator."""
    lines = [f"{c.name:<{FIRST_WIDTH}}{c.summary.partition(',')[0].partition(';')[0]}" for c in commands if c.first]
    return "\n".join([*lines, "help all every command, page by page", "help WORD one command in full"])


class Interpreter:
    """The interpreter, one for the daemon. context: what the commands work with."""

    def __init__(self, context: CommandContext, commands: Iterable[ConsoleCommand]) -> None:
        self.context = context
        self.commands = {command.name: command for command in commands}
        usage, aliases = "help [all|COMMAND]", ("?", "h")
        helper = command(usage, most=1, choices=lambda _: ("all", *self.commands), aliases=aliases)(self._help)
        self.commands["help"] = helper
        self._aliases = {alias: c.name for c in self.commands.values() for alias in c.aliases}

    async def interpret(self, text: str, frontend: Frontend) -> CommandResult:
        """Run one line. Errors that an operator can cause are not raised: they are returned as a CommandResult."""
        if self.means_stop(text):
            return await self._stop(text, frontend)
        try:
            words = shlex.split(text, comments=True)
        except ValueError as error:
            return _trouble(CommandError(f"{text.strip()}: {error}", NOT_UNDERSTOOD))
        if not words:
            return CommandResult("")
        try:
            if VERSION_WORDS[0] in words or words == ["version"]:
                return CommandResult(f"facetd {VERSION}", {"version": VERSION})
            command = self._find(words[0])
            if any(word in HELP_WORDS for word in words[1:]):
                return _described(command, frontend)
            grade = command.does(words[1:])
            self._check_rights(command, grade, frontend)
            if grade != "look":
                self.context.log.record("command", who=frontend.who, door=frontend.name, text=text.strip())
            if command.most is not None:
                no_more(words[1:], command.most, command.usage)
            with operator_command(command.name, self.context.cycle.supervisor.stops):
                return await command.run(self.context, words[1:], frontend)
        except CommandError as problem:
            return _trouble(problem)
        except ANSWERABLE as error:
            text, code = one_line(error), cause_of(error).code
            known = {} if code is CauseCode.INTERNAL else {"code": code}
            return CommandResult(text, {"error": text, "why": type(error).__name__, **known}, NOT_DONE)
        except Exception as error:
            return _own_fault(error)

    async def _stop(self, text: str, frontend: Frontend) -> CommandResult:
        """Stop the arm first, whatever else the line contains and whether or not it can be recorded."""
        try:
            answer = await self.commands["stop"].run(self.context, [], frontend)
        except Exception as error:
            answer = _own_fault(error, "NOT CONFIRMED: press the emergency stop; ")
        with contextlib.suppress(Exception):
            self.context.log.record("command", who=frontend.who, door=frontend.name, text=printable(text.strip()))
        return answer

    def at_once(self, text: str) -> bool:
        """Whether a line runs even while the last command is still running."""
        words, command = self._meant(text)
        if command is None or isinstance(command.at_once, bool):
            return command is not None and command.at_once is True
        return len(words) > 1 and words[1] in command.at_once

    def keeps_question(self, text: str) -> bool:
        """Whether a line is a command that runs while a question stays open (KEEPS_QUESTION)."""
        _, command = self._meant(text)
        return command is not None and command.name in KEEPS_QUESTION and not (is_yes(text) or is_no(text))

    def withdraws(self, text: str) -> bool:
        """Whether a line withdraws the arm's permission to move: it answers no question, and cancels open ones."""
        words, command = self._meant(text)
        return self.means_stop(text) or (command is not None and command.name in WITHDRAW and len(words) == 1)

    def means_stop(self, text: str) -> bool:
        """Whether a line stops the arm, also behind half of another line (`go hostop`) that is no known name."""
        return means_stop(text) or (ends_as_a_stop(text) and not self._is_known(text))

    def _is_known(self, text: str) -> bool:
        words, command = self._meant(text)
        if command is None or len(words) < 2:
            return False
        if command.name in TAKES_ANY_WORD:
            return True
        try:
            return words[-1] in {*command.offered(self.context), *command.further(self.context, words[1])}
        except ANSWERABLE:
            return False

    def complete(self, typed: str) -> list[str]:
        """Completions of the line typed so far; none where the choices cannot be read."""
        *before, prefix = typed.split(" ")
        if not before:
            return [name for name in sorted(self.commands) if name.startswith(prefix)]
        command = self.commands.get(before[0])
        if command is None or len(before) > 2:
            return []
        try:
            offered = command.offered(self.context) if len(before) == 1 else command.further(self.context, before[1])
            return [" ".join([*before, choice]) for choice in sorted(offered) if choice.startswith(prefix)]
        except ANSWERABLE:
            return []

    def moves(self, text: str) -> bool:
        words, command = self._meant(text)
        return command is not None and command.does(words[1:]) == "move"

    def _meant(self, text: str) -> tuple[list[str], ConsoleCommand | None]:
        """The words of a line, and the command that it names."""
        words = text.split()
        try:
            return words, self._find(words[0]) if words else None
        except CommandError:
            return words, None

    def _find(self, word: str) -> ConsoleCommand:
        """The command of that name, or the only one with that prefix. Raises CommandError."""
        name = self._aliases.get(word.lower(), word.lower())
        if name in self.commands:
            return self.commands[name]
        if name in ("quit", "exit", "bye", "logout"):
            raise CommandError("a serial terminal stays open; there is nothing to close")
        if name == "facetctl":
            raise CommandError("type the command without `facetctl`", NOT_UNDERSTOOD)
        if name == "facetd>":  # copied from a page of the manual
            raise CommandError("type the command without the prompt `facetd>`", NOT_UNDERSTOOD)
        name = JOBS.get(name, name)
        if name in OF_THE_SHELL:
            raise CommandError(f"{word}: not a console command; run it in a shell: `facetctl {name}`", NOT_UNDERSTOOD)
        prefix = [c for c in self.commands if c.startswith(name)] if len(name) >= 3 else []
        if len(prefix) == 1:
            return self.commands[prefix[0]]
        close = prefix or difflib.get_close_matches(name, self.commands, 3, 0.7)
        hint = f"did you mean {either(close)}?" if close else "`help all` lists every command"
        raise CommandError(f"{word}: no such command; {hint}", NOT_UNDERSTOOD)

    def _check_rights(self, command: ConsoleCommand, grade: Grade, frontend: Frontend) -> None:
        if grade != "look" and frontend.may == "look" and command.name not in ("stop", "pause", *WITHDRAW):
            raise CommandError(f"{command.name}: not permitted: this {frontend.name} is read-only ({RIGHTS})")

    async def _help(self, _: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
        every = {c.name: c.summary for c in self.commands.values()}
        if not words:
            return CommandResult(first_screen(self.commands.values()), {"commands": every})
        if words[0] != "all":
            answer = _described(self._find(words[0]), frontend)
            return replace(answer, text=await by_pages(answer.text, frontend))
        every_line = table([(c.usage, c.summary) for c in self.commands.values()], frontend.columns)
        return CommandResult(await by_pages(every_line, frontend), {"commands": every})


async def by_pages(text: str, frontend: Frontend) -> str:
    """Show all pages but the last, waiting for Enter after each. Returns the last, or nothing where the operator quits;
    all of it where the height of the terminal is unknown."""
    lines = fold(text, frontend.columns)
    if frontend.rows is None or not frontend.asks:
        return text
    page = max(frontend.rows - 2, 2)  # the question and the answer are below it
    while len(lines) >= frontend.rows:
        await frontend.say("\n".join(lines[:page]))
        lines = lines[page:]
        if (await frontend.ask(MORE)).strip():
            return ""
    return "\n".join(lines)


def _described(command: ConsoleCommand, frontend: Frontend) -> CommandResult:
    return CommandResult(command.described(frontend.columns), {"usage": command.usage})


def one_of(words: list[str], place: int, choices: Iterable[str], what: str, usage: str) -> str:
    """The argument at an index, one of the choices. what: its kind, `word` for a keyword. Raises CommandError."""
    allowed = sorted(choices)
    keyword = what == "word" and len(allowed) > 0
    if len(words) <= place:
        lacking = either(allowed) if keyword else what
        unlisted = not keyword and not all(word in usage for word in allowed)
        listed = f"; choose from: {', '.join(allowed)}" if allowed and unlisted else ""
        raise CommandError(f"{lacking} is missing: {usage}{listed}", NOT_UNDERSTOOD)
    word = words[place]
    if word in allowed:
        return word
    close = difflib.get_close_matches(word, allowed, 1) or [k for k in allowed if k.startswith(word)]
    if keyword and len(close) != 1:
        raise CommandError(f"{word}: expected {either(allowed)}; usage: {usage}", NOT_UNDERSTOOD)
    hint = f"choose from: {', '.join(allowed)}" if allowed else "there is none yet"
    if len(close) == 1:
        hint = f"did you mean {close[0]}?"
    raise CommandError(f"{word}: no such {what}; {hint}", NOT_UNDERSTOOD)


def form_of(usage: str, act: str) -> str:
    """The form of a usage that begins with a keyword: `place show [NAME] | drop NAME` and `drop`: `place drop NAME`."""
    name, _, forms = usage.partition(" ")
    return next((f"{name} {form}" for form in forms.split(" | ") if form.split()[0] == act), usage)


def no_more(words: list[str], count: int, usage: str) -> None:
    """Raise CommandError where there are more arguments than the command takes."""
    if len(words) > count:
        raise CommandError(f"{words[count]}: one word too many; usage: {usage}", NOT_UNDERSTOOD)


def number(word: str, what: str, low: int, high: int) -> int:
    """A whole number within bounds. Raises CommandError."""
    with contextlib.suppress(ValueError):
        if low <= (found := whole(word)) <= high:
            return found
    raise CommandError(f"{what}: expected a whole number from {low} to {high}, found {shown(word)}", NOT_UNDERSTOOD)


async def yes_or_no(frontend: Frontend, question: str) -> bool | None:
    """Ask until the answer is yes or no; None where the operator stopped the arm or disconnected."""
    for _ in range(MAX_QUESTIONS):
        answer = (await frontend.ask(question)).strip()
        if not answer or is_yes(answer) or is_no(answer):
            return None if not answer else is_yes(answer)
        await frontend.say(f"Ignored: `{answer}`. Answer y or n.")
    return None


def either(names: list[str]) -> str:
    """['a', 'b', 'c'] -> 'a, b or c'."""
    return " or ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]


def _own_fault(error: Exception, before: str = "") -> CommandResult:
    journal.write("trouble", traceback.format_exc(), journal.ERROR)
    message = f"{before}{internal_error(error)}; run `bundle` and send the file to the maintainer"
    return CommandResult(message, {"error": message, "why": "internal"}, NOT_DONE)


def _trouble(problem: CommandError) -> CommandResult:
    return CommandResult(str(problem), {"error": str(problem)}, problem.status)
