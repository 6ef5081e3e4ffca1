"""`note` and `operator`: what they keep in the run, and what they refuse."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from daemon.commands import every_command
from daemon.console.interpreter import CommandResult, Interpreter
from daemon.events.records import SCHEMA
from tests.fakes.fake_context import FakeFrontend, fake_context


@pytest.fixture
def context(tmp_path: Path) -> Any:
    return fake_context(tmp_path)


def say(context: Any, text: str, frontend: FakeFrontend) -> CommandResult:
    return asyncio.run(Interpreter(context, every_command()).interpret(text, frontend))


def records(context: Any, kind: str) -> list[dict[str, Any]]:
    return [fields for one, fields in context.log.records if one == kind]


def test_a_note_is_kept_with_who_wrote_it(context: Any) -> None:
    frontend = FakeFrontend()
    assert say(context, "note lamp replaced, ask Ann", frontend).status == 0
    assert records(context, "note") == [{"who": frontend.who, "text": "lamp replaced, ask Ann"}]
    assert set(records(context, "note")[0]) <= {"kind", *SCHEMA["note"].__struct_fields__}


@pytest.mark.parametrize(
    ("typed", "told"), [("note", "TEXT is missing: `note TEXT`"), (f"note {'x' * 301}", "at most 300")]
)
def test_no_note_and_one_too_long_are_refused(context: Any, typed: str, told: str) -> None:
    result = say(context, typed, FakeFrontend())
    assert told in result.text
    assert result.status == 2
    assert records(context, "note") == []


def test_an_operator_has_a_name_and_stays_at_their_terminal(context: Any) -> None:
    frontend = FakeFrontend()
    frontend.who = "operator at /dev/ttyS0"
    assert say(context, "operator ann", frontend).text == "From now on: ann: operator at /dev/ttyS0."
    say(context, "operator bob", frontend)
    assert frontend.who == "bob: operator at /dev/ttyS0", "one name at a time"
    assert records(context, "operator") == [
        {"who": "ann: operator at /dev/ttyS0", "before": "operator at /dev/ttyS0"},
        {"who": "bob: operator at /dev/ttyS0", "before": "ann: operator at /dev/ttyS0"},
    ]
    assert say(context, "operator", frontend).text == "At this terminal: bob: operator at /dev/ttyS0."
    say(context, "note all well", frontend)
    assert records(context, "note")[0]["who"].startswith("bob: ")


@pytest.mark.parametrize("typed", ["operator a:b", f"operator {'x' * 31}", "operator ann bob"])
def test_a_name_is_one_short_word(context: Any, typed: str) -> None:
    frontend = FakeFrontend()
    before = frontend.who
    assert say(context, typed, frontend).status == 2
    assert frontend.who == before
