"""What the next start must know stands in a file of its own: no clock, no name and no damaged run hides it."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from daemon.store.runlog import RunLog
from daemon.store.standing import SLOT, Standing, StandingFile, after, left_behind

HELD = Standing("a", cycle=4, state="retreat", hand_closed=True, label="cube")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "standing"


def stood(path: Path, *standings: Standing) -> None:
    file = StandingFile(path)
    for standing in standings:
        file.write(standing)
    file.close()


def test_the_newest_counts_whatever_the_clock_says_and_whatever_runs_lie_about(path: Path) -> None:
    stood(path, Standing("z"), Standing("b"))
    stood(path, HELD)
    assert left_behind(path, ran_before=True) == HELD


def test_where_the_daemon_never_ran_nothing_is_asked_and_where_the_file_went_away_all_is(path: Path) -> None:
    assert left_behind(path, ran_before=False) is None
    left = left_behind(path, ran_before=True)
    assert left is not None
    assert left.in_doubt
    assert left.hand_closed
    assert left.damage == f"{path}: missing, though there were runs before"


@pytest.mark.parametrize("at", [0, 9, SLOT, SLOT + 40])
def test_a_damaged_slot_is_told_and_nobody_believes_that_the_hand_is_empty(path: Path, at: int) -> None:
    stood(path, Standing("a"), Standing("a", cycle=1))
    content = bytearray(path.read_bytes())
    content[at] ^= 1
    path.write_bytes(content)
    left = left_behind(path, ran_before=True)
    assert left is not None
    assert (left.damage, left.in_doubt, left.hand_closed) == (f"{path}: damaged", True, True)


@pytest.mark.parametrize(
    "content", [b"x", b"[" * SLOT * 2, b"\xff" * SLOT * 2, bytes(SLOT * 3), b"0 {}".ljust(SLOT * 2)]
)
def test_whatever_else_lies_there_is_told_as_damage(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    left = left_behind(path, ran_before=False)
    assert left is not None
    assert str(path) in left.damage


def test_a_power_cut_at_any_byte_of_a_write_leaves_the_old_or_the_new_or_asks(path: Path) -> None:
    stood(path, Standing("a"), Standing("a", cycle=3))
    before = path.read_bytes()
    stood(path, HELD)
    whole = path.read_bytes()
    for cut in range(0, SLOT + 1, 64):
        for slot in (0, SLOT):
            path.write_bytes(before[:slot] + whole[slot : slot + cut] + before[slot + cut :])
            left = left_behind(path, ran_before=True)
            assert left is not None
            assert left.cycle in (3, 4)
            assert left == HELD or left == Standing("a", cycle=3) or left.damage


def test_a_full_disk_still_takes_what_the_hand_did(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str | None] = []
    log = RunLog(tmp_path / "run", standing=StandingFile(path), on_trouble=told.append)

    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("os.write", full)
    log.record("hand", closed=True)
    log.settle()
    assert told == [f"{tmp_path / 'run'}: No space left on device"]
    left = left_behind(path, ran_before=True)
    assert left is not None
    assert left.hand_closed
    monkeypatch.undo()
    log.close()


def test_it_is_in_the_file_before_the_next_move_may_leave(path: Path, tmp_path: Path) -> None:
    log = RunLog(tmp_path / "run", standing=StandingFile(path))
    log.record("cycle_start", cycle=7, target="cube")
    left = left_behind(path, ran_before=True)
    log.close("killed, as far as this file knows")
    assert left is not None
    assert (left.run, left.cycle, left.label) == ("run", 7, "cube")


def test_a_run_that_goes_on_in_another_folder_keeps_what_stands(path: Path, tmp_path: Path) -> None:
    log = RunLog(tmp_path / "one", standing=StandingFile(path))
    log.record("auto", on=True, count=5, every_s=None)
    log.roll(tmp_path / "two")
    log.record("hand", closed=True)
    left = left_behind(path, ran_before=True)
    log.close()
    assert left is not None
    assert left.auto is not None
    assert (left.run, left.auto.count, left.hand_closed) == ("two", 5, True)


def test_a_fault_that_stood_when_the_daemon_ended_or_was_killed_is_told_and_one_that_was_resumed_is_not() -> None:
    faulty = after(after(Standing("a"), "fault", {"text": "the cable"}), "state", {"from": "idle", "to": "fault"})
    assert (faulty.fault, faulty.to_be_told) == ("the cable", True)
    resumed = after(faulty, "state", {"from": "fault", "event": "resume", "to": "idle"})
    assert not resumed.to_be_told
    assert after(faulty, "run_end", {"holding": False}).to_be_told, "no end of a daemon is a resume"
    assert not after(resumed, "run_end", {"holding": False}).to_be_told


def test_a_text_of_any_length_fits(path: Path) -> None:
    stood(path, after(Standing("a"), "fault", {"text": "\0\N{GREEK SMALL LETTER ALPHA}" * 10_000}))
    left = left_behind(path, ran_before=True)
    assert left is not None
    assert left.damage == ""


def test_a_closed_file_is_let_go_and_may_be_closed_again(path: Path) -> None:
    before = len(os.listdir("/proc/self/fd"))
    file = StandingFile(path)
    file.close()
    file.close()
    assert len(os.listdir("/proc/self/fd")) == before


@pytest.mark.parametrize("event", [{"from": "paused", "event": "resume"}, {"from": "fault", "event": "stop"}])
def test_only_a_resume_from_a_fault_settles_a_doubt(event: dict[str, str]) -> None:
    doubtful = after(Standing("b"), "left", {"run": "a", "cycle": 2, "hand_closed": True})
    assert after(doubtful, "state", {**event, "to": "survey"}).in_doubt
    assert not after(doubtful, "state", {"from": "fault", "event": "resume", "to": "idle"}).in_doubt
