"""A run's records as rows, and rows of every release in one table."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.events.codes import BY_SUMMARY, EARLIER_SUMMARIES, CauseCode
from daemon.fleet.collect import collect, source_of
from daemon.fleet.layout import add_month, add_rows, rows_of, schema_of
from daemon.fleet.schema import TABLES, VERSION
from daemon.fleet.store import Store, StoreError
from daemon.fleet.views import open_views
from daemon.review.digest import digest
from daemon.review.page import read_digest
from tests.fakes.made_run import MadeRun, part
from tests.unit.fleet.conftest import CellMaker

pytest.importorskip("fsspec", reason="fsspec is not installed: make extra-fleet")
pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed: make extra-fleet")
pq = pytest.importorskip("pyarrow.parquet")
dataset = pytest.importorskip("pyarrow.dataset")
pytest.importorskip("duckdb", reason="duckdb is not installed: make extra-fleet")


def rows(tables: dict[str, Any], name: str) -> list[dict[str, object]]:
    found: list[dict[str, object]] = tables[name].to_pylist()
    return found


def test_a_move_that_was_held_back_as_it_was_typed_was_not_sent(tmp_path: Path) -> None:
    made = MadeRun(tmp_path / "20260102T030405Z")
    for kind, fields in (
        ("move", {"purpose": "bin"}), ("held_back", {"what": "move"}), ("move", {"purpose": "home"}),
        ("hand", {"closed": True}), ("held_back", {"what": "hand"}),
    ):  # fmt: skip
        made.write(kind, cycle=1, **fields)
    made.close()
    moves = rows(rows_of(read_digest(made.folder)), "moves")
    assert [(row["purpose"], row["sent"], row["seconds"]) for row in moves] == [
        ("bin", False, None), ("home", True, None),
    ]  # fmt: skip


def test_a_pick_becomes_rows_of_every_part_of_the_table(tmp_path: Path) -> None:
    made = MadeRun(tmp_path / "20260102T030405Z")
    made.pick(why="gone")
    made.write("fault", code="arm_lost", text="no answer")
    made.close()
    tables = rows_of(read_digest(made.folder))
    assert {name: len(table) for name, table in tables.items()} == {
        "runs": 1, "cycles": 1, "looks": 3, "parts": 3, "moves": 2, "faults": 1, "health": 3,
    }  # fmt: skip
    assert all(table.schema.equals(schema_of(name)) for name, table in tables.items())
    (cycle,) = rows(tables, "cycles")
    assert (cycle["cycle"], cycle["outcome"], cycle["label"], cycle["looks"], cycle["tried"]) == (
        1, "picked", "cube", 2, True,
    )  # fmt: skip
    assert rows(tables, "moves")[0]["seconds"] == 1.0
    assert rows(tables, "faults")[0] | {"t": 0, "day": 0, "seq": 0} == {
        "day": 0, "run": "20260102T030405Z", "seq": 0, "cycle": None, "t": 0, "kind": "fault", "code": "arm_lost",
        "text": "no answer",
    }  # fmt: skip
    look = rows(tables, "looks")[1]
    assert (look["purpose"], look["parts"], look["named"], look["predicted_mm"]) == ("approach", 1, 1, 1.5)
    assert rows(tables, "health")[0]["run"] == "20260102T030405Z"


def test_a_name_is_proved_by_the_pick_that_then_held_it_and_only_where_it_lay(tmp_path: Path) -> None:
    made = MadeRun(tmp_path / "20260102T030405Z")
    away = np.eye(4)
    away[0, 3] = 100.0
    made.cycle = 1
    made.write("cycle_start", cycle=1, target=None)
    made.look("survey 1", part("pyramid"), part("cube", cyclopean_from_part=away.tolist()))
    made.look("approach", part("cube"), stop=1)
    made.write("estimate", cycle=1, stop=1, label="cube", world_from_part=np.eye(4), covariance=np.eye(6))
    made.look("verify", part("cube"))
    made.write("cycle_end", cycle=1, outcome="picked", label="cube", stops=1, why="gone", grasp=None)
    made.close()
    found = [(r["label"], r["picked_as"]) for r in rows(rows_of(read_digest(made.folder)), "parts")]
    assert found == [("pyramid", "cube"), ("cube", None), ("cube", "cube"), ("cube", None)]


def test_records_of_a_release_that_knew_less_become_rows_with_null_in_them() -> None:
    def record(seq: int, kind: str, **more: object) -> dict[str, object]:
        return {"v": 1, "seq": seq, "t": f"2024-01-01T00:00:0{seq}.000Z", "mono_s": float(seq), "kind": kind, **more}

    old = [
        record(0, "run_start"),
        record(1, "cycle_start", cycle=1),
        record(2, "look", cycle=1),
        record(3, "move", cycle=1),
        record(4, "cycle_end", cycle=1, outcome="missed"),
    ]
    tables = rows_of(digest("20240101T000000Z", old))
    assert rows(tables, "cycles")[0]["outcome"] == "missed"
    assert rows(tables, "looks")[0]["ms"] is None
    assert rows(tables, "moves")[0]["x_mm"] is None
    assert rows(tables, "runs")[0]["release"] is None


def older(store: Store, cell: str, month: str) -> Path:
    """A month of cycles as version 1 had them."""
    first = [c.name for c in TABLES["cycles"].columns if c.since == 1]
    schema = pa.schema([schema_of("cycles").field(name) for name in first], metadata={b"facetd.schema": b"1"})
    row = dict.fromkeys(first) | {"day": np.datetime64(f"{month}-03").astype(object), "run": "old", "outcome": "missed"}
    path = Path(store.path("tables", "cycles", f"cell={cell}", f"month={month}", "rows.parquet"))
    path.parent.mkdir(parents=True)
    pq.write_table(pa.Table.from_pylist([row], schema), path)
    return path


def test_a_persons_stop_of_an_older_schema_is_no_tried_pick(store: Store) -> None:
    """Three stops and a kill had made a cell miss one part in four."""
    schema = schema_of("cycles")
    ends = [("fault", "operator's stop"), ("fault", "camera cable"), ("unfinished", "cut off"), ("picked", None)]
    day = np.datetime64("2025-12-03").astype(object)
    rows = [
        dict.fromkeys(schema.names) | {"day": day, "tried": True, "outcome": outcome, "cause": cause}
        for outcome, cause in ends
    ]
    path = Path(store.path("tables", "cycles", "cell=north", "month=2025-12", "rows.parquet"))
    path.parent.mkdir(parents=True)
    pq.write_table(pa.Table.from_pylist(rows, schema), path)
    found = open_views(store).execute("SELECT outcome, tried, cause FROM cycles ORDER BY ALL").fetchall()
    assert found == [
        ("aborted", False, CauseCode.OPERATOR_STOP.summary), ("fault", True, CauseCode.CAMERA_LOST.summary),
        ("picked", True, None), ("unfinished", False, CauseCode.CUT_OFF.summary),
    ]  # fmt: skip
    assert not EARLIER_SUMMARIES.keys() & BY_SUMMARY.keys()


def test_files_of_an_older_schema_are_read_with_those_of_today(store: Store, cell: CellMaker) -> None:
    older(store, "north", "2025-12")
    collect(store, [source_of(f"south={cell('south')}")])
    asked = "SELECT cell, outcome, tried, count(*) FROM cycles GROUP BY ALL ORDER BY ALL"
    assert open_views(store).execute(asked).fetchall() == [("north", "missed", None, 1), ("south", "picked", True, 2)]


def test_a_column_that_no_file_of_the_store_has_yet_is_null(store: Store) -> None:
    older(store, "north", "2025-12")
    assert open_views(store).execute("SELECT outcome, eyes FROM cycles").fetchall() == [("missed", None)]


def test_which_cameras_looked_stands_with_each_look_and_each_pick(tmp_path: Path) -> None:
    made = MadeRun(tmp_path / "20260102T030405Z")
    made.cycle = 1
    made.write("cycle_start", cycle=1, target=None)
    made.look("survey 1", part("cube"))
    made.moved = {"eye": "right", "left": np.eye(4), "right": np.eye(4), "arm_mm": 0.1, "arm_deg": 0.02}
    made.look("approach", part("cube"), stop=1)
    made.write("cycle_end", cycle=1, outcome="picked", label="cube", stops=1, why="gone", grasp=None)
    made.close()
    tables = rows_of(read_digest(made.folder))
    assert [row["eyes"] for row in rows(tables, "looks")] == ["both", "right"]
    assert [row["eyes"] for row in rows(tables, "cycles")] == ["both, right"]


def test_a_month_that_an_older_release_began_goes_on_as_todays(store: Store, cell: CellMaker) -> None:
    run = rows_of(read_digest(cell("north") / "20260102T030405Z"))
    day = run["cycles"]["day"][0].as_py()
    path = older(store, "north", f"{day:%Y-%m}")
    add_rows(store, "north", [run])
    table = pq.ParquetFile(path).read()
    assert table.schema.names == schema_of("cycles").names
    assert sorted(table["run"].to_pylist()) == ["20260102T030405Z"] * 2 + ["old"]
    assert int(pq.read_schema(path).metadata[b"facetd.schema"]) == VERSION


def test_a_month_that_a_newer_release_began_is_left_alone(store: Store, cell: CellMaker) -> None:
    run = rows_of(read_digest(cell("north") / "20260102T030405Z"))
    month = f"{run['cycles']['day'][0].as_py():%Y-%m}"
    path = older(store, "north", month)
    newer = pq.ParquetFile(path).read().replace_schema_metadata({b"facetd.schema": b"99"})
    pq.write_table(newer, path)
    before = path.read_bytes()
    with pytest.raises(StoreError, match=f"is of schema 99, this release knows {VERSION}: collect with a newer one"):
        add_month(store, "cycles", "north", month, run["cycles"])
    assert path.read_bytes() == before


def test_rows_of_a_run_are_replaced_not_doubled_and_sorted_by_day(store: Store, cell: CellMaker) -> None:
    runs = cell("north", "20260103", "20260102")
    given = [rows_of(read_digest(folder)) for folder in sorted(runs.iterdir(), reverse=True)]
    for run in (*given, given[0]):
        add_rows(store, "north", [run])
    assert open_views(store).execute("SELECT count(*), count(DISTINCT run) FROM cycles").fetchone() == (4, 2)
    days = open_views(store).execute("SELECT day FROM cycles").fetchnumpy()["day"]
    assert (days[1:] >= days[:-1]).all()


def test_other_readers_find_the_documented_columns(store: Store, cell: CellMaker) -> None:
    collect(store, [source_of(f"{name}={cell(name)}") for name in ("7", "north")])
    for name in TABLES:
        if name == "faults":
            continue
        found = dataset.dataset(store.path("tables", name), partitioning="hive").to_table()
        assert set(found.column_names) == {c.name for c in TABLES[name].columns} | {"cell", "month"}
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    assert set(pandas.read_parquet(store.path("tables", "cycles"))["outcome"]) == {"picked"}
    assert {cell for (cell,) in open_views(store).execute("SELECT cell FROM runs").fetchall()} == {"7", "north"}
