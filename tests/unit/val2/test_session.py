"""An open line, in simulated time: whose turn it is, who is pre-empted, and what came while nobody listened."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from functools import partial
from types import MappingProxyType
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from daemon.arm.permission import MotionPermission
from drivers.ledger import Ledger
from drivers.val2.dialect import Dialect
from drivers.val2.errors import Busy, ControllerError, Disturbed, NoAnswer, PortError, Preempted
from drivers.val2.session import LineSession, quoted
from drivers.val2.wire import Prompt, Text
from tests.fakes.in_time import lived
from tests.unit.val2.test_link_scripted import table

PROMPT = b"\r\n."
ASKS = b"\r\nAre you sure (Y/N)? "
ANSWERS = {
    b"WHERE": table().encode(),
    b"STATUS": b"\r\nMonitor speed 9" + PROMPT,
    b"CAL": ASKS,
    **dict.fromkeys((b"", b"SPEED 9", b"N"), PROMPT),
}
REFUSAL = b"\r\n*Illegal command*"


class Wire:
    """A port on which a test is the controller."""

    def __init__(self) -> None:
        self.loop, self.sent, self.open = asyncio.get_running_loop(), b"", True
        self.answers: list[tuple[float, bytes]] = []
        """What is said to the next thing that is typed, and how long after it."""
        self.records: list[dict[str, Any]] = []
        self.session = LineSession(
            "wire",
            Dialect(),
            self.loop.time,
            Ledger(self.records.append),
            self._opened,
            lambda: None,
            lambda: None,
            MotionPermission(),
        )

    def _opened(self, path: str, dialect: Dialect, on_bytes: Any, on_lost: Any) -> Any:
        self.hear, self.lose = on_bytes, on_lost
        return self

    def write(self, data: bytes) -> None:
        """See Port."""
        self.sent += data
        for late_s, said in self.answers:
            self.loop.call_later(late_s, self.hear, said)
        self.answers = []

    def overtake(self) -> None:
        """See Port."""

    def close(self) -> None:
        """See Port."""
        self.open = False


def test_one_has_the_line_at_a_time_in_the_order_they_asked() -> None:
    async def story() -> list[str]:
        session, order = Wire().session, list[str]()

        async def has(name: str) -> None:
            async with session.turn():
                order.append(f"{name} begins")
                await asyncio.sleep(1.0)
                order.append(f"{name} ends")

        await asyncio.gather(has("a"), has("b"))
        return order

    assert lived(story()) == ["a begins", "a ends", "b begins", "b ends"]


def test_a_preemption_ends_who_has_the_line_and_who_waited_for_it_and_lets_who_comes_later_wait() -> None:
    async def story() -> None:
        wire = Wire()
        session, came = wire.session, list[str]()

        async def has(name: str, seconds: float = 1.0, moves: bool = False) -> None:
            try:
                async with session.turn(moves=moves) as talk:
                    await asyncio.sleep(seconds)
                    talk.send_raw(name.encode())
                came.append(f"{name} done")
            except Preempted as error:
                came.append(f"{name}: {error}")

        first, waiting = asyncio.ensure_future(has("first")), asyncio.ensure_future(has("waiting"))
        await asyncio.sleep(0.1)
        async with session.preemption() as talk:
            later, motion = asyncio.ensure_future(has("later", 0.0)), asyncio.ensure_future(has("motion", 0.0, True))
            await asyncio.sleep(2.0)
            talk.send_raw(b"ABORT")
            assert "later done" not in came
        await asyncio.gather(first, waiting, later, motion)
        assert wire.sent == b"ABORTlater"
        assert sorted(came) == [
            "first: stopped", "later done", "motion: a stop is under way", "waiting: stopped",
        ]  # fmt: skip

    lived(story())


def test_an_error_that_came_while_nobody_listened_is_told_once_before_the_next_line_is_typed() -> None:
    async def story() -> None:
        wire = Wire()
        wire.hear(b"\r\n*Arm power off*\r\nand more\r\n*Emergency stop*\r\n.")
        await asyncio.sleep(0.1)
        with pytest.raises(ControllerError, match=r"\*Arm power off\*; \*Emergency stop\*"):
            async with wire.session.turn():
                raise AssertionError("nothing may be typed")
        async with wire.session.turn():
            pass

    lived(story())


def test_a_question_that_came_while_nobody_listened_keeps_the_line_until_it_is_answered() -> None:
    async def story() -> None:
        session = (wire := Wire()).session
        wire.hear(b"\r\nLoad VAL-II from floppy (Y/N)? ")
        await asyncio.sleep(0.1)
        for _ in range(2):
            with pytest.raises(ControllerError, match="the controller asks 'Load VAL-II from floppy"):
                async with session.turn():
                    raise AssertionError("nothing may be typed")
        async with session.turn(answers_question=True):
            session.question = None
        async with session.turn():
            pass

    lived(story())


class InTurn(Wire):
    """A controller that echoes and answers what is typed, key by key in turn, and is busy before some of the keys."""

    def __init__(self, busy_s: Mapping[int, float] = MappingProxyType({}), echo: bool = True) -> None:
        """busy_s: for how long before it reads which key, counted from 0."""
        super().__init__()
        self.session.dialect = self.session.talk.dialect = Dialect(echo=echo)
        self._busy_s, self._echo, self._free_s, self._line = busy_s, echo, 0.0, b""
        self._asked = PROMPT

    def write(self, data: bytes) -> None:
        """See Port."""
        for key in (bytes([byte]) for byte in data):
            said = key * self._echo
            if key == b"\x15":
                self._line, said = b"", self._asked
            elif key == b"\r":
                said, self._line = ANSWERS.get(self._line, REFUSAL + PROMPT), b""
                self._asked = said if said == ASKS else PROMPT
            else:
                self._line += key
            self._free_s = max(self._free_s, self.loop.time()) + self._busy_s.get(len(self.sent), 0.001)
            self.sent += key
            self.loop.call_at(self._free_s, self.hear, said)


@pytest.mark.parametrize(
    ("echo", "typed"), [(True, b"FOO\x15!!\rSTATUS\rWHERE\rSPEED 9\r"), (False, b"STATUS\rWHERE\rSPEED 9\r")]
)
@example(busy_s={20: 0.3})
@example(busy_s={4: 0.05, 6: 0.5})
@given(busy_s=st.dictionaries(st.integers(0, 20), st.floats(0.0, 0.7), max_size=4))
def test_however_late_a_person_s_lines_are_answered_nobody_is_blamed_once_they_have_left(
    echo: bool, typed: bytes, busy_s: dict[int, float]
) -> None:
    """The prompt of one line was taken for the last: the next answer was somebody else's."""

    async def story() -> None:
        wire, shown = InTurn(busy_s, echo), bytearray()
        async with wire.session.terminal(shown.extend) as type_in:
            type_in(typed)
        heard = bytes(shown)
        for _ in range(3):
            async with wire.session.turn() as talk:
                assert (await talk.ask("SPEED 9", (), 1.0)).errors == ()
            await asyncio.sleep(1.0)
        assert bytes(shown) == heard, "whoever left is shown nothing more"

    lived(story())


