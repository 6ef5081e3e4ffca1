"""What the daemon before left is not forgotten: not by a start that fails, a second crash, or an orderly stop."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec
import pytest

from daemon.events.pick_order import PickOrder
from daemon.store.recovery_state import RecoveryFile, RecoveryState, read_interrupted_state
from daemon.store.runlog import RunLog
from daemon.store.runs import new_folder

NOW = datetime(2026, 11, 21, 10, tzinfo=UTC)
Record = tuple[str, dict[str, Any]]
START: Record = ("run_start", {})
GRIPPED: tuple[Record, ...] = (
    START,
    ("cycle_start", {"cycle": 4, "target": None}),
    ("estimate", {"cycle": 4, "label": "cube"}),
    ("hand", {"closed": True}),
    ("state", {"from": "closing", "event": "closed", "to": "retreat"}),
)


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    return tmp_path / "runs"


def left_behind(runs: Path) -> RecoveryState | None:
    return read_interrupted_state(runs.parent / "standing", ran_before=runs.is_dir())


def ran(runs: Path, *records: Record, end: dict[str, Any] | None = None) -> None:
    """A run with these records; without `end` it was killed."""
    log = RunLog(new_folder(runs, NOW), recovery=RecoveryFile(runs.parent / "standing"))
    for kind, fields in records:
        log.record(kind, **fields)
    assert log.settle()
    if end is not None:
        log.close("ended", **end)


def came_back(runs: Path, *more: Record, end: dict[str, Any] | None = None) -> None:
    """The daemon starts after what is in `runs`, as the service does it, and ends again."""
    left = left_behind(runs)
    found: tuple[Record, ...] = ()
    if left is not None:
        said = {"run": left.run, "cycle": left.cycle, "state": left.state, "hand_closed": left.hand_closed,
                "label": left.label, "auto": left.auto and msgspec.structs.asdict(left.auto)}  # fmt: skip
        found = (("left", said),)
    ran(runs, *found, START, *more, end=end)


def gripped(left: RecoveryState | None) -> bool:
    return left is not None and left.hand_closed and left.label == "cube"


def test_a_run_cut_off_with_the_part_in_the_gripper_says_so(runs: Path) -> None:
    ran(runs, *GRIPPED)
    left = left_behind(runs)
    assert gripped(left)
    assert left is not None
    assert (left.cycle, left.state) == (4, "retreat")


def test_a_second_crash_before_anybody_looked_forgets_nothing(runs: Path) -> None:
    ran(runs, *GRIPPED)
    came_back(runs)
    came_back(runs)
    assert gripped(left_behind(runs))


def test_starts_that_come_to_nothing_do_not_hide_it(runs: Path) -> None:
    ran(runs, *GRIPPED)
    first = left_behind(runs)
    assert first is not None
    for _ in range(5):
        left = left_behind(runs)
        assert left is not None
        assert left.run == first.run, "told is the run that was cut off, not the start that came to nothing"
        ran(runs, ("left", {"run": left.run, "cycle": 4, "hand_closed": True, "label": "cube"}), end={})
    assert gripped(left_behind(runs))


def test_a_clean_stop_before_resume_leaves_the_question_open(runs: Path) -> None:
    ran(runs, *GRIPPED)
    came_back(runs, end={"holding": None})
    assert gripped(left_behind(runs))


def resumed(*then: Record) -> tuple[Record, ...]:
    return (("state", {"from": "fault", "event": "resume", "to": "idle"}), *then)


@pytest.mark.parametrize(
    ("more", "end", "open_question"),
    [
        (resumed(("holding", {"held": False})), {"holding": False}, False),
        (resumed(("holding", {"held": False})), None, False),
        (resumed(("holding", {"held": True})), {"holding": True}, True),
        (resumed(("holding", {"held": True})), None, True),
        (resumed(), {"holding": None}, True),
        (resumed(("holding", {"held": True}), ("hand", {"closed": False})), {"holding": False}, False),
    ],
)
def test_the_question_is_settled_by_the_operators_word_or_by_opening_the_hand(
    runs: Path, more: tuple[Record, ...], end: dict[str, Any] | None, open_question: bool
) -> None:
    ran(runs, *GRIPPED)
    came_back(runs, *more, end=end)
    left = left_behind(runs)
    assert (left is not None and left.hand_closed) is open_question


def test_a_daemon_stopped_with_a_part_in_the_gripper_is_asked_about_it_when_it_starts_again(runs: Path) -> None:
    ran(runs, *GRIPPED, end={"holding": True})
    assert gripped(left_behind(runs))


AUTO: tuple[Record, ...] = (START, ("auto", {"on": True, "count": 20, "every_s": None}))
BINNED: Record = ("state", {"from": "bin", "event": "binned", "to": "home"})


def left_of_auto(runs: Path) -> PickOrder | None:
    left = left_behind(runs)
    return None if left is None else left.auto


def test_an_auto_cut_off_is_told_with_the_parts_that_are_left_of_it(runs: Path) -> None:
    ran(runs, *AUTO, *[BINNED] * 7, ("cycle_start", {"cycle": 8}))
    assert left_of_auto(runs) == PickOrder(13, None)
    came_back(runs)
    came_back(runs, *resumed(("holding", {"held": True})))
    assert left_of_auto(runs) == PickOrder(13, None)
    came_back(runs, *resumed(("holding", {"held": True}), BINNED))
    assert left_of_auto(runs) == PickOrder(12, None)


def test_an_auto_that_waited_for_parts_when_it_was_cut_off_is_told_though_no_pick_was_under_way(runs: Path) -> None:
    ran(runs, START, ("auto", {"on": True, "count": None, "every_s": 30}), ("cycle_end", {"cycle": 8}))
    assert left_of_auto(runs) == PickOrder(None, 30)


@pytest.mark.parametrize("end", [("auto", {"on": False}), BINNED], ids=["ended", "the last part binned"])
def test_an_auto_that_had_brought_all_leaves_nothing(runs: Path, end: Record) -> None:
    ran(runs, START, ("auto", {"on": True, "count": 1, "every_s": None}), end)
    assert left_behind(runs) is None


def test_an_orderly_end_with_an_empty_gripper_leaves_nothing(runs: Path) -> None:

    assert left_behind(runs) is None
    ran(runs, START, end={"holding": False})
    assert left_behind(runs) is None
