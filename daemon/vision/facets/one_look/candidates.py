"""Facets that may be: polygons matched between the cameras, fitted, triangulated, weighed against each other.

Matching is epipolar, ordered, facet-wise. D'Souza matches corner by corner inside an epipolar band (section 4.2.3) and
loses its way where sides are short; whole facets, taken round their border in order, leave far fewer ways to be wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from daemon.arrays import Array, Flags, Index
from daemon.vision.geometry import Baseline, PlanarShape, RectifiedCamera, disparity, planarities, rings, weighted_plane
from daemon.vision.image import Fitted, Outline, StereoImages, fitted_outlines, outlines_near
from daemon.vision.settings import VisionSettings
from daemon.vision.values import Facet, MeasuredCorners

# Set by eye on the rendered scenes, like the shares in choose() and what it calls.
_FEW = 2  # pairs of much the same region that are fitted
COVERED = 0.25  # of the smaller: more than that, and the two cannot both be there
_MODEL_RAD = 2e-3  # a corner may be this much of its distance off, where another edge runs close by
_PER_CORNER = 0.05  # of worth, that each corner must bring
_SAME_UNION = 0.7  # of two outlines' union that both cover: much the same region
_PER_PX = 0.1  # of worth, that a px of mismatch between the cameras takes


@dataclass(frozen=True, eq=False)
class Candidate:
    """A facet that may be: as fitted in both cameras (the right's corners in the left's order), in space, and its
    worth.
    """

    facet: Facet
    left: Fitted
    right: Fitted
    score: float
    left_shape: PlanarShape
    right_shape: PlanarShape

    def covers(self, other: Candidate) -> float:
        """Greatest part, in either camera, of the smaller of the two that both cover."""
        return max(self.left_shape.covers(other.left_shape), self.right_shape.covers(other.right_shape))


def outlines_of(images: StereoImages, settings: VisionSettings, *, in_one: bool) -> list[tuple[Outline, ...]]:
    """The left and the right camera's outlines, best supported first; in_one: those as well that one camera alone
    shows."""
    rough = [view.rough(settings) for view in images.views]
    if not in_one:
        left, right = ([p.corners for p in own] for own in rough)
        both = in_both(left, right, images.geometry, settings)
        rough = [list(compress(own, there)) for own, there in zip(rough, both, strict=True)]
    return outlines_near(list(zip(images.views, rough, strict=True)), settings)


def find_candidates(
    outlines: Sequence[Sequence[Outline]], images: StereoImages, settings: VisionSettings
) -> list[Candidate]:
    """Pairs of the left and the right camera's outlines that fit along the epipolar lines, fitted and triangulated; of
    similar pairs only the best few.
    """
    left, right = outlines
    matches = match_polygons([o.corners for o in left], [o.corners for o in right], images.geometry, settings)
    matches = _best_few(matches, left, right)
    requests = (images.left, [left[m.left] for m in matches]), (images.right, [right[m.right] for m in matches])
    fitted = [
        (a, b.rolled(m.shift), min(left[m.left].support, right[m.right].support) - _PER_PX * m.cost)
        for m, a, b in zip(matches, *fitted_outlines(requests), strict=True)
        if a is not None and b is not None
    ]
    return [c for c in candidates(fitted, images.geometry) if c.facet.epipolar_px.max() < settings.max_epipolar_px]


def candidates(fitted: Sequence[tuple[Fitted, Fitted, float]], geometry: Baseline) -> list[Candidate]:
    """Candidates of polygons in the left and the right camera whose corners correspond, each with how far its outlines
    are seen, less what speaks against it.
    """
    facets = triangulate([(left.polygon.measured, right.polygon.measured) for left, right, _ in fitted], geometry)
    found = []
    for facet, (left, right, support) in zip(facets, fitted, strict=True):
        agreement = float(min(left.sides.support.min(), right.sides.support.min()))  # least share of rows on their line
        score = support + agreement - _PER_CORNER * len(facet.left_px)
        found.append(
            Candidate(facet, left, right, score, PlanarShape.of(facet.left_px), PlanarShape.of(facet.right_px))
        )
    return found


def _best_few(matches: list[PolygonMatch], left: Sequence[Outline], right: Sequence[Outline]) -> list[PolygonMatch]:
    """Keep the best two of the matches of much the same region, by how far the outlines are seen and how well they
    match."""

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


def choose(
    candidates: list[Candidate], settings: VisionSettings
) -> tuple[list[Candidate], list[tuple[Candidate, str]]]:
    """Non-maximum suppression: of candidates that overlap in either camera keep the one with the highest score, one
    with arcs before one whose sides are all straight; and those refused, with the reason: one that is not flat is two
    facets."""
    chosen, refused = list[Candidate](), list[tuple[Candidate, str]]()
    for c in sorted(candidates, key=lambda c: (not c.facet.arcs, -c.score)):
        if _flatness_sigmas(c.facet) > settings.planarity_sigmas:
            refused.append((c, "its corners do not lie in one plane: it is two facets"))
        elif not any(c.covers(k) > COVERED for k in chosen):
            chosen.append(c)
    return chosen, refused


def _flatness_sigmas(facet: Facet) -> float:
    """Return how far the worst corner leaves the facet's plane, in predicted sigmas; 0 for a triangle."""
    if len(facet.corners_mm) < 4:
        return 0.0
    model_mm2 = (_MODEL_RAD * facet.corners_mm[:, 2].mean()) ** 2 * np.eye(3)
    residuals = weighted_plane(facet.corners_mm, facet.covariance_mm2 + model_mm2)[2]
    return float(np.abs(residuals).max())


