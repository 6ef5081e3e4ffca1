"""What the fleet's page says of each cell, and that it opens."""

from __future__ import annotations

from datetime import date, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.fleet.layout import add_rows, rows_of
from daemon.fleet.page import STATES, faults_by_cause, fleet_data, is_worse, write_fleet_page
from daemon.fleet.store import Store, StoreError, open_store
from daemon.fleet.views import open_views
from daemon.review.digest import Digest, digest
from daemon.review.page import read_digest
from tests.fakes.made_run import MadeRun
from tests.manuals.data import QUESTIONS

pytest.importorskip("fsspec", reason="fsspec is not installed: make extra-fleet")
pytest.importorskip("duckdb", reason="duckdb is not installed: make extra-fleet")
made_year = pytest.importorskip("tests.fakes.made_year", reason="pyarrow is not installed: make extra-fleet")

DAYS, CELLS = 365, 32
LAST = date(2026, 12, 31)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """The first week of a year of many cells, and its last four."""
    folder = tmp_path_factory.mktemp("hall")
    made = MadeRun(folder / "20260102T030405Z", pictures=False)
    cameras = {"darkness_left": 200.0, "darkness_right": 190.0, "epipolar_pair": 0.08}
    turns = {f"{axis}_deg": 0.01 for axis in ("pitch", "roll", "vergence")}
    turns |= {f"{axis}_sigma_deg": 0.02 for axis in ("pitch", "roll", "vergence")}
    look = made.look
    made.look = lambda *args, **more: look(*args, **(cameras | turns | more))
    for label in ("cube", "pyramid", "pentagonal_prism"):
        made.pick(label=label)
    made.close()
    store = open_store(str(folder / "store"))
    picks = made_year.picks_of([rows_of(read_digest(made.folder))])
    first = LAST - timedelta(days=DAYS - 1)
    for begin, days in ((0, 7), (DAYS - 28, 28)):
        list(made_year.write_year(store, picks, CELLS, first, DAYS, 40, only=range(begin, begin + days)))
    return store


@pytest.fixture(scope="module")
def data(store: Store) -> Any:
    return fleet_data(store, 7)


def named(data: Any, number: int) -> Any:
    return next(cell for cell in data["cells"] if cell["name"] == f"cell{number + 1:02d}")


def test_each_cell_that_suffers_is_told_of_by_what_it_suffers_from(data: Any) -> None:
    assert named(data, made_year.FAULTY)["state"] == "faults"
    assert list(data["remedies"]) == list(data["causes"])
    assert named(data, made_year.WORSE)["state"] == "misses"
    assert named(data, made_year.SILENT)["state"] == "silent"
    turned = named(data, 6)["turn"]["pitch"][-1] - named(data, 6)["usual"]["pitch"]
    assert [text for kind, text in named(data, 6)["findings"] if kind == "drifts"] == [
        f"pitch of the right camera {turned:+.2f} degrees since calibration"
    ]
    assert named(data, 4)["state"] == "dark"


def test_the_others_are_well_and_come_last(data: Any) -> None:
    states = [cell["state"] for cell in data["cells"]]
    assert states == sorted(states, key=STATES.index)
    slips, fades, turns = set(range(3, CELLS, 7)), set(range(4, CELLS, 9)), set(range(6, CELLS, 13))
    ill = {made_year.FAULTY, made_year.WORSE, made_year.SILENT} | slips | fades | turns
    assert {f"cell{n + 1:02d}" for n in range(CELLS)} - {c["name"] for c in data["cells"] if c["state"] != "well"} >= {
        f"cell{n + 1:02d}" for n in range(CELLS) if n not in ill
    }


def test_counts_of_the_page_are_those_of_the_days_it_shows(data: Any) -> None:
    well = named(data, 0)
    assert (len(data["days"]), data["days"][-1]) == (7, str(LAST))
    assert well["tried"] == 7 * 40
    assert sum(of for _, of in well["parts"].values()) == well["tried"]
    assert named(data, made_year.SILENT)["tried"] == 4 * 40


@pytest.mark.parametrize(
    ("back", "told"), [(False, "the left camera is in use alone"), (True, "both are in use again")]
)
def test_a_cell_that_looked_with_one_camera_is_told_of(tmp_path: Path, back: bool, told: str) -> None:
    made = MadeRun(tmp_path / "20260102T030405Z", pictures=False)
    made.pick()
    made.moved = {"eye": "left", "left": np.eye(4), "right": np.eye(4), "arm_mm": 0.1, "arm_deg": 0.02}
    made.pick()
    if back:
        made.moved = None
        made.pick()
    made.close()
    store, rows = open_store(str(tmp_path / "store")), rows_of(read_digest(made.folder))
    looks, at = rows["looks"], rows["looks"].schema.get_field_index("t")
    at_once = looks["t"].take([0] * len(looks))  # times are kept in milliseconds: looks in one are told by number
    rows["looks"] = looks.set_column(at, looks.schema.field(at), at_once)
    add_rows(store, "north", [rows])
    (north,) = fleet_data(store, 7)["cells"]
    assert (north["state"], north["findings"]) == ("one camera", [["one camera", f"3 looks with one camera; {told}"]])


