"""What a production engineer asks first, of one run and of a week; two runs beside one another."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daemon import frames
from daemon.review.brief import read_brief
from daemon.review.digest import digest
from daemon.review.measures import strips
from daemon.review.page import read_digest
from daemon.review.pagedata import events
from daemon.review.production import compared, production, remedies
from tests.fakes.made_run import MadeRun, part


def test_picked_of_tried_stops_by_cause_and_interventions(made: MadeRun) -> None:
    made.pick()
    made.pick("missed", why="cube still lies there")
    made.write("command", who="ann", door="console", text="teach cube")
    made.write("auto", on=True, count=3, every_s=None)
    made.write("command", who="ann", door="console", text="auto on 3")
    made.write("command", who="ann", door="console", text="pause")
    made.pick("empty", why="nothing on the table")
    made.pick(label="pyramid")
    found = production([read_digest(made.close())])
    assert (found["tried"], found["picked"], found["interventions"]) == (3, 2, 1)
    assert found["parts"] == {"cube": [1, 2], "pyramid": [1, 1]}
    assert found["stops"] == {"gripper does not open or close": 1}
    assert found["median_s"] == pytest.approx(found["p95_s"])


@pytest.mark.parametrize("auto", [False, True])
@pytest.mark.parametrize("how", ["stop", "abort", "refuse", "a no at the question"])
def test_a_person_who_ends_a_pick_is_one_intervention_as_the_daemon_writes_it(
    made: MadeRun, how: str, auto: bool
) -> None:
    """Of a single pick none was counted: its end is written before the fault and the command of a stop."""
    if auto:
        made.write("auto", on=True, count=3, every_s=None)
    made.pick()
    if how == "refuse":
        made.cycle += 1
        made.write("cycle_start", cycle=made.cycle, target=None)
        made.write("command", who="ann", door="console", text="refuse")
        made.write("cycle_end", cycle=made.cycle, outcome="aborted", label="cube", stops=1, why="no", predicted=None)
    else:
        made.pick("aborted", why="stopped by ann")
    if how == "stop":
        made.write("fault", cycle=made.cycle, code="operator_stop", text="stopped by ann", **{"while": "pick"})
    if how in ("stop", "abort"):
        made.write("command", who="ann", door="console", text=how)
    if how == "stop":
        made.write("state", cycle=made.cycle, event="resume", to="idle", **{"from": "fault"})
        made.write("command", who="ann", door="console", text="resume")
    made.pick()
    assert production([read_digest(made.close())])["interventions"] == 1


def test_a_part_that_a_look_denied_and_that_went_to_the_bin_is_told_though_the_pick_went_on_to_another(
    made: MadeRun,
) -> None:
    """An `auto on 1` had put two parts into the bin, and the page said `1 of 1`."""
    made.cycle += 1
    made.write("cycle_start", cycle=made.cycle, target=None)
    elsewhere = part("cube", cyclopean_from_part=frames.rigid(np.eye(3), np.array([200.0, 0.0, 0.0])).tolist())
    made.look("survey 1", part("cube"), elsewhere)
    made.write("estimate", cycle=1, stop=1, label="cube", world_from_part=np.eye(4), covariance=np.eye(6),
               predicted_mm=0.6, predicted_deg=0.2, chi2=1.0)  # fmt: skip
    made.look("verify", part("cube"), stop=2)
    made.write("decision", cycle=1, text="missed", why="cube still lies there", code="still_there")
    made.write("move", cycle=1, how="joint", purpose="bin", target=None, speed_pct=100)
    made.write("hand", cycle=1, closed=False)
    made.look("survey 1", elsewhere)
    made.write("cycle_end", cycle=1, outcome="picked", label="cube", stops=2, why="cube is gone from where it lay",
               predicted=None)  # fmt: skip
    digest = read_digest(made.close())
    found = production([digest])
    assert (found["picked"], found["uncounted"], found["stops"]) == (1, 1, {})
    (told,) = [e["text"] for e in events(digest) if e["kind"] == "uncounted"]
    assert told.startswith("`cube still lies there`, but a later look at the table did not find it")
    assert "likely in the bin" in told


def test_what_ended_a_cycle_and_is_told_right_after_it_stopped_it_once(made: MadeRun) -> None:
    made.pick("aborted", why="stopped by ann", code="operator_stop")
    for number in (made.cycle, None):
        made.write("fault", cycle=number, code="operator_stop", text="stopped by ann", **{"while": ""})
    found = production([read_digest(made.close())])
    assert found["stops"] == {"operator's stop": 2}, "by the cycle and the one that was in none"
    assert list(remedies(found)) == ["operator's stop"]


def test_a_second_stop_while_the_first_ones_fault_stands_is_one_and_one_after_a_resume_is_another(
    made: MadeRun,
) -> None:
    """The page's title counted five stops, its list four; and of two stops with a resume between, the list had one."""
    made.pick()

    def fault(before: str) -> None:
        made.write("fault", cycle=made.cycle, code="operator_stop", text="stopped by ann", **{"while": ""})
        made.write("state", cycle=made.cycle, event="stop", to="fault", **{"from": before})

    fault("idle")
    fault("fault")
    made.write("state", cycle=made.cycle, event="resume", to="idle", **{"from": "fault"})
    fault("idle")
    run = read_digest(made.close())
    for reading in (run, read_brief(made.folder)):
        assert production([reading])["stops"] == {"operator's stop": 2}
    assert [event["kind"] for event in events(run)].count("fault") == 2


