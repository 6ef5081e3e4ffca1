"""A planted day is counted the same everywhere, by expectations made by hand.

Two runs: the first, at the cell's own pace, has fourteen picks, two stops by a person, a miss, a camera's fault, an
empty table, a part that was put down, teaching and jogging between autos, and ends in a kill in mid-pick. The second,
after the restart, runs at another pace: seven picks, a stop, a miss; somebody refuses the way home of the last pick.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from daemon.ctl import main
from daemon.events.outcomes import Outcome
from daemon.events.upgrade import VERSION
from daemon.review.brief import read_brief
from daemon.review.page import read_digest
from daemon.review.pagedata import page_data
from daemon.review.production import production
from daemon.review.week import week_data
from tests.fakes.fake_cell import cycle_of, one_part
from tests.fakes.made_run import MadeRun, quiet

BY_HAND = [
    {"picked": 14, "tried": 16, "released": 0, "aborted": 2, "interrupted": 1, "interventions": 4},
    {"picked": 7, "tried": 8, "released": 0, "aborted": 1, "interrupted": 0, "interventions": 3},
]
"""Interventions: of the first run, a pause, two stops and the fault that somebody had to clear; of the second, the
restart in mid-pick, a stop, and the refused way home."""
STOPS = {
    "operator's stop": 3,
    "gripper does not open or close": 2,
    "camera not connected": 1,
    "interrupted by a crash or power cut": 1,
    "operator refused a move": 1,
}
"""The causes: of each stop, miss, fault and of the kill, once."""


def command(made: MadeRun, *texts: str) -> None:
    for text in texts:
        made.write("command", who="ann", door="console", text=text)


def auto(made: MadeRun, on: bool) -> None:
    command(made, "auto on" if on else "auto off")
    made.write("auto", on=on, count=None, every_s=None)


def stopped(made: MadeRun, outcome: str, text: str, code: str) -> None:
    """A pick that a fault ends, and the person who clears it."""
    made.cycle += 1
    made.write("cycle_start", cycle=made.cycle, target=None)
    made.write("state", cycle=made.cycle, event="begin", to="survey", **{"from": "idle"})
    made.write("fault", cycle=made.cycle, code=code, text=text, **{"while": "auto"})
    made.write("state", cycle=made.cycle, event="stop", to="fault", **{"from": "survey"})
    made.write("cycle_end", cycle=made.cycle, outcome=outcome, label="cube", stops=0, why=text,
               predicted={"mm": 1.6, "deg": 0.2})  # fmt: skip
    command(made, "stop", "holding no", "resume")
    made.write("state", cycle=made.cycle, event="resume", to="idle", **{"from": "fault"})


@pytest.fixture(params=[1, VERSION])
def day(request: Any, tmp_path: Path) -> list[Path]:
    """The day's run folders, as an earlier release wrote them and as this one does."""
    by_person = "fault" if request.param == 1 else "aborted"

    def person_stops(made: MadeRun) -> None:
        stopped(made, by_person, "stopped by ann", "stopped by ann" if request.param == 1 else "operator_stop")

    first = MadeRun(tmp_path / "runs" / "20260102T060000Z", pictures=False, limits={"grasp_mm": 1.0})
    command(first, "teach cube", "train", "accept", "jog x 10")
    auto(first, True)
    for _ in range(8):
        first.pick()
    command(first, "pause")
    first.pick()
    person_stops(first)
    command(first, "jog z 10", "look", "teach pyramid")
    auto(first, True)
    first.pick("missed", why="cube still lies there")
    person_stops(first)
    auto(first, True)
    for _ in range(5):
        first.pick()
    stopped(first, "fault", "CameraError: left camera is gone", "CameraError" if request.param == 1 else "camera_lost")
    auto(first, True)
    first.pick("placed", why="put down what was in the hand")
    first.pick("empty", why="nothing on the table that can be picked")
    auto(first, False)
    command(first, "calibrate verify", "go home")
    first.cycle += 1
    first.write("cycle_start", cycle=first.cycle, target="cube")
    runs = [first.cut(request.param)]

    second = MadeRun(tmp_path / "runs" / "20260102T120000Z", pictures=False, times_life=20.0, limits={"grasp_mm": 1.0})
    second.write("left", run=first.folder.name, cycle=first.cycle, state="survey", hand_closed=False, auto=None)
    command(second, "resume")
    second.write("state", cycle=0, event="resume", to="idle", **{"from": "fault"})
    auto(second, True)
    for _ in range(6):
        second.pick()
    person_stops(second)
    second.pick("missed", why="cube still lies there")
    auto(second, True)
    second.pick(stopped="operator_no", why="gone from where it lay; then the operator refused: home")
    runs.append(second.close(request.param))
    quiet(tmp_path)
    return runs


