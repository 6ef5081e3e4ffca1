"""The run log: every record written whole, through kills, full disks and disks that hang."""

from __future__ import annotations

import errno
import os
import random
import signal
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from daemon.store.recovery_state import RecoveryFile, read_interrupted_state
from daemon.store.runlog import RunLog, _Worker
from daemon.store.runs import check_wire, read_run
from tests.fakes.waiting import until

NOW = datetime(2026, 11, 21, 10, tzinfo=UTC)


@pytest.fixture
def log(tmp_path: Path) -> Iterator[RunLog]:
    log = RunLog(tmp_path / "run", wall=lambda: NOW, clock=lambda: 12.5)
    yield log
    log.close()


def image(value: int = 7) -> np.ndarray:
    return np.full((48, 64), value, np.uint8)


def test_a_record_carries_version_number_both_clocks_and_kind(log: RunLog) -> None:
    log.record("decision", cycle=3, text="go on", margin=np.float64(1.5))
    log.record("move", target=np.eye(4), purpose=Path("a/b"), speed_pct=float("nan"))
    log.close()
    first, second, end = read_run(log.folder).records
    assert first == {
        "v": 2, "seq": 0, "t": "2026-11-21T10:00:00.000Z", "mono_s": 12.5, "kind": "decision",
        "cycle": 3, "text": "go on", "margin": 1.5,
    }  # fmt: skip
    assert (second["target"], second["purpose"], second["speed_pct"]) == (np.eye(4).tolist(), "a/b", None)
    assert (end["kind"], end["why"], end["seq"]) == ("run_end", "stopped", 2)


def test_the_images_of_a_look_lie_beside_it_under_its_number(log: RunLog) -> None:
    log.record("decision", text="look")
    log.record("look", cycle=1, images={"left": image(7), "right": image(9)})
    assert log.settle()
    look = read_run(log.folder).records[1]
    assert look["images"] == {"left": "images/000001-left.png", "right": "images/000001-right.png"}
    got = [cv2.imread(str(log.folder / name), cv2.IMREAD_UNCHANGED) for name in look["images"].values()]
    assert np.array_equal(got, [image(7), image(9)])


def test_a_file_is_kept_once_by_its_content(log: RunLog, tmp_path: Path) -> None:
    for name in ("a.yaml", "b.yaml"):
        (tmp_path / name).write_text("x: 1\n")
    assert log.keep(tmp_path / "a.yaml") == log.keep(tmp_path / "b.yaml")
    assert [p.read_text() for p in (log.folder / "kept").iterdir()] == ["x: 1\n"]


def test_a_run_is_never_written_over(log: RunLog) -> None:
    with pytest.raises(FileExistsError):
        RunLog(log.folder)


def test_rolling_ends_one_run_and_goes_on_in_the_next(log: RunLog, tmp_path: Path) -> None:
    first = log.folder
    log.record("decision", text="in the first")
    log.roll(tmp_path / "second")
    log.record("decision", text="in the second")
    log.close()
    assert [r["kind"] for r in read_run(first).records] == ["decision", "run_end"]
    assert [r["text"] for r in read_run(tmp_path / "second").records[:1]] == ["in the second"]


WRITER = """
import sys, itertools
from pathlib import Path
import numpy as np
from daemon.store.runlog import RunLog, _Worker
log = RunLog(Path(sys.argv[1]))
picture = np.zeros((480, 640), np.uint8)
for n in itertools.count():
    if n % 10 == 0:
        log.record("look", n=n, images={"left": picture, "right": picture})
    else:
        log.record("decision", n=n, text="x" * (n % 700))
    log.wire({"n": n})
    print(n, flush=True)
"""


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_kill_minus_nine_at_any_moment_loses_at_most_the_last_line(tmp_path: Path) -> None:
    chance = random.Random(5)
    for trial in range(int(os.environ.get("FACETD_KILLS", "8"))):
        folder = tmp_path / str(trial)
        writer = subprocess.Popen([sys.executable, "-c", WRITER, str(folder)], stdout=subprocess.PIPE, text=True)
        assert writer.stdout is not None
        writer.stdout.readline()
        time.sleep(chance.uniform(0, 0.3))
        writer.send_signal(signal.SIGKILL)
        said = [int(line) for line in writer.stdout.read().split() or ["0"]]
        writer.stdout.close()
        writer.wait()
        run = read_run(folder)
        numbers = [r["n"] for r in run.records if r["kind"] != "gap"]  # this writer outruns its pictures
        assert numbers == list(range(len(numbers))), "a line is missing from the middle"
        assert len(numbers) >= said[-1] + 1, "a line that was acknowledged is not in the file"
        assert len(run.skipped) <= 1
        assert [p for p in check_wire(folder) if "torn" not in p] == []
        for picture in (folder / "images").glob("*.png"):
            assert cv2.imread(str(picture), cv2.IMREAD_UNCHANGED) is not None, "half a picture under its final name"
        assert not any(r["kind"] == "run_end" for r in run.records)


