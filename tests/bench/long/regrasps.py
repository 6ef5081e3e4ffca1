"""Parts that are to lie on another side at their place: the demo's four and ten machined ones.

plan: from which side to which the planner finds a way, against a search by brute force with random poses in between.
cell: each part from random stable faces to random sides in the simulated cell, against its own truth.

usage: python -m tests.bench.long.regrasps plan [SAMPLES [LABEL ...]] | cell [COUNT [FIRST [LABEL ...]]]
SAMPLES: random poses for each face that a part can lie on (12); COUNT: picks of each part (4); FIRST: the first seed
(1000).
"""

from __future__ import annotations

import asyncio
import sys
import time
from collections import Counter

import numpy as np

from daemon.pick.planning.plan import Destination, NoPlan
from daemon.pick.planning.regrasp import Regrasping
from daemon.store.place_status import PlaceStatus
from tests.fakes.regrasps import TurnedOver, goal_on, pairs_by_brute_force, sides_of, start_on, turned_over
from tests.fakes.set_downs import PARTS, model, shape_of
from tests.fakes.simulated_cell import rig


async def plans(samples: int, labels: list[str]) -> None:
    """Print for each part how many pairs of sides there are, what each of both finds, and how long a plan takes."""
    async with rig(seed=1, model=model()) as here:
        await here.cycle.supervisor.mover.wait_until_at_rest()
        settings, cell, reach = here.cycle.settings, here.cycle.cell, here.cycle.supervisor.mover.reach
        print(
            f"{'part':<18}{'pairs':>6}{'brute':>7}{'planned':>9}{'of these':>10}"
            f"{'grasps':>16}{'first s':>9}{'next s':>8}"
        )
        every = [0, 0, 0]
        for label in labels:
            shape, sides = model().metric[label].solid, sides_of(label)
            brute = pairs_by_brute_force(label, shape, settings, cell.mounting, reach, samples, 7)
            took, found, missed = list[float](), dict[tuple[int, int], int](), list[tuple[int, int]]()
            for pair in [(a, b) for a in sides for b in sides]:
                began_s = time.perf_counter()
                goal = goal_on(label, shape, pair[1])
                regrasping = Regrasping(
                    shape, Destination([goal]), settings, cell.mounting, reach.allows_each, cell.rig
                )
                steps = regrasping.plan(start_on(shape, pair[0]))
                took.append(time.perf_counter() - began_s)
                if not isinstance(steps, NoPlan):
                    found[pair] = len(steps)
                elif pair in brute:
                    missed.append(pair)
            both = len(brute & set(found))
            counts = " ".join(f"{n}x{c}" for n, c in sorted(Counter(found.values()).items()))
            print(f"{label:<18}{len(sides) ** 2:>6}{len(brute):>7}{len(found):>9}{both:>10}{counts:>16}"
                  f"{took[0]:>9.2f}{np.median(took[1:] or took):>8.2f}", *missed, flush=True)  # fmt: skip
            every = [every[0] + len(brute), every[1] + len(found), every[2] + both]
    print(f"all: {every[0]} by brute force, {every[1]} planned, {every[2]} of those by brute force")


def made(label: str, seed: int) -> TurnedOver:
    """One of them."""
    rng = np.random.default_rng(seed)
    rest, side = int(rng.integers(len(shape_of(label).rests))), int(rng.choice(sides_of(label)))
    return asyncio.run(turned_over(label, rest, side, seed, model()))


def cell(count: int, first: int, labels: list[str]) -> None:
    """Print each, and the figures."""
    every = list[TurnedOver]()
    for label in labels:
        for seed in range(first, first + count):
            one = made(label, seed)
            every.append(one)
            print(f"{label} {seed}: planned {one.grasps}, laid {one.laid}, {one.end.outcome}, {one.state.status}, "
                  f"{one.error_mm:.2f} mm, {one.end.seconds:.0f} s; {one.end.why}", flush=True)  # fmt: skip
    planned = [one for one in every if one.grasps]
    for grasps in sorted({one.grasps for one in planned if one.grasps}):
        some = [one for one in planned if one.grasps == grasps]
        right = [one for one in some if one.state.status is PlaceStatus.RIGHT]
        seconds = np.median([one.end.seconds for one in right]) if right else float("nan")
        errors = np.percentile([one.error_mm for one in right], [50, 95]) if right else (float("nan"),) * 2
        print(f"{grasps} grasps: {len(right)} of {len(some)} seen right, median {seconds:.0f} s, "
              f"true error {errors[0]:.2f} mm median, {errors[1]:.2f} mm at 95 %")  # fmt: skip
    print(f"{len(every) - len(planned)} of {len(every)} without a plan: told before anything was taken")


if __name__ == "__main__":
    what, *words = sys.argv[1:]
    numbers = [int(word) for word in words if word.isdigit()]
    chosen = [word for word in words if not word.isdigit()] or list(PARTS)
    if what == "plan":
        (count,) = numbers + [12][len(numbers) :]
        asyncio.run(plans(count, chosen))
    else:
        count, first = numbers + [4, 1000][len(numbers) :]
        cell(count, first, chosen)
