"""The teaching stand: how a part is held before the cameras so that they see one of its characteristic views.

Geometry and light only; putting it there is cell.py's.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from drivers.simcell.light import facet_levels
from drivers.simcell.parts import Shape, part_shape
from drivers.simcell.rigid import Array, apply, rigid, turn, turn_between
from drivers.simcell.truth import Lighting

VIEWS: dict[str, tuple[tuple[int, ...], ...]] = {
    "cube": ((4, 4, 4),),
    "pyramid": ((3, 3, 3, 3), (3, 3, 4)),
    "triangular_prism": ((3, 4, 4),),
    "pentagonal_prism": ((4, 4, 5), (4, 4, 4)),
    "hexagonal_prism": ((4, 4, 6),),
    "tetrahedron": ((3, 3, 3),),
}
"""Characteristic views by part: the number of sides of each facet in sight."""

DISTANCE_MM = 340.0
LEAST_FACING = 0.15
HIDDEN_FACING = -0.04
KINDS, TURNS = 12, 24


class NoViewError(Exception):
    """A part cannot be held so: which part, which view, and why."""


def characteristic_pose(
    label: str,
    view: int,
    world_from_cyclopean: Array,
    eyes_cyclopean_mm: Sequence[Array],
    lighting: Lighting,
    distance_mm: float = DISTANCE_MM,
) -> Array:
    """world_from_part (4, 4) that shows both eyes the view-th characteristic view, as clearly lit as turning it allows.

    eyes_cyclopean_mm: optical centres (3,). Raises NoViewError where the part has no such view.
    """
    views = VIEWS.get(label, ())
    if not 0 <= view < len(views):
        raise NoViewError(f"{label}: characteristic views are numbered 0 to {len(views) - 1}, not {view}")
    shape = part_shape(label)
    middle = apply(world_from_cyclopean, np.array([0.0, 0.0, distance_mm]))
    eyes = [apply(world_from_cyclopean, eye) for eye in eyes_cyclopean_mm]
    best, best_score = None, 0.0
    for towards in _directions(shape, views[view]):
        upright = turn_between(towards, -world_from_cyclopean[:3, 2])
        for angle in 2 * np.pi * np.arange(TURNS) / TURNS:
            pose = rigid(turn(world_from_cyclopean[:3, 2], angle) @ upright, middle)
            score = _clearness(shape, pose, eyes, views[view], lighting)
            if score > best_score:
                best, best_score = pose, score
    if best is None:
        raise NoViewError(f"{label}: view {view} cannot be shown at {distance_mm:.0f} mm")
    return best


def _directions(shape: Shape, wanted: tuple[int, ...]) -> list[Array]:
    """Directions (3,) in the part's frame from which the facets of a wanted view are all turned to the eye alike."""
    sides = [len(face) for face in shape.hull.faces]
    found = []
    for facets in combinations(range(len(sides)), len(wanted)):
        if sorted(sides[i] for i in facets) == sorted(wanted):
            towards = _evenly_between(shape.hull.normals[list(facets)])
            if tuple(np.flatnonzero(shape.hull.normals @ towards > 1e-9)) == facets:
                found.append(towards)
    return found[:KINDS]


def _evenly_between(normals: Array) -> Array:
    """The direction (3,) whose least cosine with the (K, 3) normals is greatest: step by step towards the worst."""
    towards: Array = normals.mean(axis=0)
    for step in range(2, 300):
        worst = normals[np.argmin(normals @ towards)]
        towards += (worst - towards) / step
    return towards


def _clearness(
    shape: Shape, world_from_part: Array, eyes: Sequence[Array], wanted: tuple[int, ...], lighting: Lighting
) -> float:
    """The least step in grey level at any edge, between facets or to the table; 0 where the view is not as wanted."""
    solid = shape.hull
    middles = apply(world_from_part, np.array([solid.vertices[list(f)].mean(axis=0) for f in solid.faces]))
    normals = solid.normals @ world_from_part[:3, :3].T
    for eye in eyes:
        to_eye = eye - middles
        facing = np.sum(normals * to_eye, axis=1) / np.linalg.norm(to_eye, axis=1)
        seen = facing > 0
        if tuple(sorted(len(f) for f, s in zip(solid.faces, seen, strict=True) if s)) != tuple(sorted(wanted)):
            return 0.0
        if facing[seen].min() < LEAST_FACING or facing[~seen].max() > HIDDEN_FACING:
            return 0.0
    levels = {
        int(i): _level(middles[i], normals[i], lighting.facet_albedo, eyes[0], lighting) for i in np.flatnonzero(seen)
    }
    bare = _level(middles.mean(axis=0), np.array([0.0, 0.0, 1.0]), lighting.table_albedo, eyes[0], lighting)
    between = [
        abs(levels[a] - levels[b])
        for a, b in combinations(levels, 2)
        if len(set(solid.faces[a]) & set(solid.faces[b])) == 2
    ]
    return min(*between, *(abs(level - bare) for level in levels.values()))


def _level(point: Array, normal: Array, albedo: float, eye: Array, lighting: Lighting) -> float:
    return float(facet_levels(point[None].astype(np.float32), normal, albedo, eye, lighting)[0])
