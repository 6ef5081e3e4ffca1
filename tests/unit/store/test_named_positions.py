"""The file of named places: the last line counts, nothing is lost, a torn end is passed over."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import numpy as np
import pytest

from daemon.store import named_positions
from daemon.store.named_positions import NamedPositions
from daemon.store.outside import FileError


def at(x: float) -> np.ndarray:
    pose = np.eye(4)
    pose[0, 3] = x
    return pose


def test_the_last_of_a_name_counts_and_the_others_are_its_history(tmp_path: Path) -> None:
    places = NamedPositions(tmp_path / "new")
    assert places.now() == {}
    for name, x in (("a", 1.0), ("b", 2.0), ("a", 3.0)):
        places.keep(name, at(x), "anna")
    places.keep("b", None, "ben")
    again = NamedPositions(tmp_path / "new")
    assert {name: pose[0, 3] for name, pose in again.now().items()} == {"a": 3.0}
    assert [one.who for one in again.history("b")] == ["anna", "ben"]


def test_a_line_that_lost_its_end_is_passed_over_and_the_next_is_whole(tmp_path: Path) -> None:
    places = NamedPositions(tmp_path)
    places.keep("a", at(1.0), "anna")
    whole = places.path.read_bytes()
    places.path.write_bytes(whole + whole[: len(whole) // 2])
    assert list(places.now()) == ["a"]
    places.keep("b", at(2.0), "anna")
    assert sorted(places.now()) == ["a", "b"]


def test_what_cannot_be_kept_is_said(tmp_path: Path) -> None:
    (tmp_path / "places.jsonl").mkdir()
    with pytest.raises(FileError, match=r"places\.jsonl: "):
        NamedPositions(tmp_path).keep("a", at(1.0), "anna")


def test_what_was_said_not_to_be_kept_is_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk across the net is full only once it is asked to keep what it took."""
    places = NamedPositions(tmp_path)
    places.keep("a", at(1.0), "anna")

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        with pytest.raises(FileError, match="No space left"):
            places.keep("a", at(2.0), "ben")
    assert {name: pose[0, 3] for name, pose in places.now().items()} == {"a": 1.0}
    places.keep("b", at(3.0), "anna")
    assert sorted(places.now()) == ["a", "b"]


def test_years_of_names_do_not_make_the_file_too_large_to_be_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is too large is not read: then no place could be gone to any more, and nobody was told before."""
    monkeypatch.setattr(named_positions, "LARGEST_BYTES", 20_000)
    places = NamedPositions(tmp_path)
    places.keep("first", at(-1.0), "anna")
    places.keep("gone", at(-2.0), "anna")
    places.keep("gone", None, "anna")
    for k in range(300):
        places.keep(f"p{k % 3}", at(float(k)), "anna")
    assert {name: pose[0, 3] for name, pose in places.now().items()} == {
        "first": -1.0, "p0": 297.0, "p1": 298.0, "p2": 299.0,
    }  # fmt: skip
    assert len(places.history("p0")) > 5, "the last of its history is there"


@pytest.mark.timeout(20)
def test_a_fifo_where_places_are_kept_holds_nobody_up(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "places.jsonl")
    with pytest.raises(FileError, match=r"places\.jsonl: not kept: "):
        NamedPositions(tmp_path).keep("a", at(1.0), "anna")
    reader = os.open(tmp_path / "places.jsonl", os.O_RDONLY | os.O_NONBLOCK)
    with pytest.raises(FileError, match=r"not kept: not a regular file"):
        NamedPositions(tmp_path).keep("a", at(1.0), "anna")
    os.close(reader)


@pytest.mark.parametrize(
    ("row", "place"),
    [(0, (1, 0, 0, 5.5)), (0, (1.001, 0, 0, 5)), (1, (0, -1, 0, 0)), (3, (0, 0, 0, 2)), (2, (0, 0, 1e300, 0))],
)
def test_what_is_damaged_is_no_place_to_go_to(row: int, place: tuple[float, ...], tmp_path: Path) -> None:
    """Only the first still is one: nothing but where it lies has changed."""
    NamedPositions(tmp_path).keep("a", at(5.0), "anna")
    line = json.loads((tmp_path / "places.jsonl").read_bytes())
    line["world_from_tool"][row] = place
    (tmp_path / "places.jsonl").write_text(json.dumps(line) + "\n")
    assert {name: pose[0, 3] for name, pose in NamedPositions(tmp_path).now().items()} == (
        {"a": 5.5} if place[3] == 5.5 else {}
    )


def test_a_byte_that_is_no_utf_8_costs_its_line_and_not_all_places(tmp_path: Path) -> None:
    for name in ("a", "b"):
        NamedPositions(tmp_path).keep(name, at(1.0), "anna")
    content = (tmp_path / "places.jsonl").read_bytes()
    (tmp_path / "places.jsonl").write_bytes(content.replace(b"anna", b"ann\xb6", 1))
    assert list(NamedPositions(tmp_path).now()) == ["b"]
