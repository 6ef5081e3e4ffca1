"""What the live page shows, folded from what the daemon tells."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from daemon.dashboard.state import LOOKS, DashboardState
from tests.fakes.made_run import MadeRun


def records(folder: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in (folder / "run.jsonl").read_text().splitlines()]


def test_it_shows_the_last_look_the_approach_converging_and_the_last_picks(tmp_path: Path) -> None:
    made = MadeRun(tmp_path / "20260102T030405Z")
    made.pick(label="pyramid")
    made.pick("missed")
    now = DashboardState()
    for record in records(made.close()):
        now.recorded(record)
    told = now.json()
    assert [e["mm"] for e in told["approach"]] == [1.5, 0.7]
    assert [(p["label"], p["outcome"]) for p in told["picks"]] == [("pyramid", "picked"), ("cube", "missed")]
    assert told["look"]["parts"][0]["facets"]
    assert told["cameras"] == ["left", "right"]
    assert "cycle_end   missed" in told["lines"][-2]


def test_it_keeps_few_and_takes_any_record(tmp_path: Path) -> None:
    made = MadeRun(tmp_path / "20260102T030405Z", pictures=False)
    for _ in range(30):
        made.pick()
    now = DashboardState()
    spoilt: list[dict[str, Any]] = [{"kind": "look"}, {"kind": "estimate"}, {"kind": "cycle_end"}, {}]
    for record in [*records(made.close()), *spoilt]:
        now.recorded(record)
    told = now.json()
    assert (len(told["picks"]), len(told["lines"]), len(now.pictures)) == (20, 40, LOOKS)


def test_a_status_that_says_the_same_is_no_change() -> None:
    now = DashboardState()
    now.answered({"state": "idle", "up_s": 1.0})
    before = now.version
    now.answered({"state": "idle", "up_s": 2.0})
    assert now.version == before
    now.answered(None)
    assert now.version > before


def test_a_place_whose_status_changes_is_news() -> None:
    now = DashboardState()
    place = {"name": "nest", "part": "cube", "status": "free", "off_mm": None, "off_deg": None, "outline": [[0, 0]]}
    now.answered({"state": "idle", "each_place": [place]})
    before = now.version
    now.answered({"state": "idle", "each_place": [{**place, "status": "seen right"}]})
    assert now.version > before
    assert now.json()["daemon"]["each_place"][0]["status"] == "seen right"
