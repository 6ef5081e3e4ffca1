"""What the tests of many cells share: cells with finished runs, an empty store."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from daemon.fleet.store import Store, open_store
from tests.fakes.made_run import MadeRun, quiet

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
