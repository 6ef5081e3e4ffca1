"""Tables in docs/ are the benches': those that come out the same everywhere are as the code says today."""

from __future__ import annotations

import re

import pytest

from daemon.store import folders
from tests.bench import decide
from tests.bench.thesis import DOCUMENT, written
from tests.bench.thesis.__main__ import PATTERNS, PICTURES, TIMES

TABLE = re.compile(r"<!-- table (\w+) -->\n(.*?)<!-- end -->", re.DOTALL)
WITH_KIND = re.compile(r"(?:\b(test|bench|console)\b:? )?`([^`]+)`")
FILE = re.compile(r"`((?:daemon|drivers|etc|tests)/[\w/]+(?:\.\w+|/))`")
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
SHARE, LEAST = 0.25, 0.06
"""How far what is measured on pictures may differ on another machine: a share of it, and at least so much."""


@pytest.mark.parametrize("name", PATTERNS)
def test_a_table_of_the_thesis_is_what_the_code_gives(name: str) -> None:
    text = DOCUMENT.read_text()
    assert written(text, name, PATTERNS[name]()) == text


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", PICTURES)
def test_a_table_of_the_thesis_is_what_pictures_give(name: str) -> None:
    shown, made = dict(TABLE.findall(DOCUMENT.read_text()))[name], PICTURES[name]() + "\n"
    assert NUMBER.sub("#", shown) == NUMBER.sub("#", made)
    for was, now in zip(NUMBER.findall(shown), NUMBER.findall(made), strict=True):
        assert float(now) == pytest.approx(float(was), rel=SHARE, abs=LEAST)


def rows() -> list[list[str]]:
    """The cells of each row of the page's last table: section, what, in facetd, shown by."""
    text = DOCUMENT.read_text().split("## Section by section")[1]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in text.splitlines() if line[:2] == "| "][
        2:
    ]


def test_each_row_of_the_thesis_has_a_command_or_says_why_not() -> None:
    makers, commands = {*PATTERNS, *PICTURES, *TIMES}, (folders.HOUSE / "docs" / "COMMANDS.md").read_text()
    for row in rows():
        assert len(row) == 4, row
        if row[3].startswith("No: "):
            continue
        shown = WITH_KIND.findall(row[3])
        assert shown, row
        kind = ""
        for said, named in shown:
            kind, name = said or kind, named.split()[-1]
            if kind == "test":
                assert (folders.HOUSE / "tests" / "unit" / name).exists(), row
            elif named.startswith("facetctl "):
                assert f"`facetctl {named.split()[1]}" in commands or f"### {named.split()[1]}\n" in commands, row
            elif kind == "console":
                assert f"### {named.split()[0]}\n" in commands, row
            elif named.startswith("thesis "):
                assert name in makers, row
            else:
                assert (folders.HOUSE / "tests" / "bench" / f"{name}.py").exists(), row


def test_each_file_that_the_thesis_names_exists() -> None:
    for name in FILE.findall(DOCUMENT.read_text()):
        assert (folders.HOUSE / name).exists() or (folders.HOUSE / "daemon" / name).exists(), name


def test_each_setting_link_and_bench_that_the_thesis_names_exists() -> None:
    text, settings = DOCUMENT.read_text(), (folders.HOUSE / "docs" / "SETTINGS.md").read_text()
    named = re.findall(r"`vision\.(\w+)", text)
    assert named
    assert all(f"| `{name}` |" in settings for name in named)
    assert all((DOCUMENT.parent / link).exists() for link in re.findall(r"\]\(([^)#]+)", text))
    for name in re.findall(r"python -m tests\.bench\.([a-z_]+)", text):
        assert any((folders.HOUSE / "tests" / "bench" / end).exists() for end in (f"{name}.py", f"{name}/__main__.py"))


@pytest.mark.parametrize(
    ("pattern", "last"),
    [
        (r"figures? ((?:\d\.\d+(?: to |, )?)+)", {"1": 9, "2": 6, "4": 42, "5": 26, "6": 3}),
        (r"((?:\(\d\.\d+\)(?: to |, )?)+)", {"1": 45, "2": 4, "3": 3, "4": 19, "5": 2}),
    ],
)
def test_every_figure_and_equation_of_the_thesis_has_a_row(pattern: str, last: dict[str, int]) -> None:
    named = set[tuple[str, int]]()
    for found in re.findall(pattern, " ".join(" ".join(row) for row in rows())):
        for one in found.replace("(", "").replace(")", "").split(", "):
            ends = [part.split(".") for part in one.split(" to ") if part]
            if ends:
                (chapter, first), (_, end) = ends[0], ends[-1]
                named |= {(chapter, k) for k in range(int(first), int(end) + 1)}
    first = 2 if "figure" in pattern else 1  # the appendices' figures begin with 1.2
    wanted = {(c, k) for c, end in last.items() for k in range(first if c == "1" else 1, end + 1)}
    assert not wanted - named


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