def test_a_log_cut_at_any_byte_of_its_last_record_is_read_and_the_torn_line_named(log: RunLog, tmp_path: Path) -> None:
    for n in range(3):
        log.record("decision", n=n, text="ä line")
    log.close()
    content = (log.folder / "run.jsonl").read_bytes()
    last = content.rstrip(b"\n").rfind(b"\n") + 1
    folder = tmp_path / "cut"
    folder.mkdir()
    for length in range(last, len(content)):
        (folder / "run.jsonl").write_bytes(content[:length])
        run = read_run(folder)
        whole = length == len(content) - 1
        assert len(run.records) == (4 if whole else 3)
        assert len(run.skipped) == (0 if whole or length == last else 1)
        assert all("torn last line" in text for text in run.skipped)


MANY = 10_000


class Disk:
    """os.write as seen by a full or a hanging disk, for the log's files only."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.full, self.half = False, False
        self.writes = threading.Semaphore(MANY)
        """So many are let through; then the disk hangs."""
        self._write = os.write
        monkeypatch.setattr("daemon.store.files.os.write", self.write)

    def write(self, handle: int, content: bytes) -> int:
        self.writes.acquire()
        if self.full and self.half:
            return self._write(handle, content[: len(content) // 2])
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device")
        return self._write(handle, content)


@pytest.mark.parametrize("half", [False, True])
def test_a_full_disk_is_told_and_the_gap_is_in_the_log_when_there_is_room_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, half: bool
) -> None:
    disk, told = Disk(monkeypatch), []
    log = RunLog(tmp_path / "run", on_trouble=told.append)
    log.record("decision", n=0)
    disk.full, disk.half = True, half
    for n in range(1, 6):
        log.record("decision", n=n)
    assert log.settle()
    assert log.trouble is not None
    assert "No space left on device" in log.trouble
    disk.full = False
    log.record("decision", n=6)
    log.close()
    run = read_run(log.folder)
    assert run.skipped == ()
    assert [r.get("n") for r in run.records] == [0, None, 6, None]
    assert run.records[1]["lost"] == 5
    assert run.records[1]["why"] == told[0]
    assert told[-1] is None
    assert len(told) == 2, "each change is told once"


def test_a_full_disk_is_told_once_whatever_it_does_not_take(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Log and ledger told it by turns, at every frontend, ten times a move."""
    disk, told = Disk(monkeypatch), []
    log = RunLog(tmp_path / "run", on_trouble=told.append)
    disk.full = True
    for n in range(5):
        log.record("decision", n=n)
        log.wire({"seq": n, "sent": "where"})
    assert log.settle()
    assert told == [f"{tmp_path / 'run'}: No space left on device"]
    log.close()


def test_pictures_that_pile_up_are_let_go_and_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daemon.store.runlog.PICTURES_WAITING", -1)
    log = RunLog(tmp_path / "run")
    log.record("look", images={"left": image(), "right": image()})
    log.record("decision")
    log.close()
    gaps = [record for record in read_run(log.folder).records if record["kind"] == "gap"]
    assert sum(gap["lost"] for gap in gaps) == 2
    assert {gap["why"] for gap in gaps} == {"the disk did not keep up"}
    assert list((tmp_path / "run" / "images").iterdir()) == []


