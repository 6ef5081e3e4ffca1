"""The teaching stand: how a part is held before the cameras so that they see one of its characteristic views.

Geometry and light only; putting it there is cell.py's.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from drivers.arrays import Array
from drivers.simcell.light import facet_levels
from drivers.simcell.parts import ConvexSolid, PartShape, part_shape
from drivers.simcell.rigid import apply, rigid, turn, turn_between
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

DRAWN_VIEWS = ((1, 1, 1), (-1, 1, -1), (1, -1, -1), (-1, -1, 1), (1, 1, -1), (-1, -1, -1), (1, -1, 1), (-1, 1, 1))
"""From where a part that was drawn is shown, in its frame: over each corner of its own box, opposite ones in turn."""

DISTANCE_MM = 340.0
LEAST_FACING = 0.15
HIDDEN_FACING = -0.04
TURNS = 24
TILTS_RAD = (0.0, 0.15, 0.3)
CLEAR_LEVELS, WELL_TURNED = 30.0, 0.35
"""A step in grey level, and a cosine between a facet's normal and the way to an eye, that leave nothing to wish for."""
BRIGHTEST = 240.0
WELL_ACROSS = 0.17
"""A sine between an edge and the line between the eyes: ten degrees."""


class NoViewError(Exception):
    """A part cannot be held so: which part, which view, and why."""


def characteristic_pose(
    label: str,
    view: int,
    world_from_cyclopean: Array,
    eyes_cyclopean_mm: Sequence[Array],
    lighting: Lighting,
) -> Array:
    """world_from_part (4, 4) that shows both eyes the view-th characteristic view, as clearly lit as turning it allows.

    eyes_cyclopean_mm: optical centres (3,). Raises NoViewError where the part has no such view.
    """
    views = VIEWS.get(label, ())
    if not 0 <= view < len(views):
        raise NoViewError(f"{label}: characteristic views are numbered 0 to {len(views) - 1}, not {view}")
    shape = part_shape(label)
    middle = apply(world_from_cyclopean, np.array([0.0, 0.0, DISTANCE_MM]))
    eyes = [apply(world_from_cyclopean, eye) for eye in eyes_cyclopean_mm]
    upright = turn_between(_direction(shape, views[view]), -world_from_cyclopean[:3, 2])
    best, best_score = None, 0.0
    for lean in _leans(world_from_cyclopean[:3, 0], world_from_cyclopean[:3, 1]):
        for angle in 2 * np.pi * np.arange(TURNS) / TURNS:
            pose = rigid(lean @ turn(world_from_cyclopean[:3, 2], angle) @ upright, middle)
            score = _clearness(shape, pose, eyes, views[view], lighting)
            if score > best_score:
                best, best_score = pose, score
    if best is None:
        raise NoViewError(f"{label}: view {view} cannot be shown at {DISTANCE_MM:.0f} mm")
    return best


def drawn_pose(
    shape: PartShape, view: int, world_from_cyclopean: Array, eyes_cyclopean_mm: Sequence[Array], lighting: Lighting
) -> Array:
    """The same for a part that was drawn, from one of eight sides, counted round; as near as may be where no turn shows
    all its facets clearly."""
    middle = apply(world_from_cyclopean, np.array([0.0, 0.0, DISTANCE_MM]))
    eyes = [apply(world_from_cyclopean, eye) for eye in eyes_cyclopean_mm]
    towards = np.array(DRAWN_VIEWS[view % len(DRAWN_VIEWS)]) / np.sqrt(3.0)
    upright = turn_between(towards, -world_from_cyclopean[:3, 2])
    leans = _leans(world_from_cyclopean[:3, 0], world_from_cyclopean[:3, 1])
    turns = 2 * np.pi * np.arange(TURNS) / TURNS
    poses = [rigid(lean @ turn(world_from_cyclopean[:3, 2], a) @ upright, middle) for lean in leans for a in turns]
    return max(poses, key=lambda pose: _clearness(shape, pose, eyes, None, lighting))


def _leans(right: Array, down: Array) -> list[Array]:
    """Small turns (3, 3) out of the line of sight, towards eight sides."""
    sides = [np.cos(a) * right + np.sin(a) * down for a in np.pi / 4 * np.arange(8)]
    return [turn(side, tilt) for tilt in TILTS_RAD for side in (sides if tilt else sides[:1])]


