"""Days of the whole daemon, its starts, its clients and its cameras, a few of each: nothing grows, nothing is lost but
what is told. `python -m tests.bench.long.years` goes on for a year and a hundred thousand."""

from __future__ import annotations

import gc
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.bench.long import years
from tests.bench.long.years import CLOCK, DAY_S, LostError, grown, live
from tests.fakes.chosen import few
from tests.fakes.light_daemon import LightDaemon, light_daemon


@pytest.fixture(autouse=True, scope="module")
def only_their_own() -> None:
    """What is held is counted time and again; what other tests left is not gone through each time."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def folder() -> Iterator[Path]:
    """A short path: a socket lies in it."""
    folder = Path(tempfile.mkdtemp(prefix="facetd-"))
    yield folder
    shutil.rmtree(folder)


@pytest.fixture(autouse=True)
def zone(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The bench goes to another one."""
    monkeypatch.setenv("TZ", "UTC")
    yield
    monkeypatch.undo()
    time.tzset()


@pytest.mark.parametrize(
    ("part", "count"),
    few([("starts", 8), ("clients", 16), ("cameras", 16), ("starts", 40), ("clients", 200), ("cameras", 200)], 3),
)
def test_a_few_of_each_leave_nothing_behind(
    part: str, count: int, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(years.EVERY, part, count // 8)
    assert live(part, folder, count) == []


@pytest.mark.long
def test_days_on_which_the_clock_is_set_lose_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A day back, a leap second, a year forward and back again, and past the end of 32 bits of seconds; the daemon is
    started anew every other day."""
    monkeypatch.setattr(years, "BEGIN_S", 2**31 - 1.5 * DAY_S)
    monkeypatch.setattr(years, "CLOCK", {0: -DAY_S, 1: -1.0, 2: 365 * DAY_S, 3: -365 * DAY_S})
    monkeypatch.setattr(years, "WEEK", 2)
    monkeypatch.setattr(years, "SHIFT", (10,))
    assert live("year", folder, 4) == []


def test_what_was_begun_is_gone_on_with(folder: Path) -> None:
    assert live("cameras", folder, 10) == []
    counted = folder / "cameras.json"
    assert '"done": 10' in counted.read_text()
    assert live("cameras", folder, 15) == []
    assert '"done": 15' in counted.read_text()


def test_a_run_that_went_and_was_not_told_is_noticed(folder: Path) -> None:
    with light_daemon(folder) as daemon:
        made: list[str] = []
        for _ in range(2):
            daemon.run(daemon.start())
            assert daemon.run(daemon.stop()) == 0
        years._keep_books(daemon, made)
        assert len(made) == 2
        shutil.rmtree(daemon.runs / made[0])
        with pytest.raises(LostError, match="gone, and not told"):
            years._keep_books(daemon, made)


def test_growth_is_noticed_and_what_comes_and_goes_is_not() -> None:
    def row(**more: float) -> dict[str, float]:
        return {"resident_mib": 80, "objects": 50_000, "handles": 8, "threads": 2, "tasks": 0, "disk_mb": 20} | more

    assert grown([row(resident_mib=80 + k % 3 * 6, disk_mb=10 + k % 4) for k in range(16)]) == []
    assert grown([row(handles=8 + k // 6) for k in range(16)]) == ["handles grew by 1"]
    assert grown([row(objects=50_000 + 200 * k) for k in range(16)]) == ["objects grew by 800"]
    assert grown([row(disk_mb=2 * k) for k in range(16)]) == ["30.0 MB lay on the disk"]


def test_every_kind_of_jump_is_in_the_year() -> None:
    assert {-DAY_S, 365 * DAY_S, -1.0} <= set(CLOCK.values())
    assert years.BEGIN_S < 2**31 < years.BEGIN_S + 365 * DAY_S


def test_a_daemon_in_simulated_time_picks_and_ends(folder: Path) -> None:
    async def morning(daemon: LightDaemon) -> str:
        daemon.world.put("cube", 520, 0, 0.4)
        for text in ("enable", "auto on 1"):
            assert (await daemon.do(text))["status"] == 0
        return str((await daemon.do("auto wait"))["text"])

    with light_daemon(folder) as daemon:
        daemon.run(daemon.start())
        assert daemon.run(morning(daemon)) == "1 part picked; that is as many as requested."
        assert daemon.run(daemon.stop()) == 0
