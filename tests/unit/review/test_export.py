"""MCAP is read back by its own library; the guide names every kind of record."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from daemon import ctl
from daemon.store import places
from daemon.store.runlog import KINDS
from tests.worlds.made_run import MadeRun

reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")

GUIDE = (places.HOUSE / "deploy" / "RUNS.md").read_text()


@pytest.fixture
def made(tmp_path: Path) -> MadeRun:
    made = MadeRun(tmp_path / "runs" / "20260102T030405Z")
    made.pick()
    made.pick("missed", label="pyramid")
    made.close()
    return made


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
