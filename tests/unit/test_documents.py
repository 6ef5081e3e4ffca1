"""Tables in docs/ are the benches': those that come out the same everywhere are as the code says today."""

from __future__ import annotations

import re

import pytest

from daemon.store import folders
from tests.bench import decide, thesis

TABLE = re.compile(r"<!-- table (\w+) -->\n(.*?)<!-- end -->", re.DOTALL)


@pytest.mark.parametrize("name", thesis.EVERYWHERE)
def test_a_table_of_the_thesis_is_what_the_code_gives(name: str) -> None:
    text = thesis.DOCUMENT.read_text()
    assert thesis.written(text, name, thesis.EVERYWHERE[name]()) == text


def test_every_table_has_a_maker_and_none_is_empty() -> None:
    makers = {
        thesis.DOCUMENT: {*thesis.EVERYWHERE, *thesis.HERE, *thesis.WITH_SCENES},
        decide.DOCUMENT: {"sets"},
    }
    for file, names in makers.items():
        tables = dict(TABLE.findall(file.read_text()))
        assert set(tables) == names
        assert all(made.count("\n| ") >= 3 for made in tables.values())
    documents = {f for f in (folders.HOUSE / "docs").glob("*.md") if TABLE.search(f.read_text())}
    assert documents == set(makers)
