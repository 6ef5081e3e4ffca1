"""The whole daemon among random operators and mishaps for a million steps: does the motion monitor find anything?

usage: python -m tests.bench.long.surprises [STEPS [SEED [WORKERS]]]

A failure prints the shortest script that shows it, and the seed that found it; the next seed goes on. Exit 1 where
there is one.
"""

from __future__ import annotations

import sys
import time
from functools import partial
from multiprocessing import Pool
from typing import Any

from hypothesis import seed, settings

from tests.fakes.surprises import HOUSE, STEPS, Surprises, live
from tests.fakes.whole_daemon import cell_files

STORIES = 20
"""Of one seed, which ends with the first that surprises."""
SEEDS = 20
"""Of one process: hypothesis reads the whole house for numbers at the start of each."""


def lived(first_seed: int, number: int) -> tuple[int, int, str]:
    """Seed, steps and, where the arm surprised, what was so and the script."""
    here = first_seed + number
    machine: Any = seed(here)(type("Surprises", (Surprises,), {}))
    told = ""
    try:
        live(machine, settings(HOUSE, max_examples=STORIES))
    except AssertionError as error:
        told = str(error)
    return here, machine.steps, told


def main(steps: int = 1_000_000, first_seed: int = 14, workers: int = 2) -> int:
    """Run and print."""
    began_s, done, wrong = time.monotonic(), 0, 0
    cell_files()  # once for all workers
    with Pool(workers, maxtasksperchild=SEEDS) as pool:
        for here, more, told in pool.imap_unordered(partial(lived, first_seed), range(-(-steps // (STORIES * STEPS)))):
            done += more
            wrong += bool(told)
            print(f"  {done} steps, {time.monotonic() - began_s:.0f} s", file=sys.stderr, flush=True)
            if told:
                print(f"seed {here}: the arm surprised\n{told}", flush=True)
    print(f"{done} steps of random operators and mishaps, {time.monotonic() - began_s:.0f} s: {wrong} surprises")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(*(int(word) for word in sys.argv[1:])))
