"""Lines of a run: every kind that is written is read, and what is not what it must be is named, not stumbled over."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from daemon.events.records import record_of
from daemon.review.cli import record_line
from daemon.review.digest import digest
from daemon.review.export import tables
from daemon.review.pagedata import page_data
from daemon.store.runs import read_run
from tests.fakes.made_run import MadeRun, part

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
    assert len(run.skipped) == (len(bad) > 0)
    found = digest("run", run.records)
    json.dumps(page_data(found), allow_nan=False)
    tables(found, "cell")
    assert [record_line(record) for record in run.records]


ROW = [1.0, 2.0, 3.0, 4.0]
POSE = [ROW] * 4


def look(**fields: Any) -> bytes:
    return line("look", **fields)


def of_part(**fields: Any) -> bytes:
    return look(scene={"parts": [{"label": "cube", "confidence": 1.0, **fields}]})


@pytest.mark.parametrize(
    ("of", "good", "bad"),
    [
        (lambda it: look(world_from_cyclopean=it), POSE, [POSE[1:], [*POSE, ROW], [*POSE[1:], ROW[1:]]]),
        (lambda it: look(world_from_cyclopean=it), None, [[*POSE[1:], [*ROW, 5.0]], 3]),
        (lambda it: of_part(covariance=it), [[0.0] * 6] * 6, [[[0.0] * 6] * 5, [[0.0] * 6] * 7, [[0.0] * 5] * 6]),
        (lambda it: of_part(covariance=it), None, [[[0.0] * 7] * 6]),
        (lambda it: of_part(facets=[{"corners_mm": [it]}]), ROW[:3], [ROW[:2], ROW]),
        (lambda it: of_part(facets=[{"corners_mm": [], "left_px": [it]}]), ROW[:2], [ROW[:1], ROW[:3]]),
        (lambda it: look(scene={"guesses": [{"left_px": [it]}]}), ROW, [ROW[:3], [*ROW, 5.0]]),
        (lambda it: look(table={"up": it, "level_mm": 0.0}), ROW[:3], [ROW[:2], ROW]),
        (lambda it: look(table={"up": ROW[:3], "level_mm": it}), 1e15, [1.1e15, -1.1e15, None]),
        (lambda it: look(table={"up": ROW[:3], "level_mm": it}), -1e15, ["0"]),
        (lambda it: look(cycle=it), 2**53, [2**53 + 1, -(2**53) - 1, 1.5]),
        (lambda it: look(cycle=it), -(2**53), ["1"]),
        (lambda it: line("run_start", utc_offset_s=it), 86_400, [86_401, -86_401]),
        (lambda it: line("run_start", utc_offset_s=it), -86_400, [1.5]),
        (lambda it: look(seq=it), 2**53, [2**53 + 1, -1, None]),
        (lambda it: look(seq=it), 0, [0.5]),
        (lambda it: look(moved={"eye": it, "left": POSE, "right": POSE, "arm_mm": 1, "arm_deg": 1}), "left", ["both"]),
    ],
)
def test_a_field_is_what_it_may_be_up_to_the_last_number_and_nothing_else(of: Any, good: Any, bad: list[Any]) -> None:
    assert record_of(of(good))
    for wrong in bad:
        with pytest.raises(ValueError, match=r"Expected|Invalid"):
            record_of(of(wrong))


def test_a_line_may_be_a_megabyte_long() -> None:
    long = line("say", x="")
    assert record_of(line("say", x="y" * (1_000_000 - len(long))))
    with pytest.raises(ValueError, match="too long"):
        record_of(line("say", x="y" * (1_000_001 - len(long))))


LOOKS_UP = """
import sys
from daemon.events.records import SCHEMA, record_of
ran = set()
sys.setprofile(lambda frame, event, _: ran.add(frame.f_code.co_filename))
for kind in (*SCHEMA, "command"):
    try:
        record_of(b'{"kind":"%s"}' % kind.encode())
    except ValueError:
        pass
sys.setprofile(None)
print(*ran)
"""


def test_reading_the_first_record_of_a_kind_swallows_no_control_c() -> None:
    """`facetctl tail` ran on after it: it came as the kind's fields were looked up, where msgspec takes every error for
    a field that is not there."""
    told = subprocess.run([sys.executable, "-c", LOOKS_UP], capture_output=True, text=True, check=True, timeout=60.0)
    assert "records.py" in told.stdout
    assert "typing.py" not in told.stdout
    assert "msgspec" not in told.stdout
