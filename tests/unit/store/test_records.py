"""Lines of a run: every kind that is written is read, and what is not what it must be is named, not stumbled over."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from daemon.review.cli import told
from daemon.review.digest import digest
from daemon.review.pagedata import page_data
from daemon.review.tables import tables
from daemon.store.records import record_of
from daemon.store.runs import read_run
from tests.worlds.made_run import MadeRun, part

HEAD = {"v": 1, "seq": 0, "t": "2026-01-01T00:00:00.000Z", "mono_s": 1.5}


def line(kind: object, **fields: Any) -> bytes:
    return json.dumps({**HEAD, "kind": kind, **fields}).encode()


def test_whatever_is_written_is_read_back_as_it_was(tmp_path: Path) -> None:
    made = MadeRun(tmp_path / "run")
    made.pick("missed")
    made.close()
    run = read_run(made.folder)
    assert run.skipped == ()
    assert [json.loads(text) for text in (made.folder / "run.jsonl").read_text().splitlines()] == list(run.records)


def test_what_a_newer_release_adds_is_passed_on() -> None:
    assert record_of(line("a new kind", anything={"deep": [1]}))["anything"] == {"deep": [1]}
    assert record_of(line("look", scene={"new": {"x": 1}}))["scene"] == {"new": {"x": 1}}


@pytest.mark.parametrize(
    "bad",
    [
        line(["look"]),
        line({}),
        line("look", scene=3),
        line("look", scene={"parts": [3]}),
        line("look", scene={"parts": [{"label": None, "confidence": 1}]}),
        line("look", images={"left": 7}),
        line("look", world_from_cyclopean=[[1]]),
        line("look", health={"findings": []}),
        line("estimate", predicted_mm="near"),
        line("estimate", chi2=1e300),
        line("cycle_end", predicted=[]),
        line("run_start", calibration=["kept/x"]),
        line("fault", text={"a": 1}),
        line("look") + b"}",
        b'{"kind":"look"}',
        line("look").replace(b"2026-01-01", b"2026-99-99"),
        line("look").replace(b"1.5", b"NaN"),
        b"[" * 100_000,
        b'{"a":' * 100_000,
        b"\xff\xfe",
        b"",
        b"3",
        line("look", x="y" * 1_100_000),
    ],
)
def test_a_line_with_wrong_types_is_skipped_and_named_and_the_rest_is_reviewed(bad: bytes, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    good = line("cycle_start", cycle=1) + b"\n" + line("look", scene={"parts": [part("cube")]}) + b"\n"
    (folder / "run.jsonl").write_bytes(good + bad + b"\n" + line("cycle_end", cycle=1))
    run = read_run(folder)
    assert [r["kind"] for r in run.records] == ["cycle_start", "look", "cycle_end"]
    assert len(run.skipped) == (len(bad) > 0) + (len(bad) > 1_000_002)
    found = digest("run", run.records)
    json.dumps(page_data(found), allow_nan=False)
    tables(found, "cell")
    assert [told(record) for record in run.records]
