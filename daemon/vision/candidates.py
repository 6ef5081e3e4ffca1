"""Facets that may be: polygons matched between the eyes, fitted, triangulated, weighed against each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.vision.data import Facet, Polygon
from daemon.vision.epipolar import Baseline
from daemon.vision.eye import Sight
from daemon.vision.matching import match_polygons
from daemon.vision.planes import planarity
from daemon.vision.polygons import Fitted, fit_polygons
from daemon.vision.settings import VisionSettings
from daemon.vision.shapes import overlap

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Candidate:
    """A facet that may be: as fitted in both eyes (the right's corners in the left's order), in space, and its
    worth.
    """

    facet: Facet
    left: Fitted
    right: Fitted
    worth: float


def find_candidates(left: Sight, right: Sight, eyes: Baseline, settings: VisionSettings) -> list[Candidate]:
    """Every pair of outlines that fits along the epipolar lines, fitted and triangulated."""
    matches = match_polygons([o.corners for o in left.outlines], [o.corners for o in right.outlines], eyes, settings)
    fits = [_fit_used(left, {m.left for m in matches}), _fit_used(right, {m.right for m in matches})]
    candidates = []
    for m in matches:
        a, b = fits[0][m.left], fits[1][m.right]
        if a is not None and b is not None:
            b = b.rolled(m.shift)
            facet = triangulate(a.polygon, b.polygon, eyes)
            if facet.epipolar_px.max() < settings.max_epipolar_px:
                worth = min(left.outlines[m.left].support, right.outlines[m.right].support) + _agreement(a, b)
                candidates.append(Candidate(facet, a, b, worth - 0.1 * m.cost))
    return candidates


def _fit_used(sight: Sight, used: set[int]) -> dict[int, Fitted | None]:
    order = sorted(used)
    return dict(zip(order, fit_polygons(sight, [sight.outlines[k] for k in order]), strict=True))


def _agreement(a: Fitted, b: Fitted) -> float:
    """The least fraction of rows, over all sides of both eyes, that lie on their line."""
    return float(min(a.sides.support.min(), b.sides.support.min()))


def choose(candidates: list[Candidate]) -> list[Candidate]:
    """Of candidates that cover each other in either eye, the worthiest."""
    chosen: list[Candidate] = []
    for c in sorted(candidates, key=lambda c: -c.worth):
        if not any(
            _covers(c.left.polygon, k.left.polygon) or _covers(c.right.polygon, k.right.polygon) for k in chosen
        ):
            chosen.append(c)
    return chosen


def _covers(a: Polygon, b: Polygon) -> bool:
    return overlap(a.corners_px, b.corners_px)[1] > 0.25


def triangulate(a: Polygon, b: Polygon, eyes: Baseline) -> Facet:
    """The facet whose corners are a's in the left and b's in the right eye, in the same order."""
    left, right = eyes.left.ideal(a.corners_px), eyes.right.ideal(b.corners_px)
    corners = eyes.points(left, right)
    covariance = corner_covariance(eyes, left, right, a.covariance_px2, b.covariance_px2)
    off = np.abs(left[:, 1] - right[:, 1]) * eyes.left.focal_px
    return Facet(corners, covariance, a.corners_px, b.corners_px, off, planarity(corners))


def corner_covariance(eyes: Baseline, left: Array, right: Array, left_px2: Array, right_px2: Array) -> Array:
    """(N, 3, 3) mm^2 of triangulated corners, to first order. left, right: ideal coordinates (N, 2)."""
    step = 1e-5
    jacobian = np.zeros((len(left), 3, 4))
    for k in range(4):
        d = np.zeros(4)
        d[k] = step
        up, down = eyes.points(left + d[:2], right + d[2:]), eyes.points(left - d[:2], right - d[2:])
        jacobian[:, :, k] = (up - down) / (2 * step)
    noise = np.zeros((len(left), 4, 4))
    noise[:, :2, :2], noise[:, 2:, 2:] = left_px2 / eyes.left.focal_px**2, right_px2 / eyes.right.focal_px**2
    return np.asarray(jacobian @ noise @ np.swapaxes(jacobian, 1, 2))
