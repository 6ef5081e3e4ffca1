"""Files from outside: whatever somebody puts in their place, the answer is one error, soon, in little memory."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from daemon.store.outside import FileError, open_below, read_below, read_file


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a file in it, a neighbour beside it, and links in and out."""
    (tmp_path / "in" / "deep").mkdir(parents=True)
    (tmp_path / "in" / "deep" / "file").write_bytes(b"inside")
    (tmp_path / "secret").write_bytes(b"outside")
    (tmp_path / "in" / "link").symlink_to(tmp_path / "secret")
    (tmp_path / "in" / "up").symlink_to(tmp_path)
    return tmp_path / "in"


def test_what_is_a_file_is_read_whole_also_by_a_link_that_a_person_named(folder: Path) -> None:
    assert read_file(folder / "deep" / "file", 6) == b"inside"
    assert read_file(folder / "link", 7) == b"outside"
    assert read_below(folder, "deep/file", 6) == b"inside"


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/tty", "/dev", "/dev/full"])
def test_neither_a_device_nor_a_folder_is_opened(device: str) -> None:
    with pytest.raises(FileError, match="not a regular file"):
        read_file(Path(device), 10)


@pytest.mark.timeout(5)
def test_a_fifo_without_a_writer_holds_nobody_up(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    for read in (lambda: read_file(tmp_path / "fifo", 10), lambda: read_below(tmp_path, "fifo", 10)):
        with pytest.raises(FileError, match="not a regular file"):
            read()


@pytest.mark.parametrize(
    "name", ["/etc/hostname", "../secret", "deep/../../secret", "link", "up/secret", "", ".", "de\0ep", None, 7, ["x"]]
)
def test_a_name_that_leads_out_of_its_folder_is_refused(folder: Path, name: object) -> None:
    with pytest.raises(FileError):
        read_below(folder, name, 100)


def test_a_link_is_called_no_file_before_it_is_followed(folder: Path) -> None:
    with pytest.raises(FileError, match="link: cannot be read: not a regular file"):
        read_below(folder, "link", 100)


def test_more_than_may_be_is_not_read_whatever_the_file_says_of_its_length(tmp_path: Path) -> None:
    (tmp_path / "long").write_bytes(bytes(1001))
    with pytest.raises(FileError, match=r"long: too large: 0\.001 MB; the limit is 0\.001 MB"):
        read_file(tmp_path / "long", 1000)
    assert len(read_file(tmp_path / "long", 1001)) == 1001
    with pytest.raises(FileError, match="too large"):
        read_file(Path("/proc/self/smaps"), 100)  # says that it has no length


def test_a_missing_file_and_a_name_that_cannot_be_one_are_told_in_a_line(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="none: cannot be read: No such file or directory"):
        read_file(tmp_path / "none", 10)
    with pytest.raises(FileError, match="not a file's name"):
        read_file(tmp_path / "no\0ne", 10)
    with pytest.raises(FileError, match="cannot be read"), open_below(tmp_path / "none", "file"):
        pass
