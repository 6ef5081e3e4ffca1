"""The file of named places: the last line counts, nothing is lost, a torn end is passed over."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daemon.store.named_places import NamedPlaces, NamedPlacesError


def at(x: float) -> np.ndarray:
    pose = np.eye(4)
    pose[0, 3] = x
    return pose


def test_the_last_of_a_name_counts_and_the_others_are_its_history(tmp_path: Path) -> None:
    places = NamedPlaces(tmp_path / "new")
    assert places.now() == {}
    for name, x in (("a", 1.0), ("b", 2.0), ("a", 3.0)):
        places.keep(name, at(x), "anna")
    places.keep("b", None, "ben")
    again = NamedPlaces(tmp_path / "new")
    assert {name: pose[0, 3] for name, pose in again.now().items()} == {"a": 3.0}
    assert [one.who for one in again.history("b")] == ["anna", "ben"]


def test_a_line_that_lost_its_end_is_passed_over_and_the_next_is_whole(tmp_path: Path) -> None:
    places = NamedPlaces(tmp_path)
    places.keep("a", at(1.0), "anna")
    whole = places.path.read_bytes()
    places.path.write_bytes(whole + whole[: len(whole) // 2])
    assert list(places.now()) == ["a"]
    places.keep("b", at(2.0), "anna")
    assert sorted(places.now()) == ["a", "b"]


def test_what_cannot_be_kept_is_said(tmp_path: Path) -> None:
    (tmp_path / "places.jsonl").mkdir()
    with pytest.raises(NamedPlacesError, match=r"places\.jsonl: "):
        NamedPlaces(tmp_path).keep("a", at(1.0), "anna")
