"""The kill bench is not blind: a folder or a daemon with one thing wrong is told from one with nothing wrong."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.store.recovery_state import FILE, RecoveryFile
from daemon.store.runlog import RunLog
from daemon.store.runs import new_folder
from tests.fakes.outlive import Beside, Ways, witness
from tests.fakes.sentry import Found, Sentry, come_back, go_on, look_over

NOW = datetime(2026, 11, 21, 10, tzinfo=UTC)
WELL: dict[str, Any] = {"fault": "restarted: the daemon ended in closing", "enabled": False}


class Told(Sentry):
    """A daemon played: it answers as it should, but for what a test sets otherwise."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.state, self.obeys, self.drifts_deg, self.here = dict(WELL), set[str](), 0.0, 0.0
        self.goes_home = True
        self.wire = "WHERE\r"

    def start(self, arguments: Any = (), timeout_s: float = 0.0) -> None:
        """A new run, with what was sent in it."""
        log = RunLog(new_folder(self.runs, NOW))
        log.record("run_start")
        log.wire({"way": "out", "bytes": self.wire})
        assert log.settle()

    def do(self, text: str, answer: str | None = None) -> dict[str, Any]:
        """Answer by rote."""
        self.here += self.drifts_deg
        if text == "enable":
            self.obeys |= {"go home"} if self.goes_home else set()
        data = {"status": self.state, "where": {"joints_deg": [self.here] * 6}}.get(text)
        refused = text in ("pick", "go home") and text not in self.obeys
        return {"text": "", "data": data, "status": int(refused)}


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    short = Path(f"/tmp/facetd-blind-{os.getpid()}-{tmp_path.name[-8:]}")
    yield short
    shutil.rmtree(short, ignore_errors=True)


def left_behind(daemon: Sentry) -> Path:
    """A run as a kill leaves it, in the middle of a pick, with one line torn."""
    log = RunLog(new_folder(daemon.runs, NOW), recovery=RecoveryFile(daemon.folder / "state" / FILE))
    log.record("run_start")
    log.record("command", who="bench", text="auto on")
    log.record("cycle_start", cycle=1)
    log.record("look", images={"left": np.zeros((480, 640), np.uint8)})
    for text in ("WHERE\r", "DO MOVE GOAL\r", "DO BREAK\r"):
        log.wire({"way": "out", "bytes": text})
    assert log.settle()
    with (log.folder / "run.jsonl").open("ab") as file:
        file.write(b'{"v":1,"seq":4,"t":"2026')
    daemon.acknowledged = ["auto on"]
    return log.folder


def looked_over(folder: Path, spoil: Callable[[Path], None] = lambda _: None) -> Found:
    daemon, found = Sentry(folder), Found()
    spoil(left_behind(daemon))
    found.in_cycle += look_over(daemon, found, "a kill")
    return found


def edit(file: Path, change: Callable[[list[bytes]], list[bytes]]) -> None:
    file.write_bytes(b"\n".join(change(file.read_bytes().split(b"\n"))))


def test_a_torn_last_line_is_all_that_a_kill_may_leave(folder: Path) -> None:
    found = looked_over(folder)
    assert found.well, found
    assert (found.torn, found.in_cycle) == (1, 1)


@pytest.mark.parametrize(
    ("spoil", "complaint"),
    [
        (lambda run: edit(run / "run.jsonl", lambda lines: [*lines[:2], lines[2][:20], *lines[3:]]), "unreadable line"),
        (lambda run: edit(run / "run.jsonl", lambda lines: [lines[0], *lines[2:]]), "not in order"),
        (lambda run: edit(run / "run.jsonl", lambda lines: lines[:1]), "answered and is not in the log"),
        (lambda run: edit(run / "wire.jsonl", lambda lines: [lines[0], *lines[2:]]), "does not follow"),
        (lambda run: os.truncate(next(run.glob("images/*.png")), 200), "not a whole picture"),
        (lambda run: (run.parents[1] / "model_store.json").write_text('{"cur'), "not whole"),
    ],
    ids=["torn in the middle", "line lost", "answered, not logged", "wire line lost", "picture cut", "json cut"],
)
def test_whatever_else_a_kill_leaves_is_complained_about(
    folder: Path, spoil: Callable[[Path], None], complaint: str
) -> None:
    found = looked_over(folder, spoil)
    assert any(complaint in text for text in found.complaints), found


def came_back(folder: Path, **wrong: Any) -> Found:
    daemon, found = Told(folder), Found()
    for name, value in wrong.items():
        setattr(daemon, name, value)
    come_back(daemon, found, "a kill", in_cycle=True)
    go_on(daemon, found, "a kill")
    return found


def test_a_daemon_that_asks_and_stands_still_is_not_complained_about(folder: Path) -> None:
    assert came_back(folder).well


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        ({"state": WELL | {"fault": None}}, "does not ask"),
        ({"state": WELL | {"enabled": True}}, "may move after a restart"),
        ({"obeys": {"go home"}}, "the arm moved"),
        ({"drifts_deg": 0.01}, "the arm moved"),
        ({"wire": "WHERE\rDO MOVES GOAL\r"}, "DO MOVE was sent"),
        ({"wire": "TOOL TRANS(0,0,130,0,0,0)\rCAL\r"}, "CAL was sent"),
        ({"goes_home": False}, "does not go home"),
    ],
    ids=["asks nothing", "enabled", "obeys", "moves", "sends a move", "calibrates", "stuck"],
)
def test_a_daemon_that_comes_back_wrongly_is_complained_about(
    folder: Path, wrong: dict[str, Any], complaint: str
) -> None:
    found = came_back(folder, **wrong)
    assert any(complaint in text for text in found.complaints), found


class ToldBeside(Beside):
    """A cell that goes on, with a daemon that says WHERE as the controller does, but for off_deg."""

    off_deg = 0.0

    def do(self, text: str, answer: str | None = None) -> dict[str, Any]:
        """Answer WHERE."""
        return {"text": "", "data": {"joints_deg": [j + self.off_deg for j in self.joints_deg()]}, "status": 0}


@pytest.mark.parametrize(
    ("line", "off_deg", "complaint"),
    [
        (b"WHERE\r", 0.0, None),
        (b"DO MOVES GOAL\x15!!\r", 0.0, None),
        (b"DO DRIVE 1,2,100\r", 0.0, "'DO DRIVE 1,2,100' was carried out"),
        (b"SPEED 100\r", 0.0, "which nobody typed"),
        (b"", 0.1, "WHERE is 0.1"),
    ],
    ids=["its own line", "spoiled line", "half a line completed", "a line of nobody's", "WHERE wrong"],
)
def test_a_cell_that_was_told_what_nobody_typed_is_complained_about(
    folder: Path, line: bytes, off_deg: float, complaint: str | None
) -> None:
    daemon, found = ToldBeside(folder, Ways(cancels_lines=False)), Found()
    daemon.off_deg = off_deg
    try:
        log = RunLog(new_folder(daemon.runs, NOW))
        log.wire({"way": "out", "bytes": "WHERE\r"})
        assert log.settle()
        with daemon.cell.server.controller() as controller:
            controller.receive(line, controller.now_s)
        witness(daemon, found, "a kill")
    finally:
        daemon.close()
    assert found.well if complaint is None else any(complaint in text for text in found.complaints), found
