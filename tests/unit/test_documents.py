"""Tables in docs/ are the benches': those that come out the same everywhere are as the code says today."""

from __future__ import annotations

import re

import pytest

from daemon.store import folders
from tests.bench import decide
from tests.bench.thesis import DOCUMENT, written
from tests.bench.thesis.__main__ import PATTERNS, PICTURES, TIMES

TABLE = re.compile(r"<!-- table (\w+) -->\n(.*?)<!-- end -->", re.DOTALL)
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
SHARE, LEAST = 0.25, 0.06
"""How far what is measured on pictures may differ on another machine: a share of it, and at least so much."""


@pytest.mark.parametrize("name", PATTERNS)
def test_a_table_of_the_thesis_is_what_the_code_gives(name: str) -> None:
    text = DOCUMENT.read_text()
    assert written(text, name, PATTERNS[name]()) == text


@pytest.mark.long
@pytest.mark.parametrize("name", PICTURES)
def test_a_table_of_the_thesis_is_what_pictures_give(name: str) -> None:
    shown, made = dict(TABLE.findall(DOCUMENT.read_text()))[name], PICTURES[name]() + "\n"
    assert NUMBER.sub("#", shown) == NUMBER.sub("#", made)
    for was, now in zip(NUMBER.findall(shown), NUMBER.findall(made), strict=True):
        assert float(now) == pytest.approx(float(was), rel=SHARE, abs=LEAST)


def test_every_table_has_a_maker_and_none_is_empty() -> None:
    makers = {
        DOCUMENT: {*PATTERNS, *PICTURES, *TIMES},
        decide.DOCUMENT: {"sets"},
    }
    for file, names in makers.items():
        tables = dict(TABLE.findall(file.read_text()))
        assert set(tables) == names
        assert all(made.count("\n| ") >= 3 for made in tables.values())
    documents = {f for f in (folders.HOUSE / "docs").glob("*.md") if TABLE.search(f.read_text())}
    assert documents == set(makers)