@pytest.mark.parametrize(
    ("typed", "left", "sent"), [(b"CAL\rN\r", None, b"\x15!!0\r"), (b"CAL\r", "Are you sure (Y/N)?", b"\x15")]
)
def test_of_what_a_person_was_asked_only_what_they_left_open_is_a_question_and_no_line_answers_it(
    typed: bytes, left: str | None, sent: bytes
) -> None:
    async def story() -> None:
        wire = InTurn()
        async with wire.session.terminal(lambda _: None) as type_in:
            for line in typed.splitlines(keepends=True):
                type_in(line)
                await asyncio.sleep(0.1)
        assert (wire.session.question, wire.sent) == (left, typed + sent)

    lived(story())


async def waits_for_a_line(session: LineSession) -> None:
    async with session.turn() as talk:
        await talk.next_event(60.0, "")


def test_a_lost_port_is_told_to_who_waits_and_who_comes_and_nothing_is_lost_twice() -> None:
    async def story() -> None:
        wire = Wire()
        session = wire.session

        waits = partial(waits_for_a_line, session)
        assert not session.lost
        waiting = asyncio.ensure_future(waits())
        await asyncio.sleep(0.1)
        wire.hear(b"\r\n.")  # its silence is being waited for
        wire.lose(PortError("the adapter was pulled"))
        assert session.lost
        session.close()
        assert not wire.open
        for act in (lambda: waiting, waits):
            with pytest.raises(PortError, match="pulled"):
                await act()
        await asyncio.sleep(1.0)

    lived(story())


