"""The protocol: bytes cut anywhere give the same events; a dot, a question mark, an asterisk mean what they mean."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.val2.location import Location
from drivers.val2.wire import (
    LONGEST_LINE,
    ControllerQuestion,
    Echo,
    Error,
    Garble,
    LineEvent,
    Prompt,
    Reader,
    ReaderState,
    Text,
    WhereTable,
    of_a_table,
)

WHERE_ANSWER = (
    b"         X         Y         Z         O         A         T\r\n"
    b"    520.00     -0.50   -100.00     0.000    90.000   -12.345\r\n"
    b"       JT1       JT2       JT3       JT4       JT5       JT6\r\n"
    b"    16.772    42.692  -195.320     0.000   -27.373   106.772\r\n"
)


def kinds(events: list[LineEvent]) -> list[str]:
    return [type(event).__name__ for event in events]


def after(*pieces: bytes) -> list[LineEvent]:
    """The events of bytes that come in pieces, with silence after the last."""
    reader = Reader()
    events = [event for piece in pieces for event in reader.receive(piece)]
    return events + reader.silence()


def cut(data: bytes, places: list[int]) -> list[bytes]:
    at = [0, *sorted({place % (len(data) + 1) for place in places}), len(data)]
    return [data[a:b] for a, b in pairwise(at)]


PHRASES = (
    WHERE_ANSWER, b".", b"\r\n", b"\n\r", b"\r", b"*Undefined value*\r\n", b"Are you sure (Y/N)? ", b"Change?\r\n",
    b"Program HOLD\r\n", b".52 ", b"text", b"\x00", b" ", WHERE_ANSWER[:90], b"\xff",
)  # fmt: skip
soup = st.lists(st.sampled_from(PHRASES) | st.binary(max_size=6), max_size=12).map(b"".join)


@given(soup, st.lists(st.integers(0, 2000), max_size=8), st.binary(max_size=5))
def test_bytes_cut_anywhere_give_the_same_events(stream: bytes, places: list[int], typed: bytes) -> None:
    whole, pieces = Reader(), Reader()
    for reader in (whole, pieces):
        if typed:
            reader.typed(typed)
    at_once = whole.receive(stream) + whole.silence()
    in_pieces = [event for piece in cut(stream, places) for event in pieces.receive(piece)] + pieces.silence()
    assert at_once == in_pieces


@given(soup, st.lists(st.tuples(st.integers(0, 2000), st.booleans()), max_size=8))
def test_the_events_raw_bytes_in_a_row_are_the_stream(stream: bytes, places: list[tuple[int, bool]]) -> None:
    reader = Reader()
    raw = b""
    for piece in cut(stream, [place for place, _ in places]):
        raw += b"".join(event.raw for event in reader.receive(piece))
        raw += b"".join(event.raw for event in reader.silence())
    assert stream.startswith(raw)


@given(st.lists(st.binary(max_size=40) | st.just(None), max_size=30))
def test_no_bytes_at_all_make_it_stumble(noise: list[bytes | None]) -> None:
    reader = Reader()
    for piece in noise:
        if piece is None:
            reader.silence()
        else:
            reader.receive(piece)


def test_a_dot_at_the_start_of_a_line_is_a_prompt_once_nothing_follows() -> None:
    reader = Reader()
    assert reader.receive(b"\r\n.") == []
    assert reader.awaits_silence
    assert kinds(reader.silence()) == ["Prompt"]


def test_a_prompt_split_between_two_reads_is_one_prompt() -> None:
    assert kinds(after(b"\r", b"\n", b".")) == ["Prompt"]


def test_a_prompt_comes_once_however_long_the_silence() -> None:
    reader = Reader()
    reader.receive(b".")
    assert kinds(reader.silence()) == ["Prompt"]
    assert reader.silence() == []


def test_a_dot_that_starts_a_number_is_no_prompt() -> None:
    assert kinds(after(b"\r\n", b".", b"520 mm\r\n")) == ["Text"]


def test_a_table_that_stalls_anywhere_shows_no_prompt() -> None:
    for stop in range(1, len(WHERE_ANSWER)):
        reader = Reader()
        events = reader.receive(WHERE_ANSWER[:stop])
        assert not any(isinstance(event, Prompt) for event in events + reader.silence()), WHERE_ANSWER[:stop]


def test_a_dot_in_a_stalled_number_is_no_prompt() -> None:
    reader = Reader()
    events = reader.receive(b"    16.") + reader.silence() + reader.receive(b"772\r\n")
    assert kinds(events) == ["Text"]


def test_the_prompts_to_all_lines_of_a_stop_are_a_prompt_where_they_stand_in_one_line_and_more_are_not() -> None:
    for dots in (b"....", b". . . . . ", b".........."):
        assert kinds(after(dots)) == ["Prompt"]
    assert kinds(after(b"...........")) == []


def test_a_second_dot_behind_a_prompt_is_no_prompt() -> None:
    reader = Reader()
    reader.receive(b".")
    reader.silence()
    reader.receive(b".")
    assert reader.silence() == []


def test_where_gives_the_place_and_the_joints() -> None:
    table, prompt = after(WHERE_ANSWER, b".")
    assert isinstance(prompt, Prompt)
    assert isinstance(table, WhereTable)
    assert table.where.location == Location(520.0, -0.5, -100.0, 0.0, 90.0, -12.345)
    assert table.where.joints_deg == (16.772, 42.692, -195.32, 0.0, -27.373, 106.772)


@pytest.mark.parametrize(
    ("spoiled", "by"), [(b"520.00", b"52o.00"), (b"JT3", b"JT?"), (b"16.772", b"16.7 72"), (b"-0.50", b"--0.50")]
)
def test_a_spoiled_table_is_text_and_never_a_place(spoiled: bytes, by: bytes) -> None:
    events = after(WHERE_ANSWER.replace(spoiled, by), b".")
    assert kinds(events) == ["Text"] * 4 + ["Prompt"]


def test_a_table_begun_anew_counts_from_the_new_beginning() -> None:
    lines = WHERE_ANSWER.splitlines(keepends=True)
    assert kinds(after(lines[0], lines[1], WHERE_ANSWER, b".")) == ["Text", "Text", "WhereTable", "Prompt"]


def test_a_table_cut_short_by_the_prompt_is_text() -> None:
    lines = WHERE_ANSWER.splitlines(keepends=True)
    assert kinds(after(lines[0], lines[1], b".")) == ["Text", "Text", "Prompt"]


@pytest.mark.parametrize("prompt", [b".", b" .", b"..", b" . ", b"....", b". . "])
def test_a_prompt_right_behind_the_last_number_of_where_is_a_prompt(prompt: bytes) -> None:
    table, dots = after(WHERE_ANSWER.rstrip() + prompt)
    assert isinstance(table, WhereTable)
    assert table.where.joints_deg[-1] == 106.772
    assert isinstance(dots, Prompt)
    assert (table.raw, dots.raw) == (WHERE_ANSWER.rstrip(), prompt)


@pytest.mark.parametrize("prompt", [b".", b"..", b" ."])
def test_a_whole_last_number_has_a_prompt_behind_it_where_its_dot_cannot_be_a_decimal_point(prompt: bytes) -> None:
    whole = WHERE_ANSWER.rstrip().removesuffix(b".772") + prompt
    assert ("Prompt" in kinds(after(whole))) is (prompt != b".")


@pytest.mark.parametrize("row", [1, 2])
def test_a_dot_behind_any_other_line_of_where_is_no_prompt(row: int) -> None:
    lines = WHERE_ANSWER.splitlines(keepends=True)[: row + 1]
    assert kinds(after(b"".join(lines).rstrip() + b".")) == []


def test_behind_a_row_with_a_number_too_many_a_dot_is_no_prompt() -> None:
    assert kinds(after(WHERE_ANSWER.rstrip() + b" 1.000.")) == []


@pytest.mark.parametrize(
    ("line", "of_it"),
    [
        ("X Y Z O A T", True),
        ("  JT1 JT2 JT3 JT4 JT5 JT6", True),
        ("x/jt1 y/jt2 z/jt3 o/jt4 a/jt5 t/jt6 hand", True),
        ("520.00 -0.50 -100.00 0.000 90.000 -12.345", True),
        ("1 2 3 4 5 6 7", True),
        ("52*.00 -0.50 -100.00 0.000 90.000 -12.345", True),
        ("X Y * O A T", True),
        ("JT1 JT2*16.772", True),
        ("1 2 3 4 5", False),
        ("SPEED 100", False),
        ("*Envelope error* Joint 3", False),
        ("*Undefined value*", False),
    ],
)
def test_which_lines_where_prints_also_where_noise_put_an_asterisk_into_one(line: str, of_it: bool) -> None:
    assert of_a_table(line) is of_it


@pytest.mark.parametrize(
    "line",
    ["*Undefined value*", "*Envelope error* Joint 3", "*Never heard of this*", "Program HOLD", "PROGRAM STOP", "*"],
)
def test_a_message_between_asterisks_or_a_stopped_program_is_an_error_with_its_words(line: str) -> None:
    event = after(line.encode() + b"\r\n", b".")[0]
    assert isinstance(event, Error)
    assert event.text == line


@pytest.mark.parametrize("end", [b"\r\n", b"\n\r", b"\r", b"\n", b"\r\n\r\n"])
def test_any_line_end_ends_a_line(end: bytes) -> None:
    assert kinds(after(b"one" + end + b"two" + end + b".")) == ["Text", "Text", "Prompt"]


def test_a_question_is_asked_once_nothing_follows() -> None:
    event = after(b"Are you sure (Y/N)? ")[0]
    assert isinstance(event, ControllerQuestion)
    assert event.text == "Are you sure (Y/N)?"


def test_a_question_may_end_its_line() -> None:
    assert kinds(after(b"Change?\r\n")) == ["ControllerQuestion"]


def test_a_question_mark_with_more_behind_it_asks_nothing() -> None:
    assert kinds(after(b"Ready? Not yet\r\n", b".")) == ["Text", "Prompt"]
    assert kinds(after(b"Ready?\r\nNot yet\r\n", b".")) == ["Text", "Text", "Prompt"]


def test_the_echo_is_told_from_the_answer() -> None:
    reader = Reader()
    reader.receive(b".")
    reader.silence()
    reader.typed(b"SPEED 12.5")
    events = reader.receive(b"SPEED 12.5")
    assert events == [Echo(b"SPEED 12.5", "SPEED 12.5")]
    assert reader.state is ReaderState.TYPED
    reader.line_ended()
    assert kinds(reader.receive(b"\r\n.") + reader.silence()) == ["Prompt"]


@given(st.text("ABC.?*", min_size=1, max_size=12), st.data())
def test_one_wrong_character_in_an_echo_is_noticed(text: str, data: st.DataObject) -> None:
    place = data.draw(st.integers(0, len(text) - 1))
    wrong = data.draw(st.sampled_from("xyz"))
    reader = Reader()
    reader.typed(text.encode())
    event = reader.receive((text[:place] + wrong + text[place + 1 :]).encode())[0]
    assert isinstance(event, Garble)
    assert event.expected == text


@given(st.text("ABC123", min_size=2, max_size=12), st.data())
def test_a_lost_character_is_noticed_or_waited_for(text: str, data: st.DataObject) -> None:
    place = data.draw(st.integers(0, len(text) - 1))
    reader = Reader()
    reader.typed(text.encode())
    events = reader.receive((text[:place] + text[place + 1 :]).encode())
    assert not any(isinstance(event, Echo) for event in events)


def test_a_doubled_last_character_is_noticed_before_the_line_is_ended() -> None:
    reader = Reader()
    reader.typed(b"SPEED 1")
    assert kinds(reader.receive(b"SPEED 11")) == ["Echo", "Garble"]
    assert reader.state is not ReaderState.TYPED


def test_noise_between_echo_and_line_end_is_noticed() -> None:
    reader = Reader()
    reader.typed(b"WHERE")
    reader.receive(b"WHERE")
    reader.line_ended()
    assert kinds(reader.receive(b"x\r\n")) == ["Garble"]


def test_padding_is_no_part_of_a_line() -> None:
    reader = Reader()
    reader.typed(b"WHERE")
    assert kinds(reader.receive(b"WH\x00ERE")) == ["Echo"]


def test_without_echo_the_answer_begins_where_the_line_was_ended() -> None:
    reader = Reader()
    reader.receive(b".")
    reader.silence()
    reader.line_ended(echoed=False)
    assert kinds(reader.receive(b".") + reader.silence()) == ["Prompt"]


def test_an_endless_line_is_text_and_does_not_grow() -> None:
    events = after(b"a" * (3 * LONGEST_LINE))
    assert kinds(events) == ["Text"] * 3
    assert all(isinstance(event, Text) and len(event.text) == LONGEST_LINE for event in events)


def test_silence_in_the_middle_of_a_table_does_not_break_it() -> None:
    table = b" X Y Z O A T\r\n 1 2 3 4 5 6\r\n JT1 JT2 JT3 JT4 JT5 JT6\r\n 1 2 3 4 5 6\r\n"
    reader = Reader()
    assert kinds(reader.receive(table[:30]) + reader.silence() + reader.receive(table[30:])) == ["WhereTable"]


def test_a_question_that_ended_its_line_is_asked_once() -> None:
    reader = Reader()
    reader.receive(b"Are you sure (Y/N)?\r\n")
    assert kinds(reader.silence() + reader.silence()) == ["ControllerQuestion"]


@pytest.mark.parametrize("hand", [False, True])
def test_a_where_with_one_header_for_both_lines_is_a_table_with_or_without_the_hand(hand: bool) -> None:
    reader = Reader()
    header = b" X/JT1 Y/JT2 Z/JT3 O/JT4 A/JT5 T/JT6" + b" HAND" * hand
    place = b" 520.00 -.50 -100. 0.000 90.000 0.000" + b" 90.0" * hand
    events = reader.receive(header + b"\r\n" + place + b"\r\n 1 -2.5 3 4 .5 -6\r\n")
    (table,) = events
    assert isinstance(table, WhereTable)
    assert table.where.location.values() == (520.0, -0.5, -100.0, 0.0, 90.0, 0.0)
    assert table.where.joints_deg == (1.0, -2.5, 3.0, 4.0, 0.5, -6.0)


@pytest.mark.parametrize("prompt", [b".", b". ", b".."])
def test_a_prompt_may_be_one_dot_or_two_and_a_space(prompt: bytes) -> None:
    reader = Reader()
    assert reader.receive(b"\r\n" + prompt) == []
    assert [type(event) for event in reader.silence()] == [Prompt]


def test_a_line_as_long_as_two_of_a_printers_is_one_line() -> None:
    assert [event.text for event in after(b"a" * 250 + b"\r\n") if isinstance(event, Text)] == ["a" * 250]


def test_a_dot_behind_a_question_is_its_answer_s_and_no_prompt() -> None:
    reader = Reader()
    reader.receive(b"Are you sure (Y/N)? ")
    assert kinds(reader.silence()) == ["ControllerQuestion"]
    assert kinds(reader.receive(b".") + reader.silence()) == []


def test_a_line_end_of_one_character_is_one() -> None:
    """The prompt may follow the echoed line end at once."""
    reader = Reader()
    reader.typed(b"WHERE")
    reader.receive(b"WHERE")
    reader.line_ended()
    assert kinds(reader.receive(b"\r.") + reader.silence()) == ["Prompt"]


@pytest.mark.parametrize(("wrong", "prompts"), [(b"\r", ["Prompt"]), (b"x", [])])
def test_behind_a_spoiled_echo_a_dot_is_a_prompt_only_where_the_echo_was_a_line_end(
    wrong: bytes, prompts: list[str]
) -> None:
    reader = Reader()
    reader.typed(b"WHERE")
    assert kinds(reader.receive(b"WH" + wrong)) == ["Garble"]
    assert kinds(reader.receive(b".") + reader.silence()) == prompts


def test_a_wrong_last_character_of_an_echo_is_no_echo() -> None:
    reader = Reader()
    reader.typed(b"WHERE")
    assert kinds(reader.receive(b"WHERX")) == ["Garble"]
    assert reader.state is ReaderState.LINE


def test_a_question_that_ended_its_line_may_be_followed_by_spaces_and_is_text_when_more_follows() -> None:
    assert kinds(after(b"Are you sure (Y/N)?\r\n  ")) == ["ControllerQuestion"]
    reader = Reader()
    (event,) = reader.receive(b"Ready?\r\nN")
    assert event == Text(b"Ready?\r\n", "Ready?")


def test_a_table_s_beginning_before_an_endless_line_is_told_first_and_no_dot_in_that_is_a_prompt() -> None:
    header = b"X Y Z O A T\r\n"
    reader = Reader()
    events = reader.receive(header + b"a" * LONGEST_LINE)
    assert [event.text for event in events if isinstance(event, Text)] == ["X Y Z O A T", "a" * LONGEST_LINE]
    assert kinds(reader.receive(b".") + reader.silence()) == []
