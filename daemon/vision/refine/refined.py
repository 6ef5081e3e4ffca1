"""Named parts registered on both images a last time, at the pose that the images support best.

In: named parts with the pose of the corners of facets seen whole, both images. Out: pose and corners from every edge
that shows, measured where the whole part has them.

A part taught from one side is known by half. Turned by one of its symmetries, a face in view, or the edge that it
covers another with, may be taught or unknown: a taught edge holds the pose, while a thin face beyond an unknown edge
would be taken for that edge's other side. Of poses that fit as well, the one with most support is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron, SolidBatch
from daemon.vision.image import StereoImages
from daemon.vision.model import Model
from daemon.vision.refine.edge_adjustment import AdjustedPose, adjusted
from daemon.vision.refine.edge_pose import measured
from daemon.vision.refine.expected_edges import expected
from daemon.vision.values import Part

ROUNDS, SMALL_MM = 3, 0.15
"""How often edges are measured, and a motion of the part after which another time would change nothing."""
FEWEST_EDGES = 6
"""Edges in both eyes together that hold a pose."""
LEVER_MM = 30.0
OF_COVARIANCE = 0.4
"""Of the covariance that lines say, what a part has whose facets are seen whole: with it 97 of 100 such poses are
within the 95 % of their covariance, with all of it 99 (python -m tests.bench.poses)."""


def refined_parts(
    parts: Sequence[Part], model: Model, eyes: StereoImages, by_edges: Sequence[Part] = ()
) -> tuple[Part, ...]:
    """The parts, the named ones where the edges in both images have them; those that edges named lie there already."""
    better, tolerance = list(parts), model.parameters.tolerance_mm
    named = {
        k: model.metric[part.recognition.label].solid
        for k, part in enumerate(parts)
        if part.named and not any(part is other for other in by_edges)
    }
    near = {k: _turned(parts[k], most_in_view(solid, parts[k].equivalents, eyes)) for k, solid in named.items()}
    poses = [part.cyclopean_from_part for part in near.values()]
    for (k, part), one in zip(near.items(), _adjusted(list(named.values()), poses, eyes, tolerance), strict=True):
        if one is not None:
            better[k] = _moved(part, named[k], one)
    return tuple(better)


def _turned(part: Part, which: int) -> Part:
    """The part at another of its equivalent poses."""
    if which == 0:
        return part
    pose = part.equivalents[which]
    moved = np.eye(6)
    moved[:3] = frames.point_motion((pose - part.cyclopean_from_part)[None, :3, 3])[0]
    equivalents = np.concatenate([pose[None], np.delete(part.equivalents, which, 0)])
    covariance = moved @ part.covariance @ moved.T
    return replace(part, cyclopean_from_part=pose, covariance=covariance, equivalents=equivalents)


def _adjusted(
    shapes: list[Polyhedron], near: list[Array], eyes: StereoImages, tolerance_mm: float
) -> list[AdjustedPose | None]:
    """Each shape where its edges are near its pose (4, 4); None where too few of them show.

    Most poses are good to a fraction of a px: the rough fit of a line is left to those that moved.
    """
    found: list[AdjustedPose | None] = [None] * len(shapes)
    if not shapes:
        return found
    laid, poses, open_ = SolidBatch.of(shapes), np.stack(near), np.ones(len(shapes), bool)
    for turn in range(ROUNDS):
        seen_by = [expected(laid, view, poses, open_, tolerance_mm) for view in eyes.views]
        both = measured(seen_by, eyes, on_place=turn == 0)
        for k in np.flatnonzero(open_).tolist():
            observed = [seen.only(k, laid) for seen in both]
            open_[k] = sum(int((seen.there & seen.edges.sharp).sum()) for seen in observed) >= FEWEST_EDGES
            if open_[k]:
                found[k] = one = adjusted(shapes[k], poses[k], observed, tolerance_mm)
                open_[k] = np.linalg.norm(one.motion * ([1.0] * 3 + [LEVER_MM] * 3)) > SMALL_MM
                poses[k] = one.pose
        if not open_.any():
            break
    return found


def _moved(part: Part, shape: Polyhedron, found: AdjustedPose) -> Part:
    """The part at another pose, its fitted corners and the poses that fit as well with it."""
    before = frames.apply(part.cyclopean_from_part, shape.corners_mm)
    nearest = [np.linalg.norm(ring[:, None] - before, axis=2).argmin(1) for ring in part.fitted_mm]
    return part.laid(found.pose, OF_COVARIANCE * found.covariance, tuple(found.corners_mm[ring] for ring in nearest))


MORE = 1.02
"""So many times the area in view a pose must show of what was taught to be thought better unasked."""


def most_in_view(solid: Polyhedron, poses: Array, eyes: StereoImages) -> int:
    """Which of the poses (P, 4, 4) cyclopean_from_part has most of what was taught in view; the first where none has
    notably more."""
    if len(poses) < 2:
        return 0
    areas = _in_view_px2(solid, poses, eyes)
    most = int(np.argmax(areas))
    return most if most and areas[most] > MORE * areas[0] else 0


def _in_view_px2(solid: Polyhedron, poses: Array, eyes: StereoImages) -> Array:
    """(P,) area of the facets that face each eye, px2, both together, at poses (P, 4, 4)."""
    here, after, first = solid.steps
    corners = solid.corners_mm @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3]
    total = np.zeros(len(poses))
    for view in eyes.views:
        px = view.eye.camera.project(corners.reshape(-1, 3)).reshape(*corners.shape[:2], 2)
        (x, y), (u, v) = (px[:, which].transpose(2, 0, 1) for which in (here, after))
        total += np.maximum(-np.add.reduceat(x * v - y * u, first, axis=1), 0.0).sum(1) / 2
    return total
