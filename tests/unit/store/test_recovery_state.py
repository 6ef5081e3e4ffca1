"""What the next start must know stands in a file of its own: no clock, no name and no damaged run hides it."""

from __future__ import annotations

import errno
import os
import zlib
from pathlib import Path
from typing import Any

import msgspec
import pytest

from daemon.events.pick_order import OrderStep, PickOrder
from daemon.store.recovery_state import SLOT, RecoveryFile, RecoveryState, after, read_interrupted_state
from daemon.store.runlog import RunLog

HELD = RecoveryState("a", cycle=4, state="retreat", hand_closed=True, label="cube")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "standing"


def stood(path: Path, *standings: RecoveryState) -> None:
    file = RecoveryFile(path)
    for standing in standings:
        file.write(standing)
    file.close()


def test_the_newest_counts_whatever_the_clock_says_and_whatever_runs_lie_about(path: Path) -> None:
    stood(path, RecoveryState("z"), RecoveryState("b"))
    stood(path, HELD)
    assert read_interrupted_state(path, ran_before=True) == HELD


def test_where_the_daemon_never_ran_nothing_is_asked_and_where_the_file_went_away_all_is(path: Path) -> None:
    assert read_interrupted_state(path, ran_before=False) is None
    left = read_interrupted_state(path, ran_before=True)
    assert left is not None
    assert left.in_doubt
    assert left.hand_closed
    assert left.damage == f"{path}: missing, although there were runs before"


@pytest.mark.parametrize("at", [0, 9, SLOT, SLOT + 40])
def test_a_damaged_slot_is_told_and_nobody_believes_that_the_hand_is_empty(path: Path, at: int) -> None:
    stood(path, RecoveryState("a"), RecoveryState("a", cycle=1))
    content = bytearray(path.read_bytes())
    content[at] ^= 1
    path.write_bytes(content)
    left = read_interrupted_state(path, ran_before=True)
    assert left is not None
    assert (left.damage, left.in_doubt, left.hand_closed) == (f"{path}: damaged", True, True)


