"""deploy/FAULTS.md: every thing that can fail is there, every row says all four things and names tests that exist."""

from __future__ import annotations

import re

import pytest

from daemon.store.places import HOUSE
from tests.unit.test_safety import named_in

PAGE = (HOUSE / "deploy" / "FAULTS.md").read_text(encoding="utf-8")
TABLE, _, FILES = PAGE.partition("## Files from outside")
ROWS = [[cell.strip() for cell in row.split("|")[1:-1]] for row in TABLE.splitlines() if row.startswith("| ")][2:]
TESTS = sorted(set(re.findall(r"`([\w/.]+\.py)::(\w+)`", TABLE)))


def test_nothing_that_can_fail_is_left_out() -> None:
    assert {row[0] for row in ROWS} == {"camera", "serial line", "disk", "memory", "clock", "light", "people"}


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row[0]}: {row[1]}")
def test_every_row_says_what_happens_what_is_seen_what_goes_on_and_when_and_names_a_test(row: list[str]) -> None:
    assert len(row) == 6
    assert all(row)
    assert re.search(r"::test_", row[5])


@pytest.mark.parametrize(("file", "name"), TESTS)
def test_every_test_it_names_exists(file: str, name: str) -> None:
    assert name in named_in(HOUSE / file)


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
