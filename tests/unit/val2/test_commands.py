"""The text of commands, and what a typed line may do, by its words alone."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.val2 import commands
from drivers.val2.location import Location


def test_the_longest_move_fits_a_monitor_line() -> None:
    longest = Location(-1234.56, -1234.56, -1234.56, -179.999, -89.999, -179.999)
    lines = [commands.move(longest), *commands.straight_move(longest, "GOAL"), *commands.straight_move(longest, None)]
    assert max(map(len, lines)) < 80


@pytest.mark.parametrize("percent", [0, 0.09, -5, 100.1, float("nan")])
def test_a_speed_that_is_no_percentage_is_never_written(percent: float) -> None:
    with pytest.raises(ValueError, match="expected"):
        commands.speed(percent)


@pytest.mark.parametrize(
    "text",
    ["DO MOVE P", "do moves p", " DO  READY", "EX prog", "CAL", "DO CLOSEI", "do drive 1,2,3", "DO APPRO P,50",
     "D MOVE P", "DO", "DO MOV P", "DO LEFTY", "DO SPEED 100", "EXEC PROG", "EXECUTE", "CALI", "calib", "PROCEED",
     "RETRY", "NEXT", "XSTEP", "ST", "S", "NEST", "PROG", "PA", "PANICKED", "1", "CAL;WHERE", "WHEREVER",
     "\x00DO READY", "WHERE,DO"],
)  # fmt: skip
def test_whatever_moves_arm_or_hand_is_known_to(text: str) -> None:
    assert commands.moves_the_arm(text)


@pytest.mark.parametrize(
    "text",
    ["WHERE", "DO SET P=TRANS(1,2,3,4,5,6)", "SPEED 50", "DO BREAK", "ABORT", "wher", "STAT", " status", "LISTL",
     "LISTP PROG", "DIR", "TOOL TRANS(0,0,130,0,0,0)", "HERE P1", "Y", "n", "", "FREE", "PANIC", "pan"],
)  # fmt: skip
def test_whatever_moves_nothing_is_known_to(text: str) -> None:
    assert not commands.moves_the_arm(text)


# A line may move arm or hand, work the hand, turn the arm over, begin a program; its answer is a prompt alone, or text.
MOVES, HAND, TURNS, PROGRAM, SILENT, PRINTS = "moves", "hand", "turns over", "program", "silent", "prints"
KINDS = {
    "": set(), "WHERE": set(), "ABORT": set(), "SPEED 40": {SILENT}, "TOOL TRANS(0,0,1,0,0,0)": {SILENT},
    "DO BREAK": {SILENT}, "DO SET P=TRANS(1,2,3,4,5,6)": {SILENT}, "DO SPEED 100 ALWAYS": {MOVES, SILENT},
    "DO MOVE P": {MOVES, SILENT}, "DO MOVES P": {MOVES, SILENT}, "DO READY": {MOVES}, "DO DRIVE 1,2,3": {MOVES},
    "DO OPENI": {MOVES, HAND, SILENT}, "DO CLOSEI": {MOVES, HAND, SILENT}, "DO OPEN": {MOVES, HAND},
    "DO": {MOVES, HAND}, "DO MOV P": {MOVES, HAND}, "DO LEFTY": {MOVES, HAND, TURNS},
    "D LE": {MOVES, HAND, TURNS, PROGRAM},
    "DO F": {MOVES, HAND, TURNS}, "DO FLIPPED": {MOVES, HAND}, "DON FLIP": {MOVES, HAND, PROGRAM},
    "EXECUTE MINE": {MOVES, HAND, PROGRAM}, "READY": {MOVES, HAND, PROGRAM}, "MOVE P": {MOVES, HAND, PROGRAM},
    "CAL": {MOVES, HAND, PROGRAM}, "S": {MOVES, HAND, PROGRAM}, "SP 1": {MOVES, HAND, PROGRAM}, "SPE 1": set(),
    "D": {MOVES, HAND, PROGRAM}, "STATUS": {PRINTS}, "stat": {PRINTS}, "HERE P1": {PRINTS}, "BASE": {PRINTS},
}  # fmt: skip


@pytest.mark.parametrize(("line", "kinds"), KINDS.items())
def test_what_a_line_may_do_is_known_by_its_words(line: str, kinds: set[str]) -> None:
    found = {
        MOVES: commands.moves_the_arm, HAND: commands.works_the_hand, TURNS: commands.turns_over,
        PROGRAM: commands.begins_a_program, SILENT: commands.answers_nothing,
        PRINTS: commands.prints_text,
    }  # fmt: skip
    assert {kind for kind, asked in found.items() if asked(line)} == kinds


@given(st.sampled_from([1.0, 25.4, 1000.0, 0.5]), st.floats(-1000, 1000), st.floats(-180, 180))
def test_a_length_is_written_to_a_hundredth_of_a_millimetre_in_any_unit_and_an_angle_to_a_thousandth(
    unit_mm: float, mm: float, deg: float
) -> None:
    text = commands.trans(Location(mm, -mm, mm / 2, deg, -deg, deg / 2), unit_mm).removeprefix("TRANS(").rstrip(")")
    lengths, angles = text.split(",")[:3], text.split(",")[3:]
    for word, value in zip(lengths, (mm, -mm, mm / 2), strict=True):
        assert float(word) * unit_mm == pytest.approx(value, abs=0.0051)
        digits = len(word.partition(".")[2])
        assert unit_mm * 10.0**-digits <= 0.01 < unit_mm * 10.0 ** (2 - digits)
    for word, value in zip(angles, (deg, -deg, deg / 2), strict=True):
        assert len(word.partition(".")[2]) == 3
        assert float(word) == pytest.approx(value, abs=0.00051)


@pytest.mark.parametrize("percent", [0.1, 100])
def test_the_least_and_the_highest_speed_are_written(percent: float) -> None:
    assert commands.speed(percent) == f"SPEED {percent:g}"
