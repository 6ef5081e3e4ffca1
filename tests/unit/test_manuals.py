"""References in docs/ are as the code says today, and leave no command, setting, job or option out."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import pytest

from daemon import config, ctl
from daemon.commands import every_command
from daemon.events.codes import CauseCode
from daemon.events.outcomes import Outcome
from daemon.store.folders import HOUSE
from tests.manuals import settings
from tests.manuals.__main__ import PAGES, PIECES, with_piece

STALE = "it is made from the code: `python -m tests.manuals` (or `make docs`), and commit what that writes"
COMMANDS = HOUSE / "docs" / "COMMANDS.md"
TROUBLE, PICK = (HOUSE / "docs" / "operate" / page for page in ("trouble.md", "pick.md"))
MANUALS = [HOUSE / "README.md", *sorted(f for room in ("deploy", "docs") for f in (HOUSE / room).rglob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_reference_is_what_the_code_says_today(page: Path) -> None:
    assert page.read_text(encoding="utf-8") == PAGES[page](), f"{page.name}: {STALE}"


@pytest.mark.parametrize(("page", "name"), PIECES, ids=lambda what: getattr(what, "name", what))
def test_a_piece_of_a_page_is_what_the_code_says_today(page: Path, name: str) -> None:
    text = page.read_text(encoding="utf-8")
    assert with_piece(text, name, PIECES[page, name]()) == text, f"{page.name}: {STALE}"


def every_setting() -> list[tuple[str, settings.Setting]]:
    return [(path, row) for path, _, rows in settings.sections(config.ConfigFile, "") for row in rows]


def test_every_setting_says_what_it_means() -> None:
    assert len(every_setting()) > 90
    assert [f"{path}.{row.name}" for path, row in every_setting() if not row.meaning] == []


def test_a_number_in_the_reference_has_both_its_bounds() -> None:
    """A bound that the reference cannot print would be one that a person finds by trial."""
    for path, row in every_setting():
        assert settings.allowed(row.kind) not in ("a number", "a whole number"), f"{path}.{row.name}"


def test_a_field_without_a_docstring_has_no_meaning_and_is_found() -> None:
    @dataclasses.dataclass
    class Described:
        first: int = 1
        second: int = 2
        """The second."""

    assert settings.meanings(Described) == {"second": "The second."}


def test_every_command_and_every_job_has_its_section() -> None:
    page = COMMANDS.read_text(encoding="utf-8")
    for command in every_command("simulated"):
        assert f"### {command.name}\n\n`{command.usage}`" in page
        assert command.details in page
    for name, parser in ctl._parser([*ctl.OFFLINE.values(), ctl.TRAIN])[1].items():
        assert f"### facetctl {name}\n" in page
        for action in parser._actions:
            for option in action.option_strings[-1:]:
                assert option in page or option == "--help", f"{name} {option}"


def test_every_argument_says_what_it_is() -> None:
    assert re.findall(r"^\| `.*` \|  \|$", COMMANDS.read_text(encoding="utf-8"), re.MULTILINE) == []


def test_every_cause_has_its_row_in_trouble_with_what_to_do() -> None:
    rows = dict(re.findall(r"^\| (.+?) \| \w+ \| (.+) \|$", TROUBLE.read_text(encoding="utf-8"), re.MULTILINE))
    wrong = [c for c in CauseCode if rows.get(c.summary, "no row").lower() != c.remedy.lower()]
    assert wrong == []


def test_every_outcome_of_a_pick_is_explained() -> None:
    page = PICK.read_text(encoding="utf-8")
    assert [one for one in Outcome if not re.search(rf"^\| (?:`\w+`, )*`{one}`", page, re.MULTILINE)] == []


def anchors(page: Path) -> set[str]:
    """The names by which the headings of a page are reached, as GitHub makes them, and its own."""
    text = page.read_text(encoding="utf-8")
    heads = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads} | set(
        re.findall(r'<a id="(\w+)"', text)
    )


def test_every_link_of_a_manual_leads_somewhere() -> None:
    dead = []
    for page in MANUALS:
        for file, anchor in re.findall(r"\]\((?!https?:)([^)#]*)#?([^)]*)\)", page.read_text(encoding="utf-8")):
            there = page.parent / file if file else page
            if not there.exists() or (anchor and anchor not in anchors(there)):
                dead.append((page.name, file, anchor))
    assert dead == []
