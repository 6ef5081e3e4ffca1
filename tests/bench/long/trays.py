"""Trays of twelve in the simulated cell, filled from parts that lie at random, against the cell's own truth.

usage: python -m tests.bench.long.trays [--trays N] [--kills N] [--seed N]

First trays that are filled without a disturbance (each of one of the demo's parts in turn): how many places hold their
part within tolerance, and whether the daemon says the same. Then `facetd` beside a cell that goes on, killed with -9 at
random moments of filling: whether a part lies at a place that the daemon takes for free, whether a place that it takes
for filled is empty, and whether it brought a part where one lay. Exit 1 where one of these is so.
"""

from __future__ import annotations

import argparse
import asyncio
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from daemon import frames
from daemon.pick.place_table import PlaceTable
from daemon.pick.planning.place_goals import Goal, goal_of
from daemon.store.place_file import FILE, Place, PlaceSettings, load_places
from daemon.store.place_status import AT_PLACE_MM, FILLABLE, PlaceStatus, PlaceStatuses
from drivers.simcell.parts import TAUGHT, part_shape
from drivers.simcell.world import PartPlace, PlacedPart, World
from tests.fakes.outlive import Beside, Ways
from tests.fakes.sentry import Found, come_back, go_on, killed, look_over
from tests.fakes.set_downs import drawing, drawn_model, true_error
from tests.fakes.simulated_cell import rig

FIRST_MM, PITCH_MM, TABLE_MM = (380.0, -200.0), 90.0, -300.0
COLUMNS, ROWS = 4, 3
AT_ONCE = 3
"""Parts that lie on the table at a time."""
IDLE_ROUNDS = 3
"""After so many autos in turn that bring nothing a tray is given up."""
MOST_S = 25.0
"""A kill comes within so many seconds of the beginning of an auto."""


def tray_file(label: str) -> str:
    """places.yaml of a tray for parts with this label, each on a side of as many corners as that of the first stable
    pose."""
    shape, solid = part_shape(label), drawn_model().metric[label].solid
    down = int(np.argmin((shape.hull.normals @ shape.rests[0][:3, :3].T)[:, 2]))
    corners = len(shape.hull.faces[down])
    side = next(k for k, ring in enumerate(solid.rings, start=1) if len(ring) == corners)
    corner = Place("corner", PlaceSettings(part=label), np.eye(4), None, side, (*FIRST_MM, TABLE_MM))
    pose = goal_of(corner, solid).poses[0]
    x, y, z = pose[:3, 3]
    right, down = x + PITCH_MM * (COLUMNS - 1), y - PITCH_MM * (ROWS - 1)
    rows = [[round(float(v), 6) for v in row] for row in pose]
    return (f"version: 1\npatterns:\n  tray:\n    part: {label}\n    first: {rows}\n"
            f"    row_end_mm: [{right:.3f}, {y:.3f}, {z:.3f}]\n    column_end_mm: [{x:.3f}, {down:.3f}, {z:.3f}]\n"
            f"    check_mm: [{right:.3f}, {down:.3f}, {z:.3f}]\n    columns: {COLUMNS}\n"
            f"    rows: {ROWS}\n")  # fmt: skip


def places_from(folder: Path, label: str) -> PlaceTable:
    """The tray as the daemon reads it."""
    (folder / FILE).write_text(tray_file(label), encoding="utf-8")
    table = PlaceTable(load_places(folder / FILE), PlaceStatuses(folder))
    model = drawn_model()
    table.know({label: model.metric[label].solid})
    return table


def lying_at(world: World, goal: Goal) -> list[PlacedPart]:
    """The parts that truly lie at a place."""
    lying = [part for part in world.parts if part.where is PartPlace.TABLE]
    middles = [(part, frames.apply(part.pose, part.shape.hull.vertices).mean(axis=0)) for part in lying]
    return [part for part, middle in middles if np.linalg.norm((middle - goal.centre)[:2]) < AT_PLACE_MM]


