"""Devices are watched while nothing else asks them: what is lost is told once, what hangs starves the watchdog."""

from __future__ import annotations

import asyncio
import errno
import os
import shutil
import time
from collections import Counter
from collections.abc import Awaitable, Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import AsyncMock, Mock, patch

import pytest

from daemon.arm.permission import Grant, MotionPermission
from daemon.cell.no_arm import CellError
from daemon.console.context import CommandContext
from daemon.events.codes import CauseCode, FaultCause
from daemon.maintenance import journal, watchdog
from daemon.maintenance.troubles import Troubles
from daemon.maintenance.watchdog import CHECK_LIMIT_S, QUOTA_S, Watchdog
from daemon.store.runlog import RunLog
from daemon.store.runs import list_runs, read_run
from tests.fakes.in_time import lived
from tests.fakes.simulated_time import SimulatedLoop


class WatchedCell:
    """What the watch looks at, with devices that fail when told to."""

    def __init__(self, folder: Path) -> None:
        self.failed: list[str] = []
        self.causes: list[CauseCode] = []
        self.line_opened_anew = Mock()
        self.camera_fails = False
        self.permission = MotionPermission()
        self.permission.stop_tests = 1
        self.permission.grant(Grant.ALL)
        self.notes: list[str] = []
        health = SimpleNamespace(camera_silence_s=0.2, arm_check_s=0.1)
        log = SimpleNamespace(quota_mb=10, keep_free_mb=0, roll_mb=1)
        self.run_log = RunLog(folder / "runs" / "20260101T000000Z")
        self.context: Any = SimpleNamespace(
            config=SimpleNamespace(values=SimpleNamespace(health=health, log=log), runs=folder / "runs"),
            hardware=SimpleNamespace(clock=time.monotonic, cameras=self, robot=self),
            cycle=SimpleNamespace(supervisor=self, state="idle", tally=Counter()),
            troubles=Troubles(),
            run_log=self.run_log,
            roll_due=False,
        )
        self.heard_s = time.monotonic()
        self.controller = None
        self.aside = False
        self.connected = True
        self.set_by_s = 0.0
        self.doing: str | None = None

    @property
    def busy(self) -> bool:
        return self.doing is not None

    async def grab(self, not_before_s: float, timeout_s: float) -> None:
        if self.camera_fails:
            raise CellError("no stereo pair within 0.1 s")

    async def check(self) -> None:
        self.heard_s = time.monotonic()

    async def fail(self, source: str, text: str, cause: FaultCause) -> None:
        self.failed.append(f"{source}: {text}")
        self.causes.append(cause.code)


