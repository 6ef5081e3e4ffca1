"""Answers that the controller owes: what comes too late is no answer any more, and is nobody else's line."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from drivers.val2 import commands
from drivers.val2.wire import JOINT_HEADER, LOCATION_HEADER, NUMBER, SHARED_HEADER

PROMPTS = ". "
TABLE_WORDS = frozenset([*LOCATION_HEADER, *JOINT_HEADER, *SHARED_HEADER, "HAND"])


@dataclass(frozen=True)
class Owed:
    """What may still come of a line that was typed: its echo where that did not come, for then it was never ended; else
    its answer. Of the empty line, which looks for a prompt: prompts."""

    line: str
    is_echo: bool = False

    def may_be(self, heard: str) -> bool:
        """Whether a line that came is of this kind."""
        if self.is_echo:
            return heard == self.line
        if self.line == "WHERE":
            return all(word in TABLE_WORDS or NUMBER.fullmatch(word) for word in heard.split())
        return commands.prints_text(self.line)


class PendingAnswers:
    """What was typed and not answered in time, for as long as its answer may still come."""

    def __init__(self, clock: Callable[[], float], lasts_s: float) -> None:
        """lasts_s: how late an answer may come."""
        self._clock, self._lasts_s = clock, lasts_s
        self._owed: list[tuple[Owed, float]] = []

    def add(self, owed: Owed) -> None:
        """Note what did not come in time."""
        self._owed.append((owed, self._clock()))

    def table_came(self) -> None:
        """A table has answered a WHERE: nothing of a line typed before it comes any more, but a table that another
        WHERE may owe."""
        self._owed = [(owed, at_s) for owed, at_s in self._owed if owed == Owed("WHERE")]

    def explain(self, heard: Sequence[str]) -> bool:
        """Whether what was heard (prompts as dots) may be owed."""
        self._owed = [(owed, at_s) for owed, at_s in self._owed if self._clock() - at_s <= self._lasts_s]
        lines = [line.strip(PROMPTS) for text in heard for line in text.splitlines()]
        return any(all(owed.may_be(line) for line in lines if line) for owed, _ in self._owed)
