"""The echo of the key that searches for a prompt, late: nobody else typed it. What somebody else typed is theirs."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any

import pytest

from drivers.val2.dialect import Dialect
from drivers.val2.errors import ControllerError, Disturbed, Garbled, NoAnswer
from drivers.val2.link import Link
from tests.fakes.chosen import few
from tests.fakes.in_time import lived
from tests.unit.val2.test_link_scripted import PROMPT, Scripted, linked, table

CARETS = "^U" + PROMPT
REFUSED = "\r\n*Illegal command*" + PROMPT
BYTE_S = 0.001


def says(line: str, _: int) -> str:
    return table() if line == "WHERE" else REFUSED if line.startswith("!") else PROMPT


class Stalled(Scripted):
    """A port that gives what came byte by byte, and before some bytes (by their number) nothing for a while: what a
    computer does that is too busy to read."""

    def __init__(self) -> None:
        super().__init__(says, at_first=CARETS)
        self.stalls_s: dict[int, float] = {}
        self.came = 0
        self._free_s = 0.0

    def open(self, _: str, __: Dialect, on_bytes: Callable[[bytes], None], ___: Any) -> Stalled:
        self.loop = asyncio.get_running_loop()

        def hear(data: bytes) -> None:
            for k in range(len(data)):
                due_s = max(self._free_s + BYTE_S, self.loop.time())
                self._free_s = due_s + self.stalls_s.get(self.came, 0.0)
                self.loop.call_at(self._free_s, on_bytes, data[k : k + 1])
                self.came += 1

        self.hear = hear
        return self


async def opened() -> tuple[Stalled, Link, list[str]]:
    """A line on which bytes may be late, the open link on it, and the list that grows as somebody else is noticed."""
    port, voided = Stalled(), list[str]()
    link = linked(port)
    link.disturbed = lambda: voided.append("void")
    await link.open()
    return port, link, voided


@pytest.mark.parametrize("searches", few([2, 1, 3], 1))
@pytest.mark.parametrize("ask", [Link.where, lambda link: link.command("SPEED 40")], ids=["WHERE", "SPEED"])
def test_the_late_echo_of_a_search_is_nobodys_line_wherever_it_stands_in_the_next_exchange(
    ask: Callable[[Link], Any], searches: int
) -> None:
    """An answer is so late that a prompt was searched for; its own prompt then ends the search, whose echo comes behind
    that, amid the next line. Every byte behind the answer is late once."""

    async def story(behind: int) -> int:
        port, link, voided = await opened()
        first = port.came
        await ask(link)
        answered, answer = port.came, port.came - first
        late_s = link.dialect.answer_s + (searches - 0.7) * link.dialect.resync_s
        port.stalls_s = {answered + answer - 1: late_s, answered + answer + behind: 0.04}
        await ask(link)
        assert not voided
        await link.where()
        await link.close()
        return port.came - answered - answer

    late = lived(story(0))
    assert late > searches * len(CARETS)
    for behind in range(1, late):
        lived(story(behind))


@pytest.mark.parametrize("stall_s", [0.04, 2.2])
@pytest.mark.parametrize("searches", [1, 2])
def test_behind_a_move_whose_answer_was_lost_neither_the_search_nor_our_reading_is_somebody_elses(
    searches: int, stall_s: float
) -> None:
    """A line that moves is not typed again: what was half typed after it, to read where the arm is, is taken back."""

    async def story(behind: int) -> int:
        port, link, voided = await opened()
        first = port.came
        await link.command("DO MOVE #A", timeout_s=5.0)
        answered, answer = port.came, port.came - first
        late_s = 5.0 + (searches - 0.7) * link.dialect.resync_s
        port.stalls_s = {answered + answer - 1: late_s, answered + answer + behind: stall_s}
        with pytest.raises(NoAnswer):
            await link.command("DO MOVE #A", timeout_s=5.0)
        for _ in range(3):  # on a line that is still catching up the first may fail, and says so
            with contextlib.suppress(Garbled, NoAnswer, ControllerError):
                await link.where()
        assert (await link.where()).location.values()[0] == 500.0
        assert not voided
        assert port.lines.count("DO MOVE #A") == 2
        await link.close()
        return port.came - answered - answer

    behind, late = 0, 1
    while behind < late:
        late = min(lived(story(behind)), len(CARETS) + len("WHERE") + (searches - 1) * len(CARETS + "!!" + REFUSED))
        behind += 1
    assert behind > searches * len(CARETS)


class Beside(Scripted):
    """A port on which something comes just before the echo of a line that is typed for the n-th time (from 0)."""

    def __init__(self, at_first: str, line: str, nth: int, heard: str) -> None:
        super().__init__(self._answer, at_first)
        self._unanswered = nth > 0
        self._left, self._typed_as, self._theirs = nth, line.encode(), heard

    def _answer(self, line: str, nth: int) -> str:
        return "" if self._unanswered and line.encode() == self._typed_as and nth == 0 else says(line, nth)

    def write(self, data: bytes) -> None:
        """See Port."""
        if data == self._typed_as:
            if self._left == 0:
                self.loop.call_later(0.0005, self.hear, self._theirs.encode())
            self._left -= 1
        super().write(data)


@pytest.mark.parametrize("nth", [0, 1], ids=["no search", "searched"])
@pytest.mark.parametrize(
    ("at_first", "theirs"),
    [(CARETS, CARETS), (CARETS, PROMPT), (PROMPT, PROMPT)],
    ids=["their key", "their Enter", "their Enter, keys come back without carets"],
)
def test_what_somebody_else_types_is_theirs_where_no_echo_of_ours_is_due(at_first: str, theirs: str, nth: int) -> None:
    async def story() -> None:
        port = Beside(at_first, "SPEED 40", nth, theirs)
        link = linked(port)
        await link.open()
        with pytest.raises(Disturbed):
            await link.command("SPEED 40")
        await link.close()

    lived(story())
