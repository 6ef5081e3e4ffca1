"""A part that recognition could not name, by its edges: which taught part's whole outline lies where its facets say.

A lone facet is no proof, and a part whose faces shade alike shows no more; but a facet with a name for it also says
where all other edges of that part must be. Pure: a sight of a part and the images in, a named one or None out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.vision.geometry.polyhedron import Polyhedron
from daemon.vision.registration.corner_pose import poses_that_fit
from daemon.vision.registration.edge_pose import Array, Eyes, facing, fit_edges, shown
from daemon.vision.values import Facet

REACH_MM, CLOSE_MM = 3.0, 0.8
"""How far off the pose that a facet says may be, and an edge of the proof."""
PROVED, DISPROVED = 0.9, 0.6
"""Shares of the outline: what a name needs, and what every other name must stay below."""
SAME_MM = 3.0
MOST = 6


@dataclass(frozen=True, eq=False)
class Proved:
    """label; cyclopean_from_part (4, 4); share: of its outline that both eyes show."""

    label: str
    cyclopean_from_part: Array
    share: float


def proved(facets: Sequence[Facet], shapes: Mapping[str, Polyhedron], eyes: Eyes) -> Proved | None:
    """The only one of all taught shapes whose outline lies where these facets say; None where none or several do."""
    best = [
        found for found in (_best(facets, label, shape, eyes) for label, shape in shapes.items()) if found is not None
    ]
    best.sort(key=lambda p: -p.share)
    if not best or best[0].share < PROVED or any(p.share >= DISPROVED for p in best[1:]):
        return None
    return best[0]


def _best(facets: Sequence[Facet], label: str, shape: Polyhedron, eyes: Eyes) -> Proved | None:
    """The pose of one shape that shows most of its outline, two of its facets at least in view."""
    found: list[Proved] = []
    for pose in _distinct(shape, [fit.cyclopean_from_part for fit in poses_that_fit(shape, facets)]):
        fit = fit_edges(shape, eyes, pose, REACH_MM)
        at = pose if fit is None else fit.cyclopean_from_part
        if facing(shape, eyes, at) > 1:
            found.append(Proved(label, at, shown(shape, eyes, at, CLOSE_MM) * (1.0 if fit else 0.8)))
    return max(found, key=lambda p: p.share, default=None)


def _distinct(shape: Polyhedron, poses: Sequence[Array]) -> list[Array]:
    """Poses in which the part looks different: a symmetric one's equal poses count once."""
    kept: list[tuple[Array, Array]] = []
    for pose in poses:
        corners = frames.apply(pose, shape.corners_mm)
        if not any(_same(corners, other) for other, _ in kept):
            kept.append((corners, pose))
    return [pose for _, pose in kept[:MOST]]


def _same(a: Array, b: Array) -> bool:
    return bool(np.linalg.norm(a[:, None] - b[None], axis=2).min(axis=1).max() < SAME_MM)
