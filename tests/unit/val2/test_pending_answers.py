"""Whose line it is that comes while an answer of the controller's is owed."""

from __future__ import annotations

import asyncio

import pytest

from drivers.val2.errors import Disturbed, NoAnswer
from drivers.val2.link import Link
from drivers.val2.pending_answers import PendingAnswer, PendingAnswers
from tests.fakes.in_time import lived
from tests.unit.val2.test_link_scripted import GOAL, PROMPT, START, Scripted, linked, table, usual

WHERE = "X Y Z O A T\r\n500.00 0 0 0 0 0.000\r\nJT1 JT2 JT3 JT4 JT5 JT6\r\n1 2 -3.5 4 5 6\r\n"


@pytest.mark.parametrize(
    ("owed", "heard", "explained"),
    [
        ([], ["."], False),
        (["WHERE"], [WHERE, "."], True),
        (["WHERE"], ["WHERE", WHERE, "."], False),  # its echo had come: another asks
        (["WHERE"], ["X Y Z O A T\r\n500.00"], True),
        (["WHERE"], ["."], True),
        (["WHERE"], [WHERE, "SPEED 100", "."], False),
        (["WHERE"], ["DO DRIVE 1,40,50", "."], False),
        (["SPEED 40"], ["."], True),
        (["SPEED 40"], ["SPEED 40", "."], False),
        (["SPEED 40"], ["SPEED 100", "."], False),
        (["SPEED 40"], [WHERE, "."], False),
        (["DO MOVES GOAL"], ["DO MOVE #P", "."], False),
        (["STATUS"], ["Monitor speed 40", "."], True),
        (["stat"], ["Monitor speed 40", "."], True),
        (["BASE"], ["X 0.00 Y 0.00", "."], True),
        (["ABORT"], ["SPEED 99", "."], False),
        ([""], [".", "."], True),
        ([""], ["SPEED 100", "."], False),
        (["SPEED 40", "WHERE"], [WHERE, "."], True),
    ],
)
def test_what_comes_is_explained_only_by_what_it_may_answer(owed: list[str], heard: list[str], explained: bool) -> None:
    answers = PendingAnswers(lambda: 0.0, 60.0)
    for command in owed:
        answers.add(PendingAnswer(command))
    assert answers.explain(heard) is explained


@pytest.mark.parametrize(("heard", "explained"), [("WHERE", True), ("SPEED 40", False), (WHERE, False), (".", True)])
def test_of_a_line_without_its_echo_no_answer_is_owed_but_its_echo(heard: str, explained: bool) -> None:
    """It was never ended."""
    answers = PendingAnswers(lambda: 0.0, 60.0)
    answers.add(PendingAnswer("WHERE", is_echo=True))
    assert answers.explain([heard, "."]) is explained
    answers.table_came()
    assert not answers.explain([heard, "."])


@pytest.mark.parametrize(("after_s", "explained"), [(60.0, True), (60.1, False)])
def test_an_answer_is_owed_for_so_long(after_s: float, explained: bool) -> None:
    now = [5.0]
    answers = PendingAnswers(lambda: now[0], 60.0)
    answers.add(PendingAnswer("WHERE"))
    now[0] += after_s
    assert answers.explain(["."]) is explained


@pytest.mark.parametrize(("owed", "heard", "explained"), [("STATUS", "SPEED 99", False), ("WHERE", WHERE, True)])
def test_behind_a_table_only_another_table_is_owed(owed: str, heard: str, explained: bool) -> None:
    answers = PendingAnswers(lambda: 0.0, 60.0)
    answers.add(PendingAnswer(owed))
    assert answers.explain([heard, "."])
    answers.table_came()
    assert answers.explain([heard, "."]) is explained


def test_an_answer_that_noise_took_from_a_stop_does_not_explain_another_s_lines_half_a_minute_later() -> None:
    """They were taken for the answer to ABORT: DO BREAK was typed again, nothing was said, and all went on."""

    async def story() -> tuple[list[str], list[str]]:
        broken: list[str] = []

        def says(line: str, nth: int) -> str:
            if (line, nth) == ("ABORT", 2):  # the one that is judged
                broken.append(line)
                return ""
            if line == "DO BREAK" and broken:
                return "\r\nDO SPEED 250 ALWAYS\r\nSPEED 99\r\n..."
            return usual(line, nth)

        link, dropped = await opened(Scripted(says))
        await link.stop_motion()
        await asyncio.sleep(30.0)
        await link.where()
        with pytest.raises(Disturbed, match="SPEED 250"):
            await link.command("DO BREAK")
        return broken, dropped

    assert lived(story()) == (["ABORT"], ["dropped"])


