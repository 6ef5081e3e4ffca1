"""`facetctl dashboard` where it cannot serve."""

from __future__ import annotations

import sys

import pytest

from daemon import ctl
from daemon.store import folders


def test_without_its_libraries_it_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    assert ctl.main(["dashboard"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert folders.how_to_add("dashboard") in error
