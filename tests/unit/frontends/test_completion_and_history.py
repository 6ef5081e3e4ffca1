"""The prompt's history: as a shell keeps it, cut where it is long, and never in anybody's way."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

pytest.importorskip("prompt_toolkit")

from daemon.frontends.client import files_begun
from daemon.frontends.console_prompt import HISTORY_LINES, CommandHistory


def test_commands_come_back_the_newest_first_and_a_long_file_is_cut(tmp_path: Path) -> None:
    history = CommandHistory(tmp_path / "state" / "history")
    for text in ("status", "pick cube"):
        history.store_string(text)
    assert list(history.load_history_strings()) == ["pick cube", "status"]
    (tmp_path / "state" / "history").write_text("".join(f"{k}\n" for k in range(2 * HISTORY_LINES + 1)))
    assert len(list(history.load_history_strings())) == HISTORY_LINES
    assert len((tmp_path / "state" / "history").read_text().splitlines()) == HISTORY_LINES


@pytest.mark.timeout(20)
def test_a_fifo_in_its_place_does_not_hold_up_the_prompt(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "history")
    history = CommandHistory(tmp_path / "history")
    history.store_string("status")
    assert list(history.load_history_strings()) == []


def test_a_name_that_is_none_offers_no_file() -> None:
    assert files_begun("teach cube --mesh /a\0b/") == []
    assert files_begun("teach cube --mesh ~nobody-at-all/") == []
