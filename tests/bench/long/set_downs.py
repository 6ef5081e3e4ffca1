"""Set-downs of the demo's parts and ten machined ones at random places of the simulated cell, against its own truth:
how far off, how often seen right, and how often a part that was nudged, tilted or taken away after the gripper opened
is reported.

usage: python -m tests.bench.long.set_downs [COUNT [PLANTED [FIRST [LABEL ...]]]]
COUNT: set-downs (42); PLANTED: mishaps of each kind (14); FIRST: the first seed (1000). The parts come in turn.
"""

from __future__ import annotations

import asyncio
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from daemon import frames
from daemon.store.place_status import PlaceStatus
from drivers.simcell.world import PlacedPart, World
from tests.fakes.set_downs import PARTS, Mishap, SetDownMade, model, set_down_made

NUDGED_MM, TILTED_DEG = (2.0, 5.0), (3.0, 10.0)
TOLERANCE = 1.0
"""Of a place, mm and degrees, where nothing else is written."""


def _nudged(world: World, part: PlacedPart, rng: np.random.Generator) -> None:
    way, far_mm = rng.uniform(0.0, 2 * np.pi), rng.uniform(*NUDGED_MM)
    world.nudge(part.name, float(far_mm * np.cos(way)), float(far_mm * np.sin(way)))


def _tilted(world: World, part: PlacedPart, rng: np.random.Generator) -> None:
    """Leans on a chip under one of its edges."""
    way, lean = rng.uniform(0.0, 2 * np.pi), np.radians(rng.uniform(*TILTED_DEG))
    corners = frames.apply(part.pose, part.shape.hull.vertices)
    about = frames.rotation_from_vector(lean * np.array([np.cos(way), np.sin(way), 0.0]))
    middle, floor_mm = corners.mean(axis=0), corners[:, 2].min()
    pose = frames.rigid(about, middle - about @ middle) @ part.pose
    pose[2, 3] += floor_mm - frames.apply(pose, part.shape.hull.vertices)[:, 2].min()
    world.bring_back([replace(part, pose=pose)])


def _taken(world: World, part: PlacedPart, rng: np.random.Generator) -> None:
    world.remove(part.name)


PLANTED: dict[str, tuple[Mishap, frozenset[PlaceStatus]]] = {
    "nudged by 2 to 5 mm": (_nudged, frozenset({PlaceStatus.OFF})),
    "tilted by 3 to 10 degrees": (_tilted, frozenset({PlaceStatus.OFF})),
    "taken away": (_taken, frozenset({PlaceStatus.MISSING})),
}


def made(seed: int, labels: Sequence[str], mishap: Mishap | None = None) -> SetDownMade:
    """One of them."""
    with tempfile.TemporaryDirectory() as folder:
        one = asyncio.run(set_down_made(seed, labels[seed % len(labels)], Path(folder), model(), mishap))
    print(f"{seed} {one.label} on side {one.side}: {one.end.outcome}, {one.state.status}, off {one.error_mm:.2f} mm "
          f"{one.error_deg:.2f} deg, seen {one.state.off_mm} {one.state.off_deg}, "
          f"in the gripper {one.held_mm:.2f} {one.held_deg:.2f}; {one.end.why}", flush=True)  # fmt: skip
    return one


def at_place(some: Sequence[SetDownMade]) -> list[SetDownMade]:
    """Those that were let go there."""
    return [one for one in some if one.state.status is not PlaceStatus.FREE]


def main(count: int, planted: int, first: int, labels: Sequence[str]) -> None:
    """Print each, and the table."""
    every = [made(seed, labels) for seed in range(first, first + count)]
    told = {
        name: [made(seed, labels, mishap) for seed in range(first + count, first + count + planted)]
        for name, (mishap, _) in PLANTED.items()
    }
    ends = Counter(str(one.end.outcome) for one in every)
    print(f"{count} picks: {', '.join(f'{n} {outcome}' for outcome, n in ends.most_common())}")
    there = at_place(every)
    print(f"{len(there)} let go at their place; the others went to the bin, or stayed where they lay")
    for name, values in (
        ("mm", [one.error_mm for one in there]),
        ("degrees", [one.error_deg for one in there]),
        ("mm, in the gripper", [one.held_mm for one in there]),
        ("degrees, in the gripper", [one.held_deg for one in there]),
    ):
        half, most, worst = np.percentile(values, [50, 95, 100]) if values else (np.nan,) * 3
        print(f"true error: median {half:.2f}, 95 % {most:.2f}, largest {worst:.2f} {name}")
    fine = [max(one.error_mm, one.error_deg) <= TOLERANCE for one in there]
    right = [one.state.status is PlaceStatus.RIGHT for one in there]
    agree = Counter(zip(fine, right, strict=True))
    print(f"truly within tolerance {sum(fine)}, of these seen right {agree[True, True]}; "
          f"truly not {len(fine) - sum(fine)}, of these seen right {agree[False, True]}")  # fmt: skip
    for name, some in told.items():
        let_go, wanted = at_place(some), PLANTED[name][1]
        print(f"{name}: reported {sum(one.state.status in wanted for one in let_go)} of {len(let_go)}")


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    chosen = [word for word in sys.argv[1:] if not word.isdigit()] or PARTS
    a, b, c = numbers + [42, 14, 1000][len(numbers) :]
    main(a, b, c, chosen)
