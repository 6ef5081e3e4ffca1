"""A tour round one thing: from where to look at it, and the looks. Where they are planned is pure; every motion is the
mover's, so that a stop, a pause and step mode are honoured as in a pick.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass

import numpy as np

from daemon.arm import MoveRefusedError
from daemon.arrays import Array
from daemon.pick import viewpoints
from daemon.pick.looking import Look
from daemon.pick.settings import View
from daemon.pick.world import MOVE_ERRORS, STANDING_RULES, PickContext
from daemon.vision.facets import SeenFrom

LEAST_PLACES, MOST_PLACES = 6, 12
HEADINGS_DEG = range(-180, 180, 15)
TILTS_DEG = (15.0, 30.0, 40.0, 50.0, 60.0)
NEAREST_MM, FILLED = 280.0, 0.19
"""How near the cameras go, and of the distance what half the thing may be: it must lie whole in both images, askew and
not quite in the middle."""
Told = Callable[[str], Awaitable[None]]


@dataclass(frozen=True, eq=False)
class Thing:
    """What is walked round: its middle (3,) mm, world, and how far it reaches from there."""

    middle: Array
    radius_mm: float


def places_round(thing: Thing, count: int, tool_from_cyclopean: Array, allowed: viewpoints.Reachable) -> list[Array]:
    """At most `count` poses world_from_tool (4, 4) from which the thing is looked at, as far from each other as the arm
    allows, in the order of their headings: each side of it should be faced by two of them."""
    distance_mm = max(NEAREST_MM, thing.radius_mm / FILLED)
    x, y, z = (float(v) for v in thing.middle)
    poses = [
        View((x, y, z), distance_mm, float(heading), tilt).pose(tool_from_cyclopean)
        for heading in HEADINGS_DEG
        for tilt in TILTS_DEG
    ]
    poses = [pose for pose in poses if allowed(pose)]
    if not poses:
        return []
    eyes = np.array([(pose @ tool_from_cyclopean)[:3, 3] - thing.middle for pose in poses])
    eyes /= np.linalg.norm(eyes, axis=1, keepdims=True)
    chosen = [int(np.argmin(eyes[:, 2]))]
    while len(chosen) < min(count, len(poses)):
        nearest = (eyes @ eyes[chosen].T).max(1)
        chosen.append(int(np.argmin(nearest)))
    turn = np.arctan2(eyes[chosen, 1], eyes[chosen, 0])
    return [poses[chosen[k]] for k in np.argsort(turn)]


async def walk(context: PickContext, poses: Sequence[Array], told: Told) -> list[Look]:
    """A look from each of the places that the arm comes to; told what became of each. Raises what moves and looks do."""
    looks = list[Look]()
    for number, pose in enumerate(poses, start=1):
        purpose = f"round it, {number} of {len(poses)}"
        try:
            await context.mover.travel(pose, purpose, lambda _: context.settings.travel_pct)
        except MOVE_ERRORS as error:
            if isinstance(error, MoveRefusedError) and error.refusal.rule in STANDING_RULES:
                raise
            await told(f"place {number} of {len(poses)} is left out: {error}")
            continue
        if context.mover.dry or context.mover.at is None:
            continue
        looks.append(await context.look(context.mover.at, purpose))
    return looks
