"""The status of places: what is on the disk is what holds, whatever is cut off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.store import place_status
from daemon.store.outside import FileError
from daemon.store.place_status import (
    AT_PLACE_MM,
    FILLABLE,
    LEADS_TO,
    UNSEEN,
    PlaceSpot,
    PlaceStatus,
    PlaceStatuses,
)


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

    monkeypatch.setattr("daemon.store.json_file.write_atomically", full)
    with pytest.raises(FileError, match=r"place-status\.json: not written: No space left"):
        statuses.put("nest", PlaceStatus.SET)
    assert statuses.of("nest").status is PlaceStatus.CLAIMED


@pytest.mark.parametrize("content", [b"", b"{", b'{"v": 1, "places": {"nest": {"status": "full"}}}', b"\xff" * 50])
def test_a_damaged_file_is_no_free_place(tmp_path: Path, content: bytes) -> None:
    (tmp_path / place_status.FILE).write_bytes(content)
    with pytest.raises(FileError, match=r"cannot be read: .*look at every place, delete the file"):
        PlaceStatuses(tmp_path).of("nest")


def spot(x_mm: float, part: str = "cube", turned_deg: float = 0.0) -> PlaceSpot:
    turn = frames.rotation_from_vector(np.array([0.0, 0.0, np.radians(turned_deg)]))
    return PlaceSpot(part, np.array([x_mm, 0.0, -275.0]), turn, 43.3)


def statuses_at(folder: Path, **spots: PlaceSpot) -> PlaceStatuses:
    """Those on the disk, of places that are there now."""
    statuses = PlaceStatuses(folder)
    statuses.know(spots)
    return statuses


def filled(folder: Path, name: str, at: PlaceSpot) -> None:
    for status in (PlaceStatus.CLAIMED, PlaceStatus.SET, PlaceStatus.RIGHT):
        statuses_at(folder, **{name: at}).put(name, status, 0.1, 0.1, "0.10 mm off")


@pytest.mark.parametrize(
    ("now", "why"),
    [
        (spot(535.0), "it was seen right 35.0 mm from where it is now"),
        (spot(500.0, turned_deg=90.0), "it was seen right turned by 90.0 degrees from how it is now"),
        (spot(500.0, part="pyramid"), "it was seen right with cube, and is now for pyramid"),
    ],
)
def test_a_place_that_has_moved_is_to_be_looked_at(tmp_path: Path, now: PlaceSpot, why: str) -> None:
    filled(tmp_path, "nest", spot(500.0))
    statuses = statuses_at(tmp_path, nest=now)
    assert statuses.of("nest").status is PlaceStatus.TO_LOOK_AT
    assert statuses.of("nest").why == why
    with pytest.raises(ValueError, match="claimed cannot follow to be looked at"):
        statuses.put("nest", PlaceStatus.CLAIMED)
    statuses.put("nest", PlaceStatus.FREE)
    assert statuses_at(tmp_path, nest=now).of("nest").status is PlaceStatus.FREE
    assert statuses_at(tmp_path, nest=spot(500.0)).of("nest").status is PlaceStatus.TO_LOOK_AT, "what it was before"


def test_a_place_that_has_moved_within_its_tolerance_is_as_it_was_and_small_moves_do_not_add_up(tmp_path: Path) -> None:
    filled(tmp_path, "nest", spot(500.0))
    for x_mm, status in ((500.9, PlaceStatus.RIGHT), (501.8, PlaceStatus.TO_LOOK_AT), (500.0, PlaceStatus.RIGHT)):
        assert statuses_at(tmp_path, nest=spot(x_mm)).of("nest").status is status


def test_what_lies_at_a_place_that_was_renamed_or_deleted_is_not_forgotten(tmp_path: Path) -> None:
    filled(tmp_path, "nest", spot(500.0))
    renamed = statuses_at(tmp_path, slot=spot(510.0))
    assert renamed.of("slot").status is PlaceStatus.TO_LOOK_AT
    assert renamed.of("slot").why == "a place that is no longer there was seen right here: cube may lie here"
    statuses_at(tmp_path, nest=spot(500.0)).forget({"nest"})
    assert statuses_at(tmp_path, slot=spot(510.0)).of("slot").status is PlaceStatus.TO_LOOK_AT
    assert statuses_at(tmp_path, slot=spot(700.0)).of("slot").status is PlaceStatus.FREE, "nothing was left there"
    statuses_at(tmp_path, slot=spot(510.0)).put("slot", PlaceStatus.EMPTIED)
    assert statuses_at(tmp_path, other=spot(500.0)).of("other").status is PlaceStatus.FREE, "somebody said so"


def test_what_lies_where_a_place_was_stays_known_after_a_look_where_it_is_now(tmp_path: Path) -> None:
    filled(tmp_path, "nest", spot(500.0))
    statuses_at(tmp_path, nest=spot(700.0)).put("nest", PlaceStatus.FREE)
    statuses = statuses_at(tmp_path, nest=spot(700.0), slot=spot(510.0))
    assert [statuses.of(name).status for name in ("nest", "slot")] == [PlaceStatus.FREE, PlaceStatus.TO_LOOK_AT]


def test_what_lies_beside_its_place_is_sought_wider(tmp_path: Path) -> None:
    statuses_at(tmp_path, nest=spot(500.0)).put("nest", PlaceStatus.OFF)
    for x_mm, status in ((600.0, PlaceStatus.TO_LOOK_AT), (640.0, PlaceStatus.FREE)):
        assert statuses_at(tmp_path, slot=spot(x_mm)).of("slot").status is status


def test_a_look_settles_what_may_have_reached_to_a_place_from_beside_it(tmp_path: Path) -> None:
    filled(tmp_path, "nest", spot(500.0))
    statuses = statuses_at(tmp_path, slot=spot(560.0))
    assert statuses.of("slot").status is PlaceStatus.TO_LOOK_AT
    statuses.put("slot", PlaceStatus.FREE)
    assert statuses.of("slot").status is PlaceStatus.FREE
    assert statuses_at(tmp_path, other=spot(510.0)).of("other").status is PlaceStatus.TO_LOOK_AT, "it was not looked at"


def test_places_of_which_an_earlier_release_kept_no_spot_are_looked_at(tmp_path: Path) -> None:
    kept = b'{"v": 1, "places": {"nest": {"status": "seen right", "off_mm": 0.1}, "other": {"status": "free"}}}'
    (tmp_path / place_status.FILE).write_bytes(kept)
    statuses = statuses_at(tmp_path, nest=spot(500.0), other=spot(700.0), new=spot(900.0))
    assert [statuses.of(name).status for name in ("nest", "other", "new")] == [
        PlaceStatus.TO_LOOK_AT, PlaceStatus.TO_LOOK_AT, PlaceStatus.FREE,
    ]  # fmt: skip
    statuses.put("nest", PlaceStatus.RIGHT)
    assert statuses_at(tmp_path, nest=spot(500.0)).of("nest").status is PlaceStatus.RIGHT


NAMES = st.sampled_from(("a", "b", "c"))
STEP = st.one_of(
    st.tuples(st.just("fill"), NAMES, st.integers(0, 3)),
    st.tuples(st.sampled_from(("look", "clear", "drop", "delete", "restart")), NAMES, st.just(0)),
    st.tuples(
        st.sampled_from(("move", "new")), NAMES, st.sampled_from((-300, -90, -35, -10, -1, 0, 1, 10, 35, 90, 300))
    ),
)


class Desk:
    """Places that people edit as they like, on a line; what truly lies there; kills at each line of a set-down."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.places, self.lying = folder, {"a": 0.0, "b": 300.0}, list[float]()
        self.statuses = self.loaded()

    def loaded(self) -> PlaceStatuses:
        return statuses_at(self.folder, **{name: spot(x) for name, x in self.places.items()})

    def near(self, x_mm: float) -> list[float]:
        return [each for each in self.lying if abs(each - x_mm) < AT_PLACE_MM - 2.0]

    def barred(self, name: str) -> bool:
        """Whether a part that lies at another place that is there and known to be filled leaves no room."""
        others = [x for k, x in self.places.items() if k != name and self.statuses.of(k).status not in FILLABLE]
        return any(abs(x - self.places[name]) < 2 * 43.3 for x in others)

    def step(self, what: str, name: str, number: int) -> None:
        if what in ("new", "move"):
            self.places[name] = (self.places.get(name, 0.0) if what == "move" else 0.0) + number * 0.6
        elif name not in self.places or (what == "fill" and self.barred(name)):
            return
        elif what == "fill" and self.statuses.of(name).status in FILLABLE:
            assert not self.near(self.places[name]), "a part would be set down on another"
            self.statuses.put(name, PlaceStatus.CLAIMED)
            if number > 0:
                self.statuses.put(name, PlaceStatus.SET)
            if number > 1:
                self.lying.append(self.places[name])
            if number > 2:
                self.statuses.put(name, PlaceStatus.RIGHT)
        elif what == "look":
            near = self.near(self.places[name])
            right = any(abs(x - self.places[name]) <= 1.0 for x in near)
            self.statuses.put(name, PlaceStatus.RIGHT if right else PlaceStatus.OFF if near else PlaceStatus.FREE)
        elif what == "clear":
            self.lying = [x for x in self.lying if x not in self.near(self.places[name])]
            self.statuses.put(name, PlaceStatus.EMPTIED)
        elif what in ("drop", "delete"):
            del self.places[name]
            if what == "drop":
                self.statuses.forget({name})
        self.statuses = self.loaded()

    def judge(self) -> None:
        for name, x in self.places.items():
            status = self.statuses.of(name).status
            if status in FILLABLE and not self.barred(name):
                assert not self.near(x), f"{name} counts as {status}, and a part lies there"


@given(st.lists(STEP, max_size=14))
def test_whatever_people_edit_no_place_at_which_a_part_was_left_counts_as_free(
    tmp_path_factory: pytest.TempPathFactory, steps: list[tuple[str, str, int]]
) -> None:
    desk = Desk(tmp_path_factory.mktemp("places"))
    for step in steps:
        desk.step(*step)
        desk.judge()
