"""Many picks from random poses with realistic calibration error, against a single look from the same poses.

usage: python -m tests.bench.long.picks [--picks N] [--calibrations N] [--own N] [--single-every N] [--jobs N]

Under each of some calibrations the six views are taught anew; then single parts in random resting poses are picked with
as many looks as the approach wants, and every so many of the same poses with one look from the first stand-off. The
ground truth says what was held and how far off. The calibrations are made up (hand-eye off by 0.3 mm and 0.05 degrees,
image centres by 0.3 px, in random directions) or, --own, found by the program's own calibration of the simulated cell.
Besides: how long the daemon takes from one move's end to the next one's start, with a look.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from daemon import frames
from daemon.calibration.file import Calibration
from daemon.cell.pick_cell import doubt_of
from daemon.cli.demo import PARTS
from daemon.pick.pose_fusion import Doubt
from daemon.pick.settings import Settings, StandOffs
from daemon.vision.geometry.rig import Camera
from tests.bench.calibration import calibrated
from tests.fakes import simulated_cell
from tests.fakes.simulated_cell import Rig

HAND_EYE_MM, HAND_EYE_DEG, CENTRE_PX = 0.3, 0.05, 0.3
TIME_SCALE = 40.0
SURE, SINGLE = "looks as needed", "a single look"
AGAIN = {"picked", "missed", "lost", "unsure", "unreachable", "unknown", "ambiguous", "empty"}
"""Outcomes after which the same cell goes on; after others it is built anew."""


@dataclass(frozen=True)
class Picked:
    """One pick: its outcome, whether the part ended in the bin, error at the grasp (nan where nothing was met)."""

    outcome: str
    in_bin: bool
    error_mm: float
    error_deg: float
    predicted_mm: float
    stops: int
    why: str = ""


@dataclass(frozen=True)
class Turn:
    """From a move's end (the controller's prompt, the arm at rest) to the next one's start, with a look in it: s in
    all, s waited for pictures (settling, exposure, rendering), and the processor's s for all but those."""

    wall_s: float
    pictures_s: float
    busy_s: float

    @property
    def own_s(self) -> float:
        """What the daemon itself took."""
        return self.wall_s - self.pictures_s


class Stopwatch:
    """Times the turns of one rig, by its robot's moves and its cameras' grabs."""

    def __init__(self, here: Rig) -> None:
        self.turns: list[Turn] = []
        self._since: tuple[float, float] | None = None
        self._pictures = [0.0, 0.0]
        self._move, self._grab = here.robot.move, here.cycle.cell.cameras.grab
        here.robot.move, here.cycle.cell.cameras.grab = self.move, self.grab

    async def move(self, *args: Any, **how: Any) -> Any:
        """The robot's move, with the turn before it told."""
        if self._since is not None and self._pictures[0] > 0:
            wall, busy = (b - a for a, b in zip(self._since, _now(), strict=True))
            self.turns.append(Turn(wall, self._pictures[0], busy - self._pictures[1]))
        self._pictures = [0.0, 0.0]
        reading = await self._move(*args, **how)
        self._since = _now()
        return reading

    async def grab(self, *args: Any, **how: Any) -> Any:
        """The cameras' grab, timed."""
        began = _now()
        try:
            return await self._grab(*args, **how)
        finally:
            self._pictures = [s + b - a for s, a, b in zip(self._pictures, began, _now(), strict=True)]


def _now() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()


def erring(true: Calibration, rng: np.random.Generator) -> Calibration:
    """The calibration a cell might have: off by set amounts in random directions."""
    assert true.tool_from_cyclopean is not None
    motion = np.concatenate([_some_way(rng, HAND_EYE_MM), _some_way(rng, np.radians(HAND_EYE_DEG))])
    left, right = (_off_centre(camera, rng) for camera in (true.rig.left, true.rig.right))
    rig = replace(true.rig, left=left, right=right)
    return replace(true, rig=rig, tool_from_cyclopean=frames.perturb(true.tool_from_cyclopean, motion))


def _some_way(rng: np.random.Generator, length: float) -> Any:
    way = rng.normal(size=3)
    return way / np.linalg.norm(way) * length


def _off_centre(camera: Camera, rng: np.random.Generator) -> Camera:
    angle = rng.uniform(0, 2 * np.pi)
    matrix = camera.matrix.copy()
    matrix[:2, 2] += CENTRE_PX * np.array([np.cos(angle), np.sin(angle)])
    return replace(camera, matrix=matrix)


async def pick_once(believed: Calibration, model: Any, seed: int, settings: Settings) -> Picked:
    """One part, drawn by seed, in a random resting pose alone on the table, picked under that calibration."""
    async with simulated_cell.rig(seed, model, time_scale=TIME_SCALE, settings=settings, believed=believed) as here:
        return await pick_here(here, seed)


async def pick_here(here: Rig, seed: int) -> Picked:
    """The same in a cell that runs already."""
    rng = np.random.default_rng(seed)
    label = PARTS[int(rng.integers(len(PARTS)))]
    simulated_cell.lay(here, label, rng)
    closings = len(here.cell.world.closings)
    end = await here.cycle.pick()
    error = (float("nan"), float("nan"))
    if end.grasp is not None and len(here.cell.world.closings) > closings:
        with contextlib.suppress(ValueError):
            error = here.grasp_error(end)
    predicted = end.predicted_mm if end.predicted_mm is not None else float("nan")
    return Picked(
        end.outcome, here.lies(label) == "bin", *error, predicted, end.stops, f"seed {seed}, {label}: {end.why}"
    )


