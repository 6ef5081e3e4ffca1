"""A soak: the whole daemon picks for thousands of accelerated cycles; is what it holds of memory and handles flat?

usage: python -m tests.bench.long.soak [--cycles N] [--every N] [--time-scale X] [--seed N]

Parts are strewn, cleared by `auto on`, strewn again; runs are rolled and old ones removed on the way, as over years.
Prints a row every N cycles and at the end the slope of the resident memory over the second half.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from tests.fakes.running import Footprint, Running

CONFIG = "log: {quota_mb: 300, keep_free_mb: 0, roll_mb: 40}\n"
STALLED_S = 600.0


def clear_table(daemon: Running, outcomes: Counter[str]) -> int:
    """Strew the four parts, pick until none is left; how many cycles that took. A fault is taken as mended."""
    daemon.do("scatter")
    if daemon.do("auto on")["status"] != 0:
        daemon.do("resume")
        daemon.do("holding no")
        daemon.do("enable")
        outcomes["resumed"] += 1
        return 0
    ends = daemon.do("auto wait")["data"]["ends"]
    outcomes.update(end["outcome"] for end in ends)
    return sum(end["outcome"] != "empty" for end in ends)


def row(cycles: int, began_s: float, held: Footprint, runs: Path) -> str:
    """One line of the table."""
    kept = sum(f.stat().st_size for f in runs.rglob("*") if f.is_file()) / 1e6
    hours = (time.monotonic() - began_s) / 3600
    return (f"{cycles:>7}{hours:>8.2f}{held.resident_mib:>10.1f}{held.anonymous_mib:>10.1f}{held.handles:>9}"
            f"{held.threads:>9}{held.cpu_s:>9.0f}{kept:>9.0f}")  # fmt: skip


def slope(rows: list[tuple[int, Footprint]]) -> float:
    """MiB of resident memory gained in 1,000 cycles, fitted to the second half of the rows."""
    later = rows[len(rows) // 2 :]
    if len(later) < 3:
        return float("nan")
    return float(1000 * np.polyfit([n for n, _ in later], [f.resident_mib for _, f in later], 1)[0])


def main() -> None:
    """Soak and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--cycles", type=int, default=2000)
    parser.add_argument("--every", type=int, default=100)
    parser.add_argument("--time-scale", type=float, default=80.0)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="facetd-soak-"))
    daemon = Running(folder, CONFIG, args.seed, args.time_scale)
    daemon.start()
    try:
        daemon.teach()
        daemon.do("enable")
        _soak(daemon, args.cycles, args.every)
        print(f"ended with {daemon.end()}", flush=True)
        print(
            "\n".join(daemon.judged()) or "the cell's motion monitor saw the arm do nothing that it must never do",
            flush=True,
        )
    finally:
        daemon.kill()
        shutil.rmtree(folder, ignore_errors=True)


def _soak(daemon: Running, wanted: int, every: int) -> None:
    head = ("cycles", "hours", "RSS MiB", "anon MiB", "handles", "threads", "CPU s", "runs MB")
    print("{:>7}{:>8}{:>10}{:>10}{:>9}{:>9}{:>9}{:>9}".format(*head))
    began_s = heard_s = time.monotonic()
    cycles, outcomes = 0, Counter[str]()
    rows = [(0, daemon.footprint())]
    print(row(0, began_s, rows[0][1], daemon.runs), flush=True)
    while cycles < wanted and time.monotonic() < heard_s + STALLED_S:
        done = clear_table(daemon, outcomes)
        cycles += done
        heard_s = time.monotonic() if done else heard_s
        if cycles // every > rows[-1][0] // every:
            rows.append((cycles, daemon.footprint()))
            print(row(cycles, began_s, rows[-1][1], daemon.runs), flush=True)
    handles = [f.handles for _, f in rows[1:]] or [rows[0][1].handles]
    print(f"{cycles} cycles: {', '.join(f'{n} {what}' for what, n in outcomes.most_common())}")
    print(f"resident memory grows by {slope(rows):+.2f} MiB in 1,000 cycles (second half); handles {min(handles)} to "
          f"{max(handles)}")  # fmt: skip


if __name__ == "__main__":
    main()
