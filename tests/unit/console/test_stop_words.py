"""What a person in haste writes for a stop, and what is none."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.commands import every_command
from daemon.console.stop_words import STOP_WORDS, means_stop

STOPS = [
    "stop", "STOP", " stop", "stop.", "stop;", "stop!!", "sto", "Sto", "stopp", "stop '", '"stop', "stop now", "halt",
    "hal", "Halt!", "'stop'", "/stop", "stop\xfc", "st\x00op", "\x1bstop", "\x1b[Astop", "\x00stop", "stop\x1b",
    "\udcffstop", "stop\ud800", "\ufffdstop", "\tstop", "stop\r", "stop,go home", "stop#",
    "status\nstop", "status # x\r\nstop", "status\rstop\rresume",
]  # fmt: skip
OTHERS = [
    "",
    "st",
    "ha",
    "status",
    "step on",
    "hand open",
    "help stop",
    "go stop",
    "# stop",
    "teach stop",
    "holding no",
]


@pytest.mark.parametrize("text", STOPS)
def test_a_stop_is_a_stop_however_it_is_written(text: str) -> None:
    assert means_stop(text)


@pytest.mark.parametrize("text", OTHERS)
def test_what_is_no_beginning_of_a_stop_is_none(text: str) -> None:
    assert not means_stop(text)


def test_no_other_command_begins_as_a_stop_does() -> None:
    names = [command.name for command in every_command("simulated") if command.name != "stop"]
    assert [name for name in names if means_stop(name)] == []
    assert [name for name in names if any(name.startswith(word[:3]) for word in STOP_WORDS)] == []


ODD = st.characters(exclude_categories=["L", "N", "P", "S", "Z"])


@given(parts=st.lists(st.text(ODD, max_size=3), min_size=5, max_size=5))
def test_whatever_cannot_be_shown_stands_between_its_letters_it_is_a_stop(parts: list[str]) -> None:
    assert means_stop("".join(odd + letter for odd, letter in zip(parts, "stop ", strict=True)))
