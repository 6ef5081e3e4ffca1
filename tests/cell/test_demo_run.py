"""The demo as a newcomer runs it, and its run as a production engineer reviews it: page, replay, export."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

from daemon.cli import demo as job
from daemon.ctl import main as facetctl
from daemon.store.recovery_state import FILE, read_interrupted_state
from tests.fakes.once import made_once
from tests.fakes.waiting import PATIENCE_S

AT_MOST_S = 900.0
"""How long the demo takes on a slow and busy computer."""
SEED = 106
"""Any will do; this one is known to pick every part."""
MOST_BYTES_A_PICK = 4_000_000
pytestmark = [pytest.mark.slow, pytest.mark.timeout(AT_MOST_S)]


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """What the demo printed, and its run folder."""

    def shown(folder: Path) -> None:
        command = [sys.executable, "-m", "daemon.ctl", "demo", "--seed", str(SEED), "--runs", str(folder / "runs")]
        done = subprocess.run(command, capture_output=True, text=True, timeout=AT_MOST_S, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        (folder / "said").write_text(done.stdout)

    folder = made_once(tmp_path_factory, "demo", shown)
    (run,) = [each for each in (folder / "runs").iterdir() if each.is_dir()]
    return (folder / "said").read_text(), run


@pytest.mark.long
def test_it_picks_every_part_and_says_how_sure_it_was_and_how_far_off(demo: tuple[str, Path]) -> None:
    said, run = demo
    assert f"seed {SEED}" in said
    assert "the cell's motion monitor found no forbidden motion" in said
    records = [json.loads(line) for line in (run / "run.jsonl").read_text().splitlines()]
    picked = {r["label"] for r in records if r["kind"] == "cycle_end" and r["outcome"] == "picked"}
    assert picked == {"cube", "pyramid", "triangular_prism", "pentagonal_prism"}
    truths = [r for r in records if r["kind"] == "truth" and r["held"]]
    assert len(truths) == 8, "four to the bin, four to their nests"
    assert all(r["error_mm"] < 3.0 for r in truths)
    written = sum(file.stat().st_size for file in run.rglob("*") if file.is_file())
    assert written < 8 * MOST_BYTES_A_PICK, "an SD card is worn by it"


@pytest.mark.long
def test_it_ends_with_four_parts_in_four_nests_each_turned_as_drawn(demo: tuple[str, Path]) -> None:
    said, run = demo
    assert "kit: 4 of 4 parts seen right in their nests" in said
    records = [json.loads(line) for line in (run / "run.jsonl").read_text().splitlines()]
    set_down = [r for r in records if r["kind"] == "truth" and r["place_mm"] is not None]
    assert len(set_down) == 4
    assert all(r["place_mm"] < 1.0 and r["place_deg"] < 1.0 for r in set_down)


@pytest.mark.long
def test_a_demo_after_another_finds_nothing_standing(demo: tuple[str, Path], tmp_path: Path) -> None:
    """Its daemon has a state of its own, and the runs of all demos beside it."""
    runs, args = tmp_path / "runs", argparse.Namespace(table="plain", parts="plain", time_scale=20.0, fixed=False)
    shutil.copytree(demo[1], runs / demo[1].name)
    with tempfile.TemporaryDirectory() as folder:
        configuration = job._configuration(args, SEED, runs, folder)
        with job._daemon(Path(folder), configuration) as (_, link):
            assert link.do("status", "demo", lambda _: None)["data"]["fault"] is None
            job._do(link, "enable")
            job._do(link, "go survey")


def test_what_its_daemon_refuses_is_one_line_and_status_two(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert facetctl(["demo", "--time-scale", "0", "--runs", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "simulated.time_scale: expected" in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_control_c_ends_it_with_its_daemon_and_leaves_a_whole_run_and_nothing_to_doubt(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "daemon.ctl", "demo", "--seed", "3"]
    own = {**os.environ, "STATE_DIRECTORY": str(tmp_path), "FACETD_RUNS": str(tmp_path / "runs")}
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True, env=own
    )
    assert process.stdout is not None
    while "teaching" not in process.stdout.readline():
        assert process.poll() is None
    os.killpg(process.pid, signal.SIGINT)
    _, error = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, error) == (1, "")
    (run,) = (tmp_path / "runs").iterdir()
    assert json.loads((run / "run.jsonl").read_text().splitlines()[-1])["kind"] == "run_end"
    assert read_interrupted_state(tmp_path / FILE, ran_before=True) is None, (
        "the newcomer's first daemon starts without a fault"
    )


@pytest.mark.long
def test_replayed_through_the_same_code_nothing_changes(
    demo: tuple[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    _, run = demo
    assert facetctl(["replay", str(run), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["looks"] > 20
    assert said["identical"] == said["looks"]


@pytest.mark.long
def test_its_mcap_is_read_back_by_the_mcap_reader(demo: tuple[str, Path], tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")
    _, run = demo
    out = tmp_path / "run.mcap"
    assert facetctl(["export", str(run), "--mcap", "--out", str(out)]) == 0
    with out.open("rb") as file:
        topics = {channel.topic for _, channel, _ in reader.make_reader(file).iter_messages()}
    assert any("left" in topic for topic in topics)
    assert any("log" in topic for topic in topics)


@pytest.mark.long
def test_its_page_is_clicked_through_in_a_browser(demo: tuple[str, Path], tmp_path: Path, browser: Any) -> None:
    _, run = demo
    page = tmp_path / "page.html"
    assert facetctl(["review", str(run), "--out", str(page)]) == 0
    browser.get(page.as_uri())
    assert browser.execute_script("return document.documentElement.dataset.ready") == "yes"
    rows = browser.find_elements("css selector", "#table tbody tr")
    browser.find_element("id", "search").send_keys("pyramid")
    found = browser.find_elements("css selector", "#table tbody tr")
    assert 0 < len(found) < len(rows)
    found[-1].click()
    cycle = browser.find_element("id", "cycle")
    before = cycle.find_element("css selector", "button[aria-pressed=true]").text
    browser.find_element("id", "next").click()
    assert cycle.find_element("css selector", "button[aria-pressed=true]").text != before
    assert len(cycle.find_elements("css selector", ".camera img")) == 2
    assert cycle.find_elements("css selector", ".camera polygon.facet")
    assert browser.get_log("browser") == []
