"""Commands that add people's notes to the run: comments, and who works here."""

import re

from daemon.console.context import CommandContext
from daemon.console.interpreter import CommandResult, Frontend, command
from daemon.errors import NOT_UNDERSTOOD, CommandError, spelt

LONGEST_NOTE = 300
NAME = re.compile(r"[\w.-]{1,30}")
SIGNED = ": "
"""Between the name that somebody gave and the account or terminal that they work at."""


@command("note TEXT", "change", most=None)
async def note(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Keep a comment with the run: the review page shows it at its time."""
    text = spelt(" ".join(words))
    if not text:
        raise CommandError("TEXT is missing: `note TEXT`, such as `note lamp replaced`", NOT_UNDERSTOOD)
    if len(text) > LONGEST_NOTE:
        raise CommandError(f"{len(text)} characters; a note has at most {LONGEST_NOTE}", NOT_UNDERSTOOD)
    context.log.record("note", who=frontend.who, text=text)
    return CommandResult("Kept with the run.", {"note": text})


@command("operator [NAME]", "change", most=1)
async def operator(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Report who works at this terminal from now on; the run keeps it.

    Messages, the run and its page then show this name before the account or terminal, until somebody gives another.
    A serial terminal has no login, so use it there.
    """
    if not words:
        return CommandResult(f"At this terminal: {frontend.who}.", {"who": frontend.who})
    if not NAME.fullmatch(words[0]):
        raise CommandError(f"{words[0]}: expected one word of letters and digits, such as ann", NOT_UNDERSTOOD)
    before, account = frontend.who, frontend.who.rpartition(SIGNED)[2]
    frontend.who = f"{words[0]}{SIGNED}{account}"
    context.log.record("operator", who=frontend.who, before=before)
    return CommandResult(f"From now on: {frontend.who}.", {"who": frontend.who})


COMMANDS = (note, operator)
