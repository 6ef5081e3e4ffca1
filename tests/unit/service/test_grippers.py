"""`gripper use` in the whole daemon: what it changes at once, what it refuses, and what the next start knows."""

from __future__ import annotations

import json
import os
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from math import dist
from pathlib import Path

import pytest
import yaml

from daemon.store.runs import list_runs, read_run
from tests.fakes.daemon_process import Daemon
from tests.fakes.two_grippers import LIP_MM, two_grippers

pytestmark = pytest.mark.slow


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    short = Path(f"/tmp/facetd-test-{os.getpid()}-{tmp_path.name[-12:]}")
    shutil.rmtree(short, ignore_errors=True)
    short.mkdir()
    two_grippers(short)
    yield short
    shutil.rmtree(short, ignore_errors=True)


@contextmanager
def running(folder: Path) -> Iterator[Daemon]:
    daemon = Daemon(folder, None)
    try:
        daemon.hears("READY=1")
        yield daemon
    finally:
        daemon.close()


@pytest.fixture
def daemon(folder: Path) -> Iterator[Daemon]:
    with running(folder) as started:
        yield started


def done(daemon: Daemon, text: str) -> str:
    answer = daemon.do(text)
    assert answer["status"] == 0, answer
    return str(answer["text"])


def refused(daemon: Daemon, text: str) -> str:
    answer = daemon.do(text)
    assert answer["status"] != 0, answer
    return str(answer["text"])


def tool_mm(daemon: Daemon) -> list[float]:
    return [row[3] for row in daemon.do("where")["data"]["world_from_tool"][:3]]


def tool_on_line(daemon: Daemon) -> str:
    """TOOL as it was typed last to the controller."""
    run = list_runs(daemon.folder / "state" / "runs")[-1]
    lines = [json.loads(line) for line in (run / "wire.jsonl").read_text().splitlines()]
    typed = [str(line) for line in lines if "TOOL TRANS" in str(line)]
    return typed[-1]


def test_the_gripper_that_is_said_to_be_mounted_counts_at_once_and_after_a_restart(daemon: Daemon) -> None:
    assert "the mounted gripper is unknown" in refused(daemon, "enable")
    told = done(daemon, "gripper use fingers")
    assert "130.0 mm from the wrist centre" in told
    assert "What it holds is unknown" in told
    assert daemon.do("status")["data"]["gripper"] == "fingers"
    done(daemon, "holding no")
    done(daemon, "enable")
    before, wrong = tool_mm(daemon), tool_on_line(daemon)
    told = done(daemon, "gripper use cup")
    assert "The arm is disabled: the mounted gripper changed." in told
    assert "30.0 mm from where it was" in told
    assert "suction" in told
    status = daemon.do("status")["data"]
    assert not status["enabled"]
    assert status["holding"] is None
    after = tool_mm(daemon)
    assert dist(after, before) == pytest.approx(LIP_MM - 130.0, abs=0.05)
    assert tool_on_line(daemon) != wrong
    done(daemon, "enable")
    assert "does not know whether the gripper holds a part" in refused(daemon, "pick")
    assert "cup is mounted already" in done(daemon, "gripper use cup")
    daemon.process.kill()
    daemon.process.wait()
    with running(daemon.folder) as again:
        assert again.do("status")["data"]["gripper"] == "cup"
        assert "gripper   cup" in done(again, "status")
        assert tool_mm(again) == pytest.approx(after, abs=0.05)
    runs = [read_run(run).records for run in list_runs(daemon.folder / "state" / "runs")]
    starts = [record for records in runs for record in records if record["kind"] == "run_start"]
    assert [start["gripper"] for start in starts] == [None, "fingers", "cup", "cup"]


def test_it_is_refused_with_a_part_in_the_gripper_while_something_is_done_and_for_what_is_not_known(
    daemon: Daemon,
) -> None:
    done(daemon, "gripper use fingers")
    done(daemon, "holding yes")
    assert "a part is in the gripper" in refused(daemon, "gripper use cup")
    done(daemon, "holding no")
    assert "hook: no such gripper; choose from: cup, fingers" in refused(daemon, "gripper use hook")
    done(daemon, "enable")
    done(daemon, "pause")
    job = threading.Thread(target=daemon.do, args=("go home",))
    job.start()
    while daemon.do("status")["data"]["doing"] is None:
        pass
    assert "busy: home; the gripper is changed only when that has ended" in refused(daemon, "gripper use cup")
    done(daemon, "stop")
    job.join()
    assert daemon.do("status")["data"]["gripper"] == "fingers"


def test_a_change_that_cannot_be_taken_over_changes_nothing(daemon: Daemon) -> None:
    done(daemon, "gripper use fingers")
    good = daemon.config.read_text()
    values = yaml.safe_load(good)
    values["pick"]["limits"]["table_z_mm"] = 4000
    daemon.config.write_text(yaml.safe_dump(values, sort_keys=False))
    assert "table_z_mm" in refused(daemon, "gripper use cup")
    assert json.loads((daemon.folder / "state" / "gripper.json").read_text())["name"] == "fingers"
    daemon.config.write_text(good)
    assert daemon.do("gripper")["data"]["gripper"] == "fingers"
