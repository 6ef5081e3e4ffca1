"""Whether a run is what its cell wrote, whatever it says."""

from __future__ import annotations

import os
from datetime import datetime
from pathlib import Path
from unittest.mock import patch

import pytest

from daemon.fleet.layout import utc_time
from daemon.fleet.soundness import damages
from daemon.fleet.store import StoreError, manifest_name, open_store
from daemon.review.brief import read_brief
from daemon.store.runs import read_run
from tests.fakes.made_run import MadeRun


def test_a_picture_whose_name_no_disk_takes_is_a_missing_one(tmp_path: Path) -> None:
    """And ends no collection of the cell's other runs."""
    made = MadeRun(tmp_path / "run")
    made.pick()
    made.close()
    run = read_run(made.folder)
    assert damages(made.folder, run) == []
    look = next(record for record in run.records if record["kind"] == "look")
    for name in ("x" * 300, "images/\0"):
        look["images"] = {"left": name}
        assert damages(made.folder, run) == [f"{name}: the image of a recorded look is missing"]


def test_a_last_entry_without_its_end_is_what_a_killed_daemon_leaves(tmp_path: Path) -> None:
    made = MadeRun(tmp_path / "run")
    made.log.wire({"seq": 0, "text": "WHERE"})
    made.close()
    with (made.folder / "wire.jsonl").open("ab") as file:
        file.write(b'{"seq": 1, "te')
    assert damages(made.folder, read_run(made.folder)) == []
    with (made.folder / "wire.jsonl").open("ab") as file:
        file.write(b"\n")
    assert damages(made.folder, read_run(made.folder)) == ["wire.jsonl:2: torn or unreadable line"]


def test_a_small_z_is_a_zone_as_well() -> None:
    """RFC 3339 lets it be; a run that had it ended the table of all cells."""
    for zone in "zZ":
        assert utc_time(f"2026-11-22T21:54:02.752{zone}") == datetime(2026, 11, 22, 21, 54, 2, 752000)


@pytest.mark.timeout(60)
def test_what_says_that_it_is_as_large_as_no_disk_is_read_no_further_than_a_run_may_be(tmp_path: Path) -> None:
    for name in ("run.jsonl", "wire.jsonl"):
        (tmp_path / name).touch()
        os.truncate(tmp_path / name, 10**13)
    with patch("daemon.store.runs.LARGEST_RUN", 3_000_000):
        assert read_brief(tmp_path).records == ()
        assert "run.jsonl: too large: only its first 3 MB are read" in damages(tmp_path, read_run(tmp_path))


def test_a_manifest_that_is_no_text_is_one_line(tmp_path: Path) -> None:
    pytest.importorskip("fsspec")
    store = open_store(str(tmp_path))
    store.write(b'{"cell\xff": 1}', "collected", manifest_name("a" * 16, "north", "20260102T030405Z"))
    with pytest.raises(StoreError, match=r"collected/.*north"):
        store.manifest("north", "20260102T030405Z")
