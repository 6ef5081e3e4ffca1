"""Bytes onto a disk that is full: the file is named and what to do, and what was there stays."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import Any

import pytest

from daemon.store.files import InUseError, LineFile, OpenFile, Syncer, being_written, hold, plain, write_atomically
from daemon.store.recovery_state import RecoveryFile
from tests.fakes.waiting import PATIENCE_S, until


def full(*_: object) -> int:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_is_told_with_the_file_and_the_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_bytes(b"old")
    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space left") as refused:
        write_atomically(tmp_path / "file", b"new")
    assert plain(refused.value) == f"{tmp_path / 'file'}: No space left on device; free some space there"
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_bytes() == b"old"


@pytest.mark.parametrize("before", [b"old", None])
def test_what_is_told_as_not_written_is_not_there_also_where_the_folder_cannot_be_synced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, before: bytes | None
) -> None:
    """accept was refused, and yet that version was in use at the next start."""
    if before is not None:
        (tmp_path / "file").write_bytes(before)
        (tmp_path / "file").chmod(0o600)
    sync = os.fsync

    def fsync(handle: int) -> None:
        if stat.S_ISDIR(os.fstat(handle).st_mode):
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        sync(handle)

    monkeypatch.setattr("os.fsync", fsync)
    with pytest.raises(OSError, match="Input/output error"):
        write_atomically(tmp_path / "file", b"new")
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == ([("file", b"old")] if before else [])
    if before is not None:
        assert stat.S_IMODE((tmp_path / "file").stat().st_mode) == 0o600


def test_what_cannot_be_put_back_either_is_told_as_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_bytes(b"old")
    sync, replace = os.fsync, os.replace

    def fsync(handle: int) -> None:
        if stat.S_ISDIR(os.fstat(handle).st_mode):
            monkeypatch.setattr("os.replace", full)
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        sync(handle)

    monkeypatch.setattr("os.fsync", fsync)
    with pytest.raises(OSError, match="written, but a power cut may undo it"):
        write_atomically(tmp_path / "file", b"new")
    monkeypatch.setattr("os.replace", replace)
    assert (tmp_path / "file").read_bytes() == b"new"


def test_room_for_what_must_be_known_is_taken_at_the_start_or_the_file_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.posix_fallocate", full)
    with pytest.raises(OSError, match="No space left") as refused:
        RecoveryFile(tmp_path / "standing")
    assert plain(refused.value) == f"{tmp_path / 'standing'}: No space left on device; free some space there"


def test_a_full_disk_keeps_nobody_from_claiming_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.pwrite", full)
    os.close(hold(tmp_path))


def test_a_file_and_its_folder_are_on_the_disk_before_anybody_is_told_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[bool] = []
    monkeypatch.setattr("os.fsync", lambda handle: synced.append(stat.S_ISDIR(os.fstat(handle).st_mode)))
    write_atomically(tmp_path / "a" / "file", b"new")
    assert synced == [False, True]
    write_atomically(tmp_path / "file", b"new", synced=False)
    assert synced == [False, True]
    assert [(tmp_path / name).read_bytes() for name in ("a/file", "file")] == [b"new", b"new"]


def test_a_file_that_is_replaced_keeps_who_may_read_it_and_a_new_one_is_everybodys_to_read(tmp_path: Path) -> None:
    write_atomically(tmp_path / "file", b"old")
    assert stat.S_IMODE((tmp_path / "file").stat().st_mode) == 0o644
    (tmp_path / "file").chmod(0o600)
    write_atomically(tmp_path / "file", b"new")
    assert stat.S_IMODE((tmp_path / "file").stat().st_mode) == 0o600


def test_writing_leaves_no_handle_open(tmp_path: Path) -> None:
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(5):
        write_atomically(tmp_path / "file", b"new")
        being_written(tmp_path / "file")
    assert len(os.listdir("/proc/self/fd")) == before


def test_a_short_write_is_cut_off_again_and_told_as_a_full_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = LineFile(tmp_path / "lines")
    file.append(b"one")
    write = os.write
    with monkeypatch.context() as patched:
        patched.setattr("os.write", lambda handle, line: write(handle, line[:2]))
        with pytest.raises(OSError, match="No space left"):
            file.append(b"two")
    file.append(b"three")
    assert (tmp_path / "lines").read_bytes() == b"one\nthree\n"
    with pytest.raises(FileExistsError):
        LineFile(tmp_path / "lines")
    file.close()


def test_half_a_line_that_could_not_be_cut_off_at_once_is_before_the_next_one_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file system that copies on writing has, full, no room to shorten a file either. What came next was written
    behind the half, and was lost with it: the very line that says how many were lost before it."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    file, write = LineFile(tmp_path / "lines"), os.write
    file.append(b"one")
    with monkeypatch.context() as patched:
        patched.setattr("os.write", lambda handle, line: write(handle, line[:2]))
        patched.setattr("os.ftruncate", full)
        for line in (b"two", b"three"):
            with pytest.raises(OSError, match="No space left"):
                file.append(line)
    file.append(b"four")
    assert (tmp_path / "lines").read_bytes() == b"one\nfour\n"
    file.close()


def test_who_writes_a_file_holds_it_until_it_is_closed(tmp_path: Path) -> None:
    file = LineFile(tmp_path / "lines")
    assert stat.S_IMODE((tmp_path / "lines").stat().st_mode) == 0o640
    assert file.in_place
    assert being_written(tmp_path / "lines")
    (tmp_path / "lines").rename(tmp_path / "moved")
    assert not file.in_place
    (tmp_path / "lines").touch()
    assert not file.in_place
    file.close()
    file.close()
    file.sync()
    assert file.in_place, "a closed file is nobody's to look for"
    assert not being_written(tmp_path / "moved")
    assert not being_written(tmp_path / "none")


class Watched(OpenFile):
    """Counts how often it is synced; fails while it is told to."""

    def __init__(self, fails: bool = False) -> None:
        self.synced, self.fails = 0, fails

    def sync(self) -> None:
        self.synced += 1
        if self.fails:
            raise OSError(errno.EIO, "I/O error")


def settled(syncer: Syncer, file: Any, count: int) -> bool:
    until(lambda: file.synced >= count)
    return bool(file.synced == count) and syncer.wait_until_written(PATIENCE_S)


def test_what_is_urgent_is_synced_now_and_the_rest_at_the_end() -> None:
    syncer, file, broken = Syncer(600.0), Watched(), Watched(fails=True)
    assert syncer.wait_until_written(0)
    syncer.take(broken)
    syncer.take(file)
    assert not syncer.wait_until_written(0.05)
    assert file.synced == 0
    syncer.hurry()
    assert settled(syncer, file, 1)
    syncer.take(file)
    syncer.stop()
    assert file.synced == 2
    assert not syncer._thread.is_alive()


def test_what_is_not_urgent_is_synced_every_so_often() -> None:
    syncer, file = Syncer(0.05), Watched()
    for count in (1, 2):
        syncer.take(file)
        syncer.take(file)
        assert settled(syncer, file, count)
    syncer.stop()
    assert file.synced == 2


def test_errors_are_one_line_for_people() -> None:
    assert plain(OSError(errno.EIO, "I/O error", "/x")) == "/x: I/O error"
    assert plain(OSError(errno.EDQUOT, "Quota", "/x")) == "/x: Quota; free some space there"
    assert plain(OSError(errno.EIO, "I/O error")) == "[Errno 5] I/O error"
    assert plain(OSError("odd")) == "odd"
    assert plain(ValueError("two\n  lines ")) == "two lines"
    assert plain(KeyError()) == "KeyError"


def test_a_folder_is_held_by_one_and_the_other_is_told_by_whom(tmp_path: Path) -> None:
    lock = hold(tmp_path / "state")
    assert (tmp_path / "state/lock").read_text() == f"{os.getpid()}\n"
    with pytest.raises(InUseError, match=rf"state: another facetd \(process {os.getpid()}\) uses it; stop that one"):
        hold(tmp_path / "state")
    (tmp_path / "state/lock").write_text("")
    with pytest.raises(InUseError, match=r"process unknown"):
        hold(tmp_path / "state")
    os.close(lock)
    (tmp_path / "state/lock").write_text("1234567890123\n")
    os.close(hold(tmp_path / "state"))
    assert (tmp_path / "state/lock").read_text() == f"{os.getpid()}\n"


def test_a_lock_that_is_a_link_to_somebodys_file_leaves_it_as_it_is(tmp_path: Path) -> None:
    mine = tmp_path / "mine"
    mine.write_text("a person's own")
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / "lock").symlink_to(mine)
    with pytest.raises(OSError, match="symbolic links"):
        hold(tmp_path / "state")
    assert mine.read_text() == "a person's own"


def test_a_file_that_got_the_number_0_is_a_file_as_any_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As after a start without an input."""
    done: list[tuple[str, int]] = []
    monkeypatch.setattr("os.fsync", lambda handle: done.append(("sync", handle)))
    monkeypatch.setattr("os.close", lambda handle: done.append(("close", handle)))
    file = OpenFile(tmp_path / "file", 0)
    file.sync()
    file.close()
    file.close()
    assert done == [("sync", 0), ("sync", 0), ("close", 0)]


def test_a_lock_and_what_must_be_known_are_their_owners_to_write_and_their_groups_to_read(tmp_path: Path) -> None:
    before = os.umask(0o002)
    try:
        os.close(hold(tmp_path / "held"))
        RecoveryFile(tmp_path / "standing").close()
        LineFile(tmp_path / "lines").close()
    finally:
        os.umask(before)
    made = [tmp_path / name for name in ("held/lock", "standing", "lines")]
    assert {stat.S_IMODE(path.stat().st_mode) for path in made} == {0o640}


def test_why_a_file_is_not_replaced_is_said_whatever_became_of_the_new_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(new: str, _: Path) -> None:
        os.unlink(new)
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr("os.replace", failing)
    with pytest.raises(OSError, match="Input/output error"):
        write_atomically(tmp_path / "x", b"new")
