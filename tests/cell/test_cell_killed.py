"""kill -9 of the whole daemon amid its work: nothing lost, nothing corrupt, nothing moves until `resume`."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.bench.long.kill import harm
from tests.fakes.sentry import Sentry

pytestmark = pytest.mark.long


KILLS = int(os.environ.get("FACETD_KILLS", "4"))


@pytest.fixture
def daemon() -> Iterator[Sentry]:
    folder = Path(tempfile.mkdtemp(prefix="facetd-kill-"))
    daemon = Sentry(folder)
    yield daemon
    daemon.kill()
    assert daemon.judged() == []
    shutil.rmtree(folder, ignore_errors=True)


@pytest.mark.timeout(300)
def test_killed_at_random_moments_it_loses_no_line_corrupts_no_file_and_moves_nothing_unasked(daemon: Sentry) -> None:
    daemon.start()
    daemon.do("teach cube")
    daemon.do("train")
    daemon.do("enable")
    table = harm(daemon, KILLS, 21, ["picking", "reload, bundle, CAL, hand", "teaching, training", "starting"])
    for name, found in table.items():
        assert found.well, (name, found)
        assert found.asked == found.in_cycle
    assert sum(found.kills for found in table.values()) == KILLS