def counted(done: Any) -> Any:
    return {name: done[name] for name in BY_HAND[0]}


def test_the_day_on_the_pages_of_its_runs_and_of_the_week(day: list[Path]) -> None:
    digests = [read_digest(folder) for folder in day]
    assert [counted(page_data(run)["production"]) for run in digests] == BY_HAND
    assert [counted(production([read_brief(folder)])) for folder in day] == BY_HAND
    week = week_data([read_brief(folder) for folder in day], ["", ""])["production"]
    assert counted(week) == {name: sum(run[name] for run in BY_HAND) for name in BY_HAND[0]}
    assert week["stops"] == STOPS
    assert week["paces"] == [1.0, 20.0]
    assert week["median_s"] == production(digests[:1])["median_s"], "times are those at the cell's own pace"


def test_no_limit_is_said_to_be_passed_by_a_pick_that_was_stopped(day: list[Path]) -> None:
    strips = [strip for folder in day for strip in page_data(read_digest(folder))["strips"]]
    assert not [strip["name"] for strip in strips if strip["near"] == 2]


def test_the_day_in_the_table_of_runs(day: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["runs", "--runs", str(day[0].parent), "--json"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    for row, by_hand in zip(rows, BY_HAND, strict=True):
        assert {name: row[name] for name in ("picked", "tried", "aborted")} == {
            name: by_hand[name] for name in ("picked", "tried", "aborted")
        }
    assert main(["runs", "--runs", str(day[0].parent)]) == 0
    assert "14 of 16" in capsys.readouterr().out


def test_the_day_as_status_and_metrics_count_it(day: list[Path]) -> None:
    cycle = cycle_of(one_part())
    for folder in day:
        cycle.tally.update(Outcome(c.outcome) for c in read_digest(folder).cycles if c.end is not None)
    status = cycle.status()
    assert (status["picked"], status["tried"], status["failed"], status["aborted"]) == (21, 24, 3, 3)


def test_the_day_in_the_table_of_many_cells(day: list[Path], tmp_path: Path) -> None:
    pytest.importorskip("duckdb", reason="duckdb is not installed: make extra-fleet")
    from daemon.fleet.collect import collect, source_of
    from daemon.fleet.page import fleet_data
    from daemon.fleet.store import open_store
    from daemon.fleet.views import open_views

    store = open_store(str(tmp_path / "store"))
    collect(store, [source_of(f"north={day[0].parent}")])
    asked = "SELECT count(*) FILTER (outcome = 'picked'), count(*) FROM cycles WHERE tried"
    assert open_views(store).execute(asked).fetchall() == [(21, 24)]
    assert open_views(store).execute("SELECT sum(interventions) FROM runs").fetchall() == [(7,)]
    (north,) = fleet_data(store, 7)["cells"]
    assert (north["picked"], north["tried"], north["interventions"]) == (21, 24, 7)
    assert north["faults"] == {"camera not connected": 1}, "a person's stop is no fault that needs somebody"


def test_a_run_that_is_being_written_is_shown_as_running(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = MadeRun(tmp_path / "runs" / "20260103T060000Z", pictures=False)
    made.pick()
    made.log.settle()
    try:
        main(["runs", "--runs", str(tmp_path / "runs")])
        assert capsys.readouterr().out.split()[-1] == "running"
    finally:
        made.close()
    main(["runs", "--runs", str(tmp_path / "runs")])
    assert capsys.readouterr().out.split()[-1] == "yes"
