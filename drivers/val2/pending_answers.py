"""Answers that the controller still owes: recognise a late answer, so that it is not taken for somebody else's line."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from drivers.val2 import commands
from drivers.val2.wire import JOINT_HEADER, LOCATION_HEADER, NUMBER, SHARED_HEADER

PROMPTS = ". "
TABLE_WORDS = frozenset([*LOCATION_HEADER, *JOINT_HEADER, *SHARED_HEADER, "HAND"])


@dataclass(frozen=True)
class PendingAnswer:
    """What may still come after a line that facetd typed. is_echo: its echo, which did not come, so the line was not
    ended; otherwise its answer. line: empty for the line that searches for a prompt, whose answer is prompts."""

    line: str
    is_echo: bool = False

    def may_be(self, heard: str) -> bool:
        """Whether a received line may be this answer."""
        if self.is_echo:
            return heard == self.line
        if self.line == "WHERE":
            return all(word in TABLE_WORDS or NUMBER.fullmatch(word) for word in heard.split())
        return commands.prints_text(self.line)


class PendingAnswers:
    """Lines that were not answered in time, kept for as long as their answers may still come."""

    def __init__(self, clock: Callable[[], float], lasts_s: float) -> None:
        """lasts_s: the greatest delay of an answer."""
        self._clock, self._lasts_s = clock, lasts_s
        self._owed: list[tuple[PendingAnswer, float]] = []
        self._search_echoes, self._ever_heard = Counter[bytes](), set[bytes]()

    def search_typed(self, echoes: Sequence[bytes]) -> None:
        """Note how the controller may echo what was just typed to search for the prompt."""
        self._search_echoes.update(echoes)

    def search_heard(self, raw: bytes) -> None:
        """Note what came while a prompt was searched for."""
        heard = Counter({echo: raw.count(echo) for echo in self._search_echoes})
        self._ever_heard.update(+heard)
        self._search_echoes -= heard

    def line_answered(self) -> None:
        """Note that a line was answered: whatever was typed before it is answered, too."""
        self._search_echoes.clear()

    @property
    def owes_search_echo(self) -> bool:
        """Whether a search found a prompt that came before its own echo, which is still to come. A key's echo (`^U`)
        comes only from a controller that gave one before."""
        return any(echo in self._ever_heard or not echo.startswith(b"^") for echo in self._search_echoes)

    def add(self, owed: PendingAnswer) -> None:
        """Note an answer that did not come in time."""
        self._owed.append((owed, self._clock()))

    def table_came(self) -> None:
        """Note that a table has answered a WHERE: earlier lines are answered by now, except that another WHERE may
        still owe its table."""
        self._owed = [(owed, at_s) for owed, at_s in self._owed if owed == PendingAnswer("WHERE")]

    def explain(self, heard: Sequence[str]) -> bool:
        """Whether received text (prompts as dots) may be an owed answer."""
        self._owed = [(owed, at_s) for owed, at_s in self._owed if self._clock() - at_s <= self._lasts_s]
        lines = [line.strip(PROMPTS) for text in heard for line in text.splitlines()]
        return any(all(owed.may_be(line) for line in lines if line) for owed, _ in self._owed)
