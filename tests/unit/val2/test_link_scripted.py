"""The link against a controller that says what is written down, in simulated time: what is typed, what comes of it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from drivers.val2.dialect import Dialect
from drivers.val2.errors import ControllerError, NoAnswer, PortError
from drivers.val2.link import Link
from tests.worlds.in_time import lived

PROMPT = "\r\n."
ASKS = "\r\nAre you sure (Y/N)? "


def table(x: float = 500.0, t: float = 0.0) -> str:
    return f"\r\nX Y Z O A T\r\n{x:.2f} 0 0 0 0 {t:.3f}\r\nJT1 JT2 JT3 JT4 JT5 JT6\r\n1 2 3 4 5 6" + PROMPT


class Scripted:
    """A port: echoes, takes lines, says to each what the test has for it; a control-U gives the prompt."""

    def __init__(self, says: Callable[[str, int], str], at_first: str = PROMPT, echo: bool = True) -> None:
        """says: to a line typed for the n-th time (from 0); at_first: what a control-U gives."""
        self.says, self.at_first, self.echo = says, at_first, echo
        self.lines: list[str] = []
        self._line = b""

    def open(self, _: str, __: Dialect, on_bytes: Callable[[bytes], None], ___: Any) -> Scripted:
        self.hear, self.loop = on_bytes, asyncio.get_running_loop()
        return self

    def write(self, data: bytes) -> None:
        """See Port."""
        said = ""
        for byte in data:
            if byte == 0x15:
                self._line, said = b"", said + self.at_first
            elif byte == 0x0D:
                line, self._line = self._line.decode(), b""
                said += self.says(line, self.lines.count(line))
                self.lines.append(line)
            else:
                self._line += bytes([byte])
                said += chr(byte) * self.echo
        if said:
            self.loop.call_later(0.001, self.hear, said.encode())

    def close(self) -> None:
        """See Port."""


def linked(port: Scripted, **settings: Any) -> Link:
    return Link("scripted", Dialect(**settings), asyncio.get_running_loop().time, open_port=port.open)


def usual(line: str, _: int) -> str:
    return table() if line == "WHERE" else PROMPT


@pytest.mark.parametrize("echo", [True, False])
def test_a_controller_that_says_nothing_on_opening_is_told_to_stop_only_where_nothing_is_echoed(echo: bool) -> None:
    """Where it echoes, an arm at work would have shown: then it is off, or not there."""

    async def story() -> None:
        port = Scripted(lambda *_: "", at_first="", echo=False)
        link = linked(port, echo=echo)
        with pytest.raises(NoAnswer, match="is the controller on"):
            await link.open()
        assert ("ABORT" in port.lines) is not echo
        assert not link.connected
        assert not link.stopped_on_opening

    lived(story())


def test_a_question_that_is_asked_again_after_the_first_no_is_declined_a_second_time() -> None:
    """The first stood behind what somebody had left in the line."""

    async def story(again: int) -> tuple[list[str], str | None]:
        port = Scripted(lambda line, nth: ASKS if line == "N" and nth < again else usual(line, nth), at_first=ASKS)
        link = linked(port)
        await link.open()
        return [line for line in port.lines if line == "N"], link.question

    assert lived(story(0)) == (["N"], None)
    assert lived(story(1)) == (["N", "N"], None)
    assert lived(story(2)) == (["N", "N"], "Are you sure (Y/N)?")


def test_of_two_readings_that_agree_an_abort_gives_the_later() -> None:
    async def story() -> tuple[float, ...]:
        port = Scripted(lambda line, nth: table(500.0 + 0.01 * nth) if line == "WHERE" else PROMPT)
        link = linked(port, break_after_move=True)
        await link.open()
        where = await link.abort()
        assert where is not None
        return where.location.values()

    assert lived(story())[0] == pytest.approx(500.01)


def test_a_reading_is_the_same_place_up_to_what_the_dialect_says_in_length_and_in_turn() -> None:
    async def story(x: float, turned: float) -> bool:
        def says(line: str, nth: int) -> str:
            return table(500.0 + x * (nth % 2), turned * (nth % 2)) if line == "WHERE" else PROMPT

        link = linked(Scripted(says), same_place_mm=0.5, same_place_deg=0.5)
        await link.open()
        try:
            await link.still(0.0)
        except NoAnswer:
            return False
        return True

    assert lived(story(0.5, 0.0))
    assert not lived(story(0.51, 0.0))
    assert lived(story(0.0, 0.49))
    assert not lived(story(0.0, 0.51))


@pytest.mark.parametrize(
    ("said", "raised"), [("", None), ("\r\n*Illegal command*", None), ("\r\n*Arm power off*", "Arm power off")]
)
def test_what_is_said_on_the_way_back_to_a_prompt_is_told_but_for_what_we_made_it_say(
    said: str, raised: str | None
) -> None:
    """An answer is lost; what was typed to find the prompt again may be called an illegal command."""

    async def story() -> list[str]:
        port = Scripted(lambda line, nth: "" if (line, nth) == ("SPEED 5", 0) else usual(line, nth))
        link = linked(port)
        await link.open()
        port.at_first = said + PROMPT
        if raised is None:
            await link.speed(5.0)
        else:
            with pytest.raises(ControllerError, match=raised):
                await link.speed(5.0)
        return port.lines

    assert lived(story()).count("SPEED 5") == (2 if raised is None else 1)


def test_a_link_that_was_let_go_has_no_line_and_has_seen_no_stop_and_one_opened_anew_found_no_arm_at_work() -> None:
    async def story() -> None:
        link = linked(Scripted(usual))
        assert (link.connected, link.stop_seen, link.stopped_on_opening) == (False, False, False)
        await link.open()
        await link.prove_stop()
        assert (link.connected, link.stop_seen) == (True, True)
        await link.close()
        await link.close()
        assert (link.connected, link.stop_seen) == (False, False)
        with pytest.raises(PortError, match="not open"):
            await link.where()
        link.stopped_on_opening = True
        await link.open()
        assert not link.stopped_on_opening

    lived(story())