def test_where_somebody_changed_the_port_s_settings_who_has_the_line_and_who_waits_for_it_hear_that_once() -> None:
    async def story() -> None:
        wire = Wire()
        session = wire.session

        waits = partial(waits_for_a_line, session)
        has_it, waiting = asyncio.ensure_future(waits()), asyncio.ensure_future(waits())
        await asyncio.sleep(0.1)
        wire.lose(Disturbed("stty"))
        assert not session.lost
        for one in (has_it, waiting):
            with pytest.raises(Disturbed, match="stty"):
                await one
        assert not wire.sent
        wire.answers = [(0.001, PROMPT)]
        for _ in range(2):
            async with session.turn():
                assert bytes(wire.sent) == b"\x15", "what was half typed is taken back first, and once"
        wire.lose(Disturbed("stty while nobody has it"))
        with pytest.raises(Disturbed, match="nobody has it"):
            await waits()
        async with session.turn():
            pass

    lived(story())


def test_a_stop_and_a_person_at_the_terminal_keep_the_line_where_somebody_changed_the_port_s_settings() -> None:
    async def story(stops: bool) -> None:
        wire = InTurn()
        session = wire.session

        async def lets_go_late() -> None:
            async with session.turn():
                await asyncio.sleep(1.0)

        if stops:
            holding = asyncio.ensure_future(lets_go_late())
            await asyncio.sleep(0.1)
        async with session.preemption() if stops else session.terminal(lambda _: None):
            wire.lose(Disturbed("stty"))
            session.talk.check()
        if stops:
            await holding
        with pytest.raises(Disturbed, match="stty"):
            async with session.turn():
                pass

    lived(story(True))
    lived(story(False))


def test_what_is_sent_and_heard_is_in_the_ledger() -> None:
    async def story() -> list[dict[str, Any]]:
        wire = Wire()
        wire.answers = [(0.001, b"\r\nhello\r\n.")]
        assert isinstance((await wire.session.find_prompt(wire.session.talk))[-1], Prompt)
        return wire.records

    records = lived(story())
    assert "hello" in str(records)
    assert "x15" in str(records)


def test_who_waited_through_a_preemption_never_has_the_line_and_who_asks_in_it_has_it_after() -> None:
    async def story() -> list[str]:
        session, had = Wire().session, list[str]()

        async def has(name: str) -> None:
            async with session.turn():
                had.append(name)
                await asyncio.sleep(1.0)

        first, waiting = asyncio.ensure_future(has("first")), asyncio.ensure_future(has("waiting"))
        await asyncio.sleep(0.1)
        async with session.preemption():
            later = asyncio.ensure_future(has("later"))
            await asyncio.sleep(2.0)
        await asyncio.gather(first, waiting, later, return_exceptions=True)
        assert isinstance(waiting.exception(), Preempted)
        assert later.exception() is None
        return had

    assert lived(story()) == ["first", "later"]


def test_a_person_who_comes_in_a_preemption_waits_for_its_end_and_is_then_shown_what_comes() -> None:
    async def story() -> None:
        wire, shown = InTurn(), bytearray()

        async def person() -> float:
            async with wire.session.terminal(shown.extend):
                came_s = wire.loop.time()
                wire.hear(b"\r\nhello\r\n")
            return came_s

        async with wire.session.preemption():
            coming = asyncio.ensure_future(person())
            await asyncio.sleep(2.0)
        assert await coming >= 2.0
        assert b"hello" in shown

    lived(story())


@pytest.mark.parametrize("printed", [b"\r\npart 7", b"\r\npart 7\r\n."])
def test_a_program_that_prints_on_and_on_keeps_nobody_at_a_terminal_that_was_left(printed: bytes) -> None:
    """It went on, and the arm with it, for as long as it printed; whoever had left was told nothing."""

    async def story() -> float:
        wire = Wire()

        async def prints() -> None:
            while True:
                wire.hear(printed)
                await asyncio.sleep(0.02)

        printing = asyncio.ensure_future(prints())
        began_s = wire.loop.time()
        with pytest.raises(Busy, match="a program printed for"):
            async with asyncio.timeout(100.0), wire.session.terminal(lambda _: None):
                pass
        printing.cancel()
        return wire.loop.time() - began_s

    assert lived(story()) < 10.0


