"""One exchange on the line, in simulated time: nothing is ended whose echo was not whole, nothing waits for ever."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from drivers.val2.conversation import ControllerAnswer, Conversation, Unconditional
from drivers.val2.dialect import Dialect
from drivers.val2.errors import Busy, Garbled, Interleaved, NoAnswer, Preempted, ProcessorHalted
from drivers.val2.pending_answers import PendingAnswers
from drivers.val2.wire import ControllerQuestion, Error, Prompt, Reader, Text, is_halted
from tests.fakes.in_time import lived

TABLE = b"X Y Z O A T\r\n1 2 3 4 5 6\r\nJT1 JT2 JT3 JT4 JT5 JT6\r\n1 2 3 4 5 6\r\n"
LATER_S = 0.001


class Line:
    """A controller as far as one exchange needs it: echoes, and says to each line what is written down."""

    def __init__(self, says: dict[bytes, bytes], **settings: Any) -> None:
        self.dialect, self.says = Dialect(**settings), says
        self.echoes: Callable[[bytes], bytes] = lambda data: data
        self.loop = asyncio.get_running_loop()
        self.sent: list[tuple[float, bytes, bytes]] = []
        self._line = b""
        self._silence: asyncio.TimerHandle | None = None
        self._reader = Reader()
        owed = PendingAnswers(self.loop.time, self.dialect.motion_s)
        self.talk = Conversation(self.dialect, self._reader, self._take, self.loop.time, Unconditional(), owed)

    @property
    def typed(self) -> bytes:
        """All that went out."""
        return b"".join(data for _, data, _ in self.sent)

    def _take(self, data: bytes, kept: bytes) -> None:
        self.sent.append((self.loop.time(), data, kept))
        heard = self.echoes(data)
        for byte in data:
            if byte == 0x0D:
                heard += b"\n" + self.says.get(self._line, b"")
                self._line = b""
            elif byte == 0x15:
                self._line = b""
            else:
                self._line += bytes([byte])
        if heard:
            self.loop.call_later(LATER_S, self.hear, heard)

    def hear(self, data: bytes) -> None:
        """The controller says so."""
        if self._silence is not None:
            self._silence.cancel()
        for event in self._reader.receive(data):
            self.talk.hear(event)
        if self._reader.awaits_silence:
            self._silence = self.loop.call_later(self.dialect.prompt_silence_s, self._silent)

    def _silent(self) -> None:
        for event in self._reader.silence():
            self.talk.hear(event)


def asked(line_of: Callable[[], Line], command: str, replies: tuple[str, ...] = (), timeout_s: float = 5.0) -> Any:
    """The line afterwards, what came of it, and how long it took, s."""

    async def story() -> tuple[Line, ControllerAnswer | Exception, float]:
        line = line_of()
        began_s = line.loop.time()
        try:
            came: ControllerAnswer | Exception = await line.talk.ask(command, replies, timeout_s)
        except Exception as error:
            came = error
        return line, came, line.loop.time() - began_s

    return lived(story())


def test_a_command_is_ended_once_its_echo_is_whole_and_answered_up_to_the_prompt() -> None:
    line, answer, took_s = asked(lambda: Line({b"WHERE": TABLE + b"."}), "WHERE")
    assert line.typed == b"WHERE\r"
    assert (answer.command, answer.errors, answer.question) == ("WHERE", (), None)
    assert answer.where.joints_deg == (1, 2, 3, 4, 5, 6)
    assert answer.seconds == pytest.approx(took_s)
    assert line.talk.typed_whole


def test_the_last_of_two_tables_is_the_answer_and_errors_and_lines_are_kept() -> None:
    two = TABLE + TABLE.replace(b"1 2 3", b"7 2 3") + b"*Arm power off*\r\nso it is\r\n."
    _, answer, _ = asked(lambda: Line({b"WHERE": two}), "WHERE")
    assert answer.where.location.x_mm == 7
    assert answer.errors == ("*Arm power off*",)
    assert answer.lines == ("*Arm power off*", "so it is")


@pytest.mark.parametrize("spoilt", [b"WHEXE", b"WHER", b"WHEREE"])
def test_a_line_whose_echo_is_not_what_was_typed_is_never_ended(spoilt: bytes) -> None:
    def line_of() -> Line:
        line = Line({})
        line.echoes = lambda data: spoilt if data == b"WHERE" else data
        return line

    line, error, _ = asked(line_of, "WHERE")
    assert isinstance(error, NoAnswer if spoilt == b"WHER" else Garbled)
    assert b"\r" not in line.typed
    assert not line.talk.typed_whole


def test_an_emergency_stop_said_into_an_echo_is_heard_by_whoever_finds_the_prompt_again() -> None:
    async def story() -> list[str]:
        line = Line({})
        line.echoes = lambda data: b"WHE\r\n*Emergency stop*\r\n." if data == b"WHERE" else data
        with pytest.raises(Garbled):
            await line.talk.ask("WHERE", (), 5.0)
        return [event.text for event in line.talk.unheard() if isinstance(event, Error)]

    assert lived(story()) == ["*Emergency stop*"]


def test_a_character_that_doubles_a_little_later_is_still_noticed_and_one_after_that_time_is_not_waited_for() -> None:
    def line_of(late_s: float) -> Line:
        line = Line({b"WHERE": TABLE + b"."}, echo_settle_s=0.01)
        line.loop.call_later(LATER_S + late_s, lambda: line.hear(b"E"))
        return line

    line, error, _ = asked(lambda: line_of(0.008), "WHERE")
    assert isinstance(error, Garbled)
    assert b"\r" not in line.typed
    line, _, _ = asked(lambda: line_of(0.012), "WHERE")
    assert line.typed == b"WHERE\r"


def test_an_echo_is_waited_for_as_long_as_a_person_types_and_so_many_characters_take() -> None:
    def line_of() -> Line:
        line = Line({}, typing_s=2.0, baud=100)
        line.echoes = lambda data: b""
        return line

    _, error, took_s = asked(line_of, "WHERE")
    assert isinstance(error, NoAnswer)
    assert took_s == pytest.approx(2.0 + 20 * 5 / 100)
    assert "no echo of 'WHERE' within 3.0 s" in str(error)


def test_noise_within_an_answer_spoils_it() -> None:
    def line_of() -> Line:
        line = Line({b"A": b"."}, prompt_silence_s=0.02)
        line.echoes = lambda data: data if data != b"\r" else b"x\r"
        return line

    _, error, _ = asked(line_of, "A")
    assert isinstance(error, Garbled)


@pytest.mark.parametrize(
    ("ended", "others"), [(b"SP\r\n*Illegal command*\r\n.EED 100\r", True), (b"x\r", False), (b"xyz\r", False)]
)
def test_a_line_that_another_begins_as_ours_is_ended_is_told_from_noise(ended: bytes, others: bool) -> None:
    def line_of() -> Line:
        line = Line({b"A": b"."})
        line.echoes = lambda data: data if data != b"\r" else ended
        return line

    _, error, _ = asked(line_of, "A")
    assert isinstance(error, Garbled)
    assert isinstance(error, Interleaved) is others


@pytest.mark.parametrize(
    ("text", "sent"), [("A" * 20, True), ("A" * 21, False), ("A\rB", False), ("\u00e4", False), ("", True)]
)
def test_only_one_plain_line_no_longer_than_the_controller_takes_is_typed(text: str, sent: bool) -> None:
    line, came, _ = asked(lambda: Line({text.encode("latin-1"): b"."}, line_limit=20), text)
    assert isinstance(came, ControllerAnswer if sent else ValueError)
    assert line.typed == (text.encode() + b"\r" if sent else b"")


def test_questions_are_answered_in_turn_and_one_without_a_reply_is_the_end_of_the_answer() -> None:
    says = {b"CAL": b"Are you sure (Y/N)? ", b"Y": b"And now? ", b"N": b"."}
    line, answer, _ = asked(lambda: Line(says), "CAL", ("Y", "N"))
    assert line.typed == b"CAL\rY\rN\r"
    assert answer.question is None
    line, answer, _ = asked(lambda: Line(says), "CAL", ("Y",))
    assert answer.question == "And now?"
    assert answer.lines == ("Are you sure (Y/N)?", "And now?")


def test_an_answer_that_does_not_come_is_told_with_the_command_and_its_time() -> None:
    line, error, took_s = asked(lambda: Line({b"WHERE": TABLE}), "WHERE", timeout_s=3.0)
    assert isinstance(error, NoAnswer)
    assert "no answer to 'WHERE' within 3 s" in str(error)
    assert took_s == pytest.approx(3.0, abs=0.1)
    assert line.talk.typed_whole, "it may have been carried out"


def test_without_an_echo_a_line_is_typed_and_ended_at_once_and_paced_where_it_must() -> None:
    def line_of() -> Line:
        line = Line({b"WHERE": TABLE + b"."}, echo=False, character_pause_s=0.05)
        line.echoes = lambda data: b""
        return line

    line, answer, _ = asked(line_of, "WHERE")
    assert answer.where is not None
    times = [at_s - line.sent[0][0] for at_s, _, _ in line.sent]
    assert times == pytest.approx([0.05 * k for k in range(6)])


def test_raw_bytes_go_out_at_the_pace_of_the_controller_in_one_record_of_the_ledger() -> None:
    async def story(pause_s: float) -> Line:
        line = Line({}, character_pause_s=pause_s)
        await line.talk.type_raw(b"!!\r")
        return line

    paced, whole = lived(story(0.05)), lived(story(0.0))
    assert [(data, kept) for _, data, kept in paced.sent] == [(b"!", b"!!\r"), (b"!", b""), (b"\r", b"")]
    assert [at_s for at_s, _, _ in paced.sent] == pytest.approx([0.0, 0.05, 0.1])
    assert [(data, kept) for _, data, kept in whole.sent] == [(b"!!\r", b"!!\r")]


def test_the_prompt_is_sought_by_a_cancelled_line_first_and_then_by_one_that_cannot_be_a_command() -> None:
    async def story(says: dict[bytes, bytes], **settings: Any) -> tuple[Line, Any, float]:
        line = Line(says, resync_s=1.0, **settings)
        began_s = line.loop.time()
        try:
            came: Any = await line.talk.resynchronise()
        except NoAnswer as error:
            came = error
        return line, came, line.loop.time() - began_s

    line, said, _ = lived(story({b"!!": b"*Illegal command*\r\n."}))
    assert line.typed == b"\x15" + b"\x15!!\r"
    assert isinstance(said[-1], Prompt)
    line, said, _ = lived(story({b"!!": b"*Illegal command*\r\n."}, cancel_line=b""))
    assert line.typed == b"!!\r"
    line, error, took_s = lived(story({b"!!": b"moving\r\n"}))
    assert isinstance(error, Busy), "it said something, and gave no prompt: an arm at work may be behind it"
    assert took_s == pytest.approx(3.0, abs=0.1), "three attempts"
    assert line.typed == b"\x15" + 2 * b"\x15!!\r"


def test_a_controller_that_says_nothing_at_all_is_not_busy() -> None:
    async def story() -> Any:
        line = Line({})
        line.echoes, line.says = lambda data: b"", {}
        line._take = lambda data, kept: None
        owed = PendingAnswers(line.loop.time, line.dialect.motion_s)
        line.talk = Conversation(line.dialect, Reader(), line._take, line.loop.time, Unconditional(), owed)
        with pytest.raises(NoAnswer, match=r"gives no prompt \(2 attempts\): is it on") as told:
            await line.talk.resynchronise(2)
        return told.value

    assert not isinstance(lived(story()), Busy)


@pytest.mark.parametrize("says", [b"?\r\n@", b"\r\n024366\r\n@", b"?\r\n@?\r\n@ "])
def test_the_console_of_a_halted_processor_is_recognised_at_the_first_attempt_with_its_remedy(says: bytes) -> None:
    async def story() -> tuple[Line, float]:
        line = Line({b"!!": says, b"": says}, resync_s=1.0, cancel_line=b"")
        began_s = line.loop.time()
        with pytest.raises(ProcessorHalted, match="HALT/RUN switch"):
            await line.talk.resynchronise()
        return line, line.loop.time() - began_s

    line, took_s = lived(story())
    assert line.typed == b"!!\r"
    assert took_s < 1.1


def test_an_at_sign_within_what_is_printed_is_no_halted_processor() -> None:
    assert not is_halted(b"\r\nNAME@PLACE\r\n.")
    assert not is_halted(b"a@")
    assert is_halted(b"@")


def test_a_prompt_that_was_on_its_way_is_not_the_one_that_answers() -> None:
    async def story() -> Any:
        line = Line({}, prompt_late_s=0.2)
        line.loop.call_later(0.01, lambda: line.hear(b"\r\n."))
        line.loop.call_later(0.31, lambda: line.hear(b"\r\nAre you sure (Y/N)? "))
        return await line.talk.last_prompt_or_question(1.0)

    assert isinstance(lived(story()), ControllerQuestion)


def test_what_is_said_after_a_prompt_is_waited_for_up_to_the_next() -> None:
    async def story() -> Any:
        line = Line({})
        line.loop.call_later(0.01, lambda: line.hear(b"\r\n."))
        line.loop.call_later(0.04, lambda: line.hear(b"\r\nARM IS MOVING\r\n"))
        line.loop.call_later(0.5, lambda: line.hear(b"\r\n."))
        await line.talk.last_prompt_or_question(1.0)
        return line.loop.time()

    assert lived(story()) > 0.5


def test_a_conversation_that_was_ended_sends_nothing_more_and_says_why_to_all() -> None:
    async def story() -> None:
        line = Line({})
        waiting = asyncio.ensure_future(line.talk.ask("WHERE", (), 5.0))
        await asyncio.sleep(0.0)
        count = len(line.sent)
        line.talk.end(Preempted("aborted"))
        line.talk.end(Preempted("closed"))
        for act in (
            lambda: waiting,
            lambda: line.talk.ask("WHERE", (), 5.0),
            lambda: line.talk.type_raw(b"x"),
            lambda: line.talk.next_event(5.0, ""),
        ):
            with pytest.raises(Preempted, match="aborted"):
                await act()
        with pytest.raises(Preempted, match="aborted"):
            line.talk.unheard()
        assert len(line.sent) == count
        assert line.loop.time() < 0.1

    lived(story())


@pytest.mark.parametrize("pause_s", [0.0, 0.05])
def test_behind_bytes_that_were_sent_as_they_are_a_dot_is_a_prompt_from_the_first_of_them_on(pause_s: float) -> None:
    async def story() -> list[Any]:
        line = Line({}, character_pause_s=pause_s)
        line.hear(b"\r\n.")
        await asyncio.sleep(0.1)
        line.talk.unheard()
        line.echoes = lambda data: b""
        line.loop.call_later(0.01, lambda: line.hear(b"."))
        await line.talk.type_raw(b"ab")
        await asyncio.sleep(0.1)
        return [type(event) for event in line.talk.unheard()]

    assert lived(story()) == [Prompt]


def test_a_conversation_that_ends_while_bytes_are_typed_slowly_sends_no_more_of_them() -> None:
    async def story() -> list[bytes]:
        line = Line({}, character_pause_s=0.05)
        line.loop.call_later(0.06, lambda: line.talk.end(Preempted("aborted")))
        with pytest.raises(Preempted):
            await line.talk.type_raw(b"ABORT")
        return [data for _, data, _ in line.sent]

    assert lived(story()) == [b"A", b"B"]


@pytest.mark.parametrize("pause_s", [0.0, 0.05])
def test_what_a_person_types_goes_out_in_its_order_at_the_pace_of_the_controller_and_all_of_it(pause_s: float) -> None:
    async def story() -> tuple[bytes, list[float], float]:
        line = Line({}, character_pause_s=pause_s)
        began_s = line.loop.time()
        async with line.talk.typing() as typed:
            for keys in (b"WH", b"ERE", b"\r"):
                typed(keys)
        sent_s = [round(at_s - began_s, 3) for at_s, _, _ in line.sent]
        ended_s = line.loop.time() - began_s
        line.talk.end(Preempted("aborted"))
        with pytest.raises(Preempted):
            typed(b"A")
        return line.typed, sent_s, ended_s

    typed, sent_s, ended_s = lived(story())
    assert typed == b"WHERE\r"
    assert sent_s == ([0.0] * 3 if pause_s == 0 else pytest.approx([pause_s * k for k in range(6)]))
    assert ended_s == pytest.approx(6 * pause_s)


def test_after_a_prompt_that_was_sought_what_may_still_come_is_waited_for() -> None:
    async def story(settle_s: float) -> float:
        line = Line({b"!!": b"."}, cancel_line=b"", echo_settle_s=settle_s)
        await line.talk.resynchronise()
        return line.loop.time()

    assert lived(story(0.4)) - lived(story(0.1)) == pytest.approx(0.3)


def test_a_line_that_was_not_ended_was_not_though_the_one_before_it_was() -> None:
    async def story() -> bool:
        line = Line({b"WHERE": TABLE + b"."})
        await line.talk.ask("WHERE", (), 5.0)
        assert line.talk.typed_whole
        line.echoes = lambda data: b"x"
        with pytest.raises(Garbled):
            await line.talk.ask("WHERE", (), 5.0)
        return line.talk.typed_whole

    assert lived(story()) is False


def test_whoever_waits_for_a_conversation_that_was_ended_is_told_so_each_time() -> None:
    async def story() -> float:
        line = Line({})
        began_s = line.loop.time()
        line.talk.end(Preempted("aborted"))
        for _ in range(3):
            with pytest.raises(Preempted):
                await line.talk.next_event(5.0, "no answer")
        return line.loop.time() - began_s

    assert lived(story()) == 0.0


@pytest.mark.parametrize(("line_end", "ours"), [(b"\r", 0), (b"\r\n", 1)])
def test_a_prompt_more_is_our_own_only_where_our_line_end_is_two_characters(line_end: bytes, ours: int) -> None:
    async def story() -> None:
        line = Line({}, line_end=line_end)
        prompt, typed = Prompt(b"."), Text(b"SPEED 100\r\n", "SPEED 100")
        assert line.talk.others_of([prompt]) == ["a prompt"] * (1 - ours)
        assert line.talk.others_of([prompt, prompt]) == ["a prompt"] * (2 - ours)
        assert line.talk.others_of([typed, prompt]) == ["SPEED 100", "a prompt"]

    lived(story())
