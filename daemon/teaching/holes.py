"""Find rims of holes (bores, slots, pockets) in the inner borders of a drawing's flat faces, as a camera sees them.
Pure.

A border at which the surface rises from the face is the foot of a boss and no hole; one at which it goes on smoothly
does not show. A round rim is drawn anew on its circle, which the drawing has cut into chords.
"""

from collections.abc import Iterator

import numpy as np

from daemon.arrays import Array, Index
from daemon.teaching.curved_surfaces import STRIP_RAD
from daemon.teaching.flat_regions import FlatRegions
from daemon.vision.geometry import Hole, axes_in, fit_circle, sides_of

ON_CIRCLE_MM = 0.05
MIN_ROUND = 7
"""Corners of a rim on one circle; with fewer it may be a polygon."""
ROUND_CORNERS = 48
"""Corners of a round rim: of 30 mm its chords are 0.06 mm off it, an eighth of a px at the nearest look."""


def holes_of(regions: FlatRegions, faces: Index, owner: Index, step_mm: float) -> tuple[Hole, ...]:
    """The holes in flat faces (F,), which are the facets in this order; owner (R,): the curved surface of each region,
    or -1; step_mm: the rounding of the coordinates."""
    found = []
    for facet, face in enumerate(faces.tolist()):
        for loop in sunk_loops(regions, face):
            if not any(_goes_on(regions, face, side, owner) for side in sides_of(loop)):
                found.append(Hole(facet, _rim(regions.corners[list(loop)], regions.normals[face], step_mm)))
    return tuple(found)


def sunk_loops(regions: FlatRegions, face: int) -> Iterator[tuple[int, ...]]:
    """The inner borders of a face, by corners, from which the surface goes down all round."""
    for loop in regions.loops[face][1:]:
        beyond = {regions.beyond[side] for side in sides_of(loop)}
        walls = (regions.corners[list(regions.loops[other][0])] for other in beyond)
        if all(((wall - regions.corners[loop[0]]) @ regions.normals[face]).mean() < 0 for wall in walls):
            yield loop


def _goes_on(regions: FlatRegions, face: int, side: tuple[int, int], owner: Index) -> bool:
    """Whether the surface continues smoothly into a curved one beyond a side."""
    other = regions.beyond[side]
    return bool(owner[other] >= 0 and regions.turn_rad(face, other) < STRIP_RAD)


def _rim(points: Array, normal: Array, step_mm: float) -> Array:
    """A rim (N, 3): on its circle where it is round, else without corners in straight sides."""
    across = axes_in(normal)
    flat = points @ across.T
    centre, radius, off = fit_circle(flat)
    if len(points) < MIN_ROUND or off > ON_CIRCLE_MM + step_mm:
        return points
    turns = 2 * np.pi * np.arange(ROUND_CORNERS) / ROUND_CORNERS
    ring = centre + radius * np.column_stack([np.cos(turns), np.sin(turns)])
    return np.asarray(ring @ across + (points @ normal).mean() * normal)
