"""Named parts laid onto both images a last time: every edge that shows says where the part and its corners are.

Recognition has a part's pose from the corners of the facets it saw whole, each for itself, and what was taught moves
them afterwards; here the edges are measured where the whole part has them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron, chi_square_limit
from daemon.vision.image import Eyes
from daemon.vision.model import Model
from daemon.vision.registration.edge_adjustment import Adjusted, adjusted
from daemon.vision.registration.edge_pose import measured
from daemon.vision.registration.equivalent import most_in_view
from daemon.vision.registration.expected_edges import Placements, expected
from daemon.vision.values import Part

ROUNDS, SMALL_MM = 3, 0.15
"""How often edges are measured, and a motion of the part after which another time would change nothing."""
FEWEST_EDGES = 6
"""Edges in both eyes together that hold a pose."""
LEVER_MM = 30.0
MOST_APART = chi_square_limit(6, 1e-3)
"""Chi-square of the way between the pose that corners and the pose that edges say."""


def sharpened(parts: Sequence[Part], model: Model, eyes: Eyes, by_edges: Sequence[Part] = ()) -> tuple[Part, ...]:
    """The parts, the named ones where the edges in both images have them; those that edges named lie there already."""
    better, tolerance = list(parts), model.parameters.tolerance_mm
    named = {
        k: model.metric[part.recognition.label].solid
        for k, part in enumerate(parts)
        if part.named and not any(part is other for other in by_edges)
    }
    most = {k: most_in_view(solid, parts[k].equivalents, eyes) for k, solid in named.items()}
    for which in (most, {k: 0 for k, other in most.items() if other}):
        still = {k: _turned(parts[k], turn) for k, turn in which.items() if better[k] is parts[k]}
        found = _adjusted(
            [named[k] for k in still], [part.cyclopean_from_part for part in still.values()], eyes, tolerance
        )
        for (k, part), one in zip(still.items(), found, strict=True):
            if one is not None and _believed(one, part):
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


def _adjusted(shapes: list[Polyhedron], near: list[Array], eyes: Eyes, tolerance_mm: float) -> list[Adjusted | None]:
    """Each shape where its edges are near its pose (4, 4); None where too few of them show.

    Most poses are good to a fraction of a px: the rough fit of a line is left to those that moved.
    """
    found: list[Adjusted | None] = [None] * len(shapes)
    if not shapes:
        return found
    laid, poses, open_ = Placements.of(shapes), np.stack(near), np.ones(len(shapes), bool)
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


def _believed(found: Adjusted, part: Part) -> bool:
    """Whether the edges hold the part's place better than its corners did, and agree with them to what both leave open.

    Where they hold it worse, edges of something else are among its own.
    """
    off = frames.difference(found.pose, part.cyclopean_from_part)
    apart = float(off @ np.linalg.solve(found.covariance + part.covariance, off))
    return apart < MOST_APART and bool(np.trace(found.covariance[:3, :3]) < np.trace(part.covariance[:3, :3]))


def _moved(part: Part, shape: Polyhedron, found: Adjusted) -> Part:
    """The part at another pose, its fitted corners and the poses that fit as well with it."""
    before = frames.apply(part.cyclopean_from_part, shape.corners_mm)
    nearest = [np.linalg.norm(ring[:, None] - before, axis=2).argmin(1) for ring in part.fitted_mm]
    return part.laid(found.pose, found.covariance, tuple(found.corners_mm[ring] for ring in nearest))
