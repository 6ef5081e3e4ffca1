"""Checks after a daemon was killed: what the kill left on the disk, and how the daemon restarts.

What it does when it is killed, and how often, is kill.py's and outlive.py's.
"""

from __future__ import annotations

import json
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2

from daemon.frontends.client import DaemonUnreachableError
from daemon.store.model_store import ModelStore
from daemon.store.outside import FileError
from daemon.store.recovery_state import FILE, read_interrupted_state
from daemon.store.runs import check_wire, list_runs, read_run
from tests.fakes.running import Running

CONFIG = "log: {keep_free_mb: 0, quota_mb: 100, roll_mb: 25}\n"
MOTIONS = ("DO MOVE", "DO READY", "EXECUTE", "CALIBRATE", "CAL\r", "DO OPENI", "DO CLOSEI")
STILL_S = 0.3

Act = Callable[["Sentry"], None]
"""An act of the daemon during which it is killed."""


@dataclass
class Found:
    """The findings after the kills of one kind."""

    kills: int = 0
    torn: int = 0
    lost: list[str] = field(default_factory=list)
    corrupt: list[str] = field(default_factory=list)
    unanswered: list[str] = field(default_factory=list)
    in_cycle: int = 0
    asked: int = 0
    moved: list[str] = field(default_factory=list)
    stuck: list[str] = field(default_factory=list)
    met: Counter[str] = field(default_factory=Counter)
    """What the daemon reported when it restarted, if known."""

    @property
    def complaints(self) -> list[str]:
        """All violations, one line each."""
        return [*self.lost, *self.corrupt, *self.unanswered, *self.moved, *self.stuck]

    @property
    def well(self) -> bool:
        """Whether there are no violations."""
        return not self.complaints


class Sentry(Running):
    """A daemon of which it is recorded which commands it acknowledged."""

    def __init__(self, folder: Path, config: str = CONFIG, seed: int = 9, time_scale: float = 20.0) -> None:
        super().__init__(folder, config, seed, time_scale)
        self.acknowledged: list[str] = []

    def do(self, text: str, answer: str | None = None) -> dict[str, Any]:
        """Send one command; when this returns, the daemon has acknowledged it."""
        done = super().do(text, answer)
        if done["status"] == 0:
            self.acknowledged.append(text)
        return done

    def await_moment(self) -> None:
        """Wait for the moment to kill; here any moment serves."""

    @property
    def holds(self) -> bool:
        """Whether a part is in the gripper: this cell is a new one after each start."""
        return False

    def joints_deg(self) -> list[float]:
        """Where the arm is."""
        found: list[float] = self.do("where")["data"]["joints_deg"]
        return found


def killed(daemon: Sentry, act: Callable[[Any], None], after_s: float, starting: bool) -> None:
    """Begin an act, and kill the daemon in the middle of it."""
    daemon.acknowledged = []
    if starting:
        alive = threading.Timer(after_s, daemon.kill)
        alive.start()
        try:
            daemon.start()
        except RuntimeError:
            return
        finally:
            alive.join()
        return

    def acting() -> None:
        try:
            act(daemon)
        except (DaemonUnreachableError, OSError, ValueError):
            return

    actor = threading.Thread(target=acting, daemon=True)
    actor.start()
    time.sleep(after_s)
    daemon.await_moment()
    daemon.kill()
    actor.join(10)


def look_over(daemon: Sentry, found: Found, name: str) -> bool:
    """Check what the kill left on the disk; returns whether a pick was interrupted."""
    known = list_runs(daemon.runs)
    if not known:
        return False
    for run in known[-2:]:
        read = read_run(run)
        found.torn += sum("torn" in text for text in read.skipped)
        found.lost += [f"{name}: {text}" for text in read.skipped if "torn" not in text]
        numbers = [record["seq"] for record in read.records]
        if numbers != list(range(len(numbers))):
            found.lost.append(f"{name}: {run.name}: line numbers are not in order")
        found.lost += [f"{name}: {text}" for text in check_wire(run) if "torn" not in text]
    said = [r["text"] for run in known[-2:] for r in read_run(run).records if r["kind"] == "command"]
    missing = [text for text in daemon.acknowledged if not text.startswith(UNRECORDED) and text not in said]
    found.unanswered += [f"{name}: `{text}` was answered and is not in the log" for text in missing]
    found.corrupt += [f"{name}: {text}" for text in corrupt_files(daemon.folder / "state")]
    left = read_interrupted_state(daemon.folder / "state" / FILE, ran_before=True)
    return left is not None and (left.cycle is not None or left.hand_closed)


UNRECORDED = ("look", "doctor", "bundle", "scatter", "status", "auto wait")


def corrupt_files(state: Path) -> Iterator[str]:
    """Every incomplete file with a final name."""
    for picture in state.rglob("[0-9a-z]*.png"):
        if cv2.imread(str(picture), cv2.IMREAD_UNCHANGED) is None:
            yield f"{picture}: not a whole picture"
    model_store = ModelStore(state)
    try:
        for view in model_store.views():
            if view.damage:
                yield view.damage
            if view.mesh is None:
                view.images()
        for version in {model_store.current, model_store.candidate, *model_store.history} - {None}:
            model_store.load(version)
    except FileError as error:
        yield str(error)
    for file in state.rglob("*.json"):
        try:
            json.loads(file.read_bytes())
        except ValueError:
            yield f"{file}: not whole"


def come_back(daemon: Sentry, found: Found, name: str, in_cycle: bool) -> None:
    """Start again: after an interrupted pick it must ask, and nothing may move until `resume`."""
    daemon.acknowledged = []
    daemon.start()
    state = daemon.do("status")["data"]
    found.in_cycle += in_cycle
    found.asked += in_cycle and "restarted" in str(state["fault"])
    if in_cycle and "restarted" not in str(state["fault"]):
        found.moved.append(f"{name}: a pick was cut off, and it does not ask")
    if state["enabled"]:
        found.moved.append(f"{name}: the arm may move after a restart")
    before = daemon.joints_deg()
    refused = [daemon.do(text)["status"] for text in ("pick", "go home")]
    time.sleep(STILL_S)
    if 0 in refused or daemon.joints_deg() != before:
        found.moved.append(f"{name}: the arm moved after a restart")
    found.moved += [f"{name}: {word.strip()} was sent after a restart" for word in MOTIONS if word in sent(daemon)]


def go_on(daemon: Sentry, found: Found, name: str) -> None:
    """Type an operator's commands after a restart; then the arm must move again."""
    for text in ("resume", f"holding {'yes' if daemon.holds else 'no'}", "enable"):
        daemon.do(text)
    gone = daemon.do("go home")
    if gone["status"] != 0:
        found.stuck.append(f"{name}: after `resume` and `enable` it does not go home: {gone['text']}")


def sent(daemon: Sentry) -> str:
    """All that the present daemon has sent to the controller."""
    return "".join(r["bytes"] for r in _wire(list_runs(daemon.runs)[-1]) if r["way"] == "out")


def _wire(run: Path) -> Iterator[dict[str, Any]]:
    for line in (run / "wire.jsonl").read_bytes().splitlines():
        yield json.loads(line)