def triangulate(pairs: Sequence[tuple[MeasuredCorners, MeasuredCorners]], geometry: Baseline) -> list[Facet]:
    """Facets whose corners are these in the left and in the right camera, in the same order."""
    if not pairs:
        return []
    shape, other = (rings([pair[camera][0] for pair in pairs]) for camera in (0, 1))
    spread = (np.concatenate([pair[camera][1] for pair in pairs]) for camera in (0, 1))
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


_ROUGH_PX = 2.0
"""Extra distance, px, from their epipolar lines that the ends of a rough polygon may have against an outline's; set by
eye."""


@dataclass(frozen=True, eq=False)
class PolygonMatch:
    """Left polygon `left` may be right polygon `right`; its corner i is the right's corner (i + shift) mod N.

    cost: px, rms distance of the corners from their epipolar lines and of their disparities from a plane's.
    """

    left: int
    right: int
    shift: int
    cost: float


def match_polygons(
    left: list[Array], right: list[Array], geometry: Baseline, settings: VisionSettings
) -> list[PolygonMatch]:
    """Every match that epipolar lines, depth range and planarity allow, cheapest first.

    left, right: corners (N, 2) px of each polygon, anticlockwise as seen.
    """
    if not left or not right:
        return []
    one, other = _Ideal.of(left, geometry.left), _Ideal.of(right, geometry.right)
    band = settings.search_epipolar_px / geometry.left.focal_px
    gap = np.abs(one.boxes[:, None, 1::2] - other.boxes[:, 1::2]).max(2)
    pairs = np.argwhere((one.count[:, None] == other.count) & (gap < band))
    corners = one.count[pairs[:, 0]]
    found = list[PolygonMatch]()
    for count in sorted(set(corners.tolist())):
        i, j = pairs[corners == count].T
        a, b = (camera.corners[camera.first[own, None] + np.arange(count)] for camera, own in ((one, i), (other, j)))
        shift, cost = _best_shifts(a, b, geometry, settings)
        good = np.isfinite(cost)
        found += map(PolygonMatch, *(column[good].tolist() for column in (i, j, shift, cost)))
    return sorted(found, key=lambda m: (m.cost, m.left, m.right))


def in_both(left: list[Array], right: list[Array], geometry: Baseline, settings: VisionSettings) -> tuple[Flags, Flags]:
    """Return which rough polygons of the left (P,) and of the right camera (Q,) the other camera may have outlined as
    well: along the epipolar lines one of its own spans as much, at a depth where parts may be.

    left, right: corners (N, 2) px of each polygon.
    """
    if not left or not right:
        return np.zeros(len(left), bool), np.zeros(len(right), bool)
    nearest, farthest = settings.depth_range_mm
    one, other = _Ideal.of(left, geometry.left), _Ideal.of(right, geometry.right)
    apart = one.boxes[:, None] - other.boxes  # of the least x, y, of the greatest x, y
    near = np.abs(apart[:, :, 1::2]).max(2) < (settings.search_epipolar_px + _ROUGH_PX) / geometry.left.focal_px
    shift = apart[:, :, ::2]
    near &= (shift.max(2) > geometry.length_mm / farthest) & (shift.min(2) < geometry.length_mm / nearest)
    return near.any(1), near.any(0)


@dataclass(frozen=True, eq=False)
class _Ideal:
    """P polygons of one camera in ideal coordinates: corners (M, 2), one's after the other's; first, count (P,); boxes
    (P, 4): the least x and y of each, the greatest x and y."""

    corners: Array
    first: Index
    count: Index
    boxes: Array

    @classmethod
    def of(cls, polygons: list[Array], camera: RectifiedCamera) -> _Ideal:
        """polygons: corners (N, 2) px of each."""
        corners, count = camera.ideal(np.concatenate(polygons)), np.array([len(p) for p in polygons])
        first = count.cumsum() - count
        boxes = np.concatenate([extreme.reduceat(corners, first) for extreme in (np.minimum, np.maximum)], 1)
        return cls(corners, first, count, boxes)


def _best_shifts(a: Array, b: Array, geometry: Baseline, settings: VisionSettings) -> tuple[Index, Array]:
    """Return the shift (P,) of the cheapest match of P pairs of polygons with as many corners, ideal coordinates (P, N,
    2) in the left and the right camera, and its cost (P,) px, infinite where none is possible."""
    nearest, farthest = settings.depth_range_mm
    pairs, n = a.shape[:2]
    order = (np.arange(n)[:, None] + np.arange(n)) % n
    off = (a[:, None, :, 1] - b[:, order, 1]) * geometry.left.focal_px
    disparity = a[:, None, :, 0] - b[:, order, 0]
    warp = _plane_residuals(a, disparity) * geometry.left.focal_px
    possible = (
        (np.abs(off).max(2) < settings.search_epipolar_px)
        & (disparity.min(2) > geometry.length_mm / farthest)
        & (disparity.max(2) < geometry.length_mm / nearest)
        & (warp.max(2) < settings.search_epipolar_px)
    )
    cost = np.where(possible, np.sqrt((off**2).mean(2) + (warp**2).mean(2)), np.inf)
    best = np.argmin(cost, 1)
    return best, cost[np.arange(pairs), best]


def _plane_residuals(points: Array, disparities: Array) -> Array:
    """Return how far each of the disparities (P, K, N) of points (P, N, 2) is off the best plane: over a plane in space
    disparity is affine in the image."""
    pairs, n = points.shape[:2]
    if n < 4:
        return np.zeros(disparities.shape)
    plane = np.linalg.qr(np.concatenate([points, np.ones((pairs, n, 1))], 2))[0]
    return np.asarray(np.abs(disparities @ plane @ np.swapaxes(plane, 1, 2) - disparities))
