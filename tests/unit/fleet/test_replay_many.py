"""What there is to replay, with what, and when two pieces are the same. In earnest: tests/cell/test_cell_fleet.py."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

from daemon.fleet.collect import collect, source_of
from daemon.fleet.replay_many import ReplayWith, Run, jobs_of, replay_with, run_in_folder
from daemon.fleet.replay_page import write_replay_page
from daemon.fleet.replay_results import summed
from daemon.fleet.store import StoreError, open_store
from daemon.store import folders
from tests.fakes.made_run import MadeRun
from tests.unit.fleet.conftest import CellMaker

RUN = Run("north", "20260102T030405Z", "ab" * 32, "/runs/x", False, tuple(range(100)))
CALIBRATION = folders.HOUSE / "etc" / "calibration.yaml"


def test_a_run_is_cut_into_pieces_that_hold_each_look_once() -> None:
    jobs = jobs_of([RUN], ReplayWith(), "/out")
    assert [seq for job in jobs for seq in job.looks] == list(RUN.looks)
    assert max(len(job.looks) for job in jobs) == 40
    assert len({job.key for job in jobs}) == len(jobs)


def test_a_piece_is_another_for_another_run_and_another_model(tmp_path: Path) -> None:
    def keys(run: Run, chosen: ReplayWith) -> set[str]:
        return {job.key for job in jobs_of([run], chosen, "/out")}

    model = tmp_path / "model.npz"
    model.write_bytes(b"1")
    one = ReplayWith((("model", str(model)),))
    first = keys(RUN, one)
    assert first == keys(RUN, one)
    assert not first & keys(RUN, ReplayWith())
    assert not first & keys(Run("north", RUN.name, "cd" * 32, "/runs/x", False, RUN.looks), one)
    model.write_bytes(b"2")
    assert not first & keys(RUN, one)


def test_what_to_replay_with_is_told_by_its_kind(tmp_path: Path) -> None:
    model = tmp_path / "m.npz"
    model.write_bytes(b"")
    chosen = replay_with([str(model), str(CALIBRATION), str(folders.HOUSE / "etc" / "facetd.yaml")])
    assert dict(chosen.files) == {"model": str(model), "calibration": str(CALIBRATION)}
    assert chosen.settings is not None
    with pytest.raises(StoreError, match="a second calibration"):
        replay_with([str(CALIBRATION), str(CALIBRATION)])


def test_a_run_in_a_folder_is_known_by_its_content_and_its_computer(tmp_path: Path) -> None:
    made = MadeRun(tmp_path / "north" / "20260102T030405Z")
    made.pick()
    made.close()
    run = run_in_folder(made.folder)
    assert (run.cell, run.name, len(run.looks), len(run.id)) == ("north", "20260102T030405Z", 3, 64)


def test_without_the_extra_a_cell_replays_its_own_runs_and_many_workers_are_refused_in_a_line(tmp_path: Path) -> None:
    made = MadeRun(tmp_path / "20260102T030405Z", pictures=False)
    made.pick()
    kept = made.log.keep(CALIBRATION)
    text = (made.close() / "run.jsonl").read_text()
    (made.folder / "run.jsonl").write_text(text.replace(text.split('"calibration":"')[1].split('"')[0], kept))
    code = "import sys\nfor n in ('fsspec','pyarrow','distributed','duckdb'): sys.modules[n] = None\n"
    code += "from daemon import ctl; sys.exit(ctl.main(sys.argv[1:]))"

    def said(*words: str) -> subprocess.CompletedProcess[str]:
        words = (sys.executable, "-c", code, "replay", str(made.folder), *words)
        return subprocess.run(words, capture_output=True, text=True, check=False, cwd=tmp_path)

    alone = said()
    assert (alone.returncode, alone.stderr) == (0, "")
    assert "0 looks of 1 run:" in alone.stdout
    many = said("--workers", "2")
    assert (many.returncode, many.stderr.count("\n")) == (2, 1)
    assert "extra-fleet" in many.stderr


def test_a_report_lies_in_a_bucket_and_has_pictures_from_one(cell: CellMaker) -> None:
    for needed in ("fsspec", "pyarrow"):
        pytest.importorskip(needed, reason=f"{needed} is not installed: make extra-fleet")
    bucket = open_store(f"memory://pictures{time.monotonic_ns()}")
    collect(bucket, [source_of(f"north={cell('north')}")])
    change = {"seq": 3, "cycle": 1, "part": "cube", "what": "now unknown: one facet", "regression": True}
    one = {"cell": "north", "run": "20260102T030405Z", "seq": 3, "cycle": 1, "purpose": "survey 1", "whole": True,
           "light": "over 180", "changes": [change], "parts": [], "now": {"parts": []}}  # fmt: skip
    gone = one | {"run": "20250102T030405Z"}
    write_replay_page(bucket, summed([]), [one, gone], [bucket.url], [])
    page = bucket.read("report.html").decode()
    assert page.count("data:image/jpeg;base64,") == 2
    assert "now unknown: one facet" in page


def test_a_difference_whose_picture_is_damaged_is_told_without_it(tmp_path: Path) -> None:
    made = MadeRun(tmp_path / "runs" / "20260102T030405Z")
    made.look("survey")
    run = made.close()
    one = {"cell": "north", "run": run.name, "seq": 1, "changes": [], "parts": [], "whole": True, "now": {}}
    (run / "images" / "000001-left.png").write_bytes(b"")
    page = write_replay_page(open_store(str(tmp_path / "out")), summed([]), [one], [str(run)], [])
    assert '"looks":null' in Path(page).read_text()