def test_the_prompt_is_sought_three_times_unless_told_otherwise_and_a_question_in_its_place_is_kept() -> None:
    async def story() -> None:
        wire = Wire()
        session = wire.session
        session.talk.line_may_have_leftover = False
        with pytest.raises(NoAnswer, match=r"no prompt \(3 attempts\)"):
            await session.find_prompt(session.talk)
        assert session.talk.line_may_have_leftover
        wire.answers = [(0.001, b"\r\nAre you sure (Y/N)? ")]
        await session.find_prompt(session.talk)
        assert session.question == "Are you sure (Y/N)?"
        wire.answers = [(0.001, PROMPT)]
        await session.find_prompt(session.talk)
        assert session.question is None

    lived(story())


def test_silence_counts_from_the_last_byte_and_not_from_the_dot_before() -> None:
    async def story() -> list[Any]:
        wire = Wire()
        wire.hear(b"\r\n.")
        wire.loop.call_later(0.015, wire.hear, b"52\r\n.")
        await asyncio.sleep(0.03)
        early = wire.session.talk.unheard()
        await asyncio.sleep(0.02)
        return [type(event) for event in (*early, None, *wire.session.talk.unheard())]

    assert lived(story()) == [Text, type(None), Prompt]


@pytest.mark.parametrize(
    ("heard", "told"),
    [
        (b"SPEED 300\r\n*Illegal value*\r\n.", Disturbed),
        (b"\r\n*Emergency stop*\r\n.", ControllerError),
        (b"\r\nPanic button\r\n*Emergency stop*\r\n.", ControllerError),
        (b"*Emergency stop*\r\n.", ControllerError),
        (b"x\r\n*Emergency stop*\r\n.", ControllerError),
    ],
)
def test_a_line_that_somebody_typed_and_the_controller_refused_is_somebody_elses(
    heard: bytes, told: type[Exception]
) -> None:
    """It was reported as the controller's message alone, and what was believed stayed so."""

    async def story() -> None:
        wire = Wire()
        wire.session.talk.line_may_have_leftover = False
        wire.hear(heard)
        await asyncio.sleep(0.1)
        with pytest.raises(told) as raised:
            async with wire.session.turn():
                raise AssertionError("nothing may be typed")
        assert "*" in str(raised.value)
        assert type(raised.value) is told

    lived(story())


def test_once_a_stop_was_answered_a_line_of_others_is_noticed_though_the_prompt_had_just_been_sought() -> None:
    """Until the next command of facetd's own it was taken for the answer to what the search had typed."""

    async def story() -> None:
        wire = Wire()
        wire.answers = [(0.001, PROMPT)]
        await wire.session.find_prompt(wire.session.talk)
        async with wire.session.preemption() as talk:
            wire.answers = [(0.001, b"ABORT"), (0.2, b"\r\n.")]
            await talk.ask("ABORT", (), 1.0)
        wire.hear(b"SPEED 100\r\n.")
        await asyncio.sleep(0.1)
        with pytest.raises(Disturbed, match="SPEED 100"):
            async with wire.session.turn():
                raise AssertionError("nothing may be typed")

    lived(story())


@pytest.mark.parametrize("heard", [b"DO CLOSEI\r\n", b"DO CLOSEI\r\n.", b"DO CLO", b"\r\n.SPEED 100\r\n."])
def test_a_line_of_others_right_behind_a_prompt_that_was_found_is_noticed(heard: bytes) -> None:
    """It was taken for the answer to what had been typed to find it: the first command of ours got the other's prompt,
    and nobody was told."""

    async def story() -> None:
        wire = Wire()
        wire.answers = [(0.001, PROMPT)]
        await wire.session.find_prompt(wire.session.talk)
        wire.hear(heard)
        wire.answers = [(0.001, PROMPT)]
        with pytest.raises(Disturbed, match=r"DO CLO|SPEED 100"):
            async with wire.session.turn():
                raise AssertionError("nothing may be typed")

    lived(story())


