"""The link against a controller that says what is written down, in simulated time: what is typed, what comes of it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import pytest

from drivers.val2.conversation import Unconditional
from drivers.val2.dialect import Dialect
from drivers.val2.errors import (
    ControllerError,
    Disturbed,
    Elsewhere,
    Garbled,
    LineHeldBack,
    NoAnswer,
    PortError,
    Preempted,
    StopWordRefused,
)
from drivers.val2.link import PREAMBLE_S, Link, MoveStart, NextMove
from drivers.val2.location import Location
from drivers.val2.wire import Where
from tests.fakes.in_time import lived

PROMPT = "\r\n."
ASKS = "\r\nAre you sure (Y/N)? "


def table(x: float = 500.0, t: float = 0.0, joints: str = "1 2 3 4 5 6") -> str:
    return f"\r\nX Y Z O A T\r\n{x:.2f} 0 0 0 0 {t:.3f}\r\nJT1 JT2 JT3 JT4 JT5 JT6\r\n{joints}" + PROMPT


class Scripted:
    """A port: echoes, takes lines, says to each what the test has for it; a control-U gives the prompt."""

    def __init__(self, says: Callable[[str, int], str], at_first: str = PROMPT, echo: bool = True) -> None:
        """says: to a line typed for the n-th time (from 0); at_first: what a control-U gives."""
        self.says, self.at_first, self.echo = says, at_first, echo
        self.lines: list[str] = []
        self._line = b""

    def open(self, _: str, __: Dialect, on_bytes: Callable[[bytes], None], ___: Any) -> Scripted:
        self.hear: Callable[[bytes], object] = on_bytes
        self.loop = asyncio.get_running_loop()
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

    def overtake(self) -> None:
        """See Port."""

    def close(self) -> None:
        """See Port."""


GOAL = Location(500.0, 0.0, 0.0, 0.0, 0.0, 0.0)
TRANS = "TRANS(500.00,0.00,0.00,0.000,0.000,0.000)"
START = MoveStart(40.0, lambda where: None)


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
        with pytest.raises(NoAnswer, match="gives no prompt"):
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


def test_who_comes_while_the_line_is_opened_types_nothing_amid_that() -> None:
    """A WHERE behind the key that cancels made the prompt to it an echo that was none; the arm was stopped for it, and
    what an operator asked for just then ended with the fault `a stop is under way`."""

    async def story() -> list[str]:
        port = Scripted(usual)
        link = linked(port)
        opening = asyncio.ensure_future(link.open())
        await asyncio.sleep(0.0)
        assert not opening.done()
        where = asyncio.ensure_future(link.where())
        hand = asyncio.ensure_future(link.set_hand(closed=False))
        await opening
        await asyncio.gather(where, hand)
        return port.lines

    assert lived(story()) == ["DO BREAK", "WHERE", "DO OPENI"]


def test_of_two_readings_that_agree_an_abort_gives_the_later() -> None:
    async def story() -> tuple[float, ...]:
        port = Scripted(lambda line, nth: table(500.0 + 0.01 * nth) if line == "WHERE" else PROMPT)
        link = linked(port, break_after_move=True)
        await link.open()
        where = await link.stop_motion()
        assert where is not None
        return where.location.values()

    assert lived(story())[0] == pytest.approx(500.01)


async def rests_behind(link: Link) -> bool:
    """Whether a link that is opened now takes the arm for at rest."""
    await link.open()
    try:
        await link.still(0.0)
    except NoAnswer:
        return False
    return True


def test_a_reading_is_the_same_place_up_to_what_the_dialect_says_in_length_and_in_turn() -> None:
    async def story(x: float, turned: float) -> bool:
        def says(line: str, nth: int) -> str:
            return table(500.0 + x * (nth % 2), turned * (nth % 2)) if line == "WHERE" else PROMPT

        return await rests_behind(linked(Scripted(says), same_place_mm=0.5, same_place_deg=0.5))

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
            await link.command("SPEED 5")
        else:
            with pytest.raises(ControllerError, match=raised):
                await link.command("SPEED 5")
        return port.lines

    assert lived(story()).count("SPEED 5") == (2 if raised is None else 1)


def test_what_is_reported_while_a_reading_behind_a_lost_answer_is_lost_as_well_is_not_lost() -> None:
    async def story() -> None:
        lost: list[str] = []

        def says(line: str, nth: int) -> str:
            if lost and line in lost:
                port.at_first = "\r\n*Arm power off*" + PROMPT if line == "WHERE" else PROMPT
                return ""
            return usual(line, nth)

        port = Scripted(says)
        link = linked(port)
        await link.open()
        lost += ["DO MOVE #A", "WHERE"]
        with pytest.raises(ControllerError, match="Arm power off"):
            await link.command("DO MOVE #A", timeout_s=1.0)

    lived(story())


def test_a_link_that_was_let_go_has_no_line_and_has_seen_no_stop_and_one_opened_anew_found_no_arm_at_work() -> None:
    async def story() -> None:
        link = linked(Scripted(usual))
        assert (link.connected, link.permission.stop_tests, link.stopped_on_opening) == (False, False, False)
        await link.open()
        await link.test_stop()
        assert (link.connected, link.permission.stop_tests) == (True, True)
        await link.close()
        await link.close()
        assert (link.connected, link.permission.stop_tests) == (False, False)
        with pytest.raises(PortError, match="not open"):
            await link.where()
        link.stopped_on_opening = True
        await link.open()
        assert not link.stopped_on_opening

    lived(story())


def told(
    act: Callable[[Link], Any], says: Callable[[str, int], str] = usual, **settings: Any
) -> tuple[Any, list[str], float]:
    """What an act on an open link gives or raises, what it types, and how long it takes, s."""

    async def story() -> tuple[Any, list[str], float]:
        port = Scripted(says)
        link = linked(port, **settings)
        await link.open()
        typed, began_s = len(port.lines), port.loop.time()
        try:
            came = await act(link)
        except Exception as error:
            came = error
        return came, port.lines[typed:], port.loop.time() - began_s

    return lived(story())


@pytest.mark.parametrize(("turned_deg", "rests"), [(0.01, True), (0.011, False)])
def test_an_arm_whose_joints_turn_while_its_tool_stays_where_it_is_does_not_rest(
    turned_deg: float, rests: bool
) -> None:
    """Two joints of a straight wrist, one against the other: the stop was called confirmed by the tool alone."""

    def says(line: str, nth: int) -> str:
        return table(joints=f"1 2 3 {4 + nth * turned_deg:.3f} 5 6") if line == "WHERE" else PROMPT

    async def story() -> bool:
        return await rests_behind(linked(Scripted(says)))

    assert lived(story()) is rests


def test_what_a_controller_asks_at_power_up_is_answered_in_turn_before_it_takes_a_command() -> None:
    def says(line: str, nth: int) -> str:
        return "\r\nInitialize (Y/N)? " if (line, nth) == ("Y", 0) else PROMPT

    async def story() -> list[str]:
        port = Scripted(says, at_first="\r\nLoad VAL-II from floppy (Y/N)? ")
        link = linked(port)
        await link.open()
        assert link.question == "Load VAL-II from floppy (Y/N)?"
        with pytest.raises(ControllerError, match="answer it"):
            await link.command("SPEED 5")
        answer = await link.power_up(("Y", "N"))
        assert answer.lines[-1] == "Initialize (Y/N)?"
        assert link.question is None
        with pytest.raises(ControllerError, match="the controller asks nothing"):
            await link.power_up()
        return port.lines

    assert lived(story()) == ["Y", "N"]


FLOPPY = "\r\nVAL\r\nLoad VAL-II from floppy (Y/N)? "


def test_the_yes_to_cal_is_given_to_no_question_of_a_controller_whose_power_went_just_then() -> None:
    async def story() -> list[str]:
        port = Scripted(lambda line, _: FLOPPY if line == "CAL" else PROMPT)
        link = linked(port)
        await link.open()
        with pytest.raises(ControllerError, match="asks 'Load VAL-II from floppy"):
            await link.calibrate()
        assert link.question == "Load VAL-II from floppy (Y/N)?"
        return port.lines

    assert lived(story()) == ["DO BREAK", "CAL"]


def test_the_answers_to_power_up_are_given_to_no_question_whose_yes_may_move_the_arm() -> None:
    async def story() -> list[str]:
        port = Scripted(lambda line, _: "\r\nCalibrate now (Y/N)? " if line == "Y" else PROMPT, at_first=FLOPPY)
        link = linked(port)
        await link.open()
        with pytest.raises(ControllerError, match="asks 'Calibrate now"):
            await link.power_up(("Y", "Y"))
        return port.lines

    assert lived(story()) == ["Y"]


@pytest.mark.parametrize(("asks", "may_run"), [(FLOPPY, False), ("\r\nGo on (Y/N)? ", True), (ASKS, False)])
def test_after_an_answer_to_a_question_that_nobody_knows_a_program_may_run(asks: str, may_run: bool) -> None:
    async def story() -> bool:
        port = Scripted(lambda line, _: asks if line == "CAL" else PROMPT)
        link = linked(port)
        await link.open()
        with pytest.raises(ControllerError):
            await link.command("CAL")
        await link.power_up(("N",))
        return link.program_may_run

    assert lived(story()) is may_run


@pytest.mark.parametrize(
    ("act", "typed", "settings"),
    [
        (lambda link: link.move(GOAL), [f"DO MOVE {TRANS}"], {}),
        (lambda link: link.move(GOAL, straight=True), [f"DO SET P={TRANS}", "DO MOVES P"], {"variable": "P"}),
        (lambda link: link.move(GOAL, straight=True), [f"DO MOVES {TRANS}"], {"straight_through_variable": False}),
        (lambda link: link.wait_until_at_rest(GOAL), ["DO BREAK", "WHERE"], {}),
        (lambda link: link.wait_until_at_rest(replace(GOAL, x_mm=500.1)), ["DO BREAK", "WHERE", "WHERE"], {}),
        (lambda link: link.wait_until_at_rest(replace(GOAL, a_deg=0.05)), ["DO BREAK", "WHERE", "WHERE"], {}),
        (lambda link: link.wait_until_at_rest(GOAL), ["WHERE", "WHERE"], {"break_after_move": False}),
        (lambda link: link.set_hand(closed=False), ["DO OPENI"], {}),
        (lambda link: link.set_hand(closed=True), ["DO CLOSEI"], {}),
        (lambda link: link.tool(GOAL), [f"TOOL {TRANS}"], {}),
        (
            lambda link: link.move(GOAL, start=START, straight=True),
            ["DO SPEED 100 ALWAYS", "SPEED 40", f"DO SET GOAL={TRANS}", "WHERE", "DO MOVES GOAL"],
            {},
        ),
        (
            lambda link: link.move(GOAL, start=START),
            ["DO SPEED 100 ALWAYS", "SPEED 40", "WHERE", f"DO MOVE {TRANS}"],
            {},
        ),
        (lambda link: link.calibrate(), ["CALIB", "Y"], {"calibrate_word": "CALIB"}),
        (lambda link: link.calibrate("N"), ["CAL", "N"], {}),
    ],
)
def test_what_is_typed_for_each_thing_the_arm_is_told(act: Any, typed: list[str], settings: dict[str, Any]) -> None:
    def says(line: str, nth: int) -> str:
        return ASKS if line.startswith("CAL") else usual(line, nth)

    came, lines, _ = told(act, says, **settings)
    assert not isinstance(came, Exception)
    assert lines == typed


@pytest.mark.parametrize(
    ("act", "seconds"),
    [
        (lambda link: link.command("STATUS"), 2.0),
        (lambda link: link.command("STATUS", timeout_s=3.0), 3.0),
        (lambda link: link.command("DO READY"), 40.0),
        (lambda link: link.set_hand(closed=False), 2.0),
        (lambda link: link.set_hand(closed=True), 2.0),
        (lambda link: link.move(GOAL), 40.0),
        (lambda link: link.move(GOAL, 7.0), 7.0),
        (lambda link: link.move(GOAL, straight=True), 40.0),
        (lambda link: link.move(GOAL, 7.0, straight=True), 7.0),
        (lambda link: link.calibrate(), 90.0),
    ],
)
def test_an_answer_is_waited_for_as_long_as_what_was_told_may_take(act: Any, seconds: float) -> None:
    def dumb(line: str, nth: int) -> str:
        """After the line was opened."""
        return PROMPT if line == "DO BREAK" else ""

    came, _, took_s = told(
        act,
        dumb,
        answer_s=2.0,
        motion_s=40.0,
        calibrate_s=90.0,
        typing_attempts=1,
        straight_through_variable=False,
    )
    assert isinstance(came, NoAnswer)
    assert f"within {seconds:g} s" in str(came)
    assert took_s >= seconds


def test_a_controller_without_a_speed_of_programs_may_refuse_it_in_whatever_words() -> None:
    for said, came in (("\r\n*Mischief*" + PROMPT, "None"), (ASKS, "the controller asks 'Are you sure")):

        def says(line: str, nth: int, said: str = said) -> str:
            return said if "ALWAYS" in line else usual(line, nth)

        assert str(told(lambda link: link.move(GOAL, start=START), says)[0]).startswith(came)

    async def in_a_stop(link: Link) -> None:
        stopping = asyncio.ensure_future(link.stop_motion())
        await asyncio.sleep(0.01)
        with pytest.raises(Preempted, match="a stop is under way"):
            await link.move(GOAL, start=START)
        await stopping

    assert told(in_a_stop)[0] is None


@pytest.mark.parametrize(("x", "t"), [(500.3, 0.0), (500.0, 0.3)])
def test_an_arm_at_rest_elsewhere_in_place_or_turn_is_told_once_it_has_lingered(x: float, t: float) -> None:
    def says(line: str, nth: int) -> str:
        return table(x, t) if line == "WHERE" else PROMPT

    came, _, took_s = told(lambda link: link.wait_until_at_rest(GOAL), says, stall_s=2.0)
    assert isinstance(came, Elsewhere)
    assert "at rest 0.30 mm and 0.00" in str(came) or "0.00 mm and 0.30 degrees" in str(came)
    assert came.where is not None
    assert came.where.location == Location(x, 0.0, 0.0, 0.0, 0.0, t)
    assert 2.0 <= took_s < 2.5
    came, _, took_s = told(lambda link: link.wait_until_at_rest(GOAL, 1.0), says, stall_s=2.0)
    assert isinstance(came, Elsewhere)
    assert 1.0 <= took_s < 1.5, "no longer than there is time"


def test_an_arm_that_does_not_come_to_rest_in_time_is_no_answer_with_where_it_was_last() -> None:
    def says(line: str, nth: int) -> str:
        return table(400.0 + nth) if line == "WHERE" else PROMPT

    came, lines, took_s = told(lambda link: link.wait_until_at_rest(GOAL, 1.0), says)
    assert isinstance(came, NoAnswer)
    assert came.where is not None
    assert came.where.location.x_mm == 400.0 + lines.count("WHERE") - 1
    assert 1.0 <= took_s < 1.3


def test_a_place_that_its_joints_do_not_put_the_tool_at_is_asked_for_again_and_never_given_out() -> None:
    async def story(bad: int, any_place: bool) -> Where:
        port = Scripted(lambda line, nth: table(999.0 if nth < bad else 500.0) if line == "WHERE" else PROMPT)
        link = Link(
            "scripted",
            Dialect(typing_attempts=3),
            asyncio.get_running_loop().time,
            open_port=port.open,
        )
        link.belongs_together = lambda where: where.location.x_mm < 900.0
        await link.open()
        return await link.still(1.0, True) if any_place else await link.still(1.0)

    assert lived(story(2, False)).location.x_mm == 500.0
    assert lived(story(9, True)).location.x_mm == 999.0
    with pytest.raises(Garbled, match="do not fit each other"):
        lived(story(9, False))


def test_an_arm_that_seems_at_work_on_opening_is_stopped_before_anything_else_is_typed() -> None:
    """The controller says something, and gives no prompt."""

    async def story() -> None:
        port = Scripted(usual, at_first="\r\nMOVING\r\n")
        link = linked(port)
        await link.open()
        assert link.stopped_on_opening
        assert link.permission.stop_tests
        assert port.lines[:2] == ["!!", "ABORT"]

    lived(story())


def test_opening_a_line_that_a_stop_waits_for_is_over_when_the_stop_is_and_found_no_arm_at_work() -> None:
    async def story() -> None:
        link = linked(Scripted(usual))
        opening = asyncio.ensure_future(link.open())
        await asyncio.sleep(0.0)
        stopping = asyncio.ensure_future(link.stop_motion())
        await opening
        assert stopping.done()
        assert link.permission.stop_tests
        assert not link.stopped_on_opening

    lived(story())


def test_where_no_break_is_typed_an_arm_is_seen_at_work_on_opening_by_two_readings_that_differ() -> None:
    async def story(moves: bool) -> tuple[list[str], bool]:
        port = Scripted(lambda line, nth: table(400.0 + moves * nth) if line == "WHERE" else PROMPT)
        link = linked(port, break_after_move=False)
        link.belongs_together = lambda _: False  # whose TOOL it is does not matter for that
        with contextlib.suppress(NoAnswer):  # this one moves for ever
            await link.open()
        return port.lines, link.stopped_on_opening

    lines, stopped = lived(story(False))
    assert (lines, stopped) == (["WHERE", "WHERE"], False)
    lines, _ = lived(story(True))
    assert lines[:4] == ["WHERE", "WHERE", "!!", "ABORT"]


ILLEGAL = "\r\n*Illegal command*" + PROMPT


def test_the_first_line_after_a_prompt_was_sought_is_typed_again_where_a_rest_stood_before_it_and_no_other() -> None:
    """What somebody left half typed makes it an illegal command; the second time it is one."""

    def says(line: str, nth: int) -> str:
        return ILLEGAL if line == "FOO" or (line == "DO BREAK" and nth == 0) else usual(line, nth)

    async def story() -> list[str]:
        port = Scripted(says)
        link = linked(port)
        await link.open()
        with pytest.raises(ControllerError, match="Illegal command"):
            await link.command("FOO")
        return port.lines

    assert lived(story()) == ["DO BREAK", "DO BREAK", "FOO"]

    def loses_one(line: str, nth: int) -> str:
        return ("", ILLEGAL, PROMPT)[nth] if line == "SPEED 5" else usual(line, nth)

    came, lines, _ = told(lambda link: link.command("SPEED 5"), loses_one)
    assert came.errors == ()
    assert lines == ["SPEED 5"] * 3

    def refuses_it(line: str, nth: int) -> str:
        return "\r\n*Not calibrated*" + PROMPT if line == "DO BREAK" else usual(line, nth)

    _, lines, _ = told(lambda link: link.command("SPEED 5"), refuses_it)
    assert lines == ["SPEED 5"], "another error is no rest"


@pytest.mark.parametrize(("says_where", "x"), [(table(432.0), 432.0), (PROMPT, None)])
def test_a_motion_whose_answer_is_lost_is_told_with_where_the_arm_is_if_that_is_to_be_had(
    says_where: str, x: float | None
) -> None:
    def says(line: str, _: int) -> str:
        return says_where if line == "WHERE" else "" if line.startswith("DO MOVE") else PROMPT

    came, lines, _ = told(lambda link: link.move(GOAL, 3.0), says)
    assert isinstance(came, NoAnswer)
    assert "no answer to" in str(came)
    assert (None if came.where is None else came.where.location.x_mm) == x
    assert lines == [f"DO MOVE {TRANS}", "WHERE"]


@pytest.mark.parametrize(
    ("at_first", "raised", "text"),
    [
        ("", NoAnswer, "within 3 s; then the controller gives no prompt"),
        (ASKS, ControllerError, "the controller asks 'Are you sure"),
    ],
)
def test_where_no_prompt_is_found_again_that_is_told_too(at_first: str, raised: type[Exception], text: str) -> None:
    async def story() -> None:
        port = Scripted(lambda line, nth: "" if line in ("STATUS", "!!") else usual(line, nth))
        link = linked(port, answer_s=3.0)
        await link.open()
        port.at_first = at_first
        with pytest.raises(raised, match=text):
            await link.command("STATUS")

    lived(story())


def test_a_where_without_its_table_is_asked_for_again_some_times() -> None:
    for given, tries in ((2, 3), (9, 3)):

        def says(line: str, nth: int, given: int = given) -> str:
            return table() if line == "WHERE" and nth >= given else PROMPT

        came, lines, _ = told(lambda link: link.where(), says, typing_attempts=3)
        assert lines == ["WHERE"] * tries
        assert str(came) == "the answer to WHERE was incomplete" if given > tries else isinstance(came, Where)


def test_an_answer_comes_back_whole_and_two_readings_are_a_pause_apart() -> None:
    said = {"STATUS": "\r\nall is well"}
    came, *_ = told(lambda link: link.command("STATUS"), lambda line, nth: said.get(line, "") + PROMPT)
    assert came.lines == ("all is well",)
    assert told(lambda link: link.still(5.0), poll_s=0.5)[2] >= 0.5


def test_an_arm_that_does_not_stop_is_told_again_and_again_and_where_it_was_last_is_told() -> None:
    def says(line: str, nth: int) -> str:
        return table(400.0 + nth) if line == "WHERE" else PROMPT

    came, lines, took_s = told(lambda link: link.stop_motion(), says, poll_s=0.5)
    assert isinstance(came, NoAnswer)
    assert str(came) == "the arm still moves after ABORT"
    assert came.where is not None
    assert came.where.location.x_mm == 400.0 + lines.count("WHERE") - 1
    assert lines == ["!!", "ABORT", "", "ABORT", "ABORT", "WHERE", "WHERE"] * 5
    assert took_s >= 5 * 2 * 0.5, "two readings are a pause apart"


def test_a_table_is_waited_for_in_a_stop_as_long_as_it_takes_on_a_slow_line() -> None:
    """Three hundred characters of ten bits, and what any answer takes."""
    came, *_ = told(
        lambda link: link.stop_motion(), lambda line, _: "" if line == "WHERE" else PROMPT, baud=100, resync_s=1.0
    )
    assert str(came) == "no answer to 'WHERE' within 31 s"


def test_what_a_command_asks_is_open_until_it_is_answered_and_a_stop_gets_past_it_with_a_no() -> None:
    asking = False

    def says(line: str, nth: int) -> str:
        nonlocal asking
        asking = line != "N" and (asking or line == "CAL")
        return ASKS if asking else usual(line, nth)

    async def act(link: Link) -> None:
        with pytest.raises(ControllerError, match="the controller asks 'Are you sure"):
            await link.command("CAL")
        assert link.question == "Are you sure (Y/N)?"
        with pytest.raises(ControllerError, match="answer it"):
            await link.command("SPEED 5")
        assert (await link.stop_motion()) is not None
        assert link.question is None
        await link.command("SPEED 5")

    came, lines, _ = told(act, says)
    assert came is None
    assert lines.count("N") == 1
    assert lines.count("SPEED 5") == 1


def test_an_error_is_told_with_the_place_that_was_printed_before_it() -> None:
    def says(line: str, nth: int) -> str:
        return table(432.0).removesuffix(PROMPT) + "\r\n*Out of range*" + PROMPT if line == "FOO" else usual(line, nth)

    came, *_ = told(lambda link: link.command("FOO"), says)
    assert str(came) == "*Out of range*"
    assert came.where.location.x_mm == 432.0


def test_whoever_hears_no_answer_as_the_arm_is_stopped_types_nothing_into_the_stop() -> None:
    """They sought the prompt on the line that was the stop's by then: their key that takes a line back went out behind
    its first words, and what the controller said to those they heard instead of the stop, which was a second late."""

    async def story() -> tuple[bytes, float]:
        typed, loop = bytearray(), asyncio.get_running_loop()
        port = Scripted(lambda line, nth: "" if line == "STATUS" else usual(line, nth))
        link = linked(port)
        await link.open()
        write, stopping = port.write, list[asyncio.Task[Where | None]]()
        port.write = lambda data: typed.extend(data) or write(data)

        def stop() -> None:
            stopping.append(asyncio.ensure_future(link.stop_motion()))
            loop.sleep(0.001)  # type: ignore[attr-defined]  # the computer is busy, and their time is up

        asking = asyncio.ensure_future(link.command("STATUS", timeout_s=2.0))
        while "STATUS" not in port.lines:
            await asyncio.sleep(0.0001)
        loop.call_later(1.9995, stop)
        with pytest.raises(Preempted):
            await asking
        began_s = loop.time()
        await stopping[0]
        return bytes(typed), loop.time() - began_s

    typed, seconds = lived(story())
    assert typed == b"STATUS\r\x15!!\rABORT\r\rABORT\rABORT\rWHERE\rWHERE\r"
    assert seconds < 0.5


def test_a_controller_that_asks_what_it_asks_at_power_up_has_not_taken_the_word_that_stops_the_arm() -> None:
    """Switched off and on as the stop was tried, it asked instead of answering: the stop was taken for seen, the arm
    was enabled, and the next thing that was told was typed as the answer to its question."""

    async def story() -> tuple[int, str | None, list[str]]:
        asks = "\r\nLoad VAL II from floppy (Y/N)? "
        port = Scripted(lambda line, nth: asks if line == "ABORT" else usual(line, nth))
        link = linked(port)
        await link.open()
        with pytest.raises(ControllerError, match="floppy"):
            await link.test_stop()
        with pytest.raises(ControllerError, match="floppy"):
            await link.where()
        return link.permission.stop_tests, link.question, port.lines

    stop_tests, question, lines = lived(story())
    assert (stop_tests, question) == (0, "Load VAL II from floppy (Y/N)?")
    assert set(lines) == {"DO BREAK", "!!", "ABORT", ""}


@pytest.mark.parametrize("amid", ["ABORT", "WHERE"])
def test_what_the_controller_says_by_itself_amid_a_stop_is_no_refusal_of_it_and_is_told_as_its_own_words(
    amid: str,
) -> None:
    """The stop was said not to be taken, and to press the emergency stop, as somebody had just pressed it."""

    async def story() -> tuple[int, str]:
        judged = {"ABORT": 2, "WHERE": 0}[amid]

        def says(line: str, nth: int) -> str:
            return ("\r\n*Emergency stop*" if (line, nth) == (amid, judged) else "") + usual(line, nth)

        link = linked(Scripted(says))
        await link.open()
        assert await link.stop_motion() is not None
        with pytest.raises(ControllerError) as said:
            await link.where()
        await link.where()
        return link.permission.stop_tests, str(said.value)

    assert lived(story()) == (1, "*Emergency stop*")


def test_a_word_that_is_refused_behind_what_the_controller_says_by_itself_is_refused() -> None:
    async def story() -> tuple[str, int]:
        def says(line: str, nth: int) -> str:
            if line != "ABORT":
                return usual(line, nth)
            return "\r\n" + ("*Arm power off*" if nth == 0 else "*What?*") + PROMPT

        link = linked(Scripted(says))
        await link.open()
        with pytest.raises(StopWordRefused) as refused:
            await link.test_stop()
        return str(refused.value), link.permission.stop_tests

    assert lived(story()) == ("the controller does not accept ABORT (it answers `*What?*`)", 0)


class Withheld(Unconditional):
    """Nobody permits motion."""

    withheld = True


@pytest.mark.parametrize("told", [PROMPT, "\r\n*Emergency stop*" + PROMPT])
def test_a_line_that_moves_and_is_held_back_is_taken_back_before_it_is_ended_and_what_was_told_meanwhile_is_not_lost(
    told: str,
) -> None:
    async def story() -> tuple[list[str], bytes, str]:
        port = Scripted(usual)
        link = linked(port)
        link.permission = Withheld()
        await link.open()
        port.at_first = told
        await link.command("SPEED 30")
        with pytest.raises((LineHeldBack, ControllerError)) as raised:
            await link.move(GOAL)
        return port.lines, port._line, str(raised.value)

    lines, half_typed, why = lived(story())
    assert lines == ["DO BREAK", "SPEED 30", "WHERE"]
    assert half_typed == b""
    assert why == (f"'DO MOVE {TRANS}' was held back" if told == PROMPT else "*Emergency stop*")


class Printing(Scripted):
    """Its program prints a line every half second, from EX on, until it has read the word that stops it so often."""

    def __init__(self, stops: int, at_once: bool = False) -> None:
        super().__init__(self.answer_from)
        self._stops, self._prints, self.at_first = stops, at_once, "" if at_once else PROMPT

    def open(self, *args: Any) -> Scripted:
        super().open(*args)
        self._print()
        return self

    def answer_from(self, line: str, nth: int) -> str:
        self._stops -= line == "ABORT"
        if line == "EX" or self._stops <= 0:
            self._prints, self.at_first = line == "EX", "" if line == "EX" else PROMPT
        return "" if self._prints else usual(line, nth)

    def _print(self) -> None:
        if self._prints:
            self.hear(b"\r\nPART 17 IS DONE\r\n")
        self.loop.call_later(0.5, self._print)


def test_a_stop_amid_what_a_program_prints_is_typed_again_as_long_as_it_prints() -> None:
    """Where the first words were lost nobody typed another: each line that the program printed was waited for."""

    async def story() -> float:
        port = Printing(stops=3)
        link = linked(port)
        await link.open()
        running = asyncio.ensure_future(link.command("EX", timeout_s=60.0))
        await asyncio.sleep(2.0)
        began_s = asyncio.get_running_loop().time()
        async with asyncio.timeout(60.0):
            await link.stop_motion()
        with pytest.raises(Preempted):
            await running
        return asyncio.get_running_loop().time() - began_s

    assert lived(story()) < 3.0


def test_a_program_that_prints_on_and_on_as_the_line_is_opened_is_stopped() -> None:
    async def story() -> tuple[bool, list[str], float]:
        port = Printing(stops=1, at_once=True)
        link = linked(port)
        async with asyncio.timeout(60.0):
            await link.open()
        return link.stopped_on_opening, port.lines, asyncio.get_running_loop().time()

    stopped, lines, seconds = lived(story())
    assert stopped
    assert "ABORT" in lines
    assert seconds < 3.0


def test_of_a_move_whose_place_is_not_where_it_was_to_start_no_line_that_moves_is_typed() -> None:
    def elsewhere(where: Where) -> None:
        raise Elsewhere(f"at x {where.location.x_mm:g}")

    for straight in (False, True):
        came, lines, _ = told(
            partial(Link.move, location=GOAL, start=MoveStart(40.0, elsewhere), straight=straight), usual
        )
        assert str(came) == "at x 500"
        assert lines[-1] == "WHERE"


@pytest.mark.parametrize("spoilt_line", [0, 1, 2, 3, 4])
def test_a_move_of_which_a_line_was_spoiled_as_it_was_typed_is_told_from_its_speed_on_once_more(
    spoilt_line: int,
) -> None:
    """Whoever spoiled it may have changed the speed, the location, or where the arm is."""
    told_once = ["DO SPEED 100 ALWAYS", "SPEED 40", f"DO SET GOAL={TRANS}", "WHERE"]
    whole = [*told_once, "DO MOVES GOAL"]

    async def story() -> list[str]:
        port = Scripted(usual)
        link = linked(port)
        await link.open()
        write, spoilt = port.write, []

        def spoils_one(data: bytes) -> None:
            if data == whole[spoilt_line].encode() and not spoilt:
                spoilt.append(data)
                data = data[:-1] + b"?"
            write(data)

        port.write = spoils_one
        del port.lines[:]
        await link.move(GOAL, start=START, straight=True)
        return port.lines

    assert lived(story()) == [*told_once, *whole]


THERE = Location(510.0, 0.0, 0.0, 0.0, 0.0, 0.0)
THEN = NextMove(THERE, straight=True, speed_pct=40.0)
AHEAD = ["DO SPEED 100 ALWAYS", "SPEED 40", "DO SET GOAL=TRANS(510.00,0.00,0.00,0.000,0.000,0.000)", "WHERE"]


def followed(
    between: Callable[[Link, Shared], Any], says: Callable[[str, int], str] = usual, **settings: Any
) -> tuple[list[str], list[float], Exception | None]:
    """What is typed of a move that was announced as the one before it ended, something having come in between; with
    the x of the places that were asked whether it may begin there."""

    async def story() -> tuple[list[str], list[float], Exception | None]:
        port, asked, came = Shared(says), list[float](), None
        link = linked(port, **settings)
        await link.open()
        await link.test_stop()
        await link.move(GOAL, start=START, straight=True)
        await link.wait_until_at_rest(GOAL, then=THEN)
        del port.lines[:]
        await between(link, port)
        try:
            await link.move(
                THERE, start=MoveStart(40.0, lambda where: asked.append(where.location.x_mm)), straight=True
            )
        except Disturbed as disturbed:
            came = disturbed
        return port.lines, asked, came

    return lived(story())


async def at_once(*_: object) -> None:
    """Nothing in between."""


def test_the_reading_that_ends_a_move_begins_the_next_where_that_follows_at_once() -> None:
    """Behind all that is told before it: WHERE is the last line before the one that moves."""
    lines, asked, _ = followed(at_once)
    assert (lines, asked) == (["DO MOVES GOAL"], [500.0])


def test_a_preamble_sent_ahead_goes_before_the_reading() -> None:
    async def story() -> list[str]:
        port = Scripted(usual)
        link = linked(port)
        await link.open()
        await link.move(GOAL, start=START, straight=True)
        del port.lines[:]
        await link.wait_until_at_rest(GOAL, then=THEN)
        return port.lines

    assert lived(story()) == ["DO BREAK", *AHEAD]


@pytest.mark.parametrize(
    "between",
    [
        lambda link, _: asyncio.sleep(2 * PREAMBLE_S),
        lambda link, _: link.command("SPEED 40"),
        lambda link, _: link.where(),
        lambda link, _: link.test_stop(),
        lambda link, _: link.set_hand(closed=True),
    ],
    ids=["time", "a speed", "a question", "a stop", "the gripper"],
)
def test_where_anything_was_typed_or_time_has_passed_all_is_told_and_asked_again(between: Any) -> None:
    lines, _, _ = followed(between)
    assert lines[-5:] == [*AHEAD, "DO MOVES GOAL"]


def test_what_was_heard_in_between_moves_nothing() -> None:
    async def types(link: Link, port: Shared) -> None:
        port.others("SPEED 100\r\n.")
        await asyncio.sleep(0)

    lines, asked, came = followed(types)
    assert isinstance(came, Disturbed)
    assert (lines, asked) == ([], [])


def test_of_another_move_than_the_one_announced_all_is_told() -> None:
    async def story(place: Location, speed_pct: float) -> list[str]:
        port = Scripted(usual)
        link = linked(port)
        await link.open()
        await link.move(GOAL, start=START, straight=True)
        await link.wait_until_at_rest(GOAL, then=THEN)
        del port.lines[:]
        await link.move(place, start=MoveStart(speed_pct, lambda where: None), straight=True)
        return port.lines

    assert lived(story(THERE, 40.0)) == ["DO MOVES GOAL"]
    assert len(lived(story(THERE, 30.0))) == len(lived(story(GOAL, 40.0))) == 5


def test_a_line_that_moves_and_is_spoiled_as_it_is_typed_has_all_told_again() -> None:
    async def spoils(link: Link, port: Shared) -> None:
        write, left = port.write, [b"DO MOVES GOAL"]

        def once(data: bytes) -> None:
            if data in left:
                left.remove(data)
                data = data[:-1] + b"?"
            write(data)

        port.write = once

    lines, asked, _ = followed(spoils)
    assert lines == [*AHEAD, "DO MOVES GOAL"]
    assert asked == [500.0, 500.0]


def test_where_the_arm_is_not_at_the_very_place_the_reading_begins_no_move() -> None:
    """It creeps, or arrived nearly: two readings agree first, and the next move asks again."""
    lines, _, _ = followed(at_once, lambda line, nth: table(500.1) if line == "WHERE" else PROMPT)
    assert lines == [*AHEAD, "DO MOVES GOAL"]


def test_where_moves_do_not_follow_at_once_no_preamble_is_sent_ahead_until_they_do() -> None:
    async def story() -> list[list[str]]:
        port, typed = Scripted(usual), []
        link = linked(port)
        await link.open()
        for wait_s in (2 * PREAMBLE_S, 0.0, 0.0):
            await link.move(GOAL, start=START, straight=True)
            del port.lines[:]
            await link.wait_until_at_rest(GOAL, then=NextMove(GOAL, straight=True, speed_pct=40.0))
            typed.append(list(port.lines))
            await asyncio.sleep(wait_s)
        return typed

    told, *later = [len(lines) for lines in lived(story())]
    assert (told, later) == (1 + len(AHEAD), [2, 1 + len(AHEAD)])


class Shared(Scripted):
    """A port on which somebody else types as well: it is echoed and answered to us."""

    def others(self, heard: str) -> None:
        """They type."""
        self.hear(heard.encode())


OTHERS = {
    "a command": "SPEED 100\r\n.",
    "where nothing is echoed": "\r\n.",
    "half a command": "SPEED 10",
    "another's answer": "\r\nprogram completed\r\n.",
    "another's WHERE": table(400.0)[2:],
}


@pytest.mark.parametrize("heard", OTHERS.values(), ids=OTHERS)
def test_what_answers_nothing_of_ours_sends_no_move_and_voids_what_is_believed(heard: str) -> None:
    """Between two commands, or while the one before the move is being answered."""

    async def story(within: bool) -> tuple[Exception | None, list[str], int, int]:
        port = Shared(usual)
        link = linked(port)
        await link.open()
        await link.test_stop()
        voided: list[str] = []
        link.disturbed = lambda: voided.append("void")
        del port.lines[:]
        if within:
            says = port.says
            port.says = lambda line, nth: (heard if line == "SPEED 40" else "") + says(line, nth)
        else:
            port.others(heard)
        await asyncio.sleep(0.1)
        came: Exception | None = None
        try:
            await link.move(GOAL, start=START, straight=True)
        except Exception as error:
            came = error
        return came, port.lines, len(voided), link.permission.stop_tests

    for within in (False, True):
        if within and heard in ("\r\n.", "SPEED 10"):
            continue  # the first is as long as it takes to be heard an answer of ours, the second no line
        came, lines, voided, stop_tests = lived(story(within))
        assert isinstance(came, Disturbed | Garbled)
        assert within or "another terminal or program types on the controller's line" in str(came)
        assert "DO MOVES GOAL" not in lines
        assert within or (voided, stop_tests) == (1, 0)


@pytest.mark.parametrize("line", ["DO SPEED 100 ALWAYS", "SPEED 40", f"DO SET GOAL={TRANS}"])
def test_what_somebody_types_behind_our_prompt_and_gets_refused_is_theirs_and_no_refusal_of_ours(line: str) -> None:
    """Their refused line must not hide the next one, which is carried out: here a program speed of 300 percent."""
    theirs = ".DO DRIVE 1,85,90\r\n*Joint 1 out of range*\r\n.DO SPEED 300 ALWAYS"

    async def story() -> list[str]:
        port = Scripted(lambda typed, nth: (f"\r\n{theirs}" if typed == line else "") + usual(typed, nth))
        link = linked(port)
        await link.open()
        await link.test_stop()
        with pytest.raises(Disturbed, match="DO SPEED 300 ALWAYS"):
            await link.move(GOAL, start=START, straight=True)
        assert not link.permission.stop_tests
        return port.lines

    assert "DO MOVES GOAL" not in lived(story())


@pytest.mark.parametrize("line", ["SPEED 40", f"DO SET GOAL={TRANS}"])
def test_a_second_prompt_to_a_line_before_a_move_keeps_the_move_back(line: str) -> None:
    """Where nothing is echoed the prompt is all that is heard of what somebody else typed."""

    async def story() -> list[str]:
        port = Scripted(usual, echo=False)
        link = linked(port, echo=False, prompt_silence_s=0.005)
        await link.open()
        await link.test_stop()
        del port.lines[:]

        def types_as_well(typed: str, nth: int) -> str:
            if typed == line:
                port.loop.call_later(0.01, port.hear, PROMPT.encode())
            return usual(typed, nth)

        port.says = types_as_well
        with pytest.raises((Disturbed, Garbled)):
            await link.move(GOAL, start=START, straight=True)
        return port.lines

    assert "DO MOVES GOAL" not in lived(story())


@pytest.mark.parametrize("prompt", [".", "..", ". ", "\r\n."])
@pytest.mark.parametrize("echo", [True, False])
def test_the_stop_is_confirmed_however_prompts_are_printed_and_is_tried_as_it_is_used(echo: bool, prompt: str) -> None:
    """Without a line end before them, the prompts to all that a stop types stand in one line."""

    async def story() -> tuple[list[str], list[str]]:
        def says(line: str, _: int) -> str:
            said = "*Illegal command*\r\n" if line == "!!" else ""
            return (table().removesuffix(PROMPT) + "\r\n" if line == "WHERE" else "\r\n" * echo + said) + prompt

        port = Scripted(says, at_first=prompt, echo=echo)
        link = linked(port, echo=echo)
        await link.open()
        del port.lines[:]
        await link.test_stop()
        tried = list(port.lines)
        assert link.permission.stop_tests
        del port.lines[:]
        assert await link.stop_motion() is not None
        return tried, port.lines

    tried, used = lived(story())
    assert tried == used == ["!!", "ABORT", "", "ABORT", "ABORT", "WHERE", "WHERE"]


def test_what_somebody_else_types_between_two_readings_of_an_arm_at_rest_is_told() -> None:
    """The line is ours for both, and nobody of ours types in the pause between them."""

    async def story() -> None:
        port = Shared(usual)
        link = linked(port, poll_s=0.5)
        await link.open()
        port.loop.call_later(0.3, port.others, OTHERS["a command"])
        await link.still(5.0)

    with pytest.raises(Disturbed, match="SPEED 100"):
        lived(story())


def whole(x: float = 500.0) -> list[str]:
    """The lines of WHERE."""
    return [line for line in table(x).split("\r\n") if line.strip(".")]


@pytest.mark.parametrize("double", range(4))
def test_a_line_of_where_that_comes_twice_is_a_garbled_answer_and_nobody_else_typed_it(double: int) -> None:
    lines = whole()
    twice = "\r\n".join(["", *lines[: double + 1], *lines[double:]]) + PROMPT

    async def story() -> list[str]:
        port = Scripted(lambda line, nth: twice if line == "WHERE" and nth == 0 else usual(line, nth))
        link = linked(port)
        disturbed: list[str] = []
        await link.open()
        link.disturbed = lambda: disturbed.append("others")
        assert (await link.where()).location.x_mm == 500.0
        assert not disturbed
        return [line for line in port.lines if line == "WHERE"]

    assert lived(story()) == ["WHERE", "WHERE"]


def test_what_somebody_typed_beside_a_line_of_where_that_came_twice_is_theirs() -> None:
    lines = whole()
    both = "\r\n".join(["", lines[0], *lines, "SPEED 100"]) + PROMPT

    async def story() -> None:
        port = Scripted(lambda line, nth: both if line == "WHERE" else usual(line, nth))
        link = linked(port)
        await link.open()
        await link.where()

    with pytest.raises(Disturbed, match="SPEED 100"):
        lived(story())


def test_a_controller_that_ends_no_line_before_its_prompt_behind_where_is_moved_and_stopped() -> None:
    """Its numbers have their decimals, so that a dot behind the last is none of its own."""

    def says(line: str, nth: int) -> str:
        return table(joints="1.000 2.000 3.000 4.000 5.000 6.000").replace("\r\n.", ".") if line == "WHERE" else PROMPT

    async def story() -> None:
        port = Scripted(says)
        link = linked(port)
        await link.open()
        await link.move(GOAL, start=START)
        assert (await link.wait_until_at_rest(GOAL)).location == GOAL
        stopped = await link.stop_motion()
        assert stopped is not None
        assert stopped.location == GOAL

    lived(story())


STARRED = {"a digit": ("0.000", "0.*00"), "a line end": ("T\r\n", "T*\n"), "a header": ("Y Z", "Y*Z")}


@pytest.mark.parametrize("spoiled", STARRED.values(), ids=STARRED)
def test_an_asterisk_of_noise_in_where_is_asked_again_and_no_refusal(spoiled: tuple[str, str]) -> None:
    starred = table().replace(*spoiled, 1)

    async def story(acts: Any, first: int) -> Where:
        port = Scripted(lambda line, nth: starred if line == "WHERE" and nth == first else usual(line, nth))
        link = linked(port)
        await link.open()
        where = await acts(link)
        assert port.lines.count("WHERE") > first + 1, "asked again"
        await link.command("SPEED 10")  # and no error of it is left for who comes next
        return where

    assert "*" in starred
    for first in (0, 1):
        assert lived(story(lambda link: link.stop_motion(), first)).location == GOAL
    assert lived(story(lambda link: link.where(), 0)).location == GOAL


def test_a_stop_whose_bytes_did_not_leave_a_port_that_was_changed_just_then_is_typed_again_at_once() -> None:
    async def story() -> None:
        port = Scripted(usual)
        link = linked(port)
        await link.open()
        writes, failed = port.write, list[bytes]()

        def fails_once(data: bytes) -> None:
            if not failed:
                failed.append(data)
                raise Disturbed("stty")
            writes(data)

        port.write = fails_once
        assert await link.stop_motion() is not None
        assert b"ABORT" in failed[0]
        assert "ABORT" in port.lines

    lived(story())
