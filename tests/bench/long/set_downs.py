"""Set-downs at random places of the simulated cell against its own truth: how far off, how often seen right, and how
often a part that was nudged, turned or taken away after the gripper opened is reported.

usage: python -m tests.bench.long.set_downs [COUNT [PLANTED [FIRST]]]
COUNT: set-downs (40); PLANTED: mishaps of each kind (10); FIRST: the first seed (1000).
"""

from __future__ import annotations

import asyncio
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from daemon.store.place_status import PlaceStatus
from tests.fakes.set_downs import SetDownMade, drawn_model, part_of, set_down_made
from tests.fakes.simulated_cell import Rig

Mishap = Callable[[Rig, str], None]


def _nothing(here: Rig, label: str) -> None:
    """Left as it was let go."""


def _nudged(here: Rig, label: str) -> None:
    here.cell.world.nudge(part_of(here, label).name, 2.0, 1.5)


def _turned(here: Rig, label: str) -> None:
    here.cell.world.nudge(part_of(here, label).name, 0.0, 0.0, np.radians(3.0))


def _taken(here: Rig, label: str) -> None:
    here.cell.world.remove(part_of(here, label).name)


PLANTED: dict[str, tuple[Mishap, frozenset[PlaceStatus]]] = {
    "nudged by 2.5 mm": (_nudged, frozenset({PlaceStatus.OFF})),
    "turned by 3 degrees": (_turned, frozenset({PlaceStatus.OFF})),
    "taken away": (_taken, frozenset({PlaceStatus.MISSING})),
}


def made(seed: int, mishap: Mishap = _nothing) -> SetDownMade:
    """One of them."""
    with tempfile.TemporaryDirectory() as folder:
        return asyncio.run(set_down_made(seed, Path(folder), drawn_model(), mishap))


def main(count: int, planted: int, first: int) -> None:
    """Print the table."""
    every = [made(seed) for seed in range(first, first + count)]
    at_place = [one for one in every if one.where == "table" and one.state.status is not PlaceStatus.FREE]
    ends = Counter(str(one.end.outcome) for one in every)
    print(f"{count} picks: {', '.join(f'{n} {outcome}' for outcome, n in ends.most_common())}")
    print(f"{len(at_place)} set down at their place; the others went to the bin, or stayed where they lay")
    for name, values in (("mm", [one.error_mm for one in at_place]), ("degrees", [one.error_deg for one in at_place])):
        half, most, worst = np.percentile(values, [50, 95, 100])
        print(f"true error: median {half:.2f}, 95 % {most:.2f}, largest {worst:.2f} {name}")
    right = sum(one.state.status is PlaceStatus.RIGHT for one in at_place)
    seen = [abs(one.state.off_mm - one.error_mm) for one in at_place if one.state.off_mm is not None]
    print(f"seen right: {right} of {len(at_place)}; the look errs by {np.percentile(seen, 95):.2f} mm at 95 %")
    for name, (mishap, wanted) in PLANTED.items():
        some = [made(seed, mishap) for seed in range(first, first + planted)]
        some = [one for one in some if one.state.status is not PlaceStatus.FREE]
        told = sum(one.state.status in wanted for one in some)
        print(f"{name}: reported {told} of {len(some)}")


if __name__ == "__main__":
    told = [int(word) for word in sys.argv[1:]]
    main(*(told + [40, 10, 1000][len(told) :]))
