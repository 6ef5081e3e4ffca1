"""deploy/FAULTS.md: every thing that can fail is there, every row says all four things and names tests that exist."""

from __future__ import annotations

import re

from daemon.store.folders import HOUSE
from tests.unit.test_safety import named_in

PAGE = (HOUSE / "deploy" / "FAULTS.md").read_text(encoding="utf-8")
ROWS_PART, _, REST = PAGE.partition("## Files from outside")
FILES, _, SHOWN = REST.partition("## The tests that show it")


def cells(text: str) -> list[list[str]]:
    """The rows of all tables in a text, without their headings."""
    lines = [line for line in text.splitlines() if line.startswith("| ") and not line.startswith("| | ")]
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines if "---" not in line]


ROWS = cells(ROWS_PART)
SHOWN_BY = dict(cells(SHOWN))
TESTS = sorted(set(re.findall(r"`([\w/.]+\.py)::(\w+)`", SHOWN)))


def test_nothing_that_can_fail_is_left_out() -> None:
    sections = re.findall(r"^## (.+)$", ROWS_PART, re.MULTILINE)
    assert sections == ["Cameras", "Serial line", "Disk", "Memory", "Clock", "Light", "People and clients"]
    assert len(ROWS) > 35


def test_every_row_says_what_fails_what_is_seen_what_goes_on_and_when_and_has_a_test() -> None:
    wanting = [row for row in ROWS if len(row) != 5 or not all(row) or "::test_" not in SHOWN_BY[row[0]]]
    assert wanting == []


def test_every_number_is_one_row_s() -> None:
    assert [row[0] for row in ROWS] == list(SHOWN_BY)


def test_every_test_it_names_exists() -> None:
    assert len(TESTS) > 50
    assert [f"{file}::{name}" for file, name in TESTS if name not in named_in(HOUSE / file)] == []


def test_every_kind_of_file_has_its_row() -> None:
    for kind in (
        "facetd.yaml",
        "model",
        "drawing",
        "picture",
        "run.jsonl",
        "view's note",
        "standing",
        "socket",
        "script",
    ):
        assert re.search(rf"^\| [^|]*{kind}", FILES, re.MULTILINE), kind