def test_a_line_of_others_amid_the_first_answer_after_opening_is_noticed() -> None:
    """It was taken for a part of the answer to BREAK: the line counted as opened, and nobody was told."""

    async def story() -> None:
        says = lambda line, nth: "\r\n.SPEED 250\r\n." if line == "DO BREAK" else usual(line, nth)  # noqa: E731
        with pytest.raises(Disturbed, match="SPEED 250"):
            await linked(Scripted(says)).open()

    lived(story())


class Busy(Scripted):
    """Echoes and cancels at once, as a terminal driver does; the second WHERE is carried out only so many seconds
    later."""

    late_s = 0.0

    def write(self, data: bytes) -> None:
        """See Port."""
        if self.late_s and data == b"\r" and self._line == b"WHERE":
            self.loop.call_later(self.late_s, self.hear, table().encode())
            self.loop.call_later(0.001, self.hear, b"\r\n")
            self.late_s, self._line = 0.0, b""
        else:
            super().write(data)


async def opened(port: Scripted) -> tuple[Link, list[str]]:
    """A link, and a list that grows each time what is believed is dropped."""
    link, dropped = linked(port), list[str]()
    link.disturbed = lambda: dropped.append("dropped")
    await link.open()
    await link.where()
    return link, dropped


@pytest.mark.parametrize("late_s", [5.5, 9.0, 20.0])
def test_an_answer_that_comes_late_is_said_to_be_late_and_blamed_on_nobody(late_s: float) -> None:
    """A controller that was busy for more than `answer_s`, with its terminal driver at work: in 40 of 40 drawn moments
    somebody else was said to type on the line, and what was believed of arm and gripper was dropped."""

    async def story() -> list[str]:
        port = Busy(usual)
        link, said = await opened(port)
        port.late_s = late_s
        for _ in range(30):
            try:
                await link.where()
            except NoAnswer as error:
                said.append(error.message)
            await asyncio.sleep(1.0)
        return said

    (told,) = lived(story())
    assert told.startswith("the controller answered too late (received 'X Y Z O A T")


def test_a_line_of_somebody_elses_is_theirs_also_while_an_answer_is_owed() -> None:
    async def story() -> list[str]:
        port = Busy(usual)
        link, dropped = await opened(port)
        port.late_s = 20.0
        await link.where()  # asked again
        port.hear(b"SPEED 100\r\n.")
        await asyncio.sleep(1.0)
        with pytest.raises(Disturbed, match="SPEED 100"):
            await link.where()
        return dropped

    assert lived(story()) == ["dropped"]


def test_a_late_answer_before_a_move_keeps_the_move_back() -> None:
    """It may be the place where the arm was then: nothing is sent from there, and nobody is blamed."""

    async def story() -> tuple[list[str], list[str]]:
        port = Busy(usual)
        link, dropped = await opened(port)
        port.late_s = 20.0
        await link.where()
        port.hear(table().encode())
        await asyncio.sleep(1.0)
        with pytest.raises(NoAnswer, match="too late"):
            await link.move(GOAL, start=START, straight=True)
        return dropped, [line for line in port.lines if "MOVE" in line]

    assert lived(story()) == ([], [])


def test_half_a_line_that_is_refused_is_taken_back_and_not_refused_for_ever() -> None:
    """Where the arm may not move nothing types a stop that would: each WHERE failed, until somebody gave one."""

    async def story() -> list[str]:
        link, _ = await opened(port := Scripted(usual))
        port.hear(b"SPE")
        port._line = b"SPE"
        with pytest.raises(Disturbed, match="SPE"):
            await link.where()
        await link.where()
        return port.lines[-1:]

    assert lived(story()) == ["WHERE"]


def test_on_opening_a_prompt_that_comes_late_is_not_somebody_elses_letters() -> None:
    """An echo that takes as long as a prompt is waited for: the message blamed somebody who was not there."""

    class Slow(Scripted):
        def write(self, data: bytes) -> None:
            """See Port."""
            heard, self.hear = self.hear, lambda said: self.loop.call_later(1.0, heard, said)
            super().write(data)
            self.loop.call_later(0.002, setattr, self, "hear", heard)

    async def story() -> str:
        with pytest.raises(NoAnswer) as raised:
            await linked(Slow(lambda *_: PROMPT)).open()
        return raised.value.message

    assert "somebody" not in lived(story())


def test_a_search_owes_its_echo_until_that_comes_or_a_line_is_answered() -> None:
    answers = PendingAnswers(lambda: 0.0, 60.0)
    answers.search_typed([b"^U"])
    assert not answers.owes_search_echo, "no key of this controller came back with a caret yet"
    answers.search_heard(b"^U\r\n.")
    answers.search_typed([b"^U", b"!!"])
    assert answers.owes_search_echo
    answers.search_heard(b"!!")
    assert answers.owes_search_echo
    answers.line_answered()
    assert not answers.owes_search_echo