@pytest.fixture
def notes(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What systemd is told, its watchdog being on."""
    told: list[str] = []
    monkeypatch.setattr(journal, "notify", lambda *lines: told.extend(lines))
    monkeypatch.setenv("WATCHDOG_USEC", "1000000")
    return told


def watching(folder: Path, play: Callable[[WatchedCell, Watchdog], Awaitable[None]]) -> WatchedCell:
    async def run(watched: WatchedCell) -> None:
        watch = Watchdog(watched.context)
        task = asyncio.create_task(watch.run())
        try:
            await play(watched, watch)
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        now = runner.get_loop().time
        watched: WatchedCell
        clock = lambda: 1.8e9 + now() + watched.set_by_s  # noqa: E731
        with patch.object(time, "monotonic", now), patch.object(time, "time", clock):
            watched = WatchedCell(folder)
            runner.run(run(watched))
    watched.run_log.close()
    return watched


def test_a_camera_lost_while_the_arm_may_move_stops_it_once_and_is_told_until_it_is_back(tmp_path: Path) -> None:
    async def play(watched: WatchedCell, _: Watchdog) -> None:
        watched.camera_fails = True
        await asyncio.sleep(1.3)
        assert watched.context.troubles.active["cameras"] == "cameras: no stereo pair within 0.1 s"
        watched.camera_fails = False
        await asyncio.sleep(1.2)
        assert "cameras" not in watched.context.troubles.active

    assert watching(tmp_path, play).failed == ["cameras: no stereo pair within 0.1 s"]


def test_a_camera_lost_while_the_arm_may_not_move_is_told_and_no_fault(tmp_path: Path) -> None:
    async def play(watched: WatchedCell, _: Watchdog) -> None:
        watched.permission.withdraw()
        watched.camera_fails = True
        await asyncio.sleep(0.8)
        assert "cameras" in watched.context.troubles.active

    assert watching(tmp_path, play).failed == []


@pytest.mark.parametrize(("trouble", "checks"), [(False, 1), (True, 0)])
def test_what_comes_unasked_on_the_controllers_line_is_read_at_once_and_not_at_the_next_check(
    tmp_path: Path, trouble: bool, checks: int
) -> None:
    """A line with a trouble is opened again in its own time."""
    asked: list[float] = []

    async def play(watched: WatchedCell, _: Watchdog) -> None:
        watched.context.config.values.health.arm_check_s = 10.0
        watched.doing = "pick"  # which has the line, and waits for a yes
        watched.controller = SimpleNamespace(question=None, heard_unasked=False)  # type: ignore[assignment]

        async def check() -> None:
            asked.append(time.monotonic())
            watched.controller.heard_unasked = False  # type: ignore[attr-defined]

        watched.check = check
        await asyncio.sleep(0.7)
        assert not asked
        if trouble:
            watched.context.troubles.report("controller", "controller: no answer")
        watched.controller.heard_unasked = True  # type: ignore[attr-defined]
        await asyncio.sleep(0.6)

    watching(tmp_path, play)
    assert len(asked) == checks


def test_once_a_lost_line_is_opened_again_nobody_knows_how_arm_and_hand_stand(tmp_path: Path) -> None:
    """Before anything is typed on it: a stop seen to work while it is opened gives no old leave back."""

    async def play(watched: WatchedCell, _: Watchdog) -> None:
        watched.close, watched.open = AsyncMock(), AsyncMock()  # type: ignore[attr-defined]
        watched.open.side_effect = lambda: watched.line_opened_anew.assert_called()  # type: ignore[attr-defined]
        watched.context.troubles.report("controller", "controller: no answer")
        await asyncio.sleep(0.7)
        watched.open.assert_called()  # type: ignore[attr-defined]

    assert not watching(tmp_path, play).context.troubles.active


def test_devices_that_were_opened_just_now_are_asked_only_once_they_have_been_silent(tmp_path: Path) -> None:
    asked: list[float] = []

    async def play(watched: WatchedCell, _: Watchdog) -> None:
        watched.context.config.values.health.camera_silence_s = 1.6
        began = time.monotonic()

        async def grab(not_before_s: float, timeout_s: float) -> Any:
            asked.append(time.monotonic() - began)

        watched.grab = grab
        await asyncio.sleep(1.3)

    watching(tmp_path, play)
    assert asked
    assert min(asked) > 0.7


def test_the_watchdog_is_fed_while_devices_answer_and_starves_when_one_hangs(
    tmp_path: Path, notes: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:

    async def play(watched: WatchedCell, _: Watchdog) -> None:
        await asyncio.sleep(1.2)
        assert any("WATCHDOG=1" in note for note in notes)

        async def hang(*_: float) -> None:
            await asyncio.sleep(3600.0)

        monkeypatch.setattr(watched, "grab", hang)
        await asyncio.sleep(CHECK_LIMIT_S + 2.0)
        notes.clear()
        await asyncio.sleep(1.2)
        assert not any("WATCHDOG=1" in note for note in notes)
        assert any("no sign of life from cameras" in note for note in notes)

    watching(tmp_path, play)


@pytest.mark.parametrize("aside", [False, True])
def test_the_watchdog_is_fed_while_a_pick_waits_for_an_operator_or_somebody_talks_to_the_controller(
    tmp_path: Path, notes: list[str], monkeypatch: pytest.MonkeyPatch, aside: bool
) -> None:

    async def refuse() -> None:
        raise AssertionError("the daemon does not stand aside")

    async def play(watched: WatchedCell, _: Watchdog) -> None:
        watched.doing, watched.aside = "pick", aside
        if aside:
            monkeypatch.setattr(watched, "check", refuse)
        await asyncio.sleep(3 * CHECK_LIMIT_S)
        notes.clear()
        await asyncio.sleep(1.2)
        assert any("WATCHDOG=1" in note for note in notes), notes

    watching(tmp_path, play)


def test_the_watchdog_is_fed_while_a_check_waits_for_whoever_has_the_line(
    tmp_path: Path, notes: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A check that began just before CAL took the line waits for minutes: that is no hanging driver."""

    async def wait_for_the_line() -> None:
        await asyncio.sleep(3600.0)

    async def play(watched: WatchedCell, _: Watchdog) -> None:
        monkeypatch.setattr(watched, "check", wait_for_the_line)
        await asyncio.sleep(0.7)
        watched.doing, watched.aside = "CAL", True
        await asyncio.sleep(3 * CHECK_LIMIT_S)
        notes.clear()
        await asyncio.sleep(1.2)
        assert any("WATCHDOG=1" in note for note in notes), notes

    watching(tmp_path, play)


def test_a_run_that_grew_large_while_auto_never_rests_goes_on_in_a_new_folder_between_two_picks(
    tmp_path: Path,
) -> None:
    async def play(watched: WatchedCell, watch: Watchdog) -> None:
        watched.doing = "auto"
        (watched.run_log.folder / "images" / "big.png").write_bytes(bytes(2_000_000))
        watch._quota_s = 0.0
        await asyncio.sleep(1.2)
        assert watched.context.roll_due

    watched = watching(tmp_path, play)
    context = SimpleNamespace(
        config=watched.context.config, roll_due=True, new_run=lambda folder: rolled.append(folder)
    )
    rolled: list[Path] = []
    for _ in range(2):
        CommandContext.roll_if_due(context)  # type: ignore[arg-type]
    assert len(rolled) == 1
    assert rolled[0].parent == tmp_path / "runs"


def test_a_jump_of_the_clock_is_in_the_log(tmp_path: Path) -> None:
    async def play(watched: WatchedCell, _: Watchdog) -> None:
        await asyncio.sleep(0.1)
        watched.set_by_s = 3600.0
        await asyncio.sleep(0.7)

    watching(tmp_path, play)
    (run,) = list_runs(tmp_path / "runs")
    jumps = [r["jump_s"] for r in read_run(run).records if r["kind"] == "clock"]
    assert len(jumps) == 1
    assert abs(jumps[0] - 3600) < 1


def test_nobody_who_reads_nothing_can_hold_up_the_daemon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import socket

    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as deaf:
        deaf.bind(str(tmp_path / "n"))
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "n"))
        for _ in range(2000):
            journal.notify("STATUS=" + "x" * 200)


