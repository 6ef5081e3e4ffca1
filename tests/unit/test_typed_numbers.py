"""Numbers that people type are read by one function, whose answer to what is no plain number is a line, everywhere."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from daemon.calibration.board import BoardError, parse_board
from daemon.console.interpreter import number
from daemon.errors import CommandError
from daemon.quantities import LONGEST_SHOWN, decimal, shown, whole
from daemon.store.folders import HOUSE

DAEMON = HOUSE / "daemon"
PEOPLE_TYPE_THERE = sorted(
    path
    for place in ("commands/*.py", "console/*.py", "frontends/*.py", "ctl.py", "main.py", "cli/*.py", "*/cli.py")
    for path in DAEMON.glob(place)
) + [DAEMON / "calibration" / name for name in ("recorded.py",)]
NOT_TYPED = {
    "float(v)",
    "float(value)",
    "float(f'{v:.4g}')",
    "float('nan')",
    "int(max(abs(across), abs(down)))",
    "int((datetime.now().astimezone().utcoffset() or timedelta()).total_seconds())",
    "int(number(words[0], 'PLACES', LEAST_PLACES, MOST_PLACES))",
    "int(seconds)",
    "int((seconds - whole) * 1000000.0)",
    "int(size[1])",  # a terminal's own report, of four ASCII digits
    "int(size[2])",
    "int(message['id'])",  # of the daemon
    "int(message['done']['status'])",
    "int(done['status'])",
    "int(args.run(args))",
    "int(args.job(args))",
    "int(listed.get('current', 0))",
    "int(trouble is not None)",
    "int(v)",
    "line[k].replace('.', '').isdecimal",
}
"""Calls there, beside those on arrays, that make a number of something else than what somebody typed."""


def readings(path: Path) -> list[str]:
    """Every place in a module where text may become a number otherwise than by quantities.decimal and whole."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute) and node.attr in ("isdecimal", "isdigit", "isnumeric"):
            found.append(ast.unparse(node))
        elif isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            types = [k.value for k in node.keywords if k.arg == "type"] + node.args[:1] * (called == "map")
            if (called in ("float", "int") and "np." not in ast.unparse(node)) or any(
                ast.unparse(one) in ("float", "int") for one in types
            ):
                found.append(ast.unparse(node))
    return sorted(found)


def test_nobody_reads_a_typed_number_otherwise() -> None:
    """Python's own readers take 1_0 for 10, digits of every script, and raise at 5,000 of them."""
    assert len(PEOPLE_TYPE_THERE) > 50
    found = {path.relative_to(DAEMON): {*readings(path)} - {*NOT_TYPED} for path in PEOPLE_TYPE_THERE}
    assert {path: calls for path, calls in found.items() if calls} == {}


def test_a_reader_of_python_s_own_is_found(tmp_path: Path) -> None:
    module = tmp_path / "module.py"
    module.write_text("a = float(word)\nb = word.isdigit()\nadd(type=int)\nc = list(map(float, words))\n")
    assert readings(module) == ["add(type=int)", "float(word)", "map(float, words)", "word.isdigit"]


@pytest.mark.parametrize(
    ("text", "value"), [("5", 5.0), ("-5", -5.0), ("+0.5", 0.5), (".25", 0.25), ("12.", 12.0), (" 7 ", 7.0)]
)
def test_a_plain_number_is_one_with_its_unit_or_without(text: str, value: float) -> None:
    assert decimal(text) == value
    assert decimal(f"{text}mm", "mm") == value


ODD = [
    "",
    "1_0",
    "1e3",
    "inf",
    "nan",
    "0x10",
    "\u0663",
    "\uff15",
    "--5",
    "5 5",
    "1,5",
    "9" * 5000,
    "5mm",
    "\u00b2",
    "1.2.3",
]


@pytest.mark.parametrize("text", ODD)
def test_what_is_no_plain_number_is_refused_in_one_short_line(text: str) -> None:
    for read in (decimal, whole):
        with pytest.raises(ValueError, match=r"^expected a .*number") as refused:
            read(text)
        assert len(str(refused.value)) < 120
    with pytest.raises(CommandError) as told:
        number(text, "COUNT", 1, 100)
    assert len(str(told.value)) < 150
    with pytest.raises(BoardError):
        parse_board(f"{text}x6", 16.0)


def test_what_is_told_back_is_cut() -> None:
    assert shown("9" * LONGEST_SHOWN) == "9" * LONGEST_SHOWN
    assert shown("9" * 5000) == "9" * LONGEST_SHOWN + "... (5000 characters)"
