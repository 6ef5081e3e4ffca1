"""The whole daemon on a share of one processor: does a pick still work within its deadlines, and what takes how long?

usage: python -m tests.bench.long.small_computer [SHARE...]

SHARE: 1 and 0.25 unless said otherwise: what the daemon has of one of this machine's processors, by the kernel's own
quota (cgroup, as systemd's CPUQuota=25% sets it; needs root). The cell, its line and its cameras go on beside it at
their own pace. The configuration is the one that is shipped: no deadline is longer than on a desk.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from daemon.store.runs import list_runs, read_run
from tests.fakes.outlive import Beside, Ways

SHARES = 1.0, 0.25
PARTS = ("cube", "pyramid", "triangular_prism", "pentagonal_prism")
ASKED_EVERY_S, ON_ITS_WAY_S, SEED = 0.2, 60.0, 3
GROUPS = Path("/sys/fs/cgroup")
PERIOD_US = 100_000
JOINS = 'echo $$ > {}/cgroup.procs && exec "$@"'


@dataclass
class Row:
    """What one share of a processor is enough for; seconds. answers: to `status`, asked all the while."""

    ready_s: float
    picks_s: list[float] = field(default_factory=list)
    outcomes: list[str] = field(default_factory=list)
    answers_s: list[float] = field(default_factory=list)
    rests_s: float = float("nan")
    stopped_s: float = float("nan")
    looks: list[dict[str, float]] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    judged: list[str] = field(default_factory=list)


@contextmanager
def share_of_a_processor(share: float) -> Iterator[tuple[str, ...]]:
    """A launcher whose command has so much of one processor, and whatever it starts. Raises OSError where the kernel
    does not let us."""
    first_kind = (GROUPS / "cpu").is_dir()
    group = (GROUPS / "cpu" if first_kind else GROUPS) / f"facetd-{time.monotonic_ns()}"
    group.mkdir()
    try:
        quota = round(share * PERIOD_US)
        if first_kind:
            (group / "cpu.cfs_quota_us").write_text(str(quota))
        else:
            (group / "cpu.max").write_text(f"{quota} {PERIOD_US}")
        yield "sh", "-c", JOINS.format(group), "sh"
    finally:
        group.rmdir()


def measured(share: float) -> Row:
    """A start, six views taught, a pick of each part, and a stop on the way."""
    folder = Path(tempfile.mkdtemp(prefix="facetd-small-"))
    with share_of_a_processor(share) as launcher:
        daemon = Beside(folder, Ways(time_scale=1.0), SEED)
        daemon.launcher = launcher
        try:
            daemon.start()
            row = Row(daemon.ready_s)
            daemon.teach()
            with _asked(daemon, row):
                for part in PARTS:
                    _pick(daemon, part, row)
                _stop(daemon, row)
            for record in (r for run in list_runs(daemon.runs) for r in read_run(run).records):
                if record["kind"] == "look" and record["cycle"]:
                    row.looks.append(record["seconds"])
                if record["kind"] == "fault":
                    row.faults.append(record["text"])
            row.judged = daemon.judged()
        finally:
            daemon.close()
            shutil.rmtree(folder, ignore_errors=True)
    return row


def _pick(daemon: Beside, part: str, row: Row) -> None:
    daemon.cell.clear()
    daemon.cell.scatter((part,))
    began_s = time.monotonic()
    done = daemon.do(f"pick {part}")
    row.picks_s.append(time.monotonic() - began_s)
    row.outcomes.append("picked" if done["status"] == 0 else done["text"])


def _stop(daemon: Beside, row: Row) -> None:
    """Say stop with the arm on its way; by the cell's own clock, which is ours."""
    daemon.do("go home")
    going = threading.Thread(target=daemon.do, args=("go survey",))
    going.start()
    cell, until_s = daemon.cell, time.monotonic() + ON_ITS_WAY_S
    while cell.arm.at_rest(cell.server.now_s()) and time.monotonic() < until_s:
        time.sleep(0.01)
    said_s = time.monotonic()
    stop = threading.Thread(target=daemon.do, args=("stop",))
    stop.start()
    daemon.rests()
    row.rests_s = time.monotonic() - said_s
    stop.join()
    row.stopped_s = time.monotonic() - said_s
    going.join()


@contextmanager
def _asked(daemon: Beside, row: Row) -> Iterator[None]:
    """Somebody asks for the status all the while."""
    over = threading.Event()

    def ask() -> None:
        while not over.wait(ASKED_EVERY_S):
            began_s = time.monotonic()
            daemon.do("status")
            row.answers_s.append(time.monotonic() - began_s)

    asking = threading.Thread(target=ask)
    asking.start()
    try:
        yield
    finally:
        over.set()
        asking.join()


def told(share: float, row: Row) -> None:
    """Print one share's figures."""
    picked = row.outcomes.count("picked")
    print(f"\n{share:.0%} of a processor: {picked} of {len(row.outcomes)} picked, {len(row.looks)} looks", flush=True)
    _line("READY", [row.ready_s])
    _line("a pick", row.picks_s)
    for name in sorted({name for look in row.looks for name in look}):
        _line(f"a look: {name}", [look[name] for look in row.looks if name in look])
    _line("an answer to status", row.answers_s)
    _line("from stop to rest", [row.rests_s])
    _line("from stop to its answer", [row.stopped_s])
    for text in [*(f"not picked: {text}" for text in row.outcomes if text != "picked"), *row.faults, *row.judged]:
        print(f"  {text}")


def _line(name: str, seconds: Sequence[float]) -> None:
    if seconds:
        print(f"  {name:<28}{np.median(seconds):>9.2f} s median{max(seconds):>9.2f} s worst")


def main(*shares: Any) -> None:
    """Measure and print."""
    for share in map(float, shares or SHARES):
        told(share, measured(share))


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except OSError as error:
        print(f"no share of a processor can be set here (root, and the kernel's cpu controller, are needed): {error}")
