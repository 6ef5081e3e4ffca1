"""The part being picked, from look to look: found again, brought to the world, held against its neighbours.

Values and geometry; nothing here moves, waits or writes a log.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from daemon import approach, frames
from daemon.approach import Doubt, Estimate, Sighting
from daemon.edges import fit_edges, open_eyes
from daemon.looking import Look
from daemon.plan import SAME_PLACE_MM, Plan, Seen, seen_parts
from daemon.tracking import Fit, Shape, refit
from daemon.vision.data import Facet
from daemon.workcell import Array, Workcell

NEAR_MM = 60.0
"""Facets farther than this from where the part's middle should be are not its own."""
FACETS_REACH_MM, REACH_MM = 2.0, 6.0
"""How far off the pose that edges are searched from may be: one that facets gave, and one thought before the look."""


def far(a: Array, b: Array) -> float:
    """Distance of two points, mm."""
    return float(np.linalg.norm(a - b))


@dataclass(eq=False)
class Target:
    """The part being picked: what is known of it so far; beside_before, beside_now: other parts in the last looks.

    view: (3, 3) how the tool is turned for looks, world, where that is not as for the grasp.
    """

    label: str
    shape: Shape
    world_from_part: Array
    plan: Plan
    look: Look
    sightings: list[Sighting] = field(default_factory=list)
    estimate: Estimate | None = None
    looks: int = 0
    restarts: int = 0
    view: Array | None = None
    beside_before: list[Seen] = field(default_factory=list)
    beside_now: list[Seen] = field(default_factory=list)

    @property
    def looking(self) -> Array:
        """(3, 3) how the tool is turned when looked at, world."""
        return self.plan.grasp.world_from_tool[:3, :3] if self.view is None else self.view

    @property
    def centre(self) -> Array:
        """(3,) world mm: mean of the shape's corners where they are now thought to be."""
        centre: Array = frames.apply(self.world_from_part, self.shape.corners_mm).mean(axis=0)
        return centre


def follow(target: Target, look: Look, cell: Workcell, doubt: Doubt) -> bool:
    """Find the target in a new look and add the sighting; False where it is not where it should be."""
    target.look = look
    target.looks += 1
    parts = seen_parts(look)
    fit = fitted(target, look, cell, [f for p in parts if far(p.centre, target.centre) < NEAR_MM for f in p.facets])
    if fit is None:
        return False
    target.beside_before = target.beside_now
    target.beside_now = [p for p in parts if far(p.centre, target.centre) >= SAME_PLACE_MM]
    target.sightings.append(sighted(look, fit, cell, doubt))
    return True


def fitted(target: Target, look: Look, cell: Workcell, facets: list[Facet]) -> Fit | None:
    """The target's pose in a look, by its edges; by the facets near it where its edges do not show; None where neither
    does."""
    near = frames.inverse(look.world_from_cyclopean) @ target.world_from_part
    by_facets = refit(target.shape, facets, near)
    eyes = open_eyes(look.pictures.left.pixels, look.pictures.right.pixels, cell.rig)
    if by_facets is None:
        return fit_edges(target.shape, eyes, near, REACH_MM)
    return fit_edges(target.shape, eyes, by_facets.cyclopean_from_part, FACETS_REACH_MM) or by_facets


def still_there(target: Target, look: Look, cell: Workcell) -> bool:
    """Whether the target's edges still show where it lay."""
    return fitted(target, look, cell, []) is not None


def sighted(look: Look, fit: Fit, cell: Workcell, doubt: Doubt) -> Sighting:
    """A fit in a look, brought to the world with its errors."""
    return approach.sighting(
        look.reading.world_from_tool,
        cell.tool_from_cyclopean,
        fit.cyclopean_from_part,
        fit.covariance,
        doubt,
        float(cell.rig.left.matrix[0, 0]),
        cell.rig.baseline_mm,
    )


def beside(
    before: list[Seen], now: list[Seen], shape_of: Callable[[str], Shape | None], cell: Workcell, doubt: Doubt
) -> list[float]:
    """Chi-squares of the parts that two looks both show: did they move as well?"""
    found = []
    for old in before:
        shape = shape_of(old.label)
        near = [p for p in now if far(p.centre, old.centre) < 2 * SAME_PLACE_MM]
        if shape is None or not near:
            continue
        first = refit(shape, old.facets, frames.inverse(old.look.world_from_cyclopean) @ old.world_from_part)
        here = frames.inverse(near[0].look.world_from_cyclopean) @ old.world_from_part
        second = refit(shape, near[0].facets, here, gate_mm=20.0)
        if first is not None and second is not None:
            pair = sighted(old.look, first, cell, doubt), sighted(near[0].look, second, cell, doubt)
            found.append(approach.disagreement(*pair, doubt))
    return found
