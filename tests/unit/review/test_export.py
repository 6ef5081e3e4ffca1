"""MCAP is read back by its own library; the guide names every kind of record."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from daemon import ctl
from daemon.review.export import frame_transform, messages_of, nanoseconds_of
from daemon.store import folders
from tests.fakes.made_run import MadeRun
from tests.manuals.records import document

reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")

GUIDE = (folders.HOUSE / "deploy" / "RUNS.md").read_text()


@pytest.fixture
def made(tmp_path: Path) -> MadeRun:
    made = MadeRun(tmp_path / "runs" / "20260102T030405Z")
    made.pick()
    made.pick("missed", label="pyramid")
    made.close()
    return made


def test_the_guide_names_every_kind_of_record() -> None:
    assert document() in GUIDE, "python -m tests.manuals writes it into deploy/RUNS.md"


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


def test_a_pose_is_a_place_in_metres_and_a_quaternion() -> None:
    """A quarter turn about z, and half a turn about y."""
    about_z = [[0.0, -1.0, 0.0, 100.0], [1.0, 0.0, 0.0, 200.0], [0.0, 0.0, 1.0, -300.0], [0.0, 0.0, 0.0, 1.0]]
    ((topic, _, message),) = frame_transform({"sec": 1, "nsec": 2}, "world", "tool", about_z)
    assert (topic, message["parent_frame_id"], message["child_frame_id"]) == ("/tf", "world", "tool")
    assert message["timestamp"] == {"sec": 1, "nsec": 2}
    assert message["translation"] == {"x": 0.1, "y": 0.2, "z": -0.3}
    half = np.sqrt(0.5)
    assert message["rotation"] == pytest.approx({"x": 0.0, "y": 0.0, "z": half, "w": half})
    ((_, _, turned),) = frame_transform({}, "a", "b", np.diag([-1.0, 1, -1, 1]).tolist())
    assert {name: abs(value) for name, value in turned["rotation"].items()} == pytest.approx(
        {"x": 0.0, "y": 1.0, "z": 0.0, "w": 0.0}, abs=1e-9
    )
    ((_, _, same),) = frame_transform({}, "a", "b", np.eye(4).tolist())
    assert same["rotation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    assert frame_transform({}, "a", "b", None) == []


def test_a_moment_is_told_in_nanoseconds_to_the_millisecond() -> None:
    assert nanoseconds_of({"t": "1970-01-02T00:00:01.234Z"}) == 86_401_234_000_000
    assert nanoseconds_of({}) == 0


def test_a_line_of_the_log_holds_the_record_but_for_what_has_a_place_of_its_own(tmp_path: Path) -> None:
    record = {"v": 1, "seq": 3, "t": "2026-01-02T03:04:05.000Z", "kind": "look", "cycle": 7, "scene": {"parts": []}}
    stamp = 1_767_322_345_123_456_789
    (_, _, message), *_ = [found for found in messages_of(tmp_path, record, stamp) if found[0] == "/log"]
    assert message["timestamp"] == {"sec": 1_767_322_345, "nsec": 123_456_789}
    assert json.loads(message["message"]) == {"kind": "look", "cycle": 7}
