"""A stereo pair -> facets in space, grouped into parts: the order of the steps, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.vision.data import Facet, FacetView, Polygon, Rejected
from daemon.vision.epipolar import Baseline, baseline
from daemon.vision.eye import Sight, look_with
from daemon.vision.grouping import split_groups, touching_table
from daemon.vision.image import as_grey, check_size
from daemon.vision.matching import Match, match_polygons
from daemon.vision.planes import planarity
from daemon.vision.polygons import fit_polygons
from daemon.vision.rig import StereoRig
from daemon.vision.settings import VisionSettings
from daemon.vision.shapes import overlap
from daemon.vision.sides import Sides

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Candidate:
    """A facet that may be: its polygons in both eyes (the right's corners in the left's order), its corners,
    its worth.
    """

    facet: Facet
    left: Polygon
    right: Polygon
    worth: float


def find_facets(
    left: NDArray[Any], right: NDArray[Any], rig: StereoRig, settings: VisionSettings | None = None
) -> FacetView:
    """Everything geometry can say of one stereo pair.

    left, right: (H, W) uint8, or what `as_grey` takes. Facets come untyped, corners anticlockwise as seen.
    Raises VisionError where an image cannot be used; an image with nothing in it gives an empty view.
    """
    settings = settings or VisionSettings()
    eyes = baseline(rig)
    sights = []
    for image, eye, name in ((left, eyes.left, "left image"), (right, eyes.right, "right image")):
        grey = as_grey(image, name)
        check_size(grey, rig.image_size, name)
        sights.append(look_with(eye, grey, settings))
    candidates = _candidates(sights[0], sights[1], eyes, settings)
    chosen = _choose(candidates)
    facets = tuple(c.facet for c in chosen)
    groups = split_groups(facets, touching_table(facets))
    rejected = _unmatched(sights[0], [c.left for c in chosen], "left") + _unmatched(
        sights[1], [c.right for c in chosen], "right"
    )
    sigma = float(np.mean([s.noise.sigma[128] for s in sights]))
    return FacetView(groups, rejected, tuple(c.left for c in chosen), tuple(c.right for c in chosen), sigma)


def _candidates(left: Sight, right: Sight, eyes: Baseline, settings: VisionSettings) -> list[Candidate]:
    matches = match_polygons([o.corners for o in left.outlines], [o.corners for o in right.outlines], eyes, settings)
    fits = []
    for sight, used in ((left, {m.left for m in matches}), (right, {m.right for m in matches})):
        order = sorted(used)
        fitted = fit_polygons(sight.image, sight.noise, [sight.outlines[k] for k in order], sight.eye)
        fits.append(dict(zip(order, fitted, strict=True)))
    candidates = []
    for m in matches:
        a, b = fits[0][m.left], fits[1][m.right]
        if a is not None and b is not None:
            worth = (
                min(left.outlines[m.left].support, right.outlines[m.right].support)
                + _agreement(a[1], b[1])
                - 0.1 * m.cost
            )
            facet = _facet(a[0], b[0], m, eyes)
            if facet.epipolar_px.max() < settings.max_epipolar_px:
                candidates.append(Candidate(facet, a[0], b[0], worth))
    return candidates


def _agreement(a: Sides, b: Sides) -> float:
    """The least fraction of rows, over all sides of both eyes, that lie on their line."""
    return float(min(a.support.min(), b.support.min()))


def _choose(candidates: list[Candidate]) -> list[Candidate]:
    """Of candidates that cover each other in either eye, the worthiest."""
    chosen: list[Candidate] = []
    for c in sorted(candidates, key=lambda c: -c.worth):
        if all(
            max(overlap(c.left.corners_px, k.left.corners_px)[1], overlap(c.right.corners_px, k.right.corners_px)[1])
            < 0.25
            for k in chosen
        ):
            chosen.append(c)
    return chosen


def _unmatched(sight: Sight, used: list[Polygon], eye: str) -> tuple[Rejected, ...]:
    return tuple(
        Rejected(o.corners, eye, "no polygon of the other eye fits along its epipolar lines")
        for o in sight.outlines
        if all(overlap(o.corners, p.corners_px)[1] < 0.25 for p in used)
    )


def _facet(a: Polygon, b: Polygon, match: Match, eyes: Baseline) -> Facet:
    right_px = np.roll(b.corners_px, -match.shift, 0)
    covariance_right = np.roll(b.covariance_px2, -match.shift, 0)
    left, right = eyes.left.ideal(a.corners_px), eyes.right.ideal(right_px)
    corners = eyes.points(left, right)
    covariance = _corner_covariance(eyes, left, right, a.covariance_px2, covariance_right)
    off = np.abs(left[:, 1] - right[:, 1]) * eyes.left.focal_px
    return Facet(corners, covariance, a.corners_px, right_px, off, planarity(corners))


def _corner_covariance(eyes: Baseline, left: Array, right: Array, left_px2: Array, right_px2: Array) -> Array:
    """(N, 3, 3) mm^2 of triangulated corners, to first order."""
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
