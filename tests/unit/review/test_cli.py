"""`facetctl runs`, `tail` and comparison: tables of runs for a terminal."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from daemon import ctl
from tests.worlds.made_run import MadeRun


def test_runs_are_tabled_and_laid_side_by_side(
    made: MadeRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made.pick()
    made.close()
    other = MadeRun(tmp_path / "runs" / "20260103T030405Z")
    other.pick("missed")
    other.close()
    runs = ["--runs", str(tmp_path / "runs")]
    assert ctl.main(["runs", *runs]) == 0
    table = capsys.readouterr().out.splitlines()
    assert [line.split()[:5] for line in table[1:]] == [
        ["20260102T030405Z", "1", "of", "1", "0"],
        ["20260103T030405Z", "0", "of", "1", "1"],
    ]
    page = tmp_path / "page.html"
    assert ctl.main(["review", *runs, "--out", str(page), "--against", "20260102T030405Z"]) == 0
    data = json.loads(page.read_text().split('id="data">')[1].split("</script>")[0].replace("<\\/", "</"))
    share = data["against"]["rows"][0]
    assert (share["before"], share["now"], share["delta"]) == ([1, 1], [0, 1], -100.0)
    assert data["before"]["last"]["picked"] == 1
    assert [d["same"] for d in data["against"]["differences"]] == [True, True, False]


def test_a_week_of_runs_is_one_page_and_each_point_leads_to_its_run(tmp_path: Path, browser: Any) -> None:
    runs = tmp_path / "runs"
    for day, outcome in ((1, "picked"), (9, "picked"), (10, "missed"), (12, "picked")):
        made = MadeRun(runs / f"202601{day:02d}T030405Z")
        made.pick(outcome, why="cube still lies there")
        made.pick(label="pyramid")
        made.close()
    assert ctl.main(["review", "--week", "--runs", str(runs)]) == 0
    browser.get((runs / "week.html").as_uri())
    assert browser.find_element("id", "verdict").text == "5 of 6 picked in 3 runs. Stopped by: part slipped."
    assert "Success by part" in browser.find_element("id", "trends").text
    browser.find_elements("css selector", "#trends svg circle.leads")[1].click()
    assert browser.find_element("id", "verdict").text.startswith("1 of 2 picked")
    assert browser.get_log("browser") == []


def test_an_unknown_run_is_one_line_and_status_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("review", "replay", "tail"):
        assert ctl.main([command, "--runs", str(tmp_path), "nosuch"]) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert "nosuch: no such run" in said


def test_tail_tells_a_run_line_by_line(made: MadeRun, capsys: pytest.CaptureFixture[str]) -> None:
    made.write("look", stop=0, purpose="calibrate pose 1")
    made.pick()
    made.close()
    assert ctl.main(["tail", "--runs", str(made.folder.parent)]) == 0
    told = capsys.readouterr().out
    assert "calibrate pose 1: pictures only" in told, "a board is seen there: not `nothing`"
    assert "approach: cube 98 %" in told
    assert "picked: gone from where it lay" in told
    assert "\x1b[" not in told


def test_what_a_run_holds_steers_no_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Neither its words nor its name, whoever chose it."""
    runs = tmp_path / "runs"
    for name in ("20260101T000000Z", "a\x1b]0;title\x07"):
        made = MadeRun(runs / name, pictures=False)
        made.pick("missed", label="cube\x1b[2J")
        made.write("fault", code="x", text="a\x1b]0;title\x07\nSTOPPING=1", **{"while": "moving"})
        made.close()
    for words in (["tail", "--once", "latest"], ["tail", "--once", "a\x1b]0;title\x07"], ["runs"], ["tail", "\x1b[2J"]):
        ctl.main([*words, "--runs", str(runs)])
        told = "".join(capsys.readouterr())
        assert "\x1b" not in told
        assert "\x07" not in told
        assert "\nSTOPPING=1" not in told
        assert told


def test_a_run_whose_name_is_no_utf_8_is_read_as_any_other(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = os.fsdecode(b"bad\xff")
    made = MadeRun(tmp_path / name)
    made.pick()
    made.close()
    for words in (["review", name], ["export", "--csv", name], ["tail", "--once", name], ["runs"]):
        assert ctl.main([*words, "--runs", str(tmp_path)]) == 0
        assert "bad?" in capsys.readouterr().out or words[0] == "tail"
    assert "bad?" in (tmp_path / name / "report.html").read_text()
