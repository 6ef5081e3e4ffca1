"""A million hostile inputs for every reader and frontend, in children with 200 MB of room and a clock.

usage: python -m tests.bench.long.hostile [INPUTS [SEED [WORKERS]]]

Prints a table: reader, inputs, findings (anything but a value or a named error; a child that died), the slowest input,
how much memory came on top. Exit 1 where something was found, took more than a second, or more than 200 MB.
"""

from __future__ import annotations

import os
import random
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from itertools import count
from pathlib import Path

from tests.fakes.hostile import READERS, Reader, attack

ROOM_BYTES, LONGEST_S, BATCH = 200_000_000, 1.0, 2_000


def virtual_bytes() -> int:
    """What this process has mapped."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def attacked(number: int, seed: int) -> tuple[list[str], float, float]:
    """One batch: findings, the slowest input's seconds of this processor, MB on top of what was there."""
    reader = READERS[number]
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # libraries complain there of damaged pictures
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        warm = list(attack(reader, -1, 50, Path(folder)))
        before = virtual_bytes()
        resource.setrlimit(resource.RLIMIT_AS, (before + ROOM_BYTES, resource.RLIM_INFINITY))
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        timed = Timed(reader)
        found = [*warm, *attack(timed.reader, seed, BATCH, Path(folder))]
        resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak) / 1000
    return [f"{error!r} {content[:300]!r}" for content, error in found], timed.slowest_s, grown


class Timed:
    """A reader, and how long its slowest input took."""

    def __init__(self, reader: Reader) -> None:
        self.slowest_s = 0.0
        self.reader = Reader(reader.name, reader.valid, partial(self._read, reader), reader.errors)

    def _read(self, reader: Reader, content: bytes, folder: Path) -> object:
        began_s = time.process_time()
        try:
            return reader.read(content, folder)
        finally:
            self.slowest_s = max(self.slowest_s, time.process_time() - began_s)


def batches(inputs: int, seed: int) -> Iterator[tuple[int, int]]:
    """Reader and seed of each batch, readers in turn."""
    chance = random.Random(seed)
    for number, _ in zip(count(), range(-(-inputs // BATCH)), strict=False):
        yield number % len(READERS), chance.randrange(2**32)


def main(inputs: int = 1_000_000, seed: int = 18, workers: int = 2) -> int:
    """Run and print."""
    rows = {reader.name: [0, 0, 0.0, 0.0] for reader in READERS}
    began_s = time.monotonic()
    with ProcessPoolExecutor(workers) as pool:
        running = [(number, here, pool.submit(attacked, number, here)) for number, here in batches(inputs, seed)]
        for number, here, work in running:
            row = rows[READERS[number].name]
            try:
                findings, slowest_s, grown_mb = work.result()
            except BrokenProcessPool:
                print(f"{READERS[number].name}, seed {here}: a child died", flush=True)
                row[1] += 1
                break
            for finding in findings[:3]:
                print(f"{READERS[number].name}, seed {here}: {finding}", flush=True)
            row[:] = [row[0] + BATCH, row[1] + len(findings), max(row[2], slowest_s), max(row[3], grown_mb)]
    print("| reader | inputs | findings | slowest s | MB on top |\n| --- | --- | --- | --- | --- |")
    for name, (tried, found, slowest_s, grown_mb) in rows.items():
        print(f"| {name} | {tried} | {found} | {slowest_s:.2f} | {grown_mb:.0f} |")
    print(f"{sum(row[0] for row in rows.values())} inputs in {time.monotonic() - began_s:.0f} s")
    return int(any(row[1] or row[2] > LONGEST_S or row[3] > ROOM_BYTES / 1e6 for row in rows.values()))


if __name__ == "__main__":
    sys.exit(main(*(int(word) for word in sys.argv[1:])))
