"""Names, messages and manuals in the field's own words: old words do not come back, and one name is one thing."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from daemon.store.folders import HOUSE
from tests.bench.readability import pages
from tests.manuals.readability import ASTRAY, WORDS, measured, sentences

CODE = sorted(f for root in ("daemon", "drivers") for f in (HOUSE / root).rglob("*.py"))
OLD_NAMES = {"hall", "doors", "upkeep", "live", "worlds", "turns", "sentry", "judge", "things", "mover", "laid"}
"""Names of packages and modules that were, and are none any more."""
GONE_FROM_MESSAGES = {"upkeep", r"borne(?: out)?", "twins?|rivals?", "sentry", "night of misses", "the judge"}
"""Of the words that lead astray, those that no message has."""
GONE_FROM_NAMES = {
    "told",
    "said",
    "gone",
    "amid",
    "borne",
    "twin",
    "twins",
    "rivals",
    "hall",
    "doors",
    "stranger",
    "story",
}
EYES = {"eye", "eyes"}
"""Which no name has in any package: a camera, its image, a viewpoint. A hand-eye calibration is the field's, and keys
of records stay."""
"""Words that say nothing of what a name means: what was told, to whom, and where it is gone."""
KEPT = {"gone_mm", "GONE"}
"""A key that people have in facetd.yaml, and an event that runs have recorded."""
GONE_FROM_FIRST_LINES = r"told|tells|amid|aslant|wherein|thereby|borne|twins?|gone|standing|mended|laid down"
RENAMED = [
    *(f"daemon/{package}" for package in (
        "arm", "calibration", "cell", "cli", "commands", "compute", "console", "dashboard", "events", "fleet",
        "frontends", "maintenance", "pick", "review", "signals", "store", "teaching", "vision")),
    "drivers/camera", "drivers/simcell", "drivers/val2",
    "daemon/config.py", "daemon/ctl.py", "daemon/main.py", "daemon/service.py",
]  # fmt: skip
"""Packages and modules whose names and first lines are in the field's words."""
DOCUMENTED = ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Module
OPERATORS = [*sorted((HOUSE / "docs" / "operate").glob("*.md")), HOUSE / "README.md", HOUSE / "deploy" / "README.md"]


class Words(NamedTuple):
    """Of a file: its classes; every name that it gives to something; every text of more than one word that is no
    docstring; and the first paragraph of each docstring."""

    classes: list[str]
    names: list[str]
    messages: list[str]
    first_lines: list[str]


@cache
def words(file: Path) -> Words:
    """All in one walk: the trees of all files at once would be more than the tests themselves need."""
    nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
    docs = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    found = Words([], [], [], [])
    for node in nodes:
        if isinstance(node, DOCUMENTED):
            if doc := ast.get_docstring(node):
                found.first_lines.append(doc.partition("\n\n")[0])
            if isinstance(node, ast.ClassDef):
                found.classes.append(node.name)
            if not isinstance(node, ast.Module):
                found.names.append(node.name)
        elif isinstance(node, ast.arg):
            found.names.append(node.arg)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.names.append(node.id)
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            found.names.append(node.attr)
        elif (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and id(node) not in docs
            and " " in node.value
        ):
            found.messages.append(node.value)
    return found


def test_no_package_or_module_has_a_name_of_before() -> None:
    names = {part for file in CODE for part in file.relative_to(HOUSE).with_suffix("").parts}
    assert names & OLD_NAMES == set()


def test_a_class_name_occurs_once() -> None:
    where = defaultdict(list)
    for file in CODE:
        for name in words(file).classes:
            where[name].append(str(file.relative_to(HOUSE)))
    assert {n: files for n, files in where.items() if len(files) > 1} == {}


def test_no_package_hides_a_module_behind_a_function_of_its_name() -> None:
    hidden = set()
    for door in (f for f in CODE if f.name == "__init__.py"):
        package = ".".join(door.parent.relative_to(HOUSE).parts)
        for node in ast.walk(ast.parse(door.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module != package:
                hidden |= {a.asname or a.name for a in node.names if (door.parent / f"{a.name}.py").exists()}
    assert hidden == set()


def test_no_message_says_a_word_of_before() -> None:
    assert set(WORDS) >= GONE_FROM_MESSAGES
    said = re.compile(rf"\b(?:{'|'.join(GONE_FROM_MESSAGES)})\b", re.IGNORECASE)
    assert [text for file in CODE for text in words(file).messages if said.search(text)] == []


def renamed() -> list[Path]:
    found = [file for file in CODE if file.relative_to(HOUSE).as_posix().startswith(tuple(RENAMED))]
    assert len(found) > 150
    return found


def test_no_name_has_a_word_of_before() -> None:
    assert [
        f"{file.relative_to(HOUSE)}: {name}"
        for file in renamed()
        for name in words(file).names
        if name not in KEPT and GONE_FROM_NAMES & {part.lower() for part in re.split(r"_|(?<=[a-z])(?=[A-Z])", name)}
    ] == []


def test_cameras_are_not_called_eyes() -> None:
    assert [
        f"{file.relative_to(HOUSE)}: {name}"
        for file in CODE
        if file != HOUSE / "daemon/events/records.py"
        for name in words(file).names
        if EYES & set(re.sub(r"hand_?eye|eye_on_hand", "", name.lower()).split("_"))
    ] == []


def test_no_first_line_of_a_docstring_has_a_word_of_before() -> None:
    astray = re.compile(rf"\b(?:{GONE_FROM_FIRST_LINES})\b", re.IGNORECASE)
    assert [
        f"{file.relative_to(HOUSE)}: {first.splitlines()[0]}"
        for file in renamed()
        for first in words(file).first_lines
        if astray.search(first)
    ] == []


@pytest.mark.parametrize("page", OPERATORS, ids=lambda page: page.name)
def test_an_operator_s_page_has_no_word_that_leads_astray(page: Path) -> None:
    assert [s for s in sentences(page.read_text(encoding="utf-8")) if ASTRAY.search(s)] == []


@pytest.mark.parametrize("page", OPERATORS, ids=lambda page: page.name)
def test_an_operator_s_page_says_first_what_it_is_for(page: Path) -> None:
    if page.parent.name == "operate" and page.name != "README.md":
        title, _, rest = page.read_text(encoding="utf-8").partition("\n\n")
        assert title.startswith("# ")
        assert rest.startswith("**For:** ")


def test_the_manuals_are_as_readable_as_they_were_made() -> None:
    """Mean length of a sentence 14.9 and 27 % passives before they were written anew; 11.5 and 11 % then, 10.8 and 7 %
    after a reader whose second language it is had marked what he read twice."""
    found = measured("\n\n".join(pages(None).values()))
    assert found.mean < 11.5
    assert found.p95 <= 25
    assert found.passive_pct < 9
    assert found.astray_per_1000 < 1


def test_a_measure_finds_a_passive_a_long_sentence_and_a_word_astray() -> None:
    text = (
        "# A page\n\nThe arm is not always stopped by `stop`. Whoever is told at a door waits. A" + " word" * 30 + ".\n"
    )
    found = measured(text)
    assert found.sentences == 3
    assert round(found.passive_pct) == 67
    assert round(found.long_pct) == 33
    assert found.astray_per_1000 > 50
