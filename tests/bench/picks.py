"""Many picks from random poses with realistic calibration error, against a single look from the same poses.

usage: python -m tests.bench.picks [--picks N] [--calibrations N]

For each of some made-up calibrations (hand-eye off by 0.3 mm and 0.05 degrees, image centres by 0.3 px, in random
directions) the six views are taught anew; then single parts in random resting poses are picked twice: with as many
looks as the approach wants, and with one look from the first stand-off. The witness says what was held and how far
off.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import sys
import time
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "cell"))

import simulated_cell
from simulated_cell import PARTS

from daemon import frames
from daemon.approach import Stops
from daemon.calibration.file import Calibration
from daemon.plan import Settings, doubt_of
from daemon.vision.rig import Camera

HAND_EYE_MM, HAND_EYE_DEG, CENTRE_PX = 0.3, 0.05, 0.3


@dataclass(frozen=True)
class Picked:
    """One pick: its outcome, whether the part ended in the bin, error at the grasp (nan where nothing was met)."""

    outcome: str
    in_bin: bool
    error_mm: float
    error_deg: float
    predicted_mm: float
    stops: int


def erring(true: Calibration, rng: np.random.Generator) -> Calibration:
    """The calibration a cell might have: off by set amounts in random directions."""
    assert true.tool_from_cyclopean is not None
    motion = np.concatenate([_some_way(rng, HAND_EYE_MM), _some_way(rng, np.radians(HAND_EYE_DEG))])
    left, right = (_off_centre(eye, rng) for eye in (true.rig.left, true.rig.right))
    rig = replace(true.rig, left=left, right=right)
    return replace(true, rig=rig, tool_from_cyclopean=frames.perturb(true.tool_from_cyclopean, motion))


def _some_way(rng: np.random.Generator, length: float) -> Any:
    way = rng.normal(size=3)
    return way / np.linalg.norm(way) * length


def _off_centre(eye: Camera, rng: np.random.Generator) -> Camera:
    angle = rng.uniform(0, 2 * np.pi)
    matrix = eye.matrix.copy()
    matrix[:2, 2] += CENTRE_PX * np.array([np.cos(angle), np.sin(angle)])
    return replace(eye, matrix=matrix)


async def pick_once(believed: Calibration, model: Any, seed: int, settings: Settings) -> Picked:
    """One part, drawn by seed, in a random resting pose alone on the table, picked under that calibration."""
    rng = np.random.default_rng(seed)
    label = PARTS[int(rng.integers(len(PARTS)))]
    async with simulated_cell.rig(seed, model, time_scale=40.0, settings=settings, believed=believed) as here:
        simulated_cell.lay(here, label, rng)
        end = await here.cycle.pick()
        error = (float("nan"), float("nan"))
        if end.grasp is not None and here.cell.world.closings:
            with contextlib.suppress(ValueError):
                error = here.grasp_error(end)
        predicted = end.predicted_mm if end.predicted_mm is not None else float("nan")
        return Picked(end.outcome, here.lies(label) == "bin", *error, predicted, end.stops)


async def _all(picks: int, calibrations: int) -> dict[str, list[Picked]]:
    true = simulated_cell.true_calibration()
    found: dict[str, list[Picked]] = {"looks as needed": [], "a single look": []}
    for number in range(calibrations):
        believed = erring(true, np.random.default_rng(number))
        async with simulated_cell.rig(seed=100 + number, believed=believed) as here:
            model = await simulated_cell.taught(here)
        usual = replace(Settings(), doubt=doubt_of(believed.quality))
        once = replace(usual, stops=Stops((450.0,), enough_mm=1e9, enough_deg=1e9, most_looks=1))
        for k in range(picks // calibrations):
            seed = 10_000 * (number + 1) + k
            for name, settings in (("looks as needed", usual), ("a single look", once)):
                one = await pick_once(believed, model, seed, settings)
                found[name].append(one)
            print(".", end="", flush=True)
    print()
    return found


def main() -> None:
    """Pick and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--picks", type=int, default=500)
    parser.add_argument("--calibrations", type=int, default=10)
    args = parser.parse_args()
    began = time.monotonic()
    found = asyncio.run(_all(args.picks, args.calibrations))
    print(
        f"{'':18}{'picks':>6}{'grasped':>10}{'error mm: median, 95 %':>26}{'degrees':>16}{'predicted':>11}{'stops':>7}"
    )
    for name, ones in found.items():
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
        wrong = sum(o.outcome == "picked" and not o.in_bin for o in ones)
        print(f"{'':18}said to be picked and not in the bin: {wrong}")
    print(f"{time.monotonic() - began:.0f} s")


if __name__ == "__main__":
    main()