async def _row(
    believed: Calibration, model: Any, seeds: Sequence[int], settings: Settings
) -> tuple[list[Picked], list[Turn]]:
    """All picks of one kind under one calibration, in one cell as long as it goes on."""
    left, found, turns = list(seeds), list[Picked](), list[Turn]()
    while left:
        async with simulated_cell.rig(left[0], model, TIME_SCALE, settings, believed) as here:
            watch = Stopwatch(here)
            while left and (not found or found[-1].outcome in AGAIN or not watch.turns):
                found.append(await pick_here(here, left.pop(0)))
                print("." if found[-1].in_bin else f"\n{found[-1]}", end="", flush=True)
            turns += watch.turns
    return found, turns


async def _under_one(
    number: int, picks: int, single_every: int, own: bool
) -> tuple[dict[str, list[Picked]], list[Turn]]:
    """Teach and pick under one calibration."""
    if own:
        believed = (await calibrated(number)).calibration
    else:
        believed = erring(simulated_cell.true_calibration(), np.random.default_rng(number))
    async with simulated_cell.rig(seed=100 + number, believed=believed) as here:
        model = await simulated_cell.taught(here)
    usual = replace(Settings(), doubt=doubt_of(believed.quality, Doubt()))
    once = replace(usual, stops=StandOffs((450.0,), enough_mm=1e9, enough_deg=1e9, most_looks=1))
    seeds = [10_000 * (number + 1) + k for k in range(picks)]
    sure, turns = await _row(believed, model, seeds, usual)
    single, _ = await _row(believed, model, seeds[::single_every], once)
    return {SURE: sure, SINGLE: single}, turns


def _run(task: tuple[int, bool], picks: int, single_every: int) -> tuple[dict[str, list[Picked]], list[Turn]]:
    return asyncio.run(_under_one(task[0], picks, single_every, task[1]))


def _told(name: str, ones: Sequence[Picked]) -> None:
    """One row of the table, and what went wrong in it."""
    met = [o for o in ones if np.isfinite(o.error_mm)]
    mm, deg = np.array([o.error_mm for o in met]), np.array([o.error_deg for o in met])
    print(
        f"{name:18}{len(ones):>6}{100 * np.mean([o.in_bin for o in ones]):>9.1f}%"
        f"{np.median(mm):>17.2f}, {np.quantile(mm, 0.95):>6.2f}"
        f"{np.median(deg):>9.2f}, {np.quantile(deg, 0.95):>5.2f}"
        f"{np.nanmedian([o.predicted_mm for o in ones]):>11.2f}{np.mean([o.stops for o in met]):>7.2f}"
    )
    others = Counter(o.outcome for o in ones if not o.in_bin)
    if others:
        print(f"{'':18}not in the bin: {', '.join(f'{n} {what}' for what, n in others.items())}")
    for one in (o for o in ones if not o.in_bin):
        print(f"{'':20}{one.outcome}: {one.why}")
    print(f"{'':18}said to be picked and not in the bin: {sum(o.outcome == 'picked' and not o.in_bin for o in ones)}")


def _times(turns: Sequence[Turn]) -> None:
    own, pictures, busy = (1000 * np.array([getattr(t, n) for t in turns]) for n in ("own_s", "pictures_s", "busy_s"))
    print(f"\nfrom a move's end to the next one's start with a look in it, ms, {len(turns)} times:  median     95 %")
    print(f"  {'the daemon itself':56}{np.median(own):>12.0f}{np.quantile(own, 0.95):>9.0f}")
    print(f"  {'  of that, on an idle processor (its time)':56}{np.median(busy):>12.0f}{np.quantile(busy, 0.95):>9.0f}")
    told = "besides: settling, exposure and the rendering of pictures"
    print(f"  {told:56}{np.median(pictures):>12.0f}{np.quantile(pictures, 0.95):>9.0f}")


def main() -> None:
    """Pick and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--picks", type=int, default=500)
    parser.add_argument("--calibrations", type=int, default=10, help="made-up ones")
    parser.add_argument("--own", type=int, default=0, help="calibrations that the program finds itself")
    parser.add_argument("--single-every", type=int, default=5, help="which of the poses a single look is tried at, too")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)))
    args = parser.parse_args()
    began = time.monotonic()
    tasks = [(number, False) for number in range(args.calibrations)] + [(number, True) for number in range(args.own)]
    found: dict[str, list[Picked]] = {SURE: [], SINGLE: []}
    turns: list[Turn] = []
    work = partial(_run, picks=args.picks // len(tasks), single_every=args.single_every)
    with ProcessPoolExecutor(args.jobs) as pool:
        for number, (ones, times) in enumerate(pool.map(work, tasks), start=1):
            turns += times
            for name, some in ones.items():
                found[name] += some
            binned = sum(one.in_bin for one in found[SURE])
            print(f" {number} calibrations: {binned} of {len(found[SURE])} in the bin", flush=True)
    print(f"\n{'':18}{'picks':>6}{'grasped':>10}{'error mm: median, 95 %':>26}{'degrees':>16}", end="")
    print(f"{'predicted':>11}{'stops':>7}")
    for name, every in found.items():
        _told(name, every)
    _times(turns)
    print(f"{time.monotonic() - began:.0f} s")


if __name__ == "__main__":
    main()
