"""Picks of ten machined parts, taught from their drawings, alone on the simulated cell's table in random poses.

usage: python -m tests.bench.long.machined_picks [COUNT [FIRST [LABEL ...]]]
COUNT: picks (20); FIRST: the first seed (3000). The parts come in turn.
"""

from __future__ import annotations

import asyncio
import sys
from collections import Counter
from collections.abc import Sequence

import numpy as np

from tests.fakes.set_downs import MACHINED, model, shape_of
from tests.fakes.simulated_cell import rig


async def picked(seed: int, label: str) -> tuple[str, str, str]:
    """How the pick of one part ended, where the part is, and why it ended so."""
    async with rig(seed=seed, model=model()) as here:
        here.cell.world.draw([shape_of(label)])
        here.cell.clear()
        here.cell.scatter([label], np.random.default_rng(seed))
        end = await here.cycle.pick()
        return str(end.outcome), here.lies(label), end.why


def main(count: int, first: int, labels: Sequence[str]) -> None:
    """Print each, and how many are in the bin and are said to be."""
    ends: Counter[tuple[str, str]] = Counter()
    for seed in range(first, first + count):
        label = labels[seed % len(labels)]
        outcome, where, why = asyncio.run(picked(seed, label))
        ends[outcome, where] += 1
        print(f"{seed} {label}: {outcome}, {where}; {why}", flush=True)
    print("; ".join(f"{number} {outcome}, {where}" for (outcome, where), number in ends.most_common()))


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    chosen = [word for word in sys.argv[1:] if not word.isdigit()] or MACHINED
    picks, first = numbers + [20, 3000][len(numbers) :]
    main(picks, first, chosen)
