"""A name that facets gave, held against the parts that are the same but for a side or two.

In: a part named by its facets, what was taught, both eyes. Out: whether the pictures tell it from each such twin. A
corner that is cut off in one of them may be measured where its sides would have met: the facets then fit the other. Its
edges are there in the pictures, or are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron
from daemon.vision.image import Eyes
from daemon.vision.model import Model
from daemon.vision.recognition import Recognised, left_open
from daemon.vision.registration.expected_edges import Placements
from daemon.vision.registration.rivals import LEAST_APART, by_own_edges
from daemon.vision.registration.space_corners import ALIKE_MM, corner_frames
from daemon.vision.registration.stretches import settled, stretches_of

SHARED = 2 / 3
"""Of a part's corners, that another must have to be its twin."""
IN_PLANE_MM = 4.0
"""So near to a face's plane lie the corners of a facet that may be that face, more or less of it cut off."""


def told_apart(one: Recognised, model: Model, eyes: Eyes) -> Recognised:
    """What facets gave, without its name where it has a twin from which the pictures do not tell it."""
    return left_open(one, twins, model) if one.named and (twins := untold(one, model, eyes)) else one


def untold(one: Recognised, model: Model, eyes: Eyes) -> tuple[str, ...]:
    """The twins of a named part that the pictures do not tell from it, where it lies."""
    solid, tolerance = model.metric[one.label].solid, model.parameters.tolerance_mm
    near = [
        (label, known.solid, pose)
        for label, known in model.metric.items()
        if label != one.label and len(turns := as_twins(solid, known.solid))
        for pose in _with_faces(known.solid, one.part.cyclopean_from_part @ turns, one.part.fitted_mm)
    ]
    if not near:
        return ()
    shapes = [solid, *(shape for _, shape, _ in near)]
    laid, poses = Placements.of(shapes), np.stack([one.part.cyclopean_from_part, *(pose for *_, pose in near)])
    both = stretches_of(laid, eyes, settled(laid, eyes, poses, tolerance), tolerance)
    own, *others = [[seen.only(k, laid) for seen in both] for k in range(len(shapes))]
    found = [label for (label, *_), other in zip(near, others, strict=True) if by_own_edges(own, other) < LEAST_APART]
    return tuple(dict.fromkeys(found))


def _with_faces(solid: Polyhedron, poses: Array, facets_mm: Sequence[Array]) -> Array:
    """Those of a solid's poses (P, 4, 4) at which each of some facets (N, 3) lies in the plane of a face it shows."""
    normals = poses[:, :3, :3] @ solid.normals.T
    level = (solid.normals * solid.corners_mm[[ring[0] for ring in solid.rings]]).sum(1)
    level = level + (poses[:, None, :3, 3] @ normals)[:, 0]
    shown = solid.facing(poses) > 0
    near = [np.abs(corners @ normals - level[:, None]).max(1) < IN_PLANE_MM for corners in facets_mm]
    return np.asarray(poses[np.all([(shown & one).any(1) for one in near], axis=0)])


@lru_cache(maxsize=4096)
def as_twins(one: Polyhedron, other: Polyhedron) -> Array:
    """(T, 4, 4) one_from_other: the poses in which most corners of a solid are another's as well."""
    (own, cosine, length), (others, cosines, lengths) = corner_frames(one), corner_frames(other)
    same = (np.abs(length[:, None] - lengths) < ALIKE_MM).all(2) & (np.abs(cosine[:, None] - cosines) < 0.03)
    mine, theirs = np.nonzero(same)
    found = np.zeros((0, 4, 4))
    if not len(mine):
        return found
    turns = own[mine] @ np.linalg.inv(others[theirs])
    moved = other.corners_mm @ turns[:, :3, :3].transpose(0, 2, 1) + turns[:, None, :3, 3]
    apart = np.linalg.norm(moved[:, :, None] - one.corners_mm, axis=3)
    good = np.flatnonzero((apart.min(1) < ALIKE_MM).mean(1) >= SHARED)
    kept = list[int]()
    for k in good.tolist():
        if not any(np.abs(moved[k] - moved[earlier]).max() < ALIKE_MM for earlier in kept):
            kept.append(k)
    return turns[kept]
