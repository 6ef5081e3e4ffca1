"""Poses of a part held before the cameras for teaching, one for each of its characteristic views."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from drivers.arrays import Array
from drivers.rigid import apply, rigid, turn, turn_between
from drivers.simcell.light import facet_levels
from drivers.simcell.parts import ConvexSolid, PartShape
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
"""Directions, in its frame, from which a part from a drawing is shown: over each corner of its box, opposite ones in
turn."""

DISTANCE_MM = 340.0
LEAST_FACING = 0.15
HIDDEN_FACING = -0.04
TURNS = 24
TILTS_RAD = (0.0, 0.15, 0.3)
CLEAR_LEVELS, WELL_TURNED = 30.0, 0.35
"""A step in grey level, and a cosine between a facet's normal and the direction to a camera, that count as ideal."""
BRIGHTEST = 240.0
WELL_ACROSS = 0.17
"""Sine between an edge and the baseline that counts as ideal: ten degrees."""


class NoViewError(Exception):
    """A part cannot be shown in a view; the message says which, and why."""


def teaching_pose(
    shape: PartShape,
    view: int,
    world_from_cyclopean: Array,
    centres_cyclopean_mm: Sequence[Array],
    lighting: Lighting,
    distance_mm: float = DISTANCE_MM,
    drawn: bool = False,
) -> Array:
    """Pose world_from_part (4, 4) that shows both cameras the view-th characteristic view, lit as clearly as possible.

    centres_cyclopean_mm: optical centres (3,); distance_mm: from the cameras. drawn: the part is from a drawing; it is
    shown from one of eight sides (view modulo 8), even where no pose shows all facets clearly. Raises NoViewError where
    the part has no such view.
    """
    wanted = None
    if drawn:
        towards = np.array(DRAWN_VIEWS[view % len(DRAWN_VIEWS)]) / np.sqrt(3.0)
    else:
        views = VIEWS.get(shape.label, ())
        if not 0 <= view < len(views):
            raise NoViewError(f"{shape.label}: characteristic views are numbered 0 to {len(views) - 1}, not {view}")
        wanted = views[view]
        towards = _direction(shape, wanted)
    viewers = [apply(world_from_cyclopean, centre) for centre in centres_cyclopean_mm]
    poses = _poses(towards, world_from_cyclopean, distance_mm)
    score, pose = _clearest(shape, poses, viewers, wanted, lighting)
    if score == 0.0 and not drawn:
        raise NoViewError(f"{shape.label}: view {view} cannot be shown at {distance_mm:.0f} mm")
    return pose


def _poses(towards: Array, world_from_cyclopean: Array, distance_mm: float) -> list[Array]:
    """Candidate poses world_from_part before the cameras, with the direction towards (3,) of the part to them."""
    right, down, forward, _ = world_from_cyclopean[:3].T
    middle = apply(world_from_cyclopean, np.array([0.0, 0.0, distance_mm]))
    upright = turn_between(towards, -forward)
    turns = 2 * np.pi * np.arange(TURNS) / TURNS
    return [rigid(lean @ turn(forward, a) @ upright, middle) for lean in _leans(right, down) for a in turns]


def _leans(right: Array, down: Array) -> list[Array]:
    """Small rotations (3, 3) out of the line of sight, towards eight sides."""
    sides = [np.cos(a) * right + np.sin(a) * down for a in np.pi / 4 * np.arange(8)]
    return [turn(side, tilt) for tilt in TILTS_RAD for side in (sides if tilt else sides[:1])]


def _direction(shape: PartShape, wanted: tuple[int, ...]) -> Array:
    """A direction (3,) in the part's frame from which exactly the facets of a view are visible, as evenly as
    possible."""
    sides = [len(face) for face in shape.hull.faces]
    for facets in combinations(range(len(sides)), len(wanted)):
        if sorted(sides[i] for i in facets) == sorted(wanted):
            towards = _evenly_between(shape.hull.normals[list(facets)])
            if tuple(np.flatnonzero(shape.hull.normals @ towards > 1e-9)) == facets:
                return towards
    raise NoViewError(f"{shape.label}: no direction shows just facets with {', '.join(map(str, wanted))} sides")


def _evenly_between(normals: Array) -> Array:
    """The direction (3,) that maximises the least cosine with (K, 3) normals, by steps towards the worst."""
    towards: Array = normals.mean(axis=0)
    for step in range(2, 300):
        worst = normals[np.argmin(normals @ towards)]
        towards += (worst - towards) / step
    return towards