def test_a_hanging_disk_does_not_hold_up_the_one_who_records(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = Disk(monkeypatch)
    log = RunLog(tmp_path / "run", patience_s=0.01)
    disk.writes = threading.Semaphore(0)
    for n in range(5):
        log.record("move", n=n)
    disk.writes.release(MANY)
    log.close()
    assert [r["n"] for r in read_run(log.folder).records[:5]] == [0, 1, 2, 3, 4]


def test_a_line_changed_in_the_wire_ledger_is_found(log: RunLog) -> None:
    for n in range(4):
        log.wire({"n": n, "sent": "where"})
    log.close()
    assert check_wire(log.folder) == []
    path = log.folder / "wire.jsonl"
    path.write_bytes(path.read_bytes().replace(b'{"n":1,', b'{"n":8,'))
    assert check_wire(log.folder) == ["wire.jsonl:3: does not follow from the line before it"]


def test_entries_that_a_full_disk_swallowed_are_counted_in_the_wire_ledger(log: RunLog) -> None:
    for n in range(9):
        log.wire({"seq": n, "sent": "where"})
    log.close()
    path = log.folder / "wire.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:3] + lines[7:]))
    assert check_wire(log.folder) == ["wire.jsonl:4: 4 entries are missing before it"]


def test_moments_are_told_to_the_microsecond(tmp_path: Path) -> None:
    log = RunLog(tmp_path / "run", clock=lambda: 12.34567891)
    log.close()
    assert read_run(log.folder).records[0]["mono_s"] == 12.345679


def test_a_stalled_disk_is_waited_for_once_and_one_that_is_full_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    patience_s, waits = 0.0123, []

    class Counted(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            if timeout == patience_s:
                waits.append(timeout)
            return super().wait(timeout)

    disk = Disk(monkeypatch)
    monkeypatch.setattr(threading, "Event", Counted)
    log = RunLog(tmp_path / "run", patience_s=patience_s)
    disk.writes = threading.Semaphore(0)
    for n in range(20):
        log.record("move", n=n)
    until(lambda: disk.writes.release() or log._lines.waiting <= 17)
    log.record("move", n=20)
    assert len(waits) == 1, "no more until it has caught up"
    disk.writes.release(MANY)
    until(lambda: not log._behind)
    log.record("move", n=21)
    assert len(waits) == 2
    disk.full = True
    log.record("move", n=23)
    assert log.settle()
    assert log.trouble is not None
    waits.clear()
    for n in range(4):
        log.record("move", n=n)
    assert waits == []
    disk.full = False
    log.close()


def test_settled_is_what_is_written_pictures_and_all_and_on_the_disk(log: RunLog) -> None:
    log.record("decision")
    held = threading.Event()
    for worker in (log._lines, log._pictures):
        worker.do(partial(held.wait, 10.0))
        assert not log.settle(0.05)
        held.set()
        assert log.settle()
        held.clear()
    log._syncer.wait_until_written = lambda timeout_s: False
    assert not log.settle()


def test_a_picture_that_the_disk_does_not_take_is_told_with_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str | None] = []

    def full(path: Path, *_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    log = RunLog(tmp_path / "run", on_trouble=told.append)
    monkeypatch.setattr("daemon.store.runlog.write_atomically", full)
    log.record("look", images={"left": image()})
    assert log.settle()
    log.record("decision")
    log.close()
    assert f"{tmp_path}/run/images/000000-left.png: No space left on device" in told
    (gap,) = [record for record in read_run(log.folder).records if record["kind"] == "gap"]
    assert gap["lost"] == 1


def test_what_a_full_disk_refused_is_written_once_it_has_room_and_the_trouble_ends_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It stood until the next look, hours after room had been made; and the pictures were gone."""
    standing = RecoveryFile(tmp_path / "standing")
    standing.begin("run")
    log = RunLog(tmp_path / "run", recovery=standing)

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as disk:
        disk.setattr("daemon.store.runlog.write_atomically", full)
        disk.setattr(standing, "write", full)
        log.record("look", images={"left": image(), "right": image()})
        log.record("hand", closed=True)
        assert log.settle()
        assert log.trouble is not None
    log.wire({"seq": 0, "sent": "where"})
    for _ in ("the line", "then one picture", "then the other"):
        assert log.settle()
    assert log.trouble is None
    assert sorted(path.name for path in (log.folder / "images").iterdir()) == ["000000-left.png", "000000-right.png"]
    log.close()
    assert not [record for record in read_run(log.folder).records if record["kind"] == "gap"]
    known = read_interrupted_state(tmp_path / "standing", ran_before=True)
    assert known is not None
    assert known.hand_closed


def test_a_disk_that_takes_a_line_and_then_cannot_keep_it_is_told_until_it_can(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Such a line is read back from memory, and gone with the power: nobody was told. What a restart must know is
    written again: a second try to bring the same bytes to the disk says that they are there, and they are not."""
    told: list[str | None] = []
    standing = RecoveryFile(tmp_path / "standing")
    log = RunLog(tmp_path / "run", recovery=standing, on_trouble=told.append)

    def failing(_: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with monkeypatch.context() as patched:
        patched.setattr("os.fsync", failing)
        for _ in range(3):
            log.record("hand", closed=True)
            assert log.settle()
    assert len(told) == 1, "once, whatever it does not keep"
    assert "not kept: Input/output error" in str(told[0])
    written: list[bytes] = []
    write = os.pwrite
    monkeypatch.setattr("os.pwrite", lambda handle, slot, at: written.append(slot) or write(handle, slot, at))
    log.record("hand", closed=True)
    assert log.settle()
    log.wire({"seq": 0, "sent": "where"})
    assert log.settle()
    assert told[-1] is None
    assert len(written) == 1, "that the hand is closed, which the disk may not have, and once"
    log.close()


def test_what_was_not_kept_of_a_run_is_no_trouble_of_the_next_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = RunLog(tmp_path / "run")

    def failing(_: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with monkeypatch.context() as patched:
        patched.setattr("os.fsync", failing)
        log.record("decision")
        log.wire({"seq": 0, "sent": "where"})
        assert log.settle()
        assert log.trouble is not None
        log.roll(tmp_path / "next")
        assert log.settle()
    log.record("decision")
    assert log.settle()
    assert log.trouble is None
    log.close()


def test_a_file_s_name_that_is_no_utf_8_does_not_keep_a_fault_out_of_the_log(tmp_path: Path) -> None:
    """Nor does it end the thread that writes, and with it every record after."""
    odd = os.fsdecode(b"/media/caf\xe9.yaml")
    log = RunLog(tmp_path / "run", recovery=RecoveryFile(tmp_path / "standing"))
    log.record("fault", code="files", text=f"{odd}: cannot be read", more={"files": [Path(odd), odd]})
    log.record("decision", text="goes on")
    assert log.settle()
    log.close()
    fault, after, end = read_run(log.folder).records
    assert fault["text"] == "/media/caf?.yaml: cannot be read"
    assert fault["more"] == {"files": ["/media/caf?.yaml"] * 2}
    assert (after["text"], end["kind"]) == ("goes on", "run_end")
    left = read_interrupted_state(tmp_path / "standing", True)
    assert left is not None
    assert left.fault == "/media/caf?.yaml: cannot be read"


def test_a_job_that_fails_ends_no_thread_and_is_told(log: RunLog, caplog: pytest.LogCaptureFixture) -> None:
    log.record("look", images={"left": np.zeros((0, 0), np.uint8)})
    for worker in (log._lines, log._pictures):
        worker.do(lambda: dict[str, str]()["nothing"])
    log.record("look", images={"left": image()})
    assert log.settle()
    assert (log.folder / "images" / "000001-left.png").exists()
    assert caplog.text.count("KeyError: 'nothing'") == 2


@pytest.mark.parametrize(("kind", "at_once"), [("fault", True), ("hand", True), ("decision", False), ("look", False)])
def test_what_a_restart_must_know_is_brought_to_the_disk_at_once(log: RunLog, kind: str, at_once: bool) -> None:
    hurried: list[str] = []
    log._syncer.hurry = lambda: hurried.append(kind)
    log.record(kind)
    assert hurried == ([kind] if at_once else [])


def test_a_log_that_was_closed_holds_no_file_open(log: RunLog) -> None:
    run = log._run
    log.close()
    for file in (run.lines, run.wire):
        with pytest.raises(OSError, match="Bad file descriptor"):
            file.append(b"late")


def test_a_thread_of_the_log_says_whether_it_came_to_its_end_in_time() -> None:
    worker, gate = _Worker("test"), threading.Event()
    worker.do(gate.wait)
    assert not worker.end(0.05)
    gate.set()
    assert worker.end(30.0)


def test_what_is_kept_and_what_is_seen_hold_nobody_up_until_they_are_on_the_disk(
    log: RunLog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every line is synced some time soon, in a thread of its own; copies and pictures when the kernel likes."""
    taken: list[Path] = []
    monkeypatch.setattr(log._syncer, "take", lambda file: taken.append(file.path))
    synced: list[str] = []
    monkeypatch.setattr("os.fsync", lambda handle: synced.append(os.readlink(f"/proc/self/fd/{handle}")))
    (tmp_path / "model.npz").write_bytes(b"model")
    log.keep(tmp_path / "model.npz")
    log.record("look", images={"left": image()})
    log.wire({"seq": 0, "bytes": "WHERE"})
    until(lambda: len(taken) == 2 and list((log.folder / "images").iterdir()))
    assert {path.name for path in taken} == {"run.jsonl", "wire.jsonl"}
    assert [name for name in synced if "/kept/" in name or "/images/" in name] == []


def test_a_run_is_its_owners_to_write_and_its_groups_to_read(log: RunLog) -> None:
    assert {stat.S_IMODE((log.folder / name).stat().st_mode) for name in ("run.jsonl", "wire.jsonl")} == {0o640}


def test_a_log_that_ends_lets_go_of_what_a_restart_must_know(tmp_path: Path) -> None:
    standing = RecoveryFile(tmp_path / "standing")
    log = RunLog(tmp_path / "run", recovery=standing)
    log.close()
    assert standing._handle < 0


def test_what_a_disk_that_does_not_keep_up_loses_is_counted_line_by_line(
    log: RunLog, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr("daemon.store.runlog.LINES_WAITING", -1)
        for _ in range(3):
            log.record("decision")
    log.record("decision")
    assert log.settle()
    (gap,) = [record for record in read_run(log.folder).records if record["kind"] == "gap"]
    assert (gap["lost"], gap["why"]) == (3, "the disk did not keep up")