def watched(world: World, goals: list[Goal]) -> list[str]:
    """What the gripper lets go where a part lies already, in words, as it happens."""
    found: list[str] = []
    opened = world.open_hand

    def open_hand(world_from_tool):
        if world.held is not None:
            middle = frames.apply(world_from_tool @ world.held.pose, world.held.shape.hull.vertices).mean(axis=0)
            near = [goal for goal in goals if np.linalg.norm((middle - goal.centre)[:2]) < AT_PLACE_MM]
            found.extend(f"{goal.place.name} was filled twice" for goal in near if lying_at(world, goal))
        return opened(world_from_tool)

    world.open_hand = open_hand
    return found


def loose(world: World, goals: list[Goal]) -> int:
    """How many parts lie on the table beside the tray."""
    at_places = {part.name for goal in goals for part in lying_at(world, goal)}
    return sum(part.where is PartPlace.TABLE and part.name not in at_places for part in world.parts)


def scatter_on_side(world: World, label: str, rng: np.random.Generator, count: int) -> None:
    """Parts at random on the table, on the side that they are to be set down on: nothing turns a part over yet."""
    before = {part.name for part in world.parts}
    world.scatter([label] * count, rng)
    for part in world.parts:
        if part.name not in before:
            x, y, _ = part.pose[:3, 3]
            world.remove(part.name)
            world.stand(label, 0, float(x), float(y), float(rng.uniform(-np.pi, np.pi)))


async def tray_filled(seed: int, counted: Counter[str], errors: list[tuple[float, float]]) -> list[str]:
    """One tray; what was wrong, in words."""
    label, rng = TAUGHT[seed % len(TAUGHT)], np.random.default_rng(seed)
    folder = Path(tempfile.mkdtemp(prefix="facetd-tray-"))
    try:
        async with rig(seed=seed, model=drawn_model()) as here:
            table = places_from(folder, label)
            here.cycle.use_places(table)
            world, goals = here.cell.world, list(table.goals.values())
            twice, idle = watched(world, goals), 0
            while idle < IDLE_ROUNDS and (free := len(table.free(label))):
                wanted = min(AT_ONCE, free) - loose(world, goals)
                if wanted > 0:
                    scatter_on_side(world, label, rng, wanted)
                ends = await here.cycle.auto()
                counted.update(str(end.outcome) for end in ends)
                idle = idle + 1 if len(table.free(label)) == free else 0
            return [*twice, *_judged(world, table, counted, errors, f"tray {seed}, {label}")]
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _judged(
    world: World, table: PlaceTable, counted: Counter[str], errors: list[tuple[float, float]], name: str
) -> list[str]:
    """Count the places of a tray by what is so and by what the daemon says; what does not agree, in words."""
    found = []
    for goal in table.goals.values():
        parts, status = lying_at(world, goal), table.status(goal.place.name)
        counted[f"place {status}"] += 1
        if parts:
            mm, degrees = true_error(goal, parts[0])
            errors.append((mm, degrees))
            counted["truly right"] += (
                mm <= goal.place.settings.tolerance_mm and degrees <= goal.place.settings.tolerance_deg
            )
        found += [f"{name}: {text}" for text in _disagree(goal, parts, status)]
    return found


def _disagree(goal: Goal, parts: list[PlacedPart], status: PlaceStatus) -> list[str]:
    if parts and status in FILLABLE:
        return [f"a part lies at {goal.place.name}, and it counts as {status}"]
    if not parts and status is PlaceStatus.RIGHT:
        return [f"nothing lies at {goal.place.name}, and it counts as {status}"]
    return []