def _direction(shape: PartShape, wanted: tuple[int, ...]) -> Array:
    """A direction (3,) in the part's frame from which the facets of a wanted view are all turned to the eye alike."""
    sides = [len(face) for face in shape.hull.faces]
    for facets in combinations(range(len(sides)), len(wanted)):
        if sorted(sides[i] for i in facets) == sorted(wanted):
            towards = _evenly_between(shape.hull.normals[list(facets)])
            if tuple(np.flatnonzero(shape.hull.normals @ towards > 1e-9)) == facets:
                return towards
    raise NoViewError(f"{shape.label}: no direction shows just facets with {', '.join(map(str, wanted))} sides")


def _evenly_between(normals: Array) -> Array:
    """The direction (3,) whose least cosine with the (K, 3) normals is greatest: step by step towards the worst."""
    towards: Array = normals.mean(axis=0)
    for step in range(2, 300):
        worst = normals[np.argmin(normals @ towards)]
        towards += (worst - towards) / step
    return towards


def _clearness(
    shape: PartShape, world_from_part: Array, eyes: Sequence[Array], wanted: tuple[int, ...] | None, lighting: Lighting
) -> float:
    """How well a view is seen, 0 to 1: facets well turned to both eyes, clear steps at every edge, no edge along the
    line between the eyes; 0: another view than the one wanted (None: any)."""
    solid = shape.hull
    middles = apply(world_from_part, np.array([solid.vertices[list(f)].mean(axis=0) for f in solid.faces]))
    normals = solid.normals @ world_from_part[:3, :3].T
    facings = [_facing(middles, normals, eye) for eye in eyes]
    seen = facings[0] > 0
    shown = sorted(len(f) for f, s in zip(solid.faces, seen, strict=True) if s)
    if wanted is not None and shown != sorted(wanted):
        return 0.0
    turned = min(float(facing[seen].min()) for facing in facings)
    if turned < LEAST_FACING or max(float(facing[~seen].max()) for facing in facings) > HIDDEN_FACING:
        return 0.0
    step = _least_step(solid, middles, normals, np.flatnonzero(seen), eyes[0], lighting)
    ends = apply(world_from_part, solid.vertices)
    edges = [ends[b] - ends[a] for f in np.flatnonzero(seen) for a, b in _sides(solid.faces[f])]
    across = _least_across(np.array(edges), eyes[-1] - eyes[0], middles.mean(axis=0) - eyes[0])
    return min(step / CLEAR_LEVELS, 1.0) * min(turned / WELL_TURNED, 1.0) * min(across / WELL_ACROSS, 1.0)


def _sides(face: Sequence[int]) -> list[tuple[int, int]]:
    """A face's edges, by its corners."""
    return list(zip(face, [*face[1:], face[0]], strict=True))


def _least_across(edges: Array, baseline: Array, line_of_sight: Array) -> float:
    """The least sine of the angle in the picture between (E, 3) edges and the line between the eyes, along which no
    distance is to be seen; 1 with one eye."""
    sight = line_of_sight / np.linalg.norm(line_of_sight)
    along, across = np.cross(sight, baseline), np.cross(edges, sight)
    if not along.any():
        return 1.0
    lengths = np.linalg.norm(across, axis=1) * np.linalg.norm(along)
    return float((np.linalg.norm(np.cross(across, along), axis=1) / lengths).min())


def _facing(middles: Array, normals: Array, eye: Array) -> Array:
    """(F,) cosine between each face's normal and the way to the eye."""
    to_eye = eye - middles
    facing: Array = np.sum(normals * to_eye, axis=1) / np.linalg.norm(to_eye, axis=1)
    return facing


def _least_step(
    solid: ConvexSolid, middles: Array, normals: Array, seen: NDArray[np.intp], eye: Array, lighting: Lighting
) -> float:
    """The least difference in grey level across an edge between facets in sight, or between one and the table."""

    def level(point: Array, normal: Array, albedo: float) -> float:
        bright = facet_levels(point[None].astype(np.float32), normal, albedo, eye, lighting)
        return min(float(bright[0]), BRIGHTEST)

    levels = {int(i): level(middles[i], normals[i], lighting.facet_albedo) for i in seen}
    bare = level(middles.mean(axis=0), np.array([0.0, 0.0, 1.0]), lighting.table_albedo)
    touching = [(a, b) for a, b in combinations(levels, 2) if len(set(solid.faces[a]) & set(solid.faces[b])) == 2]
    return min(*(abs(levels[a] - levels[b]) for a, b in touching), *(abs(v - bare) for v in levels.values()))
