"""Set-downs in the simulated cell, held against its own truth: for tests and the benches of placing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.pick.outcome import CycleEnd
from daemon.pick.place_table import PlaceTable
from daemon.pick.planning.place_goals import Goal
from daemon.pick.planning.plan import stable_sides
from daemon.store.place_file import CellPlaces, Place, PlaceSettings
from daemon.store.place_status import PlaceState, PlaceStatuses
from daemon.teaching.solid_from_mesh import Drawing
from daemon.vision.model.model import Model
from drivers.simcell.parts import TAUGHT, PartShape, part_shape
from drivers.simcell.world import PartPlace, PlacedPart, World
from tests.bench import machined
from tests.fakes.machined import drawing as read
from tests.fakes.machined import drawing_from_taught, shape_from_drawing, shown_shape, taught_from
from tests.fakes.simulated_cell import Rig, rig

MACHINED = (
    "bracket", "clevis", "cover", "flange", "gusset", "knob", "lever", "pillow_block", "t_nut", "v_block"
)  # fmt: skip
PARTS = (*TAUGHT, *MACHINED)
FLAT = 0.999
"""Least cosine between the vertical and the normal of a side that counts as down."""


def drawing(label: str) -> bytes:
    """The simulated part's own shape, as an STL."""
    solid = part_shape(label).hull
    fans = [solid.vertices[[f[0], b, c]] for f in solid.faces for b, c in pairwise(f[1:])]
    body = b"".join(bytes(12) + np.asarray(fan, "<f4").tobytes() + bytes(2) for fan in fans)
    return bytes(80) + len(fans).to_bytes(4, "little") + body


@cache
def _read(label: str) -> Drawing:
    return machined.drawn(label) if label in MACHINED else read(f"{label}.stl", drawing(label))


def drawn_model() -> Model:
    """The demo's parts, each taught from its drawing."""
    return model_of(TAUGHT)


def model() -> Model:
    """The demo's parts and ten machined ones, each taught from its drawing."""
    return model_of(PARTS)


@cache
def model_of(labels: tuple[str, ...]) -> Model:
    """Some of them, each taught from its drawing."""
    return taught_from({label: _read(label) for label in labels})


@cache
def shape_of(label: str) -> PartShape:
    """A part's shape in the cell."""
    return shown_shape(label, _read(label)) if label in MACHINED else part_shape(label)


@cache
def shape_from_part(label: str) -> Array:
    """(4, 4) from the frame of the taught solid to that of the part in the cell."""
    one = _read(label)
    return shape_from_drawing(shape_of(label), one) @ drawing_from_taught(one, model_of((label,)).metric[label].solid)


def lies(part: PlacedPart) -> Array:
    """(4, 4): the true pose of the part in the cell, in the frame of the taught solid."""
    return part.pose @ shape_from_part(part.label)


def part_of(here: Rig, label: str) -> PlacedPart:
    """The part with that label, wherever it is."""
    return next(part for part in here.cell.world.parts if part.label == label)


def side_down_of(here: Rig, label: str) -> int | None:
    """The number of the taught side that the part in the cell lies on; None: it lies on none that it can be set down
    on."""
    shape = model_of((label,)).metric[label].solid
    down = -(shape.normals @ lies(part_of(here, label))[:3, :3].T)[:, 2]
    return next((k + 1 for k in stable_sides(shape) if down[k] > FLAT), None)


def scattered(here: Rig, label: str, rng: np.random.Generator) -> int:
    """Lay a part at random on a side that it can be set down on; its number."""
    while True:
        here.cell.clear()
        here.cell.scatter([label], rng)
        side = side_down_of(here, label)
        if side is not None:
            return side


def places_of(here: Rig, folder: Path, places: tuple[Place, ...]) -> PlaceTable:
    """Configure these places."""
    table = PlaceTable(CellPlaces(places=places), PlaceStatuses(folder))
    here.cycle.use_places(table)
    return table


def apart(poses: tuple[Array, ...], corners: Array, pose: Array) -> tuple[float, float]:
    """(mm at the middle, degrees) from a pose (4, 4) of corners (N, 3) to the nearest of some that look the same."""
    there = frames.apply(pose, corners)
    every = [frames.apply(each, corners) for each in poses]
    nearest = int(np.argmin([np.linalg.norm(each - there, axis=1).max() for each in every]))
    off_mm = float(np.linalg.norm(every[nearest].mean(axis=0) - there.mean(axis=0)))
    return off_mm, float(np.degrees(frames.angle_between(poses[nearest], pose)))


def true_error(goal: Goal, part: PlacedPart) -> tuple[float, float]:
    """(mm, degrees) that a part truly lies from its goal, or from the pose that looks the same and is nearest."""
    return apart((goal.nearest(lies(part)),), goal.shape.corners_mm, lies(part))


@dataclass(frozen=True, eq=False)
class SetDownMade:
    """One part brought to one place: how the pick ended, what the daemon says of the place, and what is so. held_mm,
    held_deg: how far off it was measured in the gripper; not a number where it was not. told: the decisions."""

    label: str
    side: int
    end: CycleEnd
    state: PlaceState
    where: str
    error_mm: float
    error_deg: float
    held_mm: float
    held_deg: float
    told: tuple[str, ...]


Mishap = Callable[[World, PlacedPart, np.random.Generator], None]


async def set_down_made(
    seed: int, label: str, folder: Path, taught: Model, mishap: Mishap | None = None
) -> SetDownMade:
    """A part, laid at random, to a place beside it at random, on the side that it lies on; mishap: what happens to it
    there, once the gripper has opened, before the look."""
    rng = np.random.default_rng(seed)
    async with rig(seed=seed, model=taught) as here:
        here.cell.world.draw([shape_of(label)] if label in MACHINED else [])
        side = scattered(here, label, rng)
        at = (float(rng.uniform(380, 500)), float(rng.choice([-1, 1]) * rng.uniform(200, 260)), -300.0)
        place = Place("nest", PlaceSettings(part=label), np.eye(4), None, side, at, float(rng.uniform(-180, 180)))
        table = places_of(here, folder, (place,))
        goal, hand, world = table.goals["nest"], here.robot.set_gripper, here.cell.world
        turns = tuple(frames.inverse(goal.poses[0]) @ pose for pose in goal.poses)
        held = [(np.nan, np.nan)]

        async def works(closed: bool) -> None:
            measured, part = here.log.said("in_gripper"), world.held
            if not closed and part is not None and measured:
                ways = tuple(measured[-1]["tool_from_part"] @ turn for turn in turns)
                held.append(apart(ways, goal.shape.corners_mm, lies(part)))
            await hand(closed)
            part = next((p for p in world.parts if p.where is PartPlace.TABLE), None)
            if not closed and mishap is not None and part is not None and table.status("nest") == "set":
                mishap(world, part, rng)

        here.robot.set_gripper = works
        end = await here.cycle.pick()
        part = next((p for p in world.parts if p.label == label), None)
        error = (np.nan, np.nan) if part is None else true_error(goal, part)
        where = "nowhere" if part is None else part.where.value
        told = tuple(f"{record['text']}: {record['why']}" for record in here.log.said("decision"))
        return SetDownMade(label, side, end, table.statuses.of("nest"), where, *error, *held[-1], told)