def fill(trays: int, first: int) -> list[str]:
    """Fill trays; print the figures; what was wrong."""
    counted: Counter[str] = Counter()
    errors: list[tuple[float, float]] = []
    wrong: list[str] = []
    for number, seed in enumerate(range(first, first + trays), start=1):
        wrong += asyncio.run(tray_filled(seed, counted, errors))
        print(f"{number} trays, {number * COLUMNS * ROWS} places: {dict(counted)}", flush=True)
    for unit, values in zip(("mm", "degrees"), np.array(errors).T if errors else (), strict=False):
        half, most, worst = np.percentile(values, [50, 95, 100])
        print(f"true error: median {half:.2f}, 95 % {most:.2f}, largest {worst:.2f} {unit}")
    return wrong


def harm(kills: int, seed: int) -> list[str]:
    """Kill a daemon that fills trays; what was wrong."""
    rng = np.random.default_rng(seed)
    folder = Path(tempfile.mkdtemp(prefix="facetd-tray-"))
    daemon, found = Beside(folder, Ways(time_scale=10.0), seed), Found()
    wrong: list[str] = []
    met: Counter[str] = Counter()
    try:
        (folder / "state").mkdir(exist_ok=True)
        table = places_from(folder / "state", "cube")
        (folder / "cube.stl").write_bytes(drawing("cube"))
        daemon.start()
        for text in (f"teach cube --mesh {folder}/cube.stl mm", "train", "enable"):
            assert daemon.do(text)["status"] == 0, text
        goals, world = list(table.goals.values()), daemon.cell.world
        wrong = watched(world, goals)
        for number in range(1, kills + 1):
            daemon.do("auto off")
            _refill(daemon, table, rng)
            killed(daemon, _filling, float(rng.uniform(0.5, MOST_S)), starting=False)
            name = f"kill {number}"
            in_cycle = look_over(daemon, found, name)
            daemon.rests()
            met.update(str(status) for status in _statuses(table).values())
            wrong += [f"{name}: {text}" for text in _lost(world, table)]
            come_back(daemon, found, name, in_cycle)
            go_on(daemon, found, name)
            print(
                f"{number} kills, {found.in_cycle} in a pick; statuses met {dict(met)}; {len(wrong)} wrong", flush=True
            )
        daemon.do("auto on")
        daemon.do("auto wait")
        wrong += [f"at the end: {text}" for text in _lost(world, table)]
        return [*wrong, *found.complaints, *daemon.judged()]
    finally:
        daemon.close()
        shutil.rmtree(folder, ignore_errors=True)


def _filling(daemon: Beside) -> None:
    for text in ("auto on", "auto wait"):
        daemon.do(text)


def _statuses(table: PlaceTable) -> dict[str, PlaceStatus]:
    """What is on the disk."""
    kept = PlaceStatuses(table.statuses.path.parent)
    return {name: kept.of(name).status for name in table.goals}


def _lost(world: World, table: PlaceTable) -> list[str]:
    statuses = _statuses(table)
    return [
        text for name, goal in table.goals.items() for text in _disagree(goal, lying_at(world, goal), statuses[name])
    ]


def _refill(daemon: Beside, table: PlaceTable, rng: np.random.Generator) -> None:
    """A person takes a full tray away, and puts parts on the table."""
    goals, world = list(table.goals.values()), daemon.cell.world
    statuses = _statuses(table)
    if sum(status in FILLABLE for status in statuses.values()) < AT_ONCE:
        for goal in goals:
            for part in lying_at(world, goal):
                world.remove(part.name)
        daemon.do("place clear all")
    wanted = AT_ONCE - loose(world, goals)
    if wanted > 0:
        scatter_on_side(world, "cube", rng, wanted)


def main() -> int:
    """Fill, kill, print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--trays", type=int, default=30)
    parser.add_argument("--kills", type=int, default=60)
    parser.add_argument("--seed", type=int, default=100)
    args = parser.parse_args()
    began_s = time.monotonic()
    wrong = fill(args.trays, args.seed) if args.trays else []
    wrong += harm(args.kills, args.seed) if args.kills else []
    print("\n".join(wrong) or "no part lost track of, no place filled twice")
    print(f"{time.monotonic() - began_s:.0f} s")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
