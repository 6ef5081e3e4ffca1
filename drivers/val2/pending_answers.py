"""Answers that the controller owes: what comes too late is no answer any more, and is nobody else's line."""

from collections.abc import Callable, Sequence

from drivers.val2 import commands
from drivers.val2.wire import JOINT_HEADER, LOCATION_HEADER, NUMBER, SHARED_HEADER

PROMPTS = ". "
TABLE_WORDS = frozenset([*LOCATION_HEADER, *JOINT_HEADER, *SHARED_HEADER, "HAND"])


class PendingAnswers:
    """What was typed and not answered in time, for as long as its answer may still come."""

    def __init__(self, clock: Callable[[], float], lasts_s: float) -> None:
        """lasts_s: how late an answer may come."""
        self._clock, self._lasts_s = clock, lasts_s
        self._owed: list[tuple[str, float]] = []

    def add(self, command: str) -> None:
        """An answer to this, or its echo, did not come in time. Empty: a prompt did not."""
        self._owed.append((command, self._clock()))

    def table_came(self) -> None:
        """A table has answered a WHERE: no answer to a line typed before it comes any more, but a table that another
        WHERE may owe."""
        self._owed = [(command, at_s) for command, at_s in self._owed if command == "WHERE"]

    def explain(self, heard: Sequence[str]) -> bool:
        """Whether what was heard (prompts as dots) may be such an answer."""
        self._owed = [(command, at_s) for command, at_s in self._owed if self._clock() - at_s <= self._lasts_s]
        lines = [line.strip(PROMPTS) for text in heard for line in text.splitlines()]
        return any(all(_may_answer(line, command) for line in lines if line) for command, _ in self._owed)


def _may_answer(line: str, command: str) -> bool:
    """What a person types is echoed, and is neither our own line nor of a table."""
    if command == "WHERE":
        return line == command or all(word in TABLE_WORDS or NUMBER.fullmatch(word) for word in line.split())
    return line == command or not (
        command == "" or commands.answers_nothing(command) or commands.moves_the_arm(command)
    )
