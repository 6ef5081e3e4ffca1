"""What is read at a terminal fits it, is broken between words, and runs on as far as the line goes."""

from __future__ import annotations

import itertools

import pytest

from daemon.commands import every_command
from daemon.console.text_layout import COLUMN, prose


@pytest.mark.parametrize("columns", [40, 80, 120])
def test_what_help_says_of_a_command_fits_the_terminal_and_no_line_ends_early(columns: int) -> None:
    for command in every_command("simulated"):
        lines = command.described(columns).splitlines()
        assert max(map(len, lines)) <= columns
        told = [line for line in command.details.splitlines() if line.strip()]
        if any(COLUMN.match(line) for line in told):
            continue
        below = [line for line in lines if line.startswith("  ")][1:]
        said = below[len(below) - len(prose(command.details, columns)) :] if told else []
        for line, after in itertools.pairwise(said):
            assert len(f"{line} {after.split()[0]}") > columns, f"{command.name}: {line}"


def test_what_stands_in_a_column_of_its_own_stays_there() -> None:
    text = "left   the one that stands on the left\nright  the other\nTwo lines\nthat are one."
    assert prose(text, 60) == [
        "  left   the one that stands on the left", "  right  the other", "  Two lines that are one."
    ]  # fmt: skip
    assert prose(text, 24)[:3] == ["  left   the one that", "    stands on the left", "  right  the other"]
