"""kill -9 of the daemon while the controller goes on: what it was left with is cancelled, nothing moves unasked."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.simcell.world import PartPlace
from tests.fakes.chosen import few
from tests.fakes.outlive import ACTS, Beside, Ways, harm

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", few(["typing, lines not cancelled", "moving, prompt at the end"], 1))
def test_it_comes_back_to_a_controller_that_went_on_and_knows_where_the_arm_is(name: str) -> None:
    (found,) = harm(1, 5, [name]).values()
    assert found.kills == 1
    assert found.met[str(ACTS[name][2].at)] == 1
    assert found.well, found


@pytest.fixture
def daemon() -> Iterator[Beside]:
    folder = Path(tempfile.mkdtemp(prefix="facetd-kill-"))
    daemon = Beside(folder, Ways(time_scale=8.0, at="a part held"))
    yield daemon
    assert daemon.judged() == []
    daemon.close()
    shutil.rmtree(folder, ignore_errors=True)


@pytest.mark.long
def test_an_auto_of_two_killed_with_the_first_part_in_the_gripper_brings_two(daemon: Beside) -> None:
    daemon.start()
    daemon.teach([("cube", 3)])
    daemon.cell.scatter(["cube"] * 3)
    daemon.do("auto on 2")
    daemon.await_moment()
    daemon.kill()
    daemon.start()
    assert "with 2 parts still to pick" in daemon.do("status")["text"]
    before = daemon.joints_deg()
    assert daemon.do("auto resume")["status"] == 1
    assert "`auto resume` continues it" in daemon.do("resume")["text"]
    for text in ("holding yes", "auto resume"):
        daemon.do(text)
    assert daemon.joints_deg() == before
    daemon.do("enable")
    assert daemon.do("auto resume")["status"] == 0
    daemon.do("auto wait")
    assert sum(part.where is PartPlace.BIN for part in daemon.cell.world.parts) == 2
    assert daemon.do("status")["data"]["left"] is None
