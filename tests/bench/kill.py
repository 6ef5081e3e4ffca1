"""kill -9 at random moments: the whole daemon is killed while it does what a day asks of it, and looked over.

usage: python -m tests.bench.kill [--kills N] [--seed N] [--time-scale X]

After each kill: is any log line lost but the last, is any file corrupt, is what an operator was answered in the log;
and once it has come back: does it ask, and does anything move before `resume`? Prints a table; exit 1 where it fails.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from daemon.doors.client import NotThereError
from daemon.store.model import ModelError
from daemon.store.runs import check_wire, interrupted, list_runs, read_run
from daemon.store.shelf import Shelf, ShelfError
from tests.bench.running import Running

CONFIG = "log: {keep_free_mb: 0, quota_mb: 100, roll_mb: 25}\n"
MOTIONS = ("DO MOVE", "DO READY", "EXECUTE", "CALIBRATE", "CAL\r", "DO OPENI", "DO CLOSEI")
STILL_S = 0.3

Act = Callable[[Running], None]


def _picking(daemon: Running) -> None:
    daemon.do("scatter")
    daemon.do("auto on")
    daemon.do("auto wait")


def _teaching(daemon: Running) -> None:
    while True:
        for text in ("teach cube", "train", "accept", "forget cube 2", "rollback"):
            daemon.do(text)


def _looking(daemon: Running) -> None:
    while True:
        daemon.do("look")


def _going(daemon: Running) -> None:
    while True:
        for place in ("survey", "home", "bin"):
            daemon.do(f"go {place}")


def _keeping(daemon: Running) -> None:
    while True:
        for text in ("reload", "doctor", "bundle", "hand close", "hand open", "robot cal"):
            daemon.do(text)


ACTS: dict[str, tuple[Act, float]] = {
    "picking": (_picking, 4.0),
    "moving": (_going, 1.5),
    "teaching, training": (_teaching, 4.0),
    "looking": (_looking, 1.0),
    "reload, bundle, CAL, hand": (_keeping, 4.0),
    "starting": (lambda _: None, 2.0),
}
"""What is being done when the kill comes, and within how many seconds of its beginning."""


@dataclass
class Found:
    """What was seen after the kills of one kind."""

    kills: int = 0
    torn: int = 0
    lost: list[str] = field(default_factory=list)
    corrupt: list[str] = field(default_factory=list)
    unanswered: list[str] = field(default_factory=list)
    in_cycle: int = 0
    asked: int = 0
    moved: list[str] = field(default_factory=list)

    @property
    def well(self) -> bool:
        """Nothing that may not be."""
        return not (self.lost or self.corrupt or self.unanswered or self.moved)


class Sentry(Running):
    """A daemon that notes which commands it has acknowledged."""

    def __init__(self, folder: Path, config: str = CONFIG, seed: int = 9, time_scale: float = 20.0) -> None:
        super().__init__(folder, config, seed, time_scale)
        self.acknowledged: list[str] = []

    def do(self, text: str) -> dict[str, Any]:
        """Say one command; when it comes back, it was heard."""
        done = super().do(text)
        if done["status"] == 0:
            self.acknowledged.append(text)
        return done


def killed(daemon: Sentry, act: Act, after_s: float, starting: bool) -> None:
    """Begin to act, and kill in the middle of it."""
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
        except (NotThereError, OSError, ValueError):
            return

    actor = threading.Thread(target=acting, daemon=True)
    actor.start()
    time.sleep(after_s)
    daemon.kill()
    actor.join(10)


def look_over(daemon: Sentry, found: Found, name: str) -> bool:
    """What the kill left on the disk; whether a pick was cut off."""
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
    left = interrupted(known[-1])
    return left is not None and (left.cycle is not None or left.hand_closed)


UNRECORDED = ("look", "doctor", "bundle", "scatter", "status", "auto wait")


def corrupt_files(state: Path) -> Iterator[str]:
    """Every file under its final name that is not whole."""
    for picture in state.rglob("[0-9a-z]*.png"):
        if cv2.imread(str(picture), cv2.IMREAD_UNCHANGED) is None:
            yield f"{picture}: not a whole picture"
    shelf = Shelf(state)
    try:
        for view in shelf.views():
            view.images()
        for version in {shelf.current, shelf.candidate, *shelf.history} - {None}:
            shelf.load(version)
    except (ShelfError, ModelError) as error:
        yield str(error)
    for file in state.rglob("*.json"):
        try:
            json.loads(file.read_bytes())
        except ValueError:
            yield f"{file}: not whole"


def come_back(daemon: Sentry, found: Found, name: str, in_cycle: bool) -> None:
    """Start again: it must ask where a pick was cut off, and nothing may move until `resume`."""
    daemon.acknowledged = []
    daemon.start()
    state = daemon.do("status")["data"]
    found.in_cycle += in_cycle
    found.asked += in_cycle and "restarted" in str(state["fault"])
    if in_cycle and "restarted" not in str(state["fault"]):
        found.moved.append(f"{name}: a pick was cut off, and it does not ask")
    if state["enabled"]:
        found.moved.append(f"{name}: the arm may move after a restart")
    before = daemon.do("where")["data"]["joints_deg"]
    refused = [daemon.do(text)["status"] for text in ("pick", "go home")]
    time.sleep(STILL_S)
    if 0 in refused or daemon.do("where")["data"]["joints_deg"] != before:
        found.moved.append(f"{name}: the arm moved after a restart")
    sent = "".join(r["bytes"] for r in _wire(list_runs(daemon.runs)[-1]) if r["way"] == "out")
    found.moved += [f"{name}: {word.strip()} was sent after a restart" for word in MOTIONS if word in sent]
    for text in ("resume", "holding no", "enable"):
        daemon.do(text)


def _wire(run: Path) -> Iterator[dict[str, Any]]:
    for line in (run / "wire.jsonl").read_bytes().splitlines():
        yield json.loads(line)


def harm(daemon: Sentry, kills: int, seed: int, names: list[str] | None = None) -> dict[str, Found]:
    """Kill a running daemon so often, at random moments of every act in turn."""
    rng = np.random.default_rng(seed)
    table = {name: Found() for name in names or ACTS}
    for k in range(kills):
        name = list(table)[k % len(table)]
        act, within_s = ACTS[name]
        found = table[name]
        if name == "starting":
            daemon.kill()
        killed(daemon, act, float(rng.uniform(0.02, within_s)), name == "starting")
        found.kills += 1
        in_cycle = look_over(daemon, found, f"kill {k + 1}, {name}")
        come_back(daemon, found, f"kill {k + 1}, {name}", in_cycle)
    return table


def print_table(table: dict[str, Found]) -> None:
    """What was seen, a row an act."""
    print(f"{'killed while':28}{'kills':>6}{'torn last line':>16}{'other lines lost':>18}{'answered, not logged':>22}"
          f"{'corrupt files':>15}{'pick cut off: asked':>21}{'moved after':>13}")  # fmt: skip
    for name, found in table.items():
        print(f"{name:28}{found.kills:>6}{found.torn:>16}{len(found.lost):>18}{len(found.unanswered):>22}"
              f"{len(found.corrupt):>15}{f'{found.asked} of {found.in_cycle}':>21}{len(found.moved):>13}")  # fmt: skip
    for found in table.values():
        for text in (*found.lost, *found.corrupt, *found.unanswered, *found.moved):
            print(f"  {text}")


def main() -> int:
    """Kill, look, print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=9)
    parser.add_argument("--time-scale", type=float, default=20.0)
    args = parser.parse_args()
    began_s = time.monotonic()
    folder = Path(tempfile.mkdtemp(prefix="facetd-kill-"))
    daemon = Sentry(folder, CONFIG, args.seed, args.time_scale)
    try:
        daemon.start()
        daemon.teach()
        daemon.do("enable")
        table = harm(daemon, args.kills, args.seed)
    finally:
        daemon.kill()
        shutil.rmtree(folder, ignore_errors=True)
    print_table(table)
    print(f"{sum(f.kills for f in table.values())} kills in {time.monotonic() - began_s:.0f} s")
    return 0 if all(found.well for found in table.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