@pytest.mark.parametrize("connected", [True, False])
def test_while_a_stop_is_under_way_the_line_is_the_stops_and_opened_again_only_where_it_is_lost(
    tmp_path: Path, connected: bool
) -> None:
    async def play(watched: WatchedCell, _: Watchdog) -> None:
        watched.close, watched.open = AsyncMock(), AsyncMock()  # type: ignore[attr-defined]
        watched.permission.stop_begins()
        watched.connected = connected
        watched.context.troubles.report("controller", "controller: no answer")
        await asyncio.sleep(0.7)
        assert watched.open.called is not connected  # type: ignore[attr-defined]

    watching(tmp_path, play)


def test_a_line_that_is_lost_during_a_stop_is_tried_again_at_every_tick_however_seldom_the_controller_is_checked(
    tmp_path: Path,
) -> None:
    """Nothing stops the arm until then: it went on for ten seconds after the adapter was plugged in again."""

    async def play(watched: WatchedCell, _: Watchdog) -> None:
        watched.context.config.values.health.arm_check_s = 10.0
        watched.close, watched.open = AsyncMock(), AsyncMock(side_effect=CellError("no such port"))  # type: ignore[attr-defined]
        watched.permission.stop_begins()
        watched.connected, watched.doing = False, "stop"
        watched.context.troubles.report("controller", "controller: the port is gone")
        await asyncio.sleep(3.2)
        assert watched.open.await_count >= 5  # type: ignore[attr-defined]

    watching(tmp_path, play)


def test_a_run_removed_under_the_daemon_is_told_and_the_log_goes_on_in_a_new_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    monkeypatch.setattr("daemon.maintenance.journal.write", lambda _, text, *__: told.append(text))
    watched = WatchedCell(tmp_path)
    first = watched.run_log.folder
    watched.context.roll_if_due = lambda: watched.run_log.roll(tmp_path / "runs" / "next")
    watch = Watchdog(watched.context)
    watch._roll(busy=True)
    assert told == []
    shutil.rmtree(tmp_path / "runs")
    watch._roll(busy=True)
    watched.run_log.record("decision", text="after")
    watched.run_log.close()
    assert told == [f"log: {first} was removed while in use; the log continues in {tmp_path / 'runs' / 'next'}"]
    assert [r["kind"] for r in read_run(tmp_path / "runs" / "next").records] == ["decision", "run_end"]


