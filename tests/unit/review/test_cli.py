"""`facetctl runs`, `tail` and comparison: tables of runs for a terminal."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from daemon import ctl
from daemon.review.page import read_digest
from tests.fakes.made_run import MadeRun
from tests.fakes.waiting import until


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
    assert browser.find_element("id", "verdict").text == "5 of 6 picked in 3 runs. Causes of stops: part slipped."
    assert "Success by part" in browser.find_element("id", "trends").text
    browser.find_elements("css selector", "#trends svg circle.leads")[1].click()
    until(lambda: browser.find_element("id", "verdict").text.startswith("1 of 2 picked"))
    assert browser.get_log("browser") == []


def test_who_may_only_read_a_run_gets_its_page_into_their_own_folder(
    made: MadeRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Members of the group facetd, in the service's folder."""
    made.pick()
    made.close()
    runs = ["--runs", str(made.folder.parent)]
    assert ctl.main(["review", *runs]) == 0
    assert capsys.readouterr().out == f"{made.folder / 'report.html'}\n"
    (tmp_path / "mine").mkdir()
    monkeypatch.chdir(tmp_path / "mine")
    monkeypatch.setattr("os.access", lambda path, mode: made.folder.parent not in (path, *Path(path).parents))
    for words in (["review"], ["review", "--week"], ["export", "--csv"]):
        assert ctl.main([*words, *runs]) == 0
    assert {path.name for path in Path().iterdir()} == {"report.html", "week.html", "cycles.csv", "looks.csv"}


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


def test_how_many_runs_or_days_is_a_number_from_one_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """None of the last runs were all of them; days beyond all calendars were a traceback, and none an empty store."""
    for day in (1, 2, 3):
        MadeRun(tmp_path / f"2026010{day}T030405Z", pictures=False).close()
    assert ctl.main(["runs", "--runs", str(tmp_path), "--last", "2"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 3
    for words in (["runs", "--last", "0"], ["fleet", "STORE", "--days", "0"], ["fleet", "STORE", "--days", "1000000"]):
        with pytest.raises(SystemExit):
            ctl.main(words)
        assert "expected 1 to 9999" in capsys.readouterr().err


def test_the_table_of_runs_is_what_a_whole_reading_says(made: MadeRun, capsys: pytest.CaptureFixture[str]) -> None:
    made.pick()
    made.write("truth", cycle=made.cycle, error_mm=0.4, error_deg=0.1, held=True)
    made.write("model", action="accept", version=3, file="kept/22222222aa.npz")
    made.pick("missed")
    made.write("fault", code="link", text="the cable", cycle=None, **{"while": "idle"})
    run = made.close()
    assert ctl.main(["runs", "--runs", str(run.parent), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == read_digest(run).statistics()


@pytest.mark.timeout(20)
def test_tail_of_a_run_that_was_cut_off_ends_with_it(made: MadeRun, capsys: pytest.CaptureFixture[str]) -> None:
    """Nobody writes it any more: whoever looked on waited for ever."""
    made.pick()
    run = made.close()
    lines = (run / "run.jsonl").read_bytes().splitlines(keepends=True)
    (run / "run.jsonl").write_bytes(b"".join(lines[:-1]))
    assert ctl.main(["tail", "--runs", str(run.parent)]) == 0
    assert "picked: gone from where it lay" in capsys.readouterr().out
