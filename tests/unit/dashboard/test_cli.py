"""`facetctl dashboard` where it cannot serve."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from daemon import ctl
from daemon.dashboard.cli import PORT
from daemon.store import folders


def test_without_its_libraries_it_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    assert ctl.main(["dashboard"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert folders.how_to_add("dashboard") in error


@pytest.mark.parametrize("words", [["--socket", "x.sock", "dashboard"], ["dashboard", "--socket", "x.sock"]])
def test_the_socket_may_be_named_before_the_command_as_everywhere(
    monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    """It was not heard there, and the page said for ever that no daemon answers."""
    served: list[object] = []
    monkeypatch.setattr("daemon.dashboard.server.serve", lambda *given: served.extend(given))
    assert ctl.main(words) == 0
    assert served == [PORT, Path("x.sock")]
