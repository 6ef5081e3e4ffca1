"""A hall of five simulated cells: recorded, collected, replayed by a scheduler and workers of their own, shown."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from daemon import ctl
from daemon.fleet.replay_many import ReplayJob, ReplayWith, jobs_of, replay_many, runs_in_store
from daemon.fleet.replay_results import TIMINGS
from daemon.fleet.store import Store, open_store
from daemon.store import folders
from daemon.store.model import load, save
from daemon.vision.model.model import relearnt
from tests.fakes.cells_recorded import record_pick
from tests.fakes.made_run import quiet
from tests.fakes.waiting import until

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]


@pytest.fixture(scope="module", autouse=True)
def extra() -> None:
    """Not while collecting: who runs none of these would import it all."""
    for needed in ("pyarrow", "fsspec", "duckdb", "distributed"):
        pytest.importorskip(needed, reason=f"{needed} is not installed: make extra-fleet")


CELLS = {
    "north": ["cube"],
    "south": ["pyramid"],
    "east": ["triangular_prism"],
    "west": ["cube", "pyramid"],
    "press": [],
}


@pytest.fixture(scope="module")
def hall(model: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of five cells' runs; one of `press` is damaged."""
    folder = tmp_path_factory.mktemp("hall")

    async def story() -> None:
        for number, (name, labels) in enumerate(CELLS.items()):
            run = folder / "cells" / name / f"2026010{number + 1}T030405Z"
            await record_pick(run, name, model, 30 + number, labels or ["cube"])

    asyncio.run(story())
    wire = folder / "cells" / "press" / "20260105T030405Z" / "wire.jsonl"
    lines = wire.read_bytes().splitlines(keepends=True)
    wire.write_bytes(b"".join(lines[:5] + lines[6:]))
    quiet(folder / "cells")
    return folder


@pytest.fixture(scope="module")
def store(hall: Path) -> Store:
    words = [f"{name}={hall}/cells/{name}" for name in CELLS]
    assert ctl.main(["runs", "collect", *words, "--into", str(hall / "store")]) == 1
    return open_store(str(hall / "store"))


def test_four_are_collected_and_the_damaged_one_is_told_of(store: Store) -> None:
    assert sorted(cell for cell, _ in store.collected()) == ["east", "north", "south", "west"]
    assert "entries are missing before it" in store.read("apart", "press", "20260105T030405Z.txt").decode()


def test_the_page_of_the_hall_opens_and_a_cell_in_it(store: Store, browser: Any, tmp_path: Path) -> None:
    assert ctl.main(["fleet", store.url, "--out", str(tmp_path / "fleet.html")]) == 0
    browser.get((tmp_path / "fleet.html").as_uri())
    assert browser.execute_script("return document.documentElement.dataset.ready") == "yes"
    cards = browser.find_elements("css selector", "#cells .cell")
    assert len(cards) == 4
    cards[0].click()
    assert cards[0].get_attribute("data-cell") in browser.find_element("id", "one").text
    assert len(browser.find_elements("css selector", "#miss tbody tr")) == 4
    assert browser.get_log("browser") == []


def bare(results: list[tuple[str, Any]]) -> list[Any]:
    """Results without what the clock says."""
    return [
        (cell, [{k: v for k, v in look.items() if k not in TIMINGS} for look in result["looks"]])
        for cell, result in results
    ]


def jobs(store: Store, out: Path, monkeypatch: pytest.MonkeyPatch, looks: int = 2) -> list[ReplayJob]:
    monkeypatch.setattr("daemon.fleet.replay_many.LOOKS_A_JOB", looks)
    return jobs_of(runs_in_store(store), ReplayWith(), str(out))


def process(*words: str) -> subprocess.Popen[str]:
    environment = os.environ | {"PYTHONPATH": str(folders.HOUSE), "DASK_LOGGING__DISTRIBUTED": "error"}
    return subprocess.Popen(
        [sys.executable, "-m", *words], env=environment, text=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )


@contextmanager
def cluster(tmp_path: Path, workers: int) -> Iterator[tuple[str, list[subprocess.Popen[str]]]]:
    """A scheduler and workers as processes of their own on the loopback: its address, and the workers."""
    told = tmp_path / "scheduler.json"
    running = [process("distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
                       "--no-show", "--scheduler-file", str(told))]  # fmt: skip
    try:
        until(lambda: told.exists() and told.read_text().strip(), "the scheduler")
        address = json.loads(told.read_text())["address"]
        for number in range(workers):
            running.append(process("distributed.cli.dask_worker", address, "--nthreads", "1", "--no-dashboard",
                                   "--no-nanny", "--local-directory", str(tmp_path / f"worker{number}")))  # fmt: skip
        yield address, running[1:]
    finally:
        for one in running:
            one.kill()
            one.wait()


