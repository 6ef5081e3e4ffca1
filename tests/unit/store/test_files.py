"""Bytes onto a disk that is full: the file is named and what to do, and what was there stays."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from daemon.store.files import hold, plain, write_atomically
from daemon.store.standing import StandingFile


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


def test_room_for_what_must_be_known_is_taken_at_the_start_or_the_file_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.posix_fallocate", full)
    with pytest.raises(OSError, match="No space left") as refused:
        StandingFile(tmp_path / "standing")
    assert plain(refused.value) == f"{tmp_path / 'standing'}: No space left on device; free some space there"


def test_a_full_disk_keeps_nobody_from_claiming_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.pwrite", full)
    os.close(hold(tmp_path))