@pytest.mark.parametrize("heard", [b"\r\n..", b"^U\r\n.", b".^U!!", b"^U\r\n.^U\r\n.", table().encode()])
def test_behind_a_prompt_that_was_found_what_is_ours_is_left_alone(heard: bytes) -> None:
    """What was typed to find it, and the table that was owed."""

    async def story() -> None:
        wire = Wire()
        wire.session.talk.line_may_have_leftover = False
        wire.answers = [(0.001, b"WHERE"), (0.1, b"\r\n")]
        with pytest.raises(NoAnswer):
            await wire.session.talk.ask("WHERE", (), 5.0)
        wire.answers = [(0.001, PROMPT)]
        await wire.session.find_prompt(wire.session.talk)
        wire.hear(heard)
        await asyncio.sleep(0.1)
        async with wire.session.turn():
            pass

    lived(story())


def test_with_nothing_owed_too_the_echo_of_a_search_is_left_alone_behind_its_prompt() -> None:
    async def story() -> None:
        wire = Wire()
        wire.answers = [(0.001, PROMPT)]
        await wire.session.find_prompt(wire.session.talk)
        wire.hear(b"^U!!\r\n.")
        await asyncio.sleep(0.1)
        async with wire.session.turn():
            pass

    lived(story())


@pytest.mark.parametrize(("heard", "told"), [(b"WHERE\r\n.", NoAnswer), (b"SPEED 9\r\n.", Disturbed)])
def test_an_echo_that_comes_too_late_is_nobody_elses_line(heard: bytes, told: type[Exception]) -> None:
    async def story() -> None:
        wire = Wire()
        with pytest.raises(NoAnswer, match="no echo"):
            await wire.session.talk.ask("WHERE", (), 5.0)
        await as_after_an_answer(wire)
        wire.hear(heard)
        await asyncio.sleep(0.1)
        with pytest.raises(told):
            async with wire.session.turn():
                raise AssertionError("nothing may be typed")

    lived(story())


def test_prompts_to_what_looked_for_one_in_vain_are_nobody_elses_when_they_come_at_last() -> None:
    async def story() -> None:
        wire = Wire()
        with pytest.raises(NoAnswer, match=r"no prompt \(3 attempts\)"):
            await wire.session.find_prompt(wire.session.talk)
        await as_after_an_answer(wire)
        wire.hear(b"\r\n.")
        await asyncio.sleep(0.1)
        with pytest.raises(NoAnswer, match="too late"):
            async with wire.session.turn():
                raise AssertionError("nothing may be typed")

    lived(story())


async def as_after_an_answer(wire: Wire) -> None:
    """The prompt is found again, and a line was answered since."""
    wire.answers = [(0.001, PROMPT)]
    await wire.session.find_prompt(wire.session.talk)
    wire.session.talk.line_may_have_leftover = False


@pytest.mark.parametrize(
    ("heard", "told"),
    [
        (b"", None),
        (b"S", None),
        (b"SPE", Disturbed),
        (b"\r\n.", Disturbed),
        (b"SPEED 100\r\n", Disturbed),
        (b"\r\n*Emergency stop*\r\n", ControllerError),
        (b"\r\nInitialise (Y/N)? ", ControllerError),
    ],
)
def test_what_the_next_turn_would_report_is_known_before_and_taken_from_nobody(
    heard: bytes, told: type[Exception] | None
) -> None:
    async def story() -> None:
        wire = Wire()
        wire.session.talk.line_may_have_leftover = False
        async with wire.session.turn():
            wire.hear(heard)
            await asyncio.sleep(0.1)
            assert not wire.session.heard_unasked, "whoever has the line hears it"
        assert wire.session.heard_unasked is (told is not None)
        assert wire.session.heard_unasked is (told is not None)
        wire.answers = [(0.001, PROMPT)]
        if told is not None:
            with pytest.raises(told):
                async with wire.session.turn():
                    raise AssertionError("nothing may be typed")
        assert not wire.session.heard_unasked

    lived(story())


def test_settings_that_somebody_changed_at_rest_are_known_until_reported_and_a_lost_line_is_not_asked() -> None:
    async def story() -> None:
        wire = Wire()
        wire.lose(Disturbed("stty"))
        assert wire.session.heard_unasked
        async with wire.session.preemption():
            assert not wire.session.heard_unasked
        with pytest.raises(Disturbed):
            async with wire.session.turn():
                raise AssertionError("nothing may be typed")
        assert not wire.session.heard_unasked
        wire.hear(b"SPEED 100\r\n")
        wire.lose(PortError("gone"))
        assert not wire.session.heard_unasked

    lived(story())