def done(out: Path) -> int:
    return len(list((out / "done").glob("*.json"))) if (out / "done").is_dir() else 0


def test_results_are_the_same_from_one_process_and_from_two_workers_one_of_them_killed(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, failed = replay_many(jobs(store, tmp_path / "one", monkeypatch), 1, None)
    assert failed == []
    assert sum(len(result["looks"]) for _, result in one) > 12
    out = tmp_path / "two"
    with cluster(tmp_path, 2) as (address, workers):
        killed: list[int] = []

        def say(count: int, of: int) -> None:
            if count >= 2 and not killed:
                workers[0].send_signal(signal.SIGKILL)
                killed.append(count)

        two, failed = replay_many(jobs(store, out, monkeypatch), 0, address, say)
    assert killed
    assert killed[0] < len(two)
    assert failed == []
    assert bare(two) == bare(one)


CLIENT = """
import sys
from daemon.fleet import replay_many as r
from daemon.fleet.store import open_store
r.LOOKS_A_JOB = 2
jobs = r.jobs_of(r.runs_in_store(open_store(sys.argv[1])), r.ReplayWith(), sys.argv[2])
r.replay_many(jobs, 0, sys.argv[3])
"""


def test_a_client_that_is_lost_leaves_the_rest_going_on_and_another_takes_it_up(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    todo = jobs(store, out, monkeypatch)
    with cluster(tmp_path, 1) as (address, _):
        client = subprocess.Popen(
            [sys.executable, "-c", CLIENT, store.url, str(out), address],
            env=os.environ | {"PYTHONPATH": str(folders.HOUSE)},
        )
        until(lambda: done(out) > 0, "nothing was begun")
        client.kill()
        client.wait()
        at_loss = done(out)
        assert at_loss < len(todo)
        until(lambda: done(out) == len(todo), "the rest did not go on")
    before = {f: f.stat().st_mtime_ns for f in (out / "done").iterdir()}
    results, failed = replay_many(todo, 1, None)
    assert (len(results), failed) == (len(todo), [])
    assert {f: f.stat().st_mtime_ns for f in (out / "done").iterdir()} == before


def test_the_command_ends_in_a_report_with_pictures(
    store: Store, hall: Path, browser: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the model of a cell that never saw a cube, cubes are lost, and the page shows them."""
    model = load(hall / "cells" / "north.npz")
    others = tuple(view for view in model.views if view.label != "cube")
    metric = {label: one for label, one in model.metric.items() if label != "cube"}
    save(relearnt(replace(model, views=others, metric=metric)), tmp_path / "less.npz")
    words = [
        "replay",
        store.url,
        "--with",
        str(tmp_path / "less.npz"),
        "--workers",
        "2",
        "--out",
        str(tmp_path / "out"),
    ]
    assert ctl.main([*words, "--json"]) == 1
    said = json.loads(capsys.readouterr().out)
    assert said["failed"] == []
    assert said["by"]["part"]["cube"]["right"][0] > said["by"]["part"]["cube"]["right"][1]
    assert said["by"]["part"]["pyramid"]["right"][0] == said["by"]["part"]["pyramid"]["right"][1]
    assert {"north", "south", "east", "west"} == set(said["by"]["cell"])
    browser.get((tmp_path / "out" / "report.html").as_uri())
    assert browser.execute_script("return document.documentElement.dataset.ready") == "yes"
    browser.find_element("css selector", "#table tbody tr").click()
    assert len(browser.find_elements("css selector", "#shown .camera img")) == 4
    assert browser.get_log("browser") == []


def test_a_job_that_cannot_be_done_is_told_of_and_the_others_are(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    todo = jobs(store, tmp_path / "out", monkeypatch, 100)
    kept = Path(store.path("runs", todo[0].run.cell, todo[0].run.name, "kept"))
    kept.rename(kept.with_name("gone"))
    try:
        results, failed = replay_many(todo, 1, None)
    finally:
        kept.with_name("gone").rename(kept)
    assert len(results) == len(todo) - 1
    (line,) = failed
    assert line.startswith(f"{todo[0].run.cell}/{todo[0].run.name}: ")
    assert "cannot be read" in line
