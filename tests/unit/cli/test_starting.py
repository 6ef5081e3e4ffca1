"""How long a start is waited for: as long as it gets on, and what is reported where it does not."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from daemon.cell import sections
from daemon.cli import demo
from daemon.cli.starting import StartError, listener, wait_until_ready
from daemon.config import load_config
from drivers.val2.dialect import Dialect

REPORT = """
import os, socket, sys, time
reports = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
reports.connect(sys.argv[1])
say = lambda *lines: reports.send("\\n".join(lines).encode())
def work(seconds):
    ends = time.monotonic() + seconds
    while time.monotonic() < ends: pass
"""
FOREVER = "time.sleep(600)"


@pytest.fixture
def folder() -> Iterator[Path]:
    """With a short path, as a socket lies in it."""
    with tempfile.TemporaryDirectory(prefix="facetd-") as made:
        yield Path(made)


def started(folder: Path, script: str, stalled_s: float = 60.0, patience_s: float = 60.0) -> list[str]:
    """What the person who waits is told."""
    said: list[str] = []
    with listener(folder) as reports:
        process = subprocess.Popen([sys.executable, "-c", REPORT + script, str(folder / "notify")])
        try:
            wait_until_ready(process, reports, said.append, stalled_s, patience_s)
        finally:
            process.kill()
            process.wait()
    return said


def test_a_daemon_that_reports_ready_ends_the_wait(folder: Path) -> None:
    assert started(folder, f"say('READY=1', 'STATUS=idle'); {FOREVER}") == []


def test_a_daemon_that_ended_is_reported_at_once_with_its_stage(folder: Path) -> None:
    with pytest.raises(StartError, match="ended with status 3 while it started, at: "):
        started(folder, "say('STATUS=opening'); sys.exit(3)")


def test_a_daemon_that_does_not_get_on_is_a_time_out_with_how_long_and_at_what(folder: Path) -> None:
    with pytest.raises(StartError, match=r"time-out: .* not ready after \d+ s, the last 1 s .* it was at: opening$"):
        started(folder, f"say('STATUS=opening'); {FOREVER}", stalled_s=1.0)


def test_new_stages_extend_the_wait_beyond_what_one_of_them_may_take(folder: Path) -> None:
    stages = f"for stage in range(5):\n    say(f'STATUS={{stage}}'); time.sleep(1.0)\nsay('READY=1'); {FOREVER}"
    assert started(folder, stages, stalled_s=4.0) == []


def test_computing_extends_the_wait_without_a_word(folder: Path) -> None:
    work = f"work(9.0)\nsay('READY=1'); {FOREVER}"
    assert started(folder, work, stalled_s=4.0) == []


def test_who_waits_long_is_told_each_stage_once(folder: Path) -> None:
    stages = f"for stage in 'ab':\n    say(f'STATUS={{stage}}'); time.sleep(1.0)\nsay('READY=1'); {FOREVER}"
    said = started(folder, stages, patience_s=0.0)
    assert [line.split(", ")[0].removeprefix("the daemon starts: ") for line in said][-2:] == ["a", "b"]
    assert len(said) == len({line.split(", ")[0] for line in said})


@pytest.mark.parametrize(("took", "scale"), [(0.0001, 20.0), (1.0, 20.0), (4.0, 5.0), (1000.0, 1.0)])
def test_the_cell_of_the_demo_is_slower_on_a_slow_computer(took: float, scale: float) -> None:
    times = iter([0.0, took * demo.STEPS_S])
    assert demo._time_scale(lambda: next(times)) == scale


def test_a_daemon_is_listened_for_in_one_folder_time_and_again(tmp_path: Path) -> None:
    for _ in range(2):
        with listener(tmp_path):
            pass
    assert list(tmp_path.iterdir()) == []


def test_the_demo_waits_long_for_a_controller_that_always_answers(tmp_path: Path) -> None:
    """On an emulated computer that others used as well, closing the gripper took longer than 5 s: a fault."""
    arguments = argparse.Namespace(time_scale=1.0, fixed=False, table="plain", parts="plain")
    made = demo._configuration(arguments, 1, tmp_path / "runs", str(tmp_path))
    (tmp_path / "facetd.yaml").write_text(json.dumps(made))
    dialect = sections.dialect(load_config(tmp_path / "facetd.yaml"))
    assert min(dialect.answer_s, dialect.typing_s) >= 12 * Dialect().answer_s
