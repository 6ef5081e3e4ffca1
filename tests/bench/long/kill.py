"""kill -9 at random moments: the whole daemon is killed while it does what a day asks of it, and looked over.

usage: python -m tests.bench.long.kill [--kills N] [--beside N] [--seed N] [--time-scale X]

After each kill: is any log line lost but the last, is any file corrupt, is what an operator was answered in the log;
and once it has come back: does it ask, does anything move before `resume`, and can it move afterwards? First a daemon
whose simulated cell ends with it (a power cut), then one whose cell goes on (outlive.py). Prints a table; exit 1 where
it fails.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from tests.fakes import outlive
from tests.fakes.sentry import CONFIG, Act, Found, Sentry, come_back, go_on, killed, look_over


def _picking(daemon: Sentry) -> None:
    daemon.do("scatter")
    daemon.do("auto on")
    daemon.do("auto wait")


def _teaching(daemon: Sentry) -> None:
    while True:
        for text in ("teach cube", "train", "accept", "forget cube 2", "rollback"):
            daemon.do(text)


def _looking(daemon: Sentry) -> None:
    while True:
        daemon.do("look")


def _going(daemon: Sentry) -> None:
    while True:
        for place in ("survey", "home", "bin"):
            daemon.do(f"go {place}")


def _keeping(daemon: Sentry) -> None:
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
        go_on(daemon, found, f"kill {k + 1}, {name}")
    return table


def with_its_cell(kills: int, seed: int, time_scale: float) -> dict[str, Found]:
    """A daemon that is killed together with its simulated cell, in a folder of its own."""
    folder = Path(tempfile.mkdtemp(prefix="facetd-kill-"))
    daemon = Sentry(folder, CONFIG, seed, time_scale)
    try:
        daemon.start()
        daemon.teach()
        daemon.do("enable")
        table = harm(daemon, kills, seed)
        table[next(iter(table))].moved += daemon.judged()
        return table
    finally:
        daemon.kill()
        shutil.rmtree(folder, ignore_errors=True)


def print_table(table: dict[str, Found]) -> None:
    """What was seen, a row an act."""
    print(f"{'killed while':46}{'kills':>6}{'torn last line':>16}{'other lines lost':>18}{'answered, not logged':>22}"
          f"{'corrupt files':>15}{'pick cut off: asked':>21}{'moved after':>13}{'stuck after':>13}  met")  # fmt: skip
    for name, found in table.items():
        met = ", ".join(f"{what} {count}" for what, count in found.met.items() if count)
        print(f"{name:46}{found.kills:>6}{found.torn:>16}{len(found.lost):>18}{len(found.unanswered):>22}"
              f"{len(found.corrupt):>15}{f'{found.asked} of {found.in_cycle}':>21}{len(found.moved):>13}"
              f"{len(found.stuck):>13}  {met}")  # fmt: skip
    for found in table.values():
        for text in found.complaints:
            print(f"  {text}")


def main() -> int:
    """Kill, look, print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--kills", type=int, default=100, help="of the daemon with its cell (default 100)")
    parser.add_argument("--beside", type=int, default=60, help="of the daemon beside a cell that goes on (default 60)")
    parser.add_argument("--seed", type=int, default=9)
    parser.add_argument("--time-scale", type=float, default=20.0, help="of the cell that ends with the daemon")
    args = parser.parse_args()
    began_s = time.monotonic()
    table = with_its_cell(args.kills, args.seed, args.time_scale) if args.kills else {}
    if args.beside:
        table |= {f"{name} (cell goes on)": found for name, found in outlive.harm(args.beside, args.seed).items()}
    print_table(table)
    print(f"{sum(f.kills for f in table.values())} kills in {time.monotonic() - began_s:.0f} s")
    return 0 if all(found.well for found in table.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
