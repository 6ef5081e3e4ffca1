"""What the report page is given of one run, value by value: a run written down by hand, and all that is made of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from daemon.review import pagedata
from daemon.review.digest import Digest, digest, duration_s, short_hash
from daemon.review.export import tables
from daemon.review.failure_causes import run_context
from daemon.review.measures import Strip, strips
from daemon.review.page import read_digest
from daemon.review.pagedata import (
    cycle_json,
    events,
    median_state_seconds,
    page_data,
    state_seconds,
    stop_json,
    timeline,
)
from daemon.review.space import moments_of
from tests.fakes.made_run import MadeRun

Json = dict[str, Any]
FACET = {
    "type": "square",
    "left_px": [[300.04, 200.06], [3, 4]],
    "right_px": [[290, 200.96]],
    "corners_mm": [[0, 0, 9]],
}
CUBE = {
    "label": "cube", "confidence": 0.98765, "match_ratio": 0.876, "activation": 0.765, "runner_up": "pyramid",
    "reason": "fits", "residual_mm": 0.456, "facets": [FACET],
}  # fmt: skip
OTHER = {"label": "unknown", "confidence": 0.999, "residual_mm": 7.0}
GUESS = {"label": "prism", "share": 0.333, "left_px": [[1, 2, 3, 4.06]], "left_shows": [True], "right_px": None}
POSE = [[1, 0, 0, 10.04], [0, 1, 0, 20], [0, 0, 1, 30], [0, 0, 0, 1]]


def line(kind: str, mono_s: float, **fields: Any) -> Json:
    return {"v": 1, "t": f"2026-01-02T03:04:{mono_s:06.3f}Z", "mono_s": mono_s, "kind": kind, **fields}


def look(mono_s: float, purpose: str, *parts: Json, **more: Any) -> Json:
    rejected = {"eye": "left", "reason": "thin", "corners_px": [[1.26, 2]]}
    scene = {"ms": 12.5, "parts": list(parts), "rejected": [rejected] * 50, "guesses": [GUESS], "notes": ["dark"]}
    return line("look", mono_s, purpose=purpose, scene=scene, seconds={"facets": 0.123456}, health={"noise": 2.0,
                "epipolar_px": 0.05}, **more)  # fmt: skip


def records() -> list[Json]:
    found = [
        line("run_start", 1.0, name="bench", cell="real", version="0.1", utc_offset_s=3600, model="kept/aaaaaaaa11.npz",
             calibration="kept/bbbbbbbb22.yaml", config="kept/cccccccc33.yaml"),
        line("command", 1.5, who="ann", door="console", text="look"),
        look(2.0, "console", OTHER),
        line("model", 2.5, action="accepted", version=3, file="kept/dddddddd44.npz"),
        line("cycle_start", 3.0, cycle=7),
        line("state", 3.0, to="survey"),
        look(4.0, "survey 1", CUBE, OTHER, cycle=7, stop=0),
        line("decision", 4.2, text="pick cube", why="surest", cycle=7),
        line("state", 4.5, to="approach"),
        line("move", 5.0, how="straight", purpose="stand-off", target=POSE, speed_pct=25.0, cycle=7),
        line("moved", 6.0, seconds=0.999, error_mm=0.01234, cycle=7),
        look(7.0, "approach", CUBE, cycle=7, stop=1, moved={"eye": "left"}),
        line("estimate", 7.5, label="cube", predicted_mm=0.777, predicted_deg=0.222, chi2=1.26, world_from_part=POSE),
        line("hand", 8.0, closed=True),
        line("move", 8.2, how="joint", purpose="bin", target=None, speed_pct=50, sent=False),
        line("refusal", 8.5, rule="table", text="too low"),
        line("state", 9.0, to="idle"),
        line("cycle_end", 9.5, cycle=7, outcome="picked", label="cube", why="gone",
             predicted={"mm": 0.704, "deg": 0.2}),
        line("truth", 9.6, cycle=7, error_mm=0.515, error_deg=0.125, held=True),
        line("clock", 10.0, jump_s=-60.0),
        line("cycle_start", 11.0, cycle=8),
        line("fault", 12.0, code="link", text="link: no answer", cycle=8),
        line("fault", 12.5, code="link", text="link: no answer", cycle=8),
        line("gap", 13.0, lost=3, why="full"),
        line("eyes", 13.5, alone="left", why="right camera: frozen"),
        line("run_end", 14.0, why="stopped"),
    ]  # fmt: skip
    return [{**record, "seq": seq} for seq, record in enumerate(found)]


@pytest.fixture
def run() -> Digest:
    return digest("20260102T030401Z", records(), ["a torn line"])


def test_what_the_page_says_first(run: Digest) -> None:
    data = page_data(run)
    assert data["run"] == "20260102T030401Z"
    assert data["started"] == "2026-01-02T03:04:01.000Z"
    assert data["seconds"] == 13.0
    assert data["utc_offset_s"] == 3600
    assert data["cell"] == {"name": "bench", "kind": "real", "version": "0.1", "times_life": None}
    assert data["models"] == ["aaaaaaaa", "version 3 (dddddddd)"]
    assert data["kept"] == {"config": "cccccccc", "calibration": "bbbbbbbb"}
    assert (data["going"], data["end"]) == (False, "stopped")
    assert data["skipped"] == ["a torn line"]
    assert [stop["purpose"] for stop in data["outside"]] == ["console"]
    assert list(data["remedies"]) == list(data["production"]["stops"]), "what stopped it is told with what to do"


def test_one_look_with_its_parts_guesses_estimate_and_moves(run: Digest) -> None:
    survey, approach = (stop_json(stop) for stop in run.cycles[0].stops)
    assert {name: approach[name] for name in ("n", "seq", "t", "purpose", "ms", "seconds", "health", "notes")} == {
        "n": 1, "seq": 11, "t": "2026-01-02T03:04:07.000Z", "purpose": "approach", "ms": 12.5,
        "seconds": {"facets": 0.1235}, "health": {"noise": 2.0, "epipolar_px": 0.05}, "notes": ["dark"],
    }  # fmt: skip
    assert approach["parts"] == [{
        "label": "cube", "conf": 0.99, "ratio": 0.88, "act": 0.77, "runner": "pyramid", "why": "fits", "res": 0.46,
        "facets": [{"type": "square", "l": [[300.0, 200.1], [3, 4]], "r": [[290, 201.0]]}],
    }]  # fmt: skip
    assert approach["rejected"] == [{"camera": "left", "why": "thin", "px": [[1.3, 2]]}] * 40
    shown = [{"px": [[1, 2], [3, 4.1]], "shows": True}]
    assert approach["guesses"] == [{"label": "prism", "share": 0.33, "l": shown, "r": []}]
    assert approach["estimate"] == {"label": "cube", "mm": 0.78, "deg": 0.22, "chi2": 1.3, "at": [10.0, 20, 30]}
    assert approach["moves"] == [
        {"kind": "hand", "text": "gripper closes"},
        {"kind": "move", "text": "bin: joint move at 50 %, not sent"},
        {"kind": "refusal", "text": "refused: table: too low"},
    ]
    assert survey["estimate"] is None
    assert [move["text"] for move in survey["moves"]] == [
        "stand-off: straight move to x 10 y 20 z 30 mm at 25 %",
        "there in 1.0 s, 0.01 mm off",
    ]


def test_a_hand_that_opens_is_not_one_that_closes() -> None:
    found = digest("x", [line("cycle_start", 0, seq=0), look(1, "survey", seq=1), line("hand", 2, closed=False, seq=2)])
    assert stop_json(found.cycles[0].stops[0])["moves"] == [{"kind": "hand", "text": "gripper opens"}]


def test_a_look_of_which_nothing_was_kept_is_shown_all_the_same() -> None:
    bare = look(1.0, "x", seq=1) | {"purpose": None, "scene": None, "seconds": None, "health": None}
    (stop,) = digest("x", [line("cycle_start", 0, seq=0), bare]).cycles[0].stops
    assert stop_json(stop) == {
        "n": None, "seq": 1, "t": "2026-01-02T03:04:01.000Z", "purpose": "look", "ms": None, "seconds": {},
        "pictures_only": True,
        "health": {}, "parts": [], "rejected": [], "guesses": [], "notes": [], "estimate": None, "moves": [],
    }  # fmt: skip


def test_one_row_of_the_table_of_cycles(run: Digest) -> None:
    first, second = run.cycles
    row = cycle_json(first, run_context(run.cycles), going=False)
    assert {k: v for k, v in row.items() if k not in ("causes", "stops")} == {
        "n": 7, "t": "2026-01-02T03:04:03.000Z", "label": "cube", "outcome": "picked", "looks": 1,
        "cameras": "both, left",
        "s": 6.5, "mm": 0.7, "deg": 0.2, "true_mm": 0.52, "true_deg": 0.12, "why": "gone",
        "decisions": [{"text": "pick cube", "why": "surest"}], "mms": [0.78],
    }  # fmt: skip
    assert len(row["stops"]) == 2
    assert cycle_json(second, run_context(run.cycles), going=False)["outcome"] == "unfinished"
    assert cycle_json(second, run_context(run.cycles), going=True)["outcome"] == "going on"
    assert cycle_json(first, run_context(run.cycles), going=True)["outcome"] == "picked"
    shown = cycle_json(second, run_context(run.cycles), going=False)["causes"]
    assert [(c["name"], c["at"]) for c in shown] == [("a fault in facetd", 21)]
    assert all(c["w"] > 0 and c["e"] and c["r"] and c["stage"] for c in shown)


def test_where_the_time_of_a_pick_goes(run: Digest) -> None:
    assert state_seconds(run.cycles[0]) == {"survey": 1.5, "approach": 4.5, "idle": 0.5}
    assert state_seconds(run.cycles[1]) == {}
    back = [line("cycle_start", 5, seq=0), line("state", 5, to="a", seq=1), line("state", 1, to="b", seq=2),
            line("state", 2, to="a", seq=3), line("cycle_end", 4.5, outcome="picked", seq=4)]  # fmt: skip
    other = digest("x", back).cycles[0]
    assert state_seconds(other) == {"a": 2.5, "b": 1.0}, "a clock that starts anew counts nothing"
    assert median_state_seconds([run.cycles[0], other, run.cycles[1]]) == {
        "survey": 0.75, "approach": 2.25, "idle": 0.25, "a": 1.25, "b": 0.5,
    }  # fmt: skip
    assert median_state_seconds([run.cycles[1]]) == {}


def test_a_bar_a_cycle_from_the_beginning_of_the_run(run: Digest) -> None:
    assert timeline(run) == [
        {"n": 7, "from": 2.0, "to": 8.5, "outcome": "picked", "label": "cube"},
        {"n": 8, "from": 10.0, "to": 12.5, "outcome": "unfinished", "label": None},
    ]
    assert timeline(digest("x", [])) == []
    moments = ((1.001, "run_start"), (2.344, "cycle_start"), (3.567, "cycle_end"))
    (bar,) = timeline(digest("x", [line(kind, at_s, cycle=1, outcome="lost") for at_s, kind in moments]))
    assert (bar["from"], bar["to"]) == (1.34, 2.57), "to a hundredth of a second"


def test_what_happened_once_each_with_what_led_to_it(run: Digest) -> None:
    found = [(e["s"], e["kind"], e["cycle"], e["text"], e["after"]) for e in events(run)]
    move, state = "move bin: joint move at 50 %, not sent", "state idle"
    assert found == [
        (1.5, "model", None, "model version 3 in use (accepted)", "command ann at console: look"),
        (7.5, "refusal", 7, "the guard refused: table: too low", move),
        (9.0, "clock", None, "the machine's clock jumped by -60.0 s", state),
        (11.0, "fault", 8, "fault: link: no answer", state),
        (12.0, "gap", 8, "records are missing: full", state),
        (12.5, "eyes", 8, "cameras in use: left: right camera: frozen", state),
        (13.0, "run_end", 8, "the run ended: stopped", state),
    ]
    none = [line("model", 0, action="start", version=None, seq=0), line("eyes", 1, alone=None, why="mended", seq=1)]
    assert [e["text"] for e in events(digest("x", none))] == ["no model in use", "cameras in use: both: mended"]
    assert [e["after"] for e in events(digest("x", none))] == [None, None]


def test_a_fault_is_told_by_its_cause_and_a_persons_stop_is_no_fault() -> None:
    found = [
        line("fault", 0, code="camera_lost", text="CameraError: left camera is gone", seq=0),
        line("fault", 1, code="operator_stop", text="stopped by ann", seq=1),
    ]
    assert [e["text"] for e in events(digest("x", found))] == [
        "fault: camera not connected: left camera is gone", "stopped by ann",
    ]  # fmt: skip


def test_a_fault_says_who_cleared_it_and_after_how_long_and_notes_are_events_too() -> None:
    found = [
        line("operator", 0, who="ann: operator at /dev/ttyS0", before="operator at /dev/ttyS0", seq=0),
        line("fault", 10, code="camera_lost", text="left camera is gone", seq=1),
        line("note", 20, who="ann: operator at /dev/ttyS0", text="cable plugged in", seq=2),
        line("command", 39, who="bob", text="resume", seq=3),
        line("state", 40, to="idle", event="resume", seq=4, **{"from": "fault"}),
        line("fault", 50, code="gripper", text="no air", seq=5),
    ]
    told = events(digest("x", found))
    assert [(e["what"], e["text"], e["cleared"]) for e in told] == [
        ("operator", "from now on ann: operator at /dev/ttyS0", None),
        ("fault", "fault: camera not connected: left camera is gone", {"by": "bob", "s": 30.0}),
        ("note", "cable plugged in (ann: operator at /dev/ttyS0)", None),
        ("fault", "fault: gripper does not open or close: no air", None),
    ]


def test_the_figures_of_a_run(run: Digest) -> None:
    assert run.statistics() == {
        "run": "20260102T030401Z", "started": "2026-01-02T03:04:01.000Z", "seconds": 13.0, "cycles": 2, "tried": 1,
        "picked": 1, "aborted": 0, "missed": 0, "outcomes": {"picked": 1, "unfinished": 1}, "looks": 3, "refusals": 1,
        "faults": 2, "mean_looks": 1, "mean_cycle_s": 6.5, "predicted_mm": 0.704, "true_mm": 0.515, "model": "dddddddd",
        "model_version": 3, "calibration": "bbbbbbbb", "config": "cccccccc", "ended": True, "going": False,
    }  # fmt: skip
    nothing = digest("x", []).statistics()
    assert (nothing["started"], nothing["seconds"], nothing["model"], nothing["mean_looks"]) == (None, 0, None, None)
    assert nothing["ended"] is False


def test_a_run_that_is_written_still_goes_on_until_its_end() -> None:
    assert digest("x", records()[:-1], going=True).going
    assert not digest("x", records(), going=True).going
    assert not digest("x", records()[:-1]).going


def test_what_belongs_to_no_cycle_is_outside_of_all(run: Digest) -> None:
    assert [r["kind"] for r in run.outside] == [
        "run_start", "command", "look", "model", "truth", "clock", "run_end",
    ]  # fmt: skip
    assert [r["kind"] for r in run.cycles[1].records] == ["cycle_start", "fault", "fault", "gap", "eyes"]
    doubled = [line("cycle_start", k, cycle=k, seq=k) for k in range(3)]
    assert [c.number for c in digest("x", doubled).cycles] == [0, 1, 2]


def test_seconds_and_hashes() -> None:
    assert duration_s([{"mono_s": 5.0}, {"mono_s": 7.0}, {"mono_s": 1.0}, {}, {"mono_s": 2.5}]) == 3.5
    assert short_hash("kept/0123456789.yaml") == "01234567"
    assert short_hash("") is None
    assert short_hash(None) is None


def test_rows_for_a_spreadsheet(run: Digest) -> None:
    found = {name: (columns, rows) for name, (columns, rows) in tables(run, "7").items()}
    for columns, rows in found.values():
        assert all(set(row) == set(columns) for row in rows)
    first = found["cycles"][1][0]
    assert first == {
        "cell": "7", "run": "20260102T030401Z", "model": "dddddddd", "calibration": "bbbbbbbb",
        "started": "2026-01-02T03:04:03.000Z", "label": "cube", "outcome": "picked", "looks": 1, "predicted_mm": 0.704,
        "predicted_deg": 0.2, "true_mm": 0.515, "true_deg": 0.125, "why": "gone", "day": "2026-01-02", "cycle": 7,
        "seconds": 6.5,
    }  # fmt: skip
    outside, survey, approach = found["looks"][1]
    assert approach == {
        "seq": 11, "cycle": 7, "stop": 1, "purpose": "approach", "epipolar_px": 0.05, "noise": 2.0,
        "predicted_mm": 0.777, "chi2": 1.26, "cell": "7", "day": "2026-01-02", "run": "20260102T030401Z", "ms": 12.5,
        "parts": 1, "named": 1, "taken": "2026-01-02T03:04:07.000Z", "labels": "cube", "best_confidence": 0.98765,
        "residual_mm": 0.456,
    }  # fmt: skip
    assert (survey["parts"], survey["named"], survey["best_confidence"], survey["residual_mm"]) == (
        2,
        1,
        0.98765,
        0.456,
    )
    assert (outside["named"], outside["labels"], outside["best_confidence"], outside["residual_mm"]) == (
        0,
        "",
        None,
        None,
    )
    assert (survey["predicted_mm"], outside["cycle"]) == (None, None)


def test_what_other_cycles_picked_explains_a_miss_though_the_page_does_not_show_them(
    run: Digest, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pagedata, "MAX_CYCLES", 1)
    picked, last = run.cycles
    end = {"kind": "cycle_end", "seq": 9999, "outcome": "missed", "label": "prism", "why": "prism still lies there"}
    (row,) = page_data(replace(run, cycles=(picked, replace(last, end=end))))["cycles"]
    assert picked.label is not None
    assert f"the gripper held {picked.label}" in row["causes"][0]["e"]


def test_after_a_calibration_the_cameras_usual_place_is_another(made: MadeRun) -> None:
    def looks(count: int, deg: float) -> None:
        for _ in range(count):
            made.look("survey", vergence_deg=deg, vergence_sigma_deg=0.01)

    looks(25, 0.0)
    made.write("run_start", reloaded=True, calibration="kept/33333333aa.yaml")
    looks(25, 0.3)
    strip = next(one for one in strips(read_digest(made.close())) if one["name"].startswith("stereo rotation"))
    assert (strip["worst"], len(strip["s"])) == (0.0, 50)


def test_a_run_whose_computer_ended_it_in_order_was_switched_off_wherever_the_page_says_so(made: MadeRun) -> None:
    made.pick()
    lines = made.close() / "run.jsonl"
    lines.write_text(lines.read_text().replace("the made run ends", "signal SIGTERM"))
    data = page_data(read_digest(made.folder))
    assert data["end"] == "switched off"
    assert data["events"][-1]["text"] == "the run ended: switched off"


def test_picks_by_part_add_up_to_all_that_were_tried(made: MadeRun) -> None:
    """Three of ten chose no part: each part had 100 %, and the run 70."""
    made.pick()
    made.pick("unreachable", label=None)
    production = page_data(read_digest(made.close()))["production"]
    assert production["parts"] == {"cube": [1, 1], "no part chosen": [0, 1]}
    assert [production[key] for key in ("picked", "tried")] == [1, 2]


def test_a_part_laid_down_between_two_grasps_is_among_a_picks_decisions() -> None:
    laid = [
        line("laid_down", 1, seq=1, label="cube", status="set", times=1, off_mm=None, off_deg=None, why=""),
        line("laid_down", 2, seq=2, label="cube", status="off", times=1, off_mm=3.26, off_deg=1.0, why="it slid"),
    ]
    (cycle,) = digest("x", [line("cycle_start", 0, seq=0), *laid]).cycles
    assert cycle_json(cycle, run_context([cycle]), going=False)["decisions"] == [
        {"text": "laid on the table: let go", "why": ""},
        {"text": "laid on the table: seen off", "why": "3.3 mm, 1.0 degrees off, it slid"},
    ]
    moments = moments_of(cycle.records, 0.0)
    assert [(m["kind"], m["text"]) for m in moments] == [
        ("laid_down", "laid on the table: set"),
        ("laid_down", "laid on the table: off"),
    ]


@pytest.mark.parametrize(("above", "worst"), [(True, 9.0), (False, -9.0)])
def test_of_very_many_looks_each_point_of_a_measure_is_the_worst_of_several(above: bool, worst: float) -> None:
    line: list[float | None] = [1.0, None] * 3000
    line[4321] = worst
    shown = Strip("contrast", "grey levels", 5.0, above, [float(k) for k in range(6000)], {"left": line}).json()
    points = shown["lines"]["left"]
    assert (shown["each"], len(shown["s"]), len(points)) == (3, 2000, 2000)
    assert points[4321 // 3] == worst
    assert shown["s"][4321 // 3] == 4320.0
    assert set(points) == {1.0, worst}
    few = Strip("contrast", "grey levels", 5.0, above, [0.0, 1.0], {"left": [None, 2.0]}).json()
    assert (few["each"], few["lines"]) == (1, {"left": [None, 2.0]})
