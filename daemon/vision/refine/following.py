"""A known part followed from look to look. Pure: facets, a shape and a pose thought to be near in, a pose out.

Recognition names a part from nothing; here its name is known and its pose nearly, so that corners are matched to the
shape's nearest and the pose cannot jump to another of a symmetric part's equal poses. Naming is not done here.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags
from daemon.vision.geometry import Polyhedron, solve, whitener
from daemon.vision.refine.expected_edges import SCALE
from daemon.vision.settings import TOLERANCE_MM
from daemon.vision.values import Facet

VAGUE_MM = 8.0
"""A facet with a corner known no better than this says nothing."""
MOST_RESIDUAL_MM = 2.5
"""Corners that fit worse than this, rms, are not the shape's."""


@dataclass(frozen=True, eq=False)
class Fit:
    """cyclopean_from_part (4, 4), its covariance (6, 6) as daemon/frames.py has it, the rms distance of the matched
    corners from the shape, and how many different corners of the shape were met."""

    cyclopean_from_part: Array
    covariance: Array
    residual_mm: float
    matched: int


def fit_to_facets(shape: Polyhedron, facets: Sequence[Facet], near: Array, gate_mm: float = 12.0) -> Fit | None:
    """The pose nearest to `near` (cyclopean_from_part) that fits the seen facets to the shape, or None.

    Corners farther than gate_mm from every corner of the shape are left out (a facet not taught, a neighbour's), and so
    are those whose nearest is the end of a chord of an arc, as a polygon round an arc may begin anywhere along it, and
    facets of which a corner is hardly known; where the rest does not fit, the vaguest facet goes, and so on. None
    where fewer than three different corners in general position are met, or they fit worse than MOST_RESIDUAL_MM.
    Source: point matches, nearest first (ICP on corners). Where the corners fit worse than
    their own covariance says, the pose's covariance grows by the same factor.
    """
    known = [f for f in facets if _vague_mm(f) < VAGUE_MM]
    while known:
        fit = _fit_to_facets(shape, known, near, gate_mm)
        if fit is not None:
            return fit
        known.remove(max(known, key=_vague_mm))
    return None


def _vague_mm(facet: Facet) -> float:
    """Return how badly the facet's worst corner is known, mm."""
    return float(np.sqrt(np.trace(facet.covariance_mm2, axis1=1, axis2=2).max()))


def _fit_to_facets(shape: Polyhedron, facets: Sequence[Facet], near: Array, gate_mm: float) -> Fit | None:
    corners = np.concatenate([f.corners_mm for f in facets])
    whitens = whitener(np.concatenate([f.covariance_mm2 for f in facets]) + TOLERANCE_MM**2 * np.eye(3))
    of_chords = _ends_of_chords(shape)
    pose = near
    for _ in range(6):
        placed = frames.apply(pose, shape.corners_mm)
        gaps = np.linalg.norm(corners[:, None] - placed[None], axis=2)
        nearest = gaps.argmin(axis=1)
        keep = (gaps.min(axis=1) < gate_mm) & ~of_chords[nearest]
        met = np.unique(nearest[keep])
        if len(met) < 3:
            return None
        there, whiten = placed[nearest[keep]], whitens[keep]
        rows, errors = whiten @ frames.point_motion(there - pose[:3, 3]), whiten @ (corners[keep] - there)[..., None]
        if np.linalg.cond(np.einsum("nia,nib->ab", rows, rows) * np.outer(SCALE, SCALE)) > 1e6:
            return None
        step = solve(rows[None], errors[None, ..., 0], np.ones((1, len(rows))), np.zeros((6, 6))).unknowns[0]
        pose = frames.perturb(pose, step)
        if np.linalg.norm(step * (1, 1, 1, 50, 50, 50)) < 1e-4:
            break
    return _judged(shape, pose, corners[keep], nearest[keep], whitens[keep])


@lru_cache(maxsize=1024)
def _ends_of_chords(shape: Polyhedron) -> Flags:
    """(K,) which corners of a shape are the ends of chords of an arc, and not one of its own two ends."""
    found = np.zeros(len(shape.corners_mm), bool)
    for arc in shape.arcs:
        apart = np.linalg.norm(shape.corners_mm[:, None] - arc.points_mm, axis=2)
        step = np.linalg.norm(np.diff(arc.points_mm, axis=0), axis=1).max()
        on = apart.min(1) < step
        if np.linalg.norm(arc.points_mm[0] - arc.points_mm[-1]) > step:
            on[apart[:, [0, -1]].argmin(0)] = False
        found |= on
    return found


def _judged(shape: Polyhedron, pose: Array, corners: Array, met: Array, whitens: Array) -> Fit | None:
    errors = corners - frames.apply(pose, shape.corners_mm)[met]
    residual_mm = float(np.sqrt((errors**2).sum(axis=1).mean()))
    if residual_mm > MOST_RESIDUAL_MM:
        return None
    rows = whitens @ frames.point_motion(frames.apply(pose, shape.corners_mm)[met] - pose[:3, 3])
    covariance = np.linalg.inv(np.einsum("nia,nib->ab", rows, rows))
    excess = float(((whitens @ errors[..., None]) ** 2).sum()) / max(3 * len(errors) - 6, 1)
    return Fit(pose, covariance * max(excess, 1.0), residual_mm, len(np.unique(met)))
