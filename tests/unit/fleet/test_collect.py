"""Runs of many cells in one store: each once, checked, nothing lost however a collection ends."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from daemon import ctl
from daemon.fleet.collect import collect, source_of
from daemon.fleet.store import Store, StoreError, open_store
from daemon.fleet.views import open_views
from tests.fakes.made_run import MadeRun, quiet
from tests.unit.fleet.conftest import CellMaker

for needed in ("pyarrow", "fsspec", "duckdb"):
    pytest.importorskip(needed, reason=f"{needed} is not installed: make extra-fleet")


def picks(store: Store) -> list[tuple[str, int]]:
    found: list[tuple[str, int]] = (
        open_views(store).execute("SELECT cell, count(*) FROM cycles GROUP BY cell ORDER BY cell").fetchall()
    )
    return found


def test_each_run_is_collected_once_with_every_file_and_its_rows(store: Store, cell: CellMaker) -> None:
    sources = [source_of(f"{name}={cell(name, '20260102', '20260203')}") for name in ("north", "south")]
    told = collect(store, sources)
    assert (told.collected, told.known, told.lines) == (4, 0, [])
    assert picks(store) == [("north", 4), ("south", 4)]
    there = Path(store.path("runs", "north", "20260102T030405Z"))
    here = Path(sources[0].where) / "20260102T030405Z"
    names = set(store.manifest("north", "20260102T030405Z").files)
    assert {"run.jsonl", "wire.jsonl", "images/000003-left.png"} <= names
    assert all((there / name).read_bytes() == (here / name).read_bytes() for name in names)
    again = collect(store, sources)
    assert (again.collected, again.known) == (0, 4)
    assert picks(store) == [("north", 4), ("south", 4)]


def test_the_same_run_under_another_name_is_not_taken_twice(store: Store, cell: CellMaker) -> None:
    runs = cell("north")
    told = collect(store, [source_of(f"north={runs}"), source_of(f"copy={runs}")])
    assert told.collected == 1
    assert told.lines == ["copy/20260102T030405Z: is the same run as north/20260102T030405Z; not collected twice"]
    assert store.names("runs", "copy") == []


@pytest.mark.parametrize("after", [0, 3, 12])
def test_a_collection_cut_off_anywhere_goes_on_where_it_was(
    store: Store, cell: CellMaker, monkeypatch: pytest.MonkeyPatch, after: int
) -> None:
    source = source_of(f"north={cell('north')}")
    put, copied = Store.put, list[str]()

    def torn(self: Store, folder: Path, name: str, *parts: str) -> tuple[int, str]:
        if len(copied) == after:
            raise OSError("pulled out")
        copied.append(name)
        return put(self, folder, name, *parts)

    with monkeypatch.context() as patched:
        patched.setattr(Store, "put", torn)
        with pytest.raises(OSError, match="pulled out"):
            collect(store, [source])
    assert store.collected() == {}
    before = {f: f.stat().st_mtime_ns for f in Path(store.path("runs")).rglob("*.png")} if after else {}
    assert collect(store, [source]).collected == 1
    assert picks(store) == [("north", 2)]
    assert all(f.stat().st_mtime_ns == then for f, then in before.items())


def test_cut_off_before_its_manifest_a_run_is_in_the_table_once(
    store: Store, cell: CellMaker, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = source_of(f"north={cell('north')}")
    with monkeypatch.context() as patched:
        patched.setattr(Store, "write", lambda *_: (_ for _ in ()).throw(OSError("full")))
        with pytest.raises(OSError, match="full"):
            collect(store, [source])
    collect(store, [source])
    assert picks(store) == [("north", 2)]


def damaged(run: Path, how: str) -> None:
    lines = (run / "run.jsonl").read_bytes().splitlines(keepends=True)
    if how == "a line is gone":
        (run / "run.jsonl").write_bytes(b"".join(lines[:3] + lines[4:]))
    elif how == "a line is garbled":
        (run / "run.jsonl").write_bytes(b"".join([*lines[:3], b"\x00" * 40 + b"\n", *lines[4:]]))
    elif how == "the ledger was altered":
        wire = (run / "wire.jsonl").read_bytes().replace(b"DO ENABLE", b"DO NOTHING")
        (run / "wire.jsonl").write_bytes(wire)
    elif how == "a kept file was changed":
        next((run / "kept").glob("*.yaml")).write_text("version: 2\n")
    elif how == "a picture was cut short":
        picture = next((run / "images").glob("*.png"))
        picture.write_bytes(picture.read_bytes()[:-20])
    elif how == "a picture is gone":
        next((run / "images").glob("*.png")).unlink()


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("a line is gone", "record 4 follows record 2"),
        ("a line is garbled", "run.jsonl:4: unreadable line"),
        ("the ledger was altered", "wire.jsonl:2: does not follow from the line before it"),
        ("a kept file was changed", "changed: its content"),
        ("a picture was cut short", "not a complete image"),
        ("a picture is gone", "the image of a recorded look is missing"),
    ],
)
def test_a_damaged_run_is_told_of_set_apart_and_stays_on_its_cell(
    store: Store, tmp_path: Path, how: str, words: str
) -> None:
    runs = tmp_path / "north"
    for day in ("20260102", "20260103"):
        made = MadeRun(runs / f"{day}T030405Z")
        made.pick()
        for text in ("DO ENABLE", "WHERE"):
            made.log.wire({"seq": 0 if text == "DO ENABLE" else 1, "text": text})
        made.close()
    damaged(runs / "20260102T030405Z", how)
    quiet(runs)
    told = collect(store, [source_of(f"north={runs}")], free=True)
    assert (told.collected, told.apart, told.freed) == (1, 1, 0)
    (line,) = told.lines
    assert line.startswith("north/20260102T030405Z: damaged, set apart: ")
    assert words in line
    assert words in store.read("apart", "north", "20260102T030405Z.txt").decode()
    assert (runs / "20260102T030405Z" / "run.jsonl").is_file()
    assert picks(store) == [("north", 1)]


def test_what_a_killed_daemon_leaves_is_no_damage(store: Store, tmp_path: Path) -> None:
    runs = tmp_path / "north"
    for day in ("20260102", "20260103"):
        made = MadeRun(runs / f"{day}T030405Z")
        made.pick()
        made.log.wire({"seq": 0, "text": "WHERE"})
        made.close()
    for name in ("run.jsonl", "wire.jsonl"):
        file = runs / "20260102T030405Z" / name
        file.write_bytes(file.read_bytes()[:-9])
    quiet(runs)
    told = collect(store, [source_of(f"north={runs}")])
    assert (told.collected, told.lines) == (2, [])


def test_a_run_that_goes_on_waits_and_so_does_one_that_was_just_written(store: Store, tmp_path: Path) -> None:
    runs = tmp_path / "north"
    fresh, open_ = MadeRun(runs / "20260102T030405Z"), MadeRun(runs / "20260103T030405Z")
    fresh.pick()
    fresh.close()
    told = collect(store, [source_of(f"north={runs}")])
    assert (told.collected, told.waiting) == (0, 2)
    quiet(runs)
    told = collect(store, [source_of(f"north={runs}")])
    assert (told.collected, told.waiting) == (1, 1)
    open_.close()


def test_the_disk_of_a_cell_is_freed_of_what_is_safe_and_of_nothing_else(store: Store, cell: CellMaker) -> None:
    runs = cell("north", "20260102", "20260103", "20260104")
    source = source_of(f"north={runs}")
    collect(store, [source])
    (runs / "20260103T030405Z" / "images" / "000003-left.png").write_bytes(b"another")
    told = collect(store, [source], free=True)
    assert told.freed == 1
    assert told.lines == ["north/20260103T030405Z: differs from what was collected; it stays on the cell"]
    assert sorted(folder.name[:8] for folder in runs.iterdir()) == ["20260103", "20260104"]
    assert picks(store) == [("north", 6)]


def test_nothing_is_freed_where_the_store_lost_a_file(store: Store, cell: CellMaker) -> None:
    runs = cell("north", "20260102", "20260103")
    source = source_of(f"north={runs}")
    collect(store, [source])
    Path(store.path("runs", "north", "20260102T030405Z", "run.jsonl")).write_bytes(b"")
    told = collect(store, [source], free=True)
    assert told.freed == 0
    assert "in the store" in told.lines[0]
    assert len(list(runs.iterdir())) == 2


def test_a_cell_that_is_not_there_keeps_nobody_from_the_others(store: Store, cell: CellMaker, tmp_path: Path) -> None:
    told = collect(store, [source_of(f"gone={tmp_path}/none"), source_of(f"north={cell('north')}")])
    assert told.collected == 1
    assert told.lines == [f"gone: {tmp_path}/none: no such folder of runs"]


def test_a_run_that_cannot_be_read_keeps_nobody_from_the_cells_others(store: Store, cell: CellMaker) -> None:
    runs = cell("north", "20260102", "20260103")
    (runs / "20260102T030405Z" / "wire.jsonl").unlink()
    (runs / "20260102T030405Z" / "run.jsonl").unlink()
    os.symlink("/dev/zero", runs / "20260102T030405Z" / "run.jsonl")
    file = runs / "20260101T030405Z" / "run.jsonl"
    file.parent.mkdir()
    file.write_bytes(b"")
    quiet(runs)
    told = collect(store, [source_of(f"north={runs}")])
    assert (told.collected, told.lines) == (2, []), (
        "what is not a file is no run; a daemon that died at once left nothing"
    )
    assert picks(store) == [("north", 2)]


def test_a_file_that_goes_away_meanwhile_is_told_of(
    store: Store, cell: CellMaker, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = cell("north", "20260102", "20260103")
    put = Store.put

    def gone(self: Store, folder: Path, name: str, *parts: str) -> tuple[int, str]:
        if folder.name.startswith("20260102") and name.startswith("kept/"):
            (folder / name).unlink()
        return put(self, folder, name, *parts)

    monkeypatch.setattr(Store, "put", gone)
    told = collect(store, [source_of(f"north={runs}")])
    assert told.collected == 1
    assert told.lines[0].startswith("north/20260102T030405Z: damaged, stays on its cell: ")


def test_a_bucket_is_a_store_as_a_folder_is(cell: CellMaker) -> None:
    bucket = open_store(f"memory://plant{time.monotonic_ns()}/facetd")
    sources = [source_of(f"north={cell('north', '20260102', '20260103')}")]
    assert collect(bucket, sources, free=True).collected == 2
    assert picks(bucket) == [("north", 4)]
    assert collect(bucket, sources).collected == 0
    assert len(list(Path(sources[0].where).iterdir())) == 1


@pytest.mark.parametrize("text", ["north", "north=", "=x", "no/rth=x", "a,b=x"])
def test_a_source_without_name_or_place_is_refused(text: str) -> None:
    with pytest.raises(StoreError, match="expected CELL=FOLDER"):
        source_of(text)


def test_a_cell_is_reached_by_rsync_over_ssh(
    store: Store, cell: CellMaker, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if shutil.which("rsync") is None:
        pytest.skip("rsync is not installed")
    runs = cell("north", "20260102", "20260103")
    ssh = tmp_path / "bin" / "ssh"
    ssh.parent.mkdir()
    ssh.write_text(
        '#!/bin/sh\nwhile [ "$1" = -o ]; do shift 2; done\n[ "$1" = cell ] || exit 255\nshift\nexec sh -c "$*"\n'
    )
    ssh.chmod(0o755)
    monkeypatch.setenv("PATH", f"{ssh.parent}:{os.environ['PATH']}")
    told = collect(store, [source_of(f"north=cell:{runs}"), source_of("far=nobody:/runs")], free=True)
    assert (told.collected, told.freed) == (2, 1)
    assert [line.split(":")[0] for line in told.lines] == ["far"]
    assert [folder.name for folder in runs.iterdir()] == ["20260103T030405Z"]
    assert picks(store) == [("north", 4)]


def test_the_command_says_what_it_did(cell: CellMaker, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = cell("north", "20260102", "20260103")
    assert ctl.main(["runs", "collect", f"north={runs}", "--into", str(tmp_path / "plant"), "--free"]) == 0
    assert "2 runs collected" in capsys.readouterr().out
    assert ctl.main(["runs", "collect", "--free", f"north={runs}", "--into", str(tmp_path / "plant")]) == 0
    with pytest.raises(SystemExit, match="2"):
        ctl.main(["runs", "collect", f"north={runs}"])
    assert "usage: facetctl runs collect" in capsys.readouterr().err


def test_without_the_extra_one_line_says_what_installs_it(tmp_path: Path) -> None:
    code = "import sys; sys.modules['fsspec'] = None; from daemon import ctl; sys.exit(ctl.main(sys.argv[1:]))"
    done = subprocess.run(
        [os.sys.executable, "-c", code, "runs", "collect", f"a={tmp_path}", "--into", str(tmp_path)],  # type: ignore[attr-defined]
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "extra-fleet" in done.stderr


def test_a_file_of_somebody_elses_among_the_manifests_is_passed_over(store: Store, cell: CellMaker) -> None:
    collect(store, [source_of(f"north={cell('north')}")])
    store.write(b"{}", "collected", "notes.json")
    assert list(store.collected()) == [("north", "20260102T030405Z")]
