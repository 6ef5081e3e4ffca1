"""What the tests of the review share: a run to be written."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fakes.made_run import MadeRun


@pytest.fixture
def made(tmp_path: Path) -> MadeRun:
    return MadeRun(tmp_path / "runs" / "20260102T030405Z")