def test_a_brief_reading_says_the_same_of_a_run_as_a_whole_one(made: MadeRun) -> None:
    made.pick()
    made.pick("missed", why="cube still lies there", chi2=70.0)
    made.look("look", focus_left=2.0, findings={"focus left": "left: out of focus"})
    folder = made.close()
    assert production([read_brief(folder)]) == production([read_digest(folder)])
    assert strips(read_brief(folder)) == strips(read_digest(folder))


def test_a_prediction_of_a_pick_that_grasped_nothing_is_beyond_no_limit(made: MadeRun) -> None:
    """`Beyond its limit: error at the grasp, most 1.6, limit 1 mm`: the first look's prediction of a stopped pick."""
    made.write("run_start", limits={"grasp_mm": 0.65}, reloaded=True)
    made.pick("aborted", why="stopped by ann")
    assert not [s for s in strips(read_digest(made.close())) if s["name"] == "error at the grasp"]


def test_a_prediction_of_a_pick_that_grasped_is_held_against_the_limit(made: MadeRun) -> None:
    made.log.record("run_start", limits={"grasp_mm": 0.65}, reloaded=True)
    made.pick("missed", why="cube still lies there")
    made.write("cycle_start", cycle=2, target=None)
    made.write("hand", cycle=2, closed=True)
    made.write("cycle_end", cycle=2, outcome="fault", label="cube", why="NoAnswer: x", predicted={"mm": 0.9, "deg": 0})
    run = read_digest(made.close())
    (strip,) = [s for s in strips(digest(run.name, run.records[1:])) if s["name"] == "error at the grasp"]
    assert (strip["worst"], strip["lines"]["predicted"], strip["near"]) == (0.9, [0.7, 0.9], 2)


def test_times_of_a_run_at_another_pace_are_no_times_of_the_cell(tmp_path: Path) -> None:
    """`1347 picks an hour` of a cell simulated at 20 times the pace, beside a run at its own."""
    fast = MadeRun(tmp_path / "20260101T000000Z", pictures=False, times_life=20.0)
    fast.pick()
    plain = MadeRun(tmp_path / "20260102T000000Z", pictures=False, times_life=1.0)
    plain.pick()
    runs = [read_digest(one.close()) for one in (fast, plain)]
    before, now = (production([run]) for run in runs)
    assert (before["picked"], before["hourly"], before["median_s"], before["p95_s"]) == (1, None, None, None)
    assert production(runs) | {"runs": 1, "picked": 1, "tried": 1, "paces": [1.0], "parts": {"cube": [1, 1]}} == now
    assert production(runs)["paces"] == [1.0, 20.0]
    assert {row["matters"] for row in compared(before, now)} == {None}


def test_a_difference_matters_where_chance_would_not_make_it() -> None:
    plain = {
        "hourly": 100.0,
        "median_s": 10.0,
        "p95_s": 12.0,
        "oee": 0.8,
        "looks": 3.0,
        "grasp_mm": 0.6,
        "true_mm": None,
    }
    rest = {"nameless": 0, "interventions": 0, "parts": {}}
    before = {"picked": 95, "tried": 100, **plain, **rest}
    some = compared(before, {**before, "picked": 92, "median_s": 10.4})
    assert [row["matters"] for row in some] == [None] * len(some)
    many = {row["name"]: row for row in compared(before, {**before, "picked": 80, "median_s": 8.0})}
    assert (many["picked of tried"]["matters"], many["picked of tried"]["delta"]) == ("worse", pytest.approx(-15))
    assert many["cycle time, median"]["matters"] == "better"


def test_a_strip_is_calm_near_or_beyond_its_limit(tmp_path: Path) -> None:
    for value, near in ((1.0, 0), (1.2, 1), (1.6, 2)):
        made = MadeRun(tmp_path / f"2026010{near + 1}T000000Z", pictures=False)
        made.look("look", focus_left=0.4)
        made.look("look", focus_left=value)
        (strip,) = [s for s in strips(read_digest(made.close())) if s["name"] == "edge width (focus)"]
        assert (strip["near"], strip["worst"], strip["limit"]) == (near, value, 1.5)
