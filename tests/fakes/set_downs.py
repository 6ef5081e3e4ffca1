"""Set-downs in the simulated cell, held against its own truth: for tests and the bench of set-downs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from daemon import frames
from daemon.config import load_config
from daemon.pick.outcome import CycleEnd
from daemon.pick.place_goals import Goal, PlaceTable
from daemon.store.library import load_facets
from daemon.store.place_file import CellPlaces, Manner, Place
from daemon.store.place_status import PlaceState, PlaceStatuses
from daemon.teaching.solid_from_mesh import solid_drawn
from daemon.vision.model.model import Model, empty_model, learn_solid
from drivers.simcell.parts import TAUGHT, part_shape
from drivers.simcell.witness import pose_error
from drivers.simcell.world import PlacedPart
from tests.fakes.simulated_cell import CONFIG, Rig, rig


def drawing(label: str) -> bytes:
    """The simulated part's own shape, as an STL."""
    solid = part_shape(label).hull
    fans = [solid.vertices[[f[0], b, c]] for f in solid.faces for b, c in pairwise(f[1:])]
    body = b"".join(bytes(12) + np.asarray(fan, "<f4").tobytes() + bytes(2) for fan in fans)
    return bytes(80) + len(fans).to_bytes(4, "little") + body


@cache
def drawn_model() -> Model:
    """The demo's parts, each taught from its drawing."""
    config = load_config(CONFIG, simulated=True)
    library = load_facets(config.file(config.values.files.facets))
    model = empty_model(library)
    for label in TAUGHT:
        model = learn_solid(model, solid_drawn(f"{label}.stl", drawing(label), "mm", library), label)
    return model


def part_of(here: Rig, label: str) -> PlacedPart:
    """The part of that label, wherever it is."""
    return next(part for part in here.cell.world.parts if part.label == label)


def side_down_of(here: Rig, label: str) -> int:
    """The number of a taught side that a part may lie on as the one in the cell lies: as many corners as that has."""
    assert here.cycle.recogniser is not None
    shape, part = here.cycle.recogniser.shape(label), part_of(here, label)
    assert shape is not None
    face = int(np.argmin((part.shape.hull.normals @ part.pose[:3, :3].T)[:, 2]))
    count = len(part.shape.hull.faces[face])
    return next(k for k, ring in enumerate(shape.rings, start=1) if len(ring) == count)


def places_of(here: Rig, folder: Path, places: tuple[Place, ...]) -> PlaceTable:
    """Have the cell bring parts to these places."""
    table = PlaceTable(CellPlaces(places=places), PlaceStatuses(folder))
    here.cycle.use_places(table)
    return table


def true_error(goal: Goal, part: PlacedPart) -> tuple[float, float]:
    """(mm, degrees) that a part truly lies from its goal, or from the pose that looks the same and is nearest."""
    there = frames.apply(part.pose, part.shape.hull.vertices)
    return min(pose_error(frames.apply(pose, goal.shape.corners_mm), there) for pose in goal.poses)


@dataclass(frozen=True, eq=False)
class SetDownMade:
    """One part brought to one place: how the pick ended, what the daemon says of the place, and what is so."""

    label: str
    end: CycleEnd
    state: PlaceState
    where: str
    error_mm: float
    error_deg: float


async def set_down_made(
    seed: int, folder: Path, model: Model, mishap: Callable[[Rig, str], None] = lambda here, label: None
) -> SetDownMade:
    """One of the demo's parts, laid at random, to a place at random beside them; mishap: what happens to it there, once
    the gripper has opened, before the look."""
    rng = np.random.default_rng(seed)
    label = TAUGHT[seed % len(TAUGHT)]
    async with rig(seed=seed, model=model) as here:
        here.cell.scatter([label], rng)
        at = (float(rng.uniform(380, 500)), float(rng.choice([-1, 1]) * rng.uniform(200, 260)), -300.0)
        side, heading_deg = side_down_of(here, label), float(rng.uniform(-180, 180))
        place = Place("nest", Manner(part=label), np.eye(4), None, side, at, heading_deg)
        table = places_of(here, folder, (place,))
        hand = here.robot.hand

        async def opened(closed: bool) -> None:
            await hand(closed)
            if not closed and table.status("nest") == "set":
                mishap(here, label)

        here.robot.hand = opened
        end = await here.cycle.pick()
        part = next((p for p in here.cell.world.parts if p.label == label), None)
        error = (np.nan, np.nan) if part is None else true_error(table.goals["nest"], part)
        where = "nowhere" if part is None else part.where.value
        return SetDownMade(label, end, table.statuses.of("nest"), where, *error)