@pytest.mark.parametrize("stopped", [True, False])
def test_half_a_line_from_before_a_search_or_a_stop_that_nobody_answers_is_nobody_elses(stopped: bool) -> None:
    """What a person had typed on a line that was pulled out then; what comes behind it is."""

    async def story() -> None:
        wire = Wire()
        wire.hear(b"CAL")
        if stopped:
            async with wire.session.preemption() as talk:
                await talk.type_raw(b"ABORT\r")
        else:
            with pytest.raises(NoAnswer):
                await wire.session.find_prompt(wire.session.talk)
        assert not wire.session.heard_unasked
        wire.hear(b"SPE")
        assert wire.session.heard_unasked
        with pytest.raises(Disturbed, match="received 'SPE'"):
            async with wire.session.turn():
                raise AssertionError("nothing may be typed")

    lived(story())


@pytest.mark.parametrize("stopped", [True, False])
def test_of_a_line_of_others_the_next_turn_tells_where_a_stop_cut_off_who_had_found_it(stopped: bool) -> None:
    """As he took back what they had half typed; what he had found was told to nobody."""

    async def story() -> None:
        wire = Wire()
        wire.session.talk.line_may_have_leftover = False
        wire.hear(b"SPEED 100\r\n.DO DR")
        finding = asyncio.ensure_future(waits_for_a_line(wire.session))
        await asyncio.sleep(0.1)
        assert wire.sent == b"\x15"
        if stopped:
            async with wire.session.preemption() as talk:
                wire.answers = [(0.001, b"ABORT"), (0.2, b"\r\n.")]
                await talk.ask("ABORT", (), 1.0)
        else:
            finding.cancel()
        with pytest.raises((Preempted, asyncio.CancelledError)):
            await finding
        wire.answers = [(0.001, PROMPT)]
        with pytest.raises(Disturbed, match="SPEED 100"):
            async with wire.session.turn():
                raise AssertionError("nothing may be typed")
        async with wire.session.turn():
            pass

    lived(story())


def test_of_much_noise_a_message_quotes_a_little() -> None:
    """3 kB of it made a fault of many lines, repeated at each command."""

    async def story() -> str:
        wire = Wire()
        wire.session.talk.line_may_have_leftover = False
        wire.hear(b"".join(b"\r\n" + bytes([65 + k % 26]) * 100 for k in range(30)) + b"\r\n.")
        await asyncio.sleep(0.1)
        with pytest.raises(Disturbed) as raised:
            async with wire.session.turn():
                raise AssertionError("nothing may be typed")
        return raised.value.message

    first, second, third = (repr(letter * 60) + "..." for letter in "ABC")
    assert lived(story()) == (
        f"another terminal or program types on the controller's line (received {first}, {second}, {third} and 28 more)"
        ": stay clear of the arm and find it, then `resume`"
    )


@pytest.mark.parametrize(("count", "more"), [(2, ""), (3, ""), (4, " and 1 more"), (9, " and 6 more")])
def test_of_a_few_pieces_all_that_a_message_has_room_for_are_quoted(count: int, more: str) -> None:
    quotes = ", ".join(f"'{letter}'" for letter in "ABC"[:count])
    assert quoted([chr(65 + k) for k in range(count)]) == quotes + more


def test_a_line_that_is_let_go_tells_who_waits_and_hears_nothing_more() -> None:
    async def story() -> None:
        wire = Wire()
        waiting = asyncio.ensure_future(wire.session.talk.next_event(60.0, ""))
        await asyncio.sleep(0.1)
        wire.hear(b"\r\n.")
        heard = len(wire.records)
        wire.session.close()
        assert not wire.open
        with pytest.raises(PortError, match=r"wire: facetd closed the line before.* look at the arm and at `status`"):
            await waiting
        await asyncio.sleep(1.0)
        assert len(wire.records) == heard

    lived(story())


def test_each_piece_that_is_heard_counts_as_a_sign_that_the_controller_is_there() -> None:
    async def story() -> int:
        wire = Wire()
        for piece in (b"WHE", b"RE", PROMPT):
            wire.hear(piece)
        return wire.session._permission.heard

    assert lived(story()) == 3