def test_set_downs_are_counted_by_what_the_look_after_them_found(tmp_path: Path) -> None:
    made = MadeRun(tmp_path / "20260102T030405Z", pictures=False)
    made.pick()
    for number in range(3):
        made.set_down(f"tray.{number}", "seen right", off_mm=0.2 + number, off_deg=0.1)
    made.set_down("tray.3", "off", "off", off_mm=1.8, off_deg=0.4)
    made.set_down("nest", "missing", "released")
    made.close()
    store = open_store(str(tmp_path / "store"))
    add_rows(store, "north", [rows_of(read_digest(made.folder))])
    (north,) = fleet_data(store, 7)["cells"]
    assert north["placed"] == [3, 1, 1]
    asked = "SELECT place, place_status, place_off_mm, place_off_deg FROM cycles ORDER BY cycle"
    rows = open_views(store).execute(asked).fetchall()
    assert rows[0] == (None,) * 4, "to the bin"
    assert rows[4] == ("tray.3", "off", pytest.approx(1.8), pytest.approx(0.4))
    assert rows[5] == ("nest", "missing", None, None)
    missed = next(question for question in QUESTIONS if question.text == "Which place is missed, where?")
    answer = open_views(store).execute(missed.sql).fetchall()
    assert [row[2:5] for row in answer][:2] == [("nest", 1, 0), ("tray.3", 1, 0)]
    assert len(answer) == 5


def test_less_than_others_by_chance_is_nothing_needs_attention() -> None:
    assert not is_worse([95, 100], [970, 1000])
    assert is_worse([80, 100], [970, 1000])
    assert not is_worse([99_000, 100_000], [991_000, 1_000_000])
    assert not is_worse([0, 0], [10, 10])


def test_faults_are_told_by_their_cause_and_those_that_tell_none_by_their_code() -> None:
    said = [
        ("SuspectError", "SuspectError: looks 1 and 2 disagree; suspect: hand-eye", 1), ("hand_eye", "whatever", 1),
        ("NoAnswer", "NoAnswer: to WHERE", 1), ("controller_silent", "NoAnswer: to DO", 1), ("arm_lost", "gone", 3),
        ("stopped by ann", "stopped by ann", 1), ("operator_stop", "whatever", 1),
    ]  # fmt: skip
    faults = [{"code": code, "text": text, "count": count} for code, text, count in said]
    assert faults_by_cause(faults) == {"arm_lost": 3, "hand-eye calibration off": 2, "controller silent": 2}


def test_a_store_without_runs_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="no runs in it yet: `facetctl runs collect"):
        fleet_data(open_store(str(tmp_path)), 7)


def test_the_page_opens_and_a_cell_in_it(store: Store, browser: Any, tmp_path: Path) -> None:
    browser.get(write_fleet_page(store, 7, tmp_path / "fleet.html").as_uri())
    assert browser.execute_script("return document.documentElement.dataset.ready") == "yes"
    assert len(browser.find_elements("css selector", "#cells .cell")) == CELLS
    browser.find_element("css selector", "#ill button").click()
    assert "arm_lost" in browser.find_element("id", "one").text
    assert browser.find_elements("css selector", "#one figure")
    assert "null" not in browser.find_element("css selector", "body").text
    assert browser.get_log("browser") == []


def test_where_nothing_was_missed_no_empty_table_stands(browser: Any, tmp_path: Path) -> None:
    made = MadeRun(tmp_path / "20260102T030405Z")
    made.pick()
    made.close()
    store = open_store(str(tmp_path / "store"))
    add_rows(store, "calm", [rows_of(read_digest(made.folder))])
    browser.get(write_fleet_page(store, 7, tmp_path / "fleet.html").as_uri())
    assert "No pick failed." in browser.find_element("css selector", "body").text
    assert browser.find_elements("id", "causes") == []
    assert browser.get_log("browser") == []


def test_a_cell_whose_run_goes_on_for_days_is_not_silent_while_it_does(tmp_path: Path) -> None:
    """It had picked the day before, and the page said that there was no run in these days."""

    def run(day: int, days: int) -> Digest:
        end = day + days
        kinds = (("run_start", day), ("cycle_start", end), ("cycle_end", end), ("run_end", end))
        return digest(f"2026010{day}T030000Z", [
            {"kind": kind, "seq": k, "t": f"2026-01-0{d}T03:00:0{k}.000Z", "mono_s": 86400.0 * (d - day) + k,
             "cycle": 1, "outcome": "picked", "label": "cube"} for k, (kind, d) in enumerate(kinds)
        ])  # fmt: skip

    store = open_store(str(tmp_path))
    for name, one in (("slow", run(2, 3)), ("gone", run(2, 0)), ("usual", run(6, 0))):
        add_rows(store, name, [rows_of(one)])
    states = {cell["name"]: (cell["state"], cell["findings"]) for cell in fleet_data(store, 3)["cells"]}
    assert states["slow"] == ("well", [])
    assert states["gone"] == ("silent", [["silent", "no run since 2026-01-02"]])
