"""What the tests of many cells share: cells with finished runs, an empty store."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from daemon.hall.store import Store, open_store
from tests.worlds.made_run import MadeRun

for needed in ("pyarrow", "fsspec", "duckdb"):
    pytest.importorskip(needed, reason=f"{needed} is not installed: make extra-fleet")

CellMaker = Callable[..., Path]


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return open_store(str(tmp_path / "store"))


@pytest.fixture
def cell(tmp_path: Path) -> CellMaker:
    """Writes a cell's runs, an hour old; gives its folder of runs."""

    def made(name: str, *days: str, outcome: str = "picked", label: str = "cube") -> Path:
        runs = tmp_path / "cells" / name
        for day in days or ("20260102",):
            run = MadeRun(runs / f"{day}T030405Z")
            run.pick()
            run.pick(outcome, label=label)
            run.close()
            quiet(runs)
        return runs

    return made


def quiet(runs: Path) -> None:
    """Nothing in these runs was written within the last hour."""
    for file in runs.rglob("*"):
        if file.is_file():
            then = file.stat().st_mtime - 3600
            os.utime(file, (then, then))
