"""Facets that may be: polygons matched between the eyes, fitted, triangulated, weighed against each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from daemon.arrays import Array
from daemon.vision.facets.matching import PolygonMatch, in_both, match_polygons
from daemon.vision.geometry import Baseline, PlanarShape, disparity, planarities, rings, weighted_plane
from daemon.vision.image import Fitted, Outline, StereoImages, fits, outlines_near
from daemon.vision.settings import VisionSettings
from daemon.vision.values import Facet, MeasuredCorners

# Set by eye on the rendered scenes, like the shares in choose() and what it calls.
_FEW = 2  # pairs of much the same region that are fitted
COVERED = 0.25  # of the smaller: more than that, and the two cannot both be there
_MODEL_RAD = 2e-3  # a corner may be this much of its distance off, where another edge runs close by
_PER_CORNER = 0.05  # of worth, that each corner must bring
_SAME_UNION = 0.7  # of two outlines' union that both cover: much the same region
_PER_PX = 0.1  # of worth, that a px of mismatch between the eyes takes


@dataclass(frozen=True, eq=False)
class Candidate:
    """A facet that may be: as fitted in both eyes (the right's corners in the left's order), in space, and its
    worth.
    """

    facet: Facet
    left: Fitted
    right: Fitted
    worth: float
    left_shape: PlanarShape
    right_shape: PlanarShape

    def covers(self, other: Candidate) -> float:
        """Greatest part, in either eye, of the smaller of the two that both cover."""
        return max(self.left_shape.covers(other.left_shape), self.right_shape.covers(other.right_shape))


def outlines_of(eyes: StereoImages, settings: VisionSettings, *, in_one: bool) -> list[tuple[Outline, ...]]:
    """The left and the right eye's outlines, best supported first; in_one: those as well that one eye alone shows."""
    rough = [view.rough(settings) for view in eyes.views]
    if not in_one:
        left, right = ([p.corners for p in own] for own in rough)
        both = in_both(left, right, eyes.geometry, settings)
        rough = [list(compress(own, there)) for own, there in zip(rough, both, strict=True)]
    return outlines_near(list(zip(eyes.views, rough, strict=True)), settings)


def find_candidates(
    outlines: Sequence[Sequence[Outline]], eyes: StereoImages, settings: VisionSettings
) -> list[Candidate]:
    """Pairs of the left and the right eye's outlines that fit along the epipolar lines, fitted and triangulated; of
    similar pairs only the best few.
    """
    left, right = outlines
    matches = match_polygons([o.corners for o in left], [o.corners for o in right], eyes.geometry, settings)
    matches = _best_few(matches, left, right)
    asked = (eyes.left, [left[m.left] for m in matches]), (eyes.right, [right[m.right] for m in matches])
    fitted = [
        (a, b.rolled(m.shift), min(left[m.left].support, right[m.right].support) - _PER_PX * m.cost)
        for m, a, b in zip(matches, *fits(asked), strict=True)
        if a is not None and b is not None
    ]
    return [c for c in candidates(fitted, eyes.geometry) if c.facet.epipolar_px.max() < settings.max_epipolar_px]


def candidates(fitted: Sequence[tuple[Fitted, Fitted, float]], geometry: Baseline) -> list[Candidate]:
    """Candidates of polygons in the left and the right eye whose corners correspond, each with how far its outlines are
    seen, less what speaks against it.
    """
    facets = triangulate([(left.polygon.measured, right.polygon.measured) for left, right, _ in fitted], geometry)
    found = []
    for facet, (left, right, support) in zip(facets, fitted, strict=True):
        worth = support + _agreement(left, right) - _PER_CORNER * len(facet.left_px)
        found.append(
            Candidate(facet, left, right, worth, PlanarShape.of(facet.left_px), PlanarShape.of(facet.right_px))
        )
    return found