def test_a_folder_for_runs_that_cannot_be_made_again_is_a_trouble_until_it_can(tmp_path: Path) -> None:
    watched = WatchedCell(tmp_path)

    def full() -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(tmp_path / "runs"))

    watched.context.roll_if_due = full
    shutil.rmtree(tmp_path / "runs")
    Watchdog(watched.context)._roll(busy=True)
    assert watched.context.troubles.active["log"].endswith("No space left on device; free some space there")
    asyncio.run(Watchdog(watched.context)._keep_quota())
    watched.run_log.close()


def test_a_quota_that_cannot_be_kept_is_a_trouble_until_it_can(tmp_path: Path) -> None:
    """A folder that may not be listed, a disk that fails: nobody would hear of it before the disk is full."""
    told: list[str | None] = []

    async def play(watched: WatchedCell, _: Watchdog) -> None:
        for failing in (OSError(errno.EIO, os.strerror(errno.EIO), "runs"), None):
            with patch("daemon.maintenance.watchdog.enforce_quota", side_effect=failing, return_value=[]):
                await asyncio.sleep(QUOTA_S + 1.0)
            told.append(watched.context.troubles.active.get("disk"))

    watching(tmp_path, play)
    assert told == ["disk: old runs cannot be removed: runs: Input/output error", None]


def test_a_run_that_the_quota_cannot_remove_is_told_until_it_is_gone(tmp_path: Path) -> None:
    told: list[str | None] = []

    def cannot(runs: Path, *_: object) -> list[Path]:
        stuck = _[-1]
        assert callable(stuck)
        stuck(runs / "20260101T000000Z", "Operation not permitted")
        return []

    async def play(watched: WatchedCell, _: Watchdog) -> None:
        for quota in (cannot, lambda *_: []):
            with patch("daemon.maintenance.watchdog.enforce_quota", quota):
                await asyncio.sleep(QUOTA_S + 1.0)
            told.append(watched.context.troubles.active.get("runs"))

    watching(tmp_path, play)
    assert told[0] is not None
    assert "20260101T000000Z cannot be removed: Operation not permitted; move it away" in told[0]
    assert told[1] is None


@pytest.mark.parametrize("enabled", [True, False])
def test_a_computer_that_slept_does_not_go_on_where_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, enabled: bool
) -> None:
    """The clock that looks are timed by stands still meanwhile: an auto went on an hour later by what it saw before."""
    watched = WatchedCell(tmp_path)
    watched.permission.grant(Grant.ALL if enabled else Grant.NOTHING)

    async def story() -> None:
        one = Watchdog(watched.context)
        awake_s = one._asleep_s
        for slept_s in (0.0, 1.0, 3601.0, 3601.0):
            monkeypatch.setattr(watchdog, "suspended_s", lambda seconds=awake_s + slept_s: seconds)
            one._tick()
            await asyncio.sleep(0.01)

    lived(story())
    assert watched.failed == ["asleep: the computer was suspended for 3600 s"] * enabled


def test_a_large_run_is_ended_in_the_first_idle_moment_after_that_was_seen(tmp_path: Path) -> None:
    """An idle moment was waited for that fell on the minute at which the size is asked."""
    watched, rolled = WatchedCell(tmp_path), list[bool]()
    watched.context.roll_if_due = lambda: rolled.append(True)
    watch = Watchdog(watched.context)
    watch._roll(busy=False)
    assert rolled == []
    with patch("daemon.maintenance.watchdog.run_bytes", lambda _: 10**12):
        asyncio.run(watch._keep_quota())
    watch._roll(busy=True)
    assert rolled == []
    watch._roll(busy=False)
    assert rolled == [True]
    watched.run_log.close()


def test_a_new_run_that_a_full_disk_does_not_take_is_told(tmp_path: Path) -> None:
    watched = WatchedCell(tmp_path)

    def full() -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(tmp_path / "runs"))

    watched.context.roll_if_due = full
    with patch("daemon.maintenance.watchdog.run_bytes", lambda _: 10**12):
        watch = Watchdog(watched.context)
        asyncio.run(watch._keep_quota())
    watch._roll(busy=True)
    assert "disk" not in watched.context.troubles.active
    watch._roll(busy=False)
    assert "cannot start a new run folder" in watched.context.troubles.active["disk"]
    watched.run_log.close()
