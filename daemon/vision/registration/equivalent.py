"""Of the poses that fit a part as well, the one that the pictures bear out best.

A part taught from one side is known by half: turned by one of its symmetries, a face that is in view, or the edge it
hides another with, may be one that was taught, or one of which nothing is known. Known, its edges hold the pose;
unknown, a thin face beyond an edge is taken for that edge's other side.
"""

from __future__ import annotations

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron
from daemon.vision.image import Eyes
from daemon.vision.registration.corner_pose import Fit
from daemon.vision.registration.edge_adjustment import Adjusted, adjusted
from daemon.vision.registration.edge_pose import facets_in_view, fit_at, measured
from daemon.vision.registration.expected_edges import EdgeObservation, Placements, expected
from daemon.vision.registration.stretches import Borne, settled, stretches_of

MORE = 1.02
"""So many times the area in view a pose must show of what was taught to be thought better unasked."""
FEWEST_IN_VIEW = 2
"""Facets that both eyes must see of what was taught for a pose to be asked about."""
LESS = 0.1
"""So much less of its edges may show there: what is not taught of a part need not be as its symmetry has it."""


def most_in_view(solid: Polyhedron, poses: Array, eyes: Eyes) -> int:
    """Which of the poses (P, 4, 4) cyclopean_from_part has most of what was taught in view; the first where none has
    notably more."""
    if len(poses) < 2:
        return 0
    areas = _in_view_px2(solid, poses, eyes)
    most = int(np.argmax(areas))
    return most if most and areas[most] > MORE * areas[0] else 0


def best_fitted(
    solid: Polyhedron, poses: Array, eyes: Eyes, tolerance_mm: float
) -> tuple[Fit, tuple[EdgeObservation, EdgeObservation]]:
    """What fit_at says at that of the poses (P, 4, 4) cyclopean_from_part, good to a px or two, whose edges hold the
    part best; both images must show about as much of it as of the first."""
    areas = _in_view_px2(solid, poses, eyes)
    sizes = np.rint(np.log(np.maximum(areas, 1.0)) / np.log(MORE))
    unlike = np.unique(sizes, return_index=True)[1].tolist()  # turns of what is known whole show the same
    others = [k for k in unlike if sizes[k] != sizes[0]]
    asked = [0, *(k for k in others if facets_in_view(solid, eyes, poses[k]) >= FEWEST_IN_VIEW)]
    if len(asked) == 1:
        return fit_at(solid, eyes, poses[0], tolerance_mm)
    laid, middle = Placements.of([solid] * len(asked)), frames.apply(poses[0], solid.corners_mm).mean(0)
    near = settled(laid, eyes, poses[asked], tolerance_mm)
    stretches = stretches_of(laid, eyes, near, tolerance_mm)
    shares = np.array([Borne.of([seen.only(k, laid) for seen in stretches]).share for k in range(len(asked))])
    good = shares > shares[0] - LESS
    edges = measured([expected(laid, view, near, good, tolerance_mm) for view in eyes.views], eyes)
    held = [
        (_off_mm2(adjusted(solid, near[k], [seen.only(k, laid) for seen in edges], tolerance_mm), middle), k)
        for k in np.flatnonzero(good).tolist()
    ]
    return fit_at(solid, eyes, near[min(held)[1]], tolerance_mm)


def _off_mm2(found: Adjusted, point_mm: Array) -> float:
    """What the square of the place of a point (3,) that goes with the part is off by."""
    motion = frames.point_motion((point_mm - found.pose[:3, 3])[None])[0]
    return float(np.trace(motion @ found.covariance @ motion.T))


def _in_view_px2(solid: Polyhedron, poses: Array, eyes: Eyes) -> Array:
    """(P,) area of the facets that face each eye, px2, both together, at poses (P, 4, 4)."""
    here, after, first = solid.steps
    corners = solid.corners_mm @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3]
    total = np.zeros(len(poses))
    for view in eyes.views:
        px = view.eye.camera.project(corners.reshape(-1, 3)).reshape(*corners.shape[:2], 2)
        (x, y), (u, v) = (px[:, which].transpose(2, 0, 1) for which in (here, after))
        total += np.maximum(-np.add.reduceat(x * v - y * u, first, axis=1), 0.0).sum(1) / 2
    return total