def _best_few(matches: list[PolygonMatch], left: Sequence[Outline], right: Sequence[Outline]) -> list[PolygonMatch]:
    """Of matches of much the same region the best two, by how far the outlines are seen and how well they match."""

    def rank(m: PolygonMatch) -> float:
        support = min(left[m.left].support, right[m.right].support)
        return m.cost * _PER_PX + _PER_CORNER * len(left[m.left].corners) - support

    kept: list[PolygonMatch] = []
    shapes: list[tuple[PlanarShape, PlanarShape]] = []
    for m in sorted(matches, key=rank):
        both = left[m.left].shape, right[m.right].shape
        alike = sum(both[0].union(s[0]) > _SAME_UNION or both[1].union(s[1]) > _SAME_UNION for s in shapes)
        if alike < _FEW:
            kept.append(m)
            shapes.append(both)
    return kept


def _agreement(a: Fitted, b: Fitted) -> float:
    """The least fraction of rows, over all sides of both eyes, that lie on their line."""
    return float(min(a.sides.support.min(), b.sides.support.min()))


def choose(
    candidates: list[Candidate], settings: VisionSettings
) -> tuple[list[Candidate], list[tuple[Candidate, str]]]:
    """Of candidates that cover each other in either eye, the worthiest; and those refused, with the reason: one that is
    not flat is two facets."""
    chosen, refused = list[Candidate](), list[tuple[Candidate, str]]()
    for c in sorted(candidates, key=lambda c: -c.worth):
        if _flatness_sigmas(c.facet) > settings.planarity_sigmas:
            refused.append((c, "its corners do not lie in one plane: it is two facets"))
        elif not any(c.covers(k) > COVERED for k in chosen):
            chosen.append(c)
    return chosen, refused


def _flatness_sigmas(facet: Facet) -> float:
    """How far the worst corner leaves the facet's plane, in predicted sigmas; 0 for a triangle."""
    if len(facet.corners_mm) < 4:
        return 0.0
    model_mm2 = (_MODEL_RAD * facet.corners_mm[:, 2].mean()) ** 2 * np.eye(3)
    residuals = weighted_plane(facet.corners_mm, facet.covariance_mm2 + model_mm2)[2]
    return float(np.abs(residuals).max())


def triangulate(pairs: Sequence[tuple[MeasuredCorners, MeasuredCorners]], geometry: Baseline) -> list[Facet]:
    """Facets whose corners are these in the left and in the right eye, in the same order."""
    if not pairs:
        return []
    shape, other = (rings([pair[eye][0] for pair in pairs]) for eye in (0, 1))
    spread = (np.concatenate([pair[eye][1] for pair in pairs]) for eye in (0, 1))
    left, right = geometry.left.ideal(shape.corners), geometry.right.ideal(other.corners)
    corners = geometry.points(left, right)
    covariance = _triangulated_covariance(geometry, left, right, *spread)
    off = np.abs(left[:, 1] - right[:, 1]) * geometry.left.focal_px
    flat = planarities(shape.moved(corners))
    each = (shape.split(v) for v in (corners, covariance, shape.corners, other.corners, off))
    return [Facet(*values) for values in zip(*each, flat, strict=True)]


def _triangulated_covariance(geometry: Baseline, left: Array, right: Array, left_px2: Array, right_px2: Array) -> Array:
    """(N, 3, 3) mm^2 of triangulated corners, to first order. left, right: ideal coordinates (N, 2)."""
    d = disparity(left, right)
    z = geometry.length_mm / d
    fall = z / d
    u, v = (left + right).T / 2
    jacobian = np.zeros((len(left), 3, 4))
    jacobian[:, :, 0] = np.stack([z / 2 - u * fall, -v * fall, -fall], 1)
    jacobian[:, :, 2] = np.stack([z / 2 + u * fall, v * fall, fall], 1)
    jacobian[:, 1, 1] = jacobian[:, 1, 3] = z / 2
    jacobian = geometry.cyclopean_from_baseline @ jacobian
    noise = np.zeros((len(left), 4, 4))
    noise[:, :2, :2], noise[:, 2:, 2:] = left_px2 / geometry.left.focal_px**2, right_px2 / geometry.right.focal_px**2
    return np.asarray(jacobian @ noise @ np.swapaxes(jacobian, 1, 2))
