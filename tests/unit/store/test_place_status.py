"""The status of places: what is on the disk is what holds, whatever is cut off."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.store import place_status
from daemon.store.place_status import FILLABLE, LEADS_TO, UNSEEN, PlaceStatus, PlaceStatusError, PlaceStatuses


def test_a_place_that_nothing_was_brought_to_is_free(tmp_path: Path) -> None:
    assert PlaceStatuses(tmp_path).of("nest").status is PlaceStatus.FREE
    assert not (tmp_path / place_status.FILE).exists()


def test_what_was_written_is_there_after_a_restart(tmp_path: Path) -> None:
    before = PlaceStatuses(tmp_path)
    before.put("nest", PlaceStatus.CLAIMED)
    before.put("nest", PlaceStatus.SET)
    before.put("nest", PlaceStatus.OFF, 1.5, 0.2, "1.50 mm off")
    found = PlaceStatuses(tmp_path).of("nest")
    assert (found.status, found.off_mm, found.off_deg, found.why) == (PlaceStatus.OFF, 1.5, 0.2, "1.50 mm off")
    assert found.at


def test_a_part_is_brought_to_no_place_before_what_lies_there_was_seen_or_taken_away() -> None:
    assert not FILLABLE & UNSEEN
    for status in set(PlaceStatus) - FILLABLE:
        assert PlaceStatus.CLAIMED not in LEADS_TO[status]
    assert PlaceStatus.SET not in LEADS_TO[PlaceStatus.FREE]


@given(st.lists(st.sampled_from(list(PlaceStatus)), max_size=8))
def test_a_status_follows_only_what_it_may(tmp_path_factory: pytest.TempPathFactory, wanted: list[PlaceStatus]) -> None:
    statuses = PlaceStatuses(tmp_path_factory.mktemp("places"))
    for status in wanted:
        before = statuses.of("nest").status
        try:
            statuses.put("nest", status)
        except ValueError:
            assert status not in LEADS_TO[before]
            assert statuses.of("nest").status is before
        else:
            assert status in (before, PlaceStatus.EMPTIED) or status in LEADS_TO[before]


def test_a_disk_that_does_not_take_it_leaves_what_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    statuses = PlaceStatuses(tmp_path)
    statuses.put("nest", PlaceStatus.CLAIMED)

    def full(path: Path, content: bytes) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(place_status, "write_atomically", full)
    with pytest.raises(PlaceStatusError, match=r"place-status\.json: not kept: No space left"):
        statuses.put("nest", PlaceStatus.SET)
    assert statuses.of("nest").status is PlaceStatus.CLAIMED


@pytest.mark.parametrize("content", [b"", b"{", b'{"v": 1, "places": {"nest": {"status": "full"}}}', b"\xff" * 50])
def test_a_damaged_file_is_no_free_place(tmp_path: Path, content: bytes) -> None:
    (tmp_path / place_status.FILE).write_bytes(content)
    with pytest.raises(PlaceStatusError, match="damaged"):
        PlaceStatuses(tmp_path).of("nest")