@pytest.mark.parametrize(
    "content", [b"x", b"[" * SLOT * 2, b"\xff" * SLOT * 2, bytes(SLOT * 3), b"0 {}".ljust(SLOT * 2)]
)
def test_whatever_else_lies_there_is_told_as_damage(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    left = read_interrupted_state(path, ran_before=False)
    assert left is not None
    assert str(path) in left.damage


def test_a_power_cut_at_any_byte_of_a_write_leaves_the_old_or_the_new_or_asks(path: Path) -> None:
    stood(path, RecoveryState("a"), RecoveryState("a", cycle=3))
    before = path.read_bytes()
    stood(path, HELD)
    whole = path.read_bytes()
    for cut in range(0, SLOT + 1, 64):
        for slot in (0, SLOT):
            path.write_bytes(before[:slot] + whole[slot : slot + cut] + before[slot + cut :])
            left = read_interrupted_state(path, ran_before=True)
            assert left is not None
            assert left.cycle in (3, 4)
            assert left == HELD or left == RecoveryState("a", cycle=3) or left.damage


def test_a_full_disk_still_takes_what_the_hand_did(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str | None] = []
    log = RunLog(tmp_path / "run", recovery=RecoveryFile(path), on_trouble=told.append)

    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("os.write", full)
    log.record("hand", closed=True)
    log.settle()
    assert told == [f"{tmp_path / 'run'}: No space left on device"]
    left = read_interrupted_state(path, ran_before=True)
    assert left is not None
    assert left.hand_closed
    monkeypatch.undo()
    log.close()


def test_that_it_cannot_be_kept_is_told_until_it_can(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However many lines the log takes meanwhile: the next of them said that all was well again. Once it can, the next
    line has it kept, not the next change."""
    told: list[str | None] = []
    log = RunLog(tmp_path / "run", recovery=RecoveryFile(path), on_trouble=told.append)

    def failing(*_: object) -> int:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with monkeypatch.context() as patched:
        patched.setattr("os.pwrite", failing)
        log.record("hand", closed=True)
        log.record("decision")
        log.settle()
        assert told == [f"{path}: Input/output error"]
        log.record("decision")
        log.settle()
        assert len(told) == 1
    log.record("decision")
    log.settle()
    assert told[1:] == [None]
    left = read_interrupted_state(path, ran_before=True)
    assert left is not None
    assert left.hand_closed
    log.close()


def test_the_file_of_an_older_release_is_read_where_it_wrote(path: Path) -> None:
    """4096 bytes a slot, since there is such a file: an upgrade in the middle of a pick forgets nothing."""
    slots = [b'{"counter":%d,"standing":{"run":"%s","hand_closed":true}}' % one for one in ((2, b"b"), (1, b"a"))]
    path.write_bytes(b"".join((b"%08x %s" % (zlib.crc32(slot), slot)).ljust(4095) + b"\n" for slot in slots))
    left = read_interrupted_state(path, ran_before=True)
    assert left == RecoveryState("b", hand_closed=True)


def test_it_is_in_the_file_before_the_next_move_may_leave(path: Path, tmp_path: Path) -> None:
    log = RunLog(tmp_path / "run", recovery=RecoveryFile(path))
    log.record("cycle_start", cycle=7, target="cube")
    left = read_interrupted_state(path, ran_before=True)
    log.close("killed, as far as this file knows")
    assert left is not None
    assert (left.run, left.cycle, left.label) == ("run", 7, "cube")


def test_a_run_that_goes_on_in_another_folder_keeps_what_stands(path: Path, tmp_path: Path) -> None:
    log = RunLog(tmp_path / "one", recovery=RecoveryFile(path))
    log.record("auto", on=True, count=5, every_s=None)
    log.roll(tmp_path / "two")
    log.record("hand", closed=True)
    left = read_interrupted_state(path, ran_before=True)
    log.close()
    assert left is not None
    assert left.auto is not None
    assert (left.run, left.auto.count, left.hand_closed) == ("two", 5, True)


def test_a_fault_that_stood_when_the_daemon_ended_or_was_killed_is_told_and_one_that_was_resumed_is_not() -> None:
    faulty = after(after(RecoveryState("a"), "fault", {"text": "the cable"}), "state", {"from": "idle", "to": "fault"})
    assert (faulty.fault, faulty.needs_attention) == ("the cable", True)
    resumed = after(faulty, "state", {"from": "fault", "event": "resume", "to": "idle"})
    assert not resumed.needs_attention
    assert after(faulty, "run_end", {"holding": False}).needs_attention, "no end of a daemon is a resume"
    assert not after(resumed, "run_end", {"holding": False}).needs_attention


def test_a_text_of_any_length_fits(path: Path) -> None:
    stood(path, after(RecoveryState("a"), "fault", {"text": "\0\N{GREEK SMALL LETTER ALPHA}" * 10_000}))
    left = read_interrupted_state(path, ran_before=True)
    assert left is not None
    assert left.damage == ""


def test_a_closed_file_is_let_go_and_may_be_closed_again(path: Path) -> None:
    before = len(os.listdir("/proc/self/fd"))
    file = RecoveryFile(path)
    file.close()
    file.close()
    assert len(os.listdir("/proc/self/fd")) == before


@pytest.mark.parametrize("event", [{"from": "paused", "event": "resume"}, {"from": "fault", "event": "stop"}])
def test_only_a_resume_from_a_fault_settles_a_doubt(event: dict[str, str]) -> None:
    doubtful = after(RecoveryState("b"), "left", {"run": "a", "cycle": 2, "hand_closed": True})
    assert after(doubtful, "state", {**event, "to": "survey"}).in_doubt
    assert not after(doubtful, "state", {"from": "fault", "event": "resume", "to": "idle"}).in_doubt


def test_the_room_for_both_slots_is_there_from_the_first_moment(path: Path) -> None:
    RecoveryFile(path).close()
    assert path.stat().st_size == 2 * SLOT
    assert path.stat().st_blocks * 512 >= 2 * SLOT
    assert read_interrupted_state(path, ran_before=False) is None


@pytest.mark.parametrize("content", [b"", bytes(2 * SLOT)], ids=["cut to nothing", "zeros"])
def test_a_file_that_says_nothing_is_not_believed_where_there_were_runs(path: Path, content: bytes) -> None:
    """What file systems make of one after a crash, and somebody who empties it: a part in the gripper was forgotten."""
    stood(path, RecoveryState("a", hand_closed=True))
    path.write_bytes(content)
    assert read_interrupted_state(path, ran_before=False) is None
    left = read_interrupted_state(path, ran_before=True)
    assert left is not None
    assert (left.hand_closed, left.in_doubt) == (True, True)
    assert left.damage == f"{path}: empty, although there were runs before"


def test_what_was_begun_and_killed_before_anything_happened_is_not_asked_about(path: Path) -> None:
    file = RecoveryFile(path)
    file.begin("a")
    file.close()
    assert read_interrupted_state(path, ran_before=True) is None
    stood(path, RecoveryState("a", fault="x"))
    again = RecoveryFile(path)
    again.begin("b")
    again.close()
    left = read_interrupted_state(path, ran_before=True)
    assert left is not None
    assert left.fault == "x", "what stands there is not written over"


PICKING = RecoveryState("a", cycle=4, state="retreat", label="cube", auto=PickOrder(3, 2.5), fault="x", in_doubt=True)


@pytest.mark.parametrize(
    ("kind", "fields", "change"),
    [
        ("cycle_start", {"cycle": 5, "target": "prism"}, {"cycle": 5, "label": "prism"}),
        ("cycle_end", {"cycle": 4, "label": "cube"}, {"cycle": None, "label": None}),
        ("estimate", {"label": "prism"}, {"label": "prism"}),
        ("fault", {"text": "y" * 300}, {"fault": "y" * 200}),
        ("state", {"from": "a", "to": "b", "event": "resume"}, {"state": "b"}),
        ("state", {"from": "fault", "to": "idle", "event": "stop"}, {"state": "idle"}),
        ("state", {"from": "fault", "to": "idle", "event": "resume"},
         {"state": "idle", "cycle": None, "in_doubt": False, "fault": None}),
        ("state", {"from": "bin", "to": "home", "event": "binned"}, {"state": "home", "auto": PickOrder(2, 2.5)}),
        ("auto", {"on": True, "count": None, "every_s": 9.0}, {"auto": PickOrder(None, 9.0)}),
        ("auto", {"on": True, "count": 2, "order": {"count": 2, "job": "kit", "steps": [{"part": "a"}]}},
         {"auto": PickOrder(2, job="kit", steps=(OrderStep("a"),))}),
        ("state", {"from": "idle", "to": "bin", "event": "full_hand"}, {"state": "bin", "label": None}),
        ("auto", {"on": False, "count": 3}, {"auto": None}),
        ("hand", {"closed": True}, {"hand_closed": True}),
        ("hand", {"closed": False}, {"hand_closed": False}),
        ("hand", {"closed": True, "sent": False}, {}),
        ("holding", {"held": None}, {"hand_closed": True}),
        ("holding", {"held": True}, {"hand_closed": True}),
        ("holding", {"held": False}, {"hand_closed": False}),
        ("run_end", {"why": "continues in b"}, {}),
        ("run_end", {"holding": False}, {"ended": True}),
        ("run_end", {"holding": None}, {"ended": True, "hand_closed": True}),
        ("left", {"run": "b", "cycle": 1, "state": "s", "label": "l", "fault": "f", "hand_closed": True,
                  "auto": {"count": 1, "every_s": None}},
         {"run": "b", "cycle": 1, "state": "s", "label": "l", "fault": "f", "hand_closed": True,
          "auto": PickOrder(1, None)}),
        ("left", {}, {"cycle": None, "state": None, "label": None, "fault": None, "auto": None}),
        ("look", {"cycle": 9, "label": "z"}, {}),
    ],
)  # fmt: skip
def test_what_each_record_says_of_how_things_stand(kind: str, fields: dict[str, Any], change: dict[str, Any]) -> None:
    assert after(PICKING, kind, fields) == msgspec.structs.replace(PICKING, **change)


def test_a_doubt_of_before_is_not_settled_by_an_end_in_order_and_a_part_in_the_hand_is_one() -> None:
    sure = msgspec.structs.replace(PICKING, in_doubt=False)
    assert after(sure, "run_end", {"holding": False}).in_doubt is False
    assert after(sure, "run_end", {"holding": None}).in_doubt is True
    assert after(PICKING, "run_end", {"holding": False}).in_doubt is True


def test_an_auto_counts_down_to_nothing() -> None:
    binned = {"event": "binned", "to": "home"}
    orders = [RecoveryState("a", auto=PickOrder(count, 1.0)) for count in (None, 3, 2, 1)]
    assert [after(state, "state", binned).auto for state in orders] == [
        PickOrder(None, 1.0),
        PickOrder(2, 1.0),
        PickOrder(1, 1.0),
        None,
    ]
    assert after(RecoveryState("a"), "state", binned) == RecoveryState("a", state="home")


@pytest.mark.parametrize(
    ("standing", "told"),
    [
        (RecoveryState("a"), False),
        (RecoveryState("a", cycle=1), True),
        (RecoveryState("a", hand_closed=True), True),
        (RecoveryState("a", auto=PickOrder(1, None)), True),
        (RecoveryState("a", cycle=1, ended=True), False),
        (RecoveryState("a", fault="x", ended=True), True),
        (RecoveryState("a", in_doubt=True, ended=True), True),
        (RecoveryState("a", state="survey", label="cube"), False),
    ],
)
def test_somebody_is_asked_where_something_was_cut_off_in_doubt_or_at_fault(
    standing: RecoveryState, told: bool
) -> None:
    assert standing.needs_attention is told


def test_who_opens_it_again_writes_over_the_older_slot(path: Path) -> None:
    for count in range(1, 6):
        stood(path, *(RecoveryState(f"run {k}", cycle=k) for k in range(count)))
        stood(path, RecoveryState("last", cycle=9))
        content = path.read_bytes()
        assert content.count(b'"last"') == 1
        assert f'"run {count - 1}"'.encode() in content, "the one before it is still whole"
        path.unlink()


def test_the_slot_of_a_number_is_where_every_release_looks_for_it(path: Path) -> None:
    """Odd ones in the second, or a release that takes over would write over the newer of the two."""
    stood(path, RecoveryState("one"))
    assert path.read_bytes()[:SLOT].strip(b"\0") == b""
    stood(path, RecoveryState("two"))
    assert b'"two"' in path.read_bytes()[:SLOT]