def _clearest(
    shape: PartShape,
    poses: Sequence[Array],
    viewers: Sequence[Array],
    wanted: tuple[int, ...] | None,
    lighting: Lighting,
) -> tuple[float, Array]:
    """The best score and its pose, the first of several."""
    best, chosen = 0.0, poses[0]
    for pose in poses:
        score = _clearness(shape, pose, viewers, wanted, lighting, best)
        if score > best:
            best, chosen = score, pose
    return best, chosen


def _clearness(
    shape: PartShape,
    world_from_part: Array,
    viewers: Sequence[Array],
    wanted: tuple[int, ...] | None,
    lighting: Lighting,
    to_beat: float,
) -> float:
    """Quality of a view, 0 to 1: facets turned to both cameras, clear steps at every edge, no edge along the baseline;
    0 for another view than the wanted one (None: any). If the quickly computed terms are not better than to_beat, the
    light is not computed, and the result is at most to_beat."""
    solid = shape.hull
    middles = apply(world_from_part, np.array([solid.vertices[list(f)].mean(axis=0) for f in solid.faces]))
    normals = solid.normals @ world_from_part[:3, :3].T
    facings = [_facing(middles, normals, viewer) for viewer in viewers]
    seen = facings[0] > 0
    shown = sorted(len(f) for f, s in zip(solid.faces, seen, strict=True) if s)
    if wanted is not None and shown != sorted(wanted):
        return 0.0
    turned = min(float(facing[seen].min()) for facing in facings)
    if turned < LEAST_FACING or max(float(facing[~seen].max()) for facing in facings) > HIDDEN_FACING:
        return 0.0
    facing_well = min(turned / WELL_TURNED, 1.0)
    if facing_well <= to_beat:
        return facing_well
    ends = apply(world_from_part, solid.vertices)
    edges = [ends[b] - ends[a] for f in np.flatnonzero(seen) for a, b in _sides(solid.faces[f])]
    across = _least_across(np.array(edges), viewers[-1] - viewers[0], middles.mean(axis=0) - viewers[0])
    along_well = min(across / WELL_ACROSS, 1.0)
    if facing_well * along_well <= to_beat:
        return facing_well * along_well
    step = _least_step(solid, middles, normals, np.flatnonzero(seen), viewers[0], lighting)
    return min(step / CLEAR_LEVELS, 1.0) * facing_well * along_well


def _sides(face: Sequence[int]) -> list[tuple[int, int]]:
    """A face's edges, by its corners."""
    return list(zip(face, [*face[1:], face[0]], strict=True))


def _least_across(edges: Array, baseline: Array, line_of_sight: Array) -> float:
    """Least sine of the angle in the image between (E, 3) edges and the baseline, along which there is no disparity; 1
    with one camera."""
    sight = line_of_sight / np.linalg.norm(line_of_sight)
    along, across = np.cross(sight, baseline), np.cross(edges, sight)
    if not along.any():
        return 1.0
    lengths = np.linalg.norm(across, axis=1) * np.linalg.norm(along)
    return float((np.linalg.norm(np.cross(across, along), axis=1) / lengths).min())


def _facing(middles: Array, normals: Array, viewer: Array) -> Array:
    """Cosine (F,) between each face's normal and the direction to the viewer."""
    to_viewer = viewer - middles
    return np.asarray(np.sum(normals * to_viewer, axis=1) / np.linalg.norm(to_viewer, axis=1))


def _least_step(
    solid: ConvexSolid, middles: Array, normals: Array, seen: NDArray[np.intp], viewer: Array, lighting: Lighting
) -> float:
    """Least difference in grey level across an edge between visible facets, or between one and the table."""

    def level(point: Array, normal: Array, albedo: float) -> float:
        bright = facet_levels(point[None].astype(np.float32), normal, albedo, viewer, lighting)
        return min(float(bright[0]), BRIGHTEST)

    levels = {int(i): level(middles[i], normals[i], lighting.facet_albedo) for i in seen}
    bare = level(middles.mean(axis=0), np.array([0.0, 0.0, 1.0]), lighting.table_albedo)
    touching = [(a, b) for a, b in combinations(levels, 2) if len(set(solid.faces[a]) & set(solid.faces[b])) == 2]
    return min(*(abs(levels[a] - levels[b]) for a, b in touching), *(abs(v - bare) for v in levels.values()))
