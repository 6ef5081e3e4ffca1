"""The line editor as a person at a VT100 meets it: what the keys do, and what stands on the screen afterwards."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.console.text_layout import fold
from daemon.frontends.line_editor import ASK_SIZE, BELL, COLUMNS, EditorKey, LineEditor, to_terminal

WORDS = ["status", "stop", "step", "teach cube", "teach pyramid"]
UP, DOWN, LEFT, RIGHT, HOME, DELETE = b"\x1b[A", b"\x1b[B", b"\x1b[D", b"\x1b[C", b"\x1b[H", b"\x1b[3~"


def editor() -> LineEditor:
    return LineEditor("> ", lambda typed: [word for word in WORDS if word.startswith(typed)])


def screen(received: bytes, columns: int = COLUMNS) -> tuple[str, int]:
    """The last row of a terminal that was sent these bytes, and the cursor's column: enough of a VT100 for the editor's
    own repertoire."""
    line: list[str] = []
    column = 0
    text = received.replace(ASK_SIZE, b"").decode()
    while text:
        if text.startswith("\x1b[K"):
            line, text = line[:column], text[3:]
            continue
        character, text = text[0], text[1:]
        if character == "\n":
            line = []
        elif character == "\r":
            column = 0
        elif character == "\b":
            column -= 1
        elif character != "\x07":
            line[column : column + 1] = [character]
            column += 1
        assert column >= 0, "the cursor ran off the left edge"
        assert column < columns, "it ran on into the next row, from where no key comes back"
    return "".join(line), column


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        (b"status\r", "status"),
        (b"status\n", "status"),
        (b"sttatus" + LEFT * 5 + b"\x7f\r", "status"),
        (b"tatus\x01s\r", "status"),
        (b"stop it\x17\r", "stop "),
        (b"nonsense\x15status\r", "status"),
        (b"ststus" + LEFT * 4 + DELETE + b"a" + b"\x05\r", "status"),
        (b"status" + HOME + RIGHT + b"x\r", "sxtatus"),
        (b"sta\t\r", "status "),
        (b"t\t\r", "teach "),
        (b"", None),
    ],
)
def test_the_keys_do_what_they_say(keys: bytes, line: str | None) -> None:
    typed = editor().feed(keys)
    assert typed.events == ([] if line is None else [line])


def test_carriage_return_and_line_feed_together_end_one_line() -> None:
    assert editor().feed(b"a\r\nb\r\n\nc\r").events == ["a", "b", "", "c"]


def test_a_line_end_split_between_two_reads_is_one_line_end() -> None:
    edit = editor()
    assert edit.feed(b"a\r").events == ["a"]
    assert edit.feed(b"\nb\r").events == ["b"]


def test_an_escape_sequence_split_between_reads_is_one_key() -> None:
    edit = editor()
    edit.feed(b"first\r")
    for byte in UP:
        edit.feed(bytes([byte]))
    assert edit.feed(b"\r").events == ["first"]


def test_history_goes_back_and_forth_and_gives_the_unfinished_line_back() -> None:
    edit = editor()
    edit.feed(b"one\rtwo\rtwo\r")
    assert edit.history == ["one", "two"]
    edit.feed(b"thr" + UP + UP + DOWN + DOWN)
    assert edit.feed(b"ee\r").events == ["three"]


def test_control_c_drops_the_line_and_is_told() -> None:
    edit = editor()
    assert edit.feed(b"pick cu\x03").events == [EditorKey.INTERRUPT]
    assert edit.feed(b"stop\r").events == ["stop"]


def test_control_d_ends_only_on_an_empty_line() -> None:
    edit = editor()
    assert edit.feed(b"a\x04").events == []
    assert edit.feed(b"\x15\x04").events == [EditorKey.END]


def test_several_completions_are_listed_and_the_line_drawn_again() -> None:
    typed = editor().feed(b"teach \t")
    assert b"cube  pyramid" in typed.echo
    assert screen(typed.echo)[0] == "> teach "


def test_a_notice_stands_above_the_line_being_typed() -> None:
    edit = editor()
    shown = edit.show_prompt() + edit.feed(b"pick").echo + edit.notice("FAULT arm power off")
    assert b"FAULT arm power off\r\n" in shown
    assert screen(shown)[0] == "> pick"


def test_an_answer_to_a_question_is_not_remembered() -> None:
    edit = editor()
    edit.remember = False
    edit.feed(b"y\r")
    assert edit.history == []


def test_a_line_longer_than_a_controller_takes_is_refused_by_the_bell() -> None:
    assert editor().feed(b"x" * 300).echo.endswith(BELL)


KEYS = [
    b"a",
    b"b ",
    b"c",
    b"\x7f",
    b"\x15",
    b"\x17",
    b"\x01",
    b"\x05",
    LEFT,
    RIGHT,
    UP,
    DOWN,
    DELETE,
    b"\t",
    b"\r",
    b"\x0c",
]


def pressed(edit: LineEditor, keys: list[bytes]) -> bytes:
    """All that a terminal is sent while keys are pressed."""
    shown = edit.show_prompt()
    for key in keys:
        typed = edit.feed(key)
        shown += typed.echo
        if typed.events:
            shown += edit.show_prompt()
    return shown


@settings(max_examples=150, deadline=None)
@given(st.lists(st.sampled_from(KEYS), min_size=6, max_size=40))
def test_whatever_is_pressed_the_screen_shows_what_return_will_send(keys: list[bytes]) -> None:
    edit = editor()
    before_return, _ = screen(pressed(edit, keys))
    (line,) = edit.feed(b"\r").events
    assert before_return == f"> {line}"


@settings(max_examples=100, deadline=None)
@given(st.integers(20, 30), st.lists(st.sampled_from([*KEYS, b"pick the cube "]), min_size=6, max_size=40))
def test_of_a_line_longer_than_the_terminal_is_wide_the_row_shows_what_is_around_the_cursor(
    columns: int, keys: list[bytes]
) -> None:
    edit = editor()
    edit.feed(b"\x1b[24;%dR" % columns)
    row, column = screen(pressed(edit, keys), columns)
    edit.feed(b"@")  # where the cursor stood
    (line,) = edit.feed(b"\r").events
    before, _, behind = str(line).partition("@")
    left, right = row[2:column], row[column:]
    assert row.startswith("> ")
    assert before.endswith(left.removeprefix("<"))
    assert behind.startswith(right.removesuffix(">"))
    assert left.startswith("<") or left == before
    assert right.endswith(">") or right == behind
    assert left or not before


@given(st.binary(max_size=80))
def test_line_noise_never_breaks_the_editor(noise: bytes) -> None:
    edit = editor()
    edit.feed(noise)
    edit.feed(b"\x1b[A\x03")
    assert edit.feed(b"status\r").events == ["status"]


def test_long_lines_are_folded_between_words_and_nothing_is_lost() -> None:
    text = "note: " + "word " * 60
    lines = fold(text, COLUMNS)
    assert max(map(len, lines)) <= COLUMNS
    assert " ".join(text.split()) == " ".join(" ".join(lines).split())
    assert to_terminal("grün\n").endswith(b"gr?n\r\n")
    path = "/var/lib/facetd/runs/a-b-c"
    assert fold(f"kept in the folder {path}", 30)[1].strip() == path, "as it can be copied"


@pytest.mark.parametrize("stray", [b"\x1b", b"\x1b\x1b", b"\x00", b"\xfc", b"\xff", b"\x80\x1b"])
def test_a_stray_byte_eats_nothing_of_what_follows(stray: bytes) -> None:
    for place in range(4):
        line = b"stop"[:place] + stray + b"stop"[place:]
        assert editor().feed(line + b"\r").events == ["stop"]


@pytest.mark.parametrize("begun", [b"\x1b", b"\x1b[", b"\x1b[3", b"\x1bO"])
def test_control_c_and_return_are_heard_in_the_middle_of_an_escape(begun: bytes) -> None:
    assert editor().feed(begun + b"\x03").events == [EditorKey.INTERRUPT]
    assert editor().feed(b"stop" + begun + b"\r").events == ["stop"]


@pytest.mark.parametrize(
    ("key", "same_as"),
    [
        (b"\x01", HOME), (b"\x02", LEFT), (b"\x05", b"\x1b[F"), (b"\x06", RIGHT), (b"\x04", DELETE), (b"\x08", b"\x7f"),
        (b"\x0c", b"\x12"), (b"\x0e", DOWN), (b"\x10", UP), (b"\x01", b"\x1bOH"),
    ],
)  # fmt: skip
def test_what_a_terminal_has_no_key_for_a_letter_with_control_does(key: bytes, same_as: bytes) -> None:
    before = b"first\rsecond\rthird\r" + UP * 2 + LEFT * 2
    lines = [editor().feed(before + one + b"x" + one + b"y\r") for one in (key, same_as)]
    assert lines[0] == lines[1]


@pytest.mark.parametrize(
    ("said", "size"),
    [(b"30;100", (30, 100)), (b"4;20", (4, 20)), (b"3;100", None), (b"30;19", None), (b"3;19", None), (b"0;0", None)],
)
def test_a_terminal_is_as_large_as_it_says_unless_nothing_could_be_read_there(
    said: bytes, size: tuple[int, int] | None
) -> None:
    edit = editor()
    usual = edit.rows, edit.columns
    assert edit.feed(b"a\x1b[" + said + b"Rb\r").events == ["ab"]
    assert (edit.rows, edit.columns) == (size or usual)


def test_what_belongs_to_a_sequence_that_nobody_knows_is_not_typed() -> None:
    assert editor().feed(b"\x1b[ Ax\r").events == ["x"]
    assert editor().feed(b"\x1b[1\ry\r").events == ["", "y"], "and what ends a line ends it"
    assert editor().feed(b"abc\x1b[\x15x\r").events == ["x"], "a key with control is none of it"
    assert editor().feed(b"\x1b[@x\x1b[~y\r").events == ["xy"]


def test_tab_types_what_all_that_may_be_meant_have_in_common() -> None:
    edit = LineEditor("> ", lambda typed: [word for word in ("stat", "status") if word.startswith(typed)])
    assert edit.feed(b"s\tus\r").events == ["status"]


@pytest.mark.parametrize(
    "keys", [b"\x7f", b"\x04", b"\x17", LEFT, RIGHT, UP, DOWN, b"\x0b", b"\x1b[5~", b"qqq\t", b"\x80"]
)
def test_what_cannot_be_done_rings(keys: bytes) -> None:
    edit = editor()
    edit.feed(b"x" + LEFT if keys != b"\x04" else b"x")
    edit.feed(b"\x05" if keys in (RIGHT, b"\x04") or b"q" in keys else b"\x01")
    assert edit.feed(keys).echo.endswith(BELL)


def test_what_is_typed_is_echoed_and_a_line_s_end_goes_to_the_next_line() -> None:
    edit = editor()
    assert edit.feed(b"ab\r").echo == b"ab\r\n"
    assert edit.feed(b"\n").echo == b"", "the other half of the same end"
    assert edit.feed(b"\n").echo == b"\r\n"
    assert edit.feed(b"\x00").echo == b"", "what a line says that is only being tested"
    assert edit.feed(b"a\x03").echo == b"a^C\r\n"


def test_what_may_be_meant_is_offered_within_the_width_of_the_terminal() -> None:
    edit = LineEditor("> ", lambda typed: ["a" * 9, "b" * 8])
    edit.feed(b"\x1b[4;20R")
    assert edit.feed(b"\t").echo == b"\r\n" + b"a" * 9 + b"  " + b"b" * 8 + b"\r\n" + edit.show_prompt()
    edit = LineEditor("> ", lambda typed: ["a" * 9, "b" * 9])
    edit.feed(b"\x1b[4;20R")
    assert edit.feed(b"\t").echo.count(b"\r\n") == 3


@pytest.mark.parametrize(
    ("options", "typed"),
    [(["go bin"], b"go bin "), (["go a/b"], b"go a/b "), (["go a/"], b"go a/"), (["go bin", "go bins"], b"go bin")],
)
def test_tab_goes_on_with_a_space_where_a_word_is_whole_and_it_is_no_folder(options: list[str], typed: bytes) -> None:
    edit = LineEditor("> ", lambda _: options)
    edit.feed(b"go")
    assert edit.feed(b"\t").echo == typed.removeprefix(b"go")


def test_of_a_long_line_the_row_stays_as_long_as_the_cursor_is_seen_on_it() -> None:
    edit = editor()
    edit.feed(b"\x1b[24;24R")
    edit.feed(b"0123456789" * 5)
    first = edit._first
    assert first > 0
    for _ in range(5):
        assert not edit.feed(LEFT).echo.startswith(b"\r"), "nothing is drawn anew"
    assert edit._first == first


def test_of_a_long_line_the_row_is_filled_to_its_last_column_before_it_goes_on() -> None:
    edit = editor()
    edit.feed(b"\x1b[24;24R")
    edit.feed(b"x" * 22)
    first, room = edit._first, 24 - 1 - len("> ")
    assert first > 0
    edit.feed(b"x" * (first + room - 22))
    assert edit._first == first
    edit.feed(b"x")
    assert edit._first > first


def test_behind_a_line_that_was_longer_than_the_row_the_next_one_begins_at_its_first_column() -> None:
    """At 9600 baud a row that is drawn again at the first key is seen."""
    line = editor()
    line.feed(b"x" * 200 + b"\r")
    assert line.feed(b"a").echo == b"a"


def test_a_sequence_that_nobody_ends_is_given_up_after_eight_characters() -> None:
    assert editor().feed(b"\x1b[" + b"1" * 8 + b"status\r").events == ["status"]
