"""What the daemon costs: seconds until READY (and how many of them it computes), memory, share of a core when idle.

usage: python -m tests.bench.footprint

Recorded: the daemon as on a real cell but for the drivers, its pictures from files. Simulated: the whole cell, cameras
rendered and controller played, in the same process.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from pathlib import Path

from tests.fakes import rendered
from tests.fakes.running import Running

STARTS, LOOKS, IDLE_S = 3, 15, 10.0


def recorded_pairs(into: Path) -> None:
    """A few pairs as recorded; those of the tests where no others are at hand."""
    home = rendered.ALL if rendered.ALL.is_dir() else rendered.HERE
    for scene in [f for f in sorted(home.iterdir()) if (f / "left.png").exists()][:5]:
        shutil.copytree(scene, into / scene.name)


def measure(name: str, config: str, arguments: tuple[str, ...], time_scale: float) -> None:
    """Print a row: the quickest of some starts, and what the last of them holds."""
    folder = Path(tempfile.mkdtemp(prefix="facetd-footprint-"))
    daemon = Running(folder, config, time_scale=time_scale)
    recorded_pairs(folder / "pairs")
    try:
        ready_s, cpu_s = [], []
        for start in range(STARTS):
            daemon.start(arguments)
            ready_s.append(daemon.ready_s)
            begun = daemon.footprint()
            cpu_s.append(begun.cpu_s)
            if start < STARTS - 1:
                daemon.end()
        time.sleep(2.0)
        before = daemon.footprint().cpu_s
        time.sleep(IDLE_S)
        idle_pct = 100 * (daemon.footprint().cpu_s - before) / IDLE_S
        for _ in range(LOOKS):
            daemon.do("look")
        after = daemon.footprint()
        print(f"{name:12}{min(ready_s):>10.2f}{min(cpu_s):>10.2f}{begun.resident_mib:>14.0f}{after.resident_mib:>16.0f}"
              f"{idle_pct:>10.1f}{after.handles:>9}{after.threads:>9}", flush=True)  # fmt: skip
        daemon.end()
        if "--sim" in arguments:
            print(
                "\n".join(daemon.judged()) or "the cell's motion monitor saw the arm do nothing that it must never do",
                flush=True,
            )
    finally:
        daemon.kill()
        shutil.rmtree(folder, ignore_errors=True)


def main() -> None:
    """Measure and print."""
    head = ("READY s", "of it CPU", "MiB at READY", f"after {LOOKS} looks", "idle %", "handles", "threads")
    print("{:12}{:>10}{:>10}{:>14}{:>16}{:>10}{:>9}{:>9}".format("", *head))
    measure("recorded", "cell: recorded\nrecorded: {pairs: pairs}\n", (), 1.0)
    measure("simulated", "", ("--sim",), 1.0)
    print(f"load of this machine meanwhile: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
