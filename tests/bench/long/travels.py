"""Random travels past the guard against a look at every half millimetre of each: does it let one through that strikes,
does it refuse one that does not, what does asking it cost, and how long does the longest it allows take?

usage: python -m tests.bench.long.travels [COUNT [SEED [WORKERS [SECONDS [FILE]]]]]
COUNT: 2,000 unless said otherwise. FILE keeps what was looked along: said again, it goes on from there.
"""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from functools import partial
from multiprocessing import Pool
from pathlib import Path
from typing import Any

import numpy as np

from daemon.arm.guard import refuse
from daemon.arm.sweep import SLACK_MM, path_refusal
from drivers.puma560 import UnreachableError
from drivers.simcell.arm import SimulatedArm
from tests.fakes.swept import ARM, NEARER, ROBOT, Travel, Truth, random_travel, truth_of

CHUNK = 100
SCENES = (0, 0, 1, 3)
"""How many keep-out boxes stand about, each scene as often as the others; every other one in a small room."""


def kind_of(travel: Travel, truth: Truth) -> str:
    """strikes: touches the table, a side of the room or a box, or its centre point leaves the workspace; close: within
    the clearance; no way: the arm cannot follow; harmless: none of it."""
    if not truth.reached:
        return "no way"
    if truth.touch_mm < 0 or truth.box_mm < -SLACK_MM:
        return "strikes"
    return "close" if truth.touch_mm < travel.limits.clearance_mm or truth.box_mm < 0 else "harmless"


Judged = tuple[bool, str, str, float, float, float]


def lasts_s(travel: Travel) -> float:
    """How long the simulated arm takes for it at full speed; nan where it cannot."""
    arm, target = SimulatedArm(ARM, travel.start.joints_rad), travel.command.world_from_tool
    joints = ROBOT.reachable(target, travel.start.joints_rad)
    try:
        if travel.command.straight:
            arm.move_straight(target, 1.0, 0.0)
        else:
            arm.move_joints(joints, 1.0, 0.0)
    except UnreachableError:
        return float("nan")
    return arm.rests_s


def judged(seed: int, chunk: int) -> tuple[int, list[Judged]]:
    """The chunk's number; of its travels (straight, kind, rule or "allowed", processor ms of the check, least gap mm,
    s it takes)."""
    rng = np.random.default_rng([seed, chunk])
    found = []
    for number in range(CHUNK):
        travel = random_travel(rng, SCENES[number % len(SCENES)], room=number % 2 == 1)
        began = time.process_time()
        refusal = path_refusal(travel.command, travel.standing, travel.start, ROBOT, travel.limits)
        ms = 1000.0 * (time.process_time() - began)
        assert refuse(travel.command, travel.standing, travel.limits) is None, "its end alone is allowed"
        truth = truth_of(travel)
        if refusal is None and not truth.reached:
            truth = truth_of(travel, NEARER)
        told = "allowed" if refusal is None else refusal.rule
        found.append((travel.command.straight, kind_of(travel, truth), told, ms, truth.touch_mm, lasts_s(travel)))
        if refusal is None and found[-1][1] in ("strikes", "no way"):
            print(f"WRONG: chunk {chunk} travel {number}: {truth}", flush=True)
    return chunk, found


def report(every: list[Judged], seconds: float) -> None:
    """Print the table."""
    print(f"{len(every)} travels, {seconds:.0f} s (drawing, checking, and looking along each by brute force)")
    for straight in (False, True):
        rows = [row for row in every if row[0] is straight]
        print("straight" if straight else "joints")
        for kind in ("strikes", "no way", "close", "harmless"):
            told = Counter(row[2] for row in rows if row[1] == kind)
            print(f"  {kind:9} {sum(told.values()):6}: {', '.join(f'{n} {rule}' for rule, n in told.most_common())}")
        for name, some in (("allowed", True), ("refused", False)):
            ms = [row[3] for row in rows if (row[2] == "allowed") is some] or [np.nan]
            median, most = np.percentile(ms, [50, 95])
            print(f"  a check, {name}: median {median:.2f} ms, 95 % {most:.2f} ms, worst {max(ms):.1f} ms")
        s = np.array([row[5] for row in rows if row[2] == "allowed" and np.isfinite(row[5])] or [np.nan])
        print(f"  an allowed one at 100 % takes: median {np.median(s):.2f} s, longest {s.max():.2f} s")
    strike = [row for row in every if row[1] == "strikes"]
    harmless = [row for row in every if row[1] == "harmless"]
    wrong = sum(row[2] == "allowed" for row in every if row[1] == "strikes")
    lost = sum(row[2] == "allowed" for row in every if row[1] == "no way")
    wasted = sum(row[2] != "allowed" for row in harmless)
    print(f"their ends are all allowed; {len(strike)} strike on the way")
    print(f"allowed, and strike: {wrong} of {len(strike)}")
    print(f"allowed, and the wrist comes nearer to straight between two places than it may: {lost}")
    print(f"refused, and harmless: {wasted} of {len(harmless)} ({100 * wasted / max(len(harmless), 1):.2f} %)")
    least = min((row[4] for row in every if row[2] == "allowed"), default=np.nan)
    print(f"nearest that an allowed one came to anything: {least:.2f} mm")


def main(count: int = 2000, seed: int = 14, workers: int = 1, most_s: int = 100_000, kept: str = "/dev/null") -> None:
    """Run and print; after most_s with what there is."""
    began, file = time.perf_counter(), Path(kept)
    lines = file.read_text(encoding="ascii").splitlines() if file.exists() else []
    known = {(of, chunk): rows for of, chunk, rows in map(json.loads, lines)}
    every = [tuple(row) for (of, _), rows in known.items() if of == seed for row in rows]
    chunks = [k for k in range((count + CHUNK - 1) // CHUNK) if (seed, k) not in known]
    with Pool(workers) as pool, file.open("a", encoding="ascii") as keeping:
        for chunk, some in pool.imap_unordered(partial(judged, seed), chunks):
            every += some
            print(json.dumps([seed, chunk, some]), file=keeping, flush=True)
            if len(every) % (20 * CHUNK) == 0:
                print(f"  {len(every)} looked along", file=sys.stderr, flush=True)
            if time.perf_counter() - began > most_s:
                break
    report(every, time.perf_counter() - began)


if __name__ == "__main__":
    numbers: Any = map(int, sys.argv[1:5])
    main(*numbers, *sys.argv[5:])
