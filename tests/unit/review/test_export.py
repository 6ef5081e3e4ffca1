"""MCAP and Parquet are read back by their own libraries; the documented queries run."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from daemon import ctl
from daemon.review.tables import CYCLE_COLUMNS, LOOK_COLUMNS
from daemon.store import places
from daemon.store.runlog import KINDS
from tests.worlds.made_run import MadeRun

duckdb = pytest.importorskip("duckdb", reason="duckdb is not installed")
reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")

GUIDE = (places.HOUSE / "deploy" / "RUNS.md").read_text()
QUERIES = re.findall(r"```sql\n(.*?)```", GUIDE, re.DOTALL)


@pytest.fixture
def made(tmp_path: Path) -> MadeRun:
    made = MadeRun(tmp_path / "runs" / "20260102T030405Z")
    made.pick()
    made.pick("missed", label="pyramid")
    made.close()
    return made


def test_a_fleet_of_cells_is_read_with_the_documented_queries(made: MadeRun, tmp_path: Path) -> None:
    runs = ["--runs", str(made.folder.parent)]
    for cell in ("north", "south", "south"):
        assert ctl.main(["export", *runs, "--parquet", "--out", str(tmp_path / "fleet"), "--cell", cell]) == 0
    assert len(QUERIES) == 3
    answers = [duckdb.sql(q.replace("STORE", str(tmp_path / "fleet"))).fetchall() for q in QUERIES]
    assert sorted(answers[0])[:2] == [("north", "cube", 0, 1), ("north", "pyramid", 1, 1)]
    assert len(answers[0]) == 4
    assert answers[1][0][1] == 0.7
    assert {row[0] for row in answers[2]} == {"north", "south"}


def test_the_guide_names_every_column_in_its_order() -> None:
    for name, columns in (("cycles", CYCLE_COLUMNS), ("looks", LOOK_COLUMNS)):
        assert f"| `{name}` | {', '.join(columns)} |" in GUIDE


def test_the_guide_names_every_kind_of_record() -> None:
    table = GUIDE.split("## run.jsonl")[1].split("## Reading")[0]
    assert set(re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (`[^|]*)\|", table, re.MULTILINE)))) == set(KINDS)


def test_an_mcap_file_is_read_back_with_every_image_pose_and_line(made: MadeRun, tmp_path: Path) -> None:
    out = tmp_path / "run.mcap"
    assert ctl.main(["export", "--runs", str(made.folder.parent), "--mcap", "--out", str(out)]) == 0
    seen: dict[str, list[dict[str, object]]] = {}
    with out.open("rb") as file:
        for schema, channel, message in reader.make_reader(file).iter_messages():
            content = json.loads(message.data)
            assert set(content) <= set(json.loads(schema.data)["properties"])
            seen.setdefault(channel.topic, []).append(content)
    assert len(seen["/left/image"]) == len(seen["/right/image"]) == 6
    assert len(seen["/estimate"]) == 4
    assert {m["child_frame_id"] for m in seen["/tf"]} == {"cyclopean", "tool", "part:cube", "part:pyramid"}
    assert len(seen["/log"]) == len((made.folder / "run.jsonl").read_text().splitlines())
