"""A part that its edges name, measured where it was laid: pose, facets, and by how much its place is in doubt.

In: a part laid onto both images, and the same part as it could lie otherwise. Out: what is named. Whether it is there
is by_segments.py's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.facets import weld
from daemon.vision.geometry import Polyhedron
from daemon.vision.recognition import Recognised, typed_as
from daemon.vision.registration.corner_pose import Fit
from daemon.vision.registration.edge_pose import facets_laid
from daemon.vision.registration.equivalent import best_fitted
from daemon.vision.registration.guessing import Likely, Search
from daemon.vision.registration.laid import Laid, laid_near
from daemon.vision.registration.measured import measured_facet
from daemon.vision.registration.on_table import flat_on
from daemon.vision.registration.pose_step import SCALE
from daemon.vision.registration.resting import Ground, rests_on
from daemon.vision.registration.space_corners import lookalikes
from daemon.vision.registration.unsure import nearby
from daemon.vision.values import Part, Recognition

OF_ODDS = 0.5
"""Of log odds, what counts between places of one part: its edges in one are mostly those in another. With this 99 of
100 poses of a real printed cube, and 94 of rendered parts, are within the 95 % of their covariance, and none beyond
three sigmas (python -m tests.bench.poses); of fits alone 76 and 81 were."""


def placed(seen: Laid, confidence: float, same: Sequence[Laid], search: Search) -> Recognised:
    """The part with the facets that both eyes have in view, measured where its sides show; same: the same part as it
    was laid there, this way and others."""
    eyes, model = search.eyes, search.model
    near = [Likely(seen.label, pose) for pose in nearby(seen.solid, seen.pose)]
    same = [*same, *laid_near(search, near)]
    alike = _alike(seen.solid, seen.pose, np.flatnonzero(seen.solid.facing(seen.pose) > 0).tolist())
    fit, observed = best_fitted(seen.solid, alike, eyes, model.parameters.tolerance_mm)
    laid = facets_laid(seen.solid, observed)
    facets = typed_as(
        [measured_facet(f, eyes.geometry) for f in laid], (seen.solid.types[f.index] for f in laid), model.library
    )
    pose, covariance = _on_ground(search.ground, seen.solid, fit)
    corners = frames.apply(pose, seen.solid.corners_mm)
    fitted = tuple(corners[seen.solid.rings[f.index]] for f in laid)
    why = f"{100 * seen.borne.share:.0f} % of what its edges could show is there in both eyes"
    name = Recognition(seen.label, confidence, 0.0, 0.0, None, False, why, (seen.label,))
    equivalents = _alike(seen.solid, pose, [f.index for f in laid])
    covariance = covariance + _spread(seen, same, alike)
    part = Part(name, facets, pose, covariance, fit.residual_mm, fitted, equivalents)
    return Recognised(weld(list(facets)), part)


def _on_ground(ground: Ground | None, solid: Polyhedron, fit: Fit) -> tuple[Array, Array]:
    """Pose (4, 4) and covariance (6, 6) of a fit, on the table if that is seen and it lies there."""
    pose, covariance = fit.cyclopean_from_part, fit.covariance
    lies = ground is not None and ground.seen and rests_on(ground, solid, pose)
    found = flat_on(ground.table, solid, pose, covariance) if ground is not None and lies else None
    return found or (pose, covariance)


def _odds_of_place(one: Laid) -> float:
    """Log odds of a part's lying just there: of how many tries that is the best says nothing of it."""
    return one.odds + float(np.log(one.tries))


def _spread(best: Laid, same: Sequence[Laid], alike: Array) -> Array:
    """(6, 6) by how much the place is in doubt of a part that could lie in several ways, each as likely as its edges
    there, alike (S, 4, 4) the poses at which it would look the same as where it is likeliest."""
    spread, total = np.zeros((6, 6)), 1.0
    for one in same:
        if one is not best:
            weight = float(np.exp(OF_ODDS * (_odds_of_place(one) - _odds_of_place(best))))
            ways = [frames.difference(one.pose, pose) for pose in alike]
            off = min(ways, key=lambda way: float(np.linalg.norm(way / SCALE)))
            spread += weight * np.outer(off, off)
            total += weight
    return spread / total


def _alike(solid: Polyhedron, pose: Array, facets: Sequence[int]) -> Array:
    """(S, 4, 4) the poses at which the corners of some facets lie where they do at this one (4, 4), which is the first,
    or where others of the solid do."""
    turns = lookalikes(solid, tuple(solid.corners_of(facets).tolist()))
    return np.array([pose @ frames.inverse(turn) for turn in turns])
