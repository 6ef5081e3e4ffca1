"""Parts that are to lie on another side at their place, in the simulated cell, held against its own truth; and which
pairs of sides a search by brute force finds a way between. For tests and the bench of regrasps."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from daemon import frames
from daemon.arm import CameraMounting, Reach, paths
from daemon.arrays import Array
from daemon.pick.outcome import CycleEnd
from daemon.pick.planning.place_goals import UPSIDE_DOWN, Goal, goal_of, ways_to
from daemon.pick.planning.plan import approach_poses, stable_sides
from daemon.pick.planning.regrasp import resting_poses
from daemon.pick.settings import Settings
from daemon.store.place_file import Place, PlaceSettings, about_vertical
from daemon.store.place_status import PlaceState
from daemon.vision.geometry import Polyhedron
from daemon.vision.model import Model
from tests.fakes.set_downs import MACHINED, model_of, places_of, shape_of, true_error
from tests.fakes.simulated_cell import rig

AT = (430.0, -220.0, -300.0)
START = np.array([520.0, 0.0, -300.0])


@dataclass(frozen=True, eq=False)
class TurnedOver:
    """The result of placing a part on another side: the pick's outcome, the number of regrasps, the true pose."""

    label: str
    side: int
    end: CycleEnd
    laid: int
    grasps: int | None
    state: PlaceState
    where: str
    error_mm: float
    error_deg: float
    told: tuple[str, ...] = ()


async def turned_over(label: str, rest: int, side: int, seed: int, taught: Model) -> TurnedOver:
    """A part that lies alone on one of its stable faces (numbered by the simulation), to a place on a side (from 0)."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        async with rig(seed=seed, model=taught) as here:
            here.cell.world.draw([shape_of(label)] if label in MACHINED else [])
            here.cell.clear()
            x, y, turn = rng.uniform(480.0, 560.0), rng.uniform(-60.0, 60.0), rng.uniform(-np.pi, np.pi)
            here.cell.world.stand(label, rest, float(x), float(y), float(turn))
            place = Place(
                "nest", PlaceSettings(part=label), np.eye(4), None, side + 1, AT, float(rng.uniform(-180.0, 180.0))
            )
            table = places_of(here, Path(folder), (place,))
            end = await here.cycle.pick()
            part = next((p for p in here.cell.world.parts if p.label == label), None)
            error = (np.nan, np.nan) if part is None else true_error(table.goals["nest"], part)
            laid = [record for record in here.log.said("laid_down") if record["status"] == "set"]
            chosen = [r.get("grasps") for r in here.log.said("decision") if r["code"] == "chosen"]
            where = "nowhere" if part is None else part.where.value
            planned = chosen[0] if chosen else None
            told = tuple(f"{record['text']}: {record['why']}" for record in here.log.said("decision"))
            return TurnedOver(label, side, end, len(laid), planned, table.statuses.of("nest"), where, *error, told)


def start_on(shape: Polyhedron, side: int, heading_deg: float = 10.0) -> Array:
    """(4, 4): the pose of a part that rests on a side, numbered from 0, where it is picked."""
    return frames.rigid(about_vertical(heading_deg) @ UPSIDE_DOWN, START) @ shape.flat_from_solid[side]


def goal_on(label: str, shape: Polyhedron, side: int) -> Goal:
    """A place where a part rests on that side, numbered from 0, and on no other that looks the same."""
    place_settings = PlaceSettings(part=label, equivalents=False)
    return goal_of(Place("nest", place_settings, np.eye(4), None, side + 1, AT, 20.0), shape)


def pairs_by_brute_force(
    label: str, shape: Polyhedron, settings: Settings, mounting: CameraMounting, reach: Reach, samples: int, seed: int
) -> set[tuple[int, int]]:
    """From which side down to which a part can be brought by at most three grasps, by trying every grasp from each of
    so many random poses on the table for each face it can lie on to each other one. Nothing here is the planner's."""
    rng, sides, gripper = np.random.default_rng(seed), stable_sides(shape), settings.gripper.turning
    assert gripper is not None
    table_z_mm, goals = settings.limits.table_z_mm, [goal_on(label, shape, side) for side in sides]
    starts, between = [start_on(shape, side) for side in sides], list[Array]()
    for face in resting_poses(shape):
        for _ in range(samples):
            out_mm, way, turn = rng.uniform(0.0, 160.0), rng.uniform(0.0, 2 * np.pi), rng.uniform(-180.0, 180.0)
            spot = np.array([START[0] + out_mm * np.cos(way), START[1] + out_mm * np.sin(way), table_z_mm])
            between.append(frames.rigid(about_vertical(turn), spot) @ face)

    def taken(pose: Array) -> list[Array]:
        """tool_from_part (4, 4) of each grasp that the arm can reach and leave."""
        centre, found = frames.apply(pose, shape.corners_mm).mean(axis=0), []
        for grasp in gripper.grasps(shape, pose, table_z_mm, settings.stops.enough_mm).found:
            if reach.allows_each(np.stack(approach_poses(grasp, centre, settings, mounting))).all():
                found.append(frames.inverse(grasp.world_from_tool) @ pose)
        return found

    def laid(held: Array) -> set[int]:
        """The numbers of the intermediate poses in which this can place the part."""
        at = np.stack([paths.lifted(pose, 0.5) for pose in between]) @ frames.inverse(held)
        over, clear = (np.stack([move(each, mm) for each in at]) for move, mm in
                       ((paths.lifted, 60.0), (paths.backed_off, settings.pregrasp_mm)))  # fmt: skip
        good = reach.allows_each(at)
        for poses in (over, clear):
            good[good] = reach.allows_each(poses[good])
        return set(np.flatnonzero(good).tolist())

    def brought(held: Array) -> set[int]:
        return {
            k for k, goal in enumerate(goals) if any(ways_to(goal, held, settings, mounting, reach.allows_each, []))
        }

    by_pose = [taken(pose) for pose in between]
    ends = [set[int]().union(*map(brought, held)) for held in by_pose]
    onward = [set[int]().union(*map(laid, held)) for held in by_pose]
    found = set[tuple[int, int]]()
    for start, side in zip(starts, sides, strict=True):
        first = taken(start)
        reached = set[int]().union(*map(brought, first))
        one = set[int]().union(*map(laid, first))
        two = one.union(*(onward[k] for k in one))
        reached = reached.union(*(ends[k] for k in two))
        found |= {(side, sides[k]) for k in reached}
    return found


def sides_of(label: str) -> list[int]:
    """The sides, numbered from 0, on which a part can rest."""
    return stable_sides(model_of((label,)).metric[label].solid)
