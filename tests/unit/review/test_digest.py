"""A run's records sorted into cycles and stops; also of runs that were cut short."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from daemon.review.digest import carried_out, digest
from daemon.review.export import cycle_rows
from daemon.review.page import read_digest
from daemon.review.pagedata import page_data, stop_json
from daemon.store.runs import read_run
from tests.fakes.made_run import MadeRun


def test_a_run_is_sorted_into_cycles_and_stops(made: MadeRun) -> None:
    made.pick()
    made.pick("missed", why="the cube lies where it lay")
    run = read_digest(made.close())
    assert [c.outcome for c in run.cycles] == ["picked", "missed"]
    assert [s.purpose for s in run.cycles[0].stops] == ["survey 1", "approach", "approach"]
    assert run.cycles[0].looks == 2
    figures = run.statistics()
    assert (figures["cycles"], figures["picked"], figures["missed"]) == (2, 1, 1)
    assert figures["predicted_mm"] == 0.7
    assert figures["ended"]


def test_a_log_cut_at_any_byte_of_its_last_record_still_reviews(made: MadeRun, tmp_path: Path) -> None:
    made.pick()
    whole = (made.close() / "run.jsonl").read_bytes()
    last = whole.rstrip(b"\n").rfind(b"\n") + 1
    cut = tmp_path / "cut"
    cut.mkdir()
    for end in range(last, len(whole) + 1):
        (cut / "run.jsonl").write_bytes(whole[:end])
        found = read_run(cut)
        data = page_data(digest("cut", found.records, found.skipped))
        assert data["production"]["picked"] == 1
        whole_again = end >= len(whole) - 1
        torn = last < end < len(whole) - 1
        assert bool(data["skipped"]) == torn
        assert bool(data["end"]) == whole_again


def test_every_prefix_of_a_run_makes_a_digest(made: MadeRun) -> None:
    made.pick("missed")
    made.pick()
    records = read_run(made.close()).records
    for count in range(len(records) + 1):
        data = page_data(digest("prefix", records[:count]))
        assert len(data["cycles"]) <= 2
    assert page_data(digest("prefix", records[:-2]))["cycles"][-1]["outcome"] == "unfinished"


def test_what_was_held_back_as_it_was_typed_is_shown_so_and_was_not_carried_out(made: MadeRun) -> None:
    made.cycle = 1
    made.write("cycle_start", cycle=1, target=None)
    made.look("survey 1")
    for kind, fields in (
        ("move", {"purpose": "bin", "how": "joint"}), ("held_back", {"what": "move"}), ("hand", {"closed": False}),
        ("move", {"purpose": "home", "how": "joint"}), ("hand", {"closed": True}), ("held_back", {"what": "hand"}),
    ):  # fmt: skip
        made.write(kind, cycle=1, **fields)
    made.log.settle()
    (cycle,) = read_digest(made.folder).cycles
    assert [r.get("purpose", r["kind"]) for r in carried_out(cycle.records)] == ["hand", "home"]
    shown = [move["text"] for move in stop_json(cycle.stops[0])["moves"]]
    assert shown[1] == "move withdrawn before it was sent"


def test_the_page_tells_which_picks_were_made_with_which_cameras_and_when_that_changed(made: MadeRun) -> None:
    made.pick()
    made.write("eyes", alone="left", why="right camera: frozen")
    made.moved = {"eye": "left", "left": np.eye(4), "right": np.eye(4), "arm_mm": 0.1, "arm_deg": 0.02}
    made.pick()
    run = read_digest(made.close())
    assert [c.cameras for c in run.cycles] == ["both", "left"]
    data = page_data(run)
    assert [c["cameras"] for c in data["cycles"]] == ["both", "left"]
    assert "cameras in use: left: right camera: frozen" in [e["text"] for e in data["events"]]


def test_each_pick_has_the_model_and_the_calibration_it_was_made_with(made: MadeRun, tmp_path: Path) -> None:
    made.write("model", action="start", version=1, file="kept/11111111aa.npz")
    made.pick()
    made.write("model", action="accept", version=2, file="kept/22222222aa.npz")
    made.pick()
    made.write("run_start", reloaded=True, model="kept/22222222aa.npz", calibration="kept/33333333aa.yaml")
    made.pick()
    run = read_digest(made.close())
    first = run.kept("calibration")
    with_what = [("11111111", first), ("22222222", first), ("22222222", "33333333")]
    assert [(c.model, c.calibration) for c in run.cycles] == with_what
    assert [(row["model"], row["calibration"]) for row in cycle_rows(run, "7")] == with_what
