"""A stereo pair -> facets in space, grouped into parts: the order of the steps, and nothing else."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.vision.data import Facet, FacetView, Polygon, Rejected
from daemon.vision.epipolar import Baseline, baseline
from daemon.vision.grouping import split_groups, touching_table
from daemon.vision.image import as_grey, check_size
from daemon.vision.matching import Match, match_polygons
from daemon.vision.planes import planarity
from daemon.vision.polygons import find_polygons
from daemon.vision.rig import StereoRig
from daemon.vision.settings import VisionSettings

Array = NDArray[np.float64]


def find_facets(
    left: NDArray[Any], right: NDArray[Any], rig: StereoRig, settings: VisionSettings | None = None
) -> FacetView:
    """Everything geometry can say of one stereo pair.

    left, right: (H, W) uint8, or what `as_grey` takes. Facets come untyped, corners anticlockwise as seen.
    Raises VisionError where an image cannot be used; an image with nothing in it gives an empty view.
    """
    settings = settings or VisionSettings()
    eyes = baseline(rig)
    grey = [as_grey(image, name) for image, name in ((left, "left image"), (right, "right image"))]
    for image, name in zip(grey, ("left image", "right image"), strict=True):
        check_size(image, rig.image_size, name)
    polygons_left, noise_left = find_polygons(grey[0], eyes.left, settings)
    polygons_right, noise_right = find_polygons(grey[1], eyes.right, settings)
    matches = match_polygons(polygons_left, polygons_right, eyes, settings)
    facets = tuple(_facet(polygons_left[m.left], polygons_right[m.right], m, eyes) for m in matches)
    groups = split_groups(facets, touching_table(facets))
    rejected = _unmatched(polygons_left, {m.left for m in matches}, "left") + _unmatched(
        polygons_right, {m.right for m in matches}, "right"
    )
    return FacetView(groups, rejected, polygons_left, polygons_right, float(np.hypot(noise_left, noise_right) / 2**0.5))


def _unmatched(polygons: tuple[Polygon, ...], matched: set[int], eye: str) -> tuple[Rejected, ...]:
    return tuple(
        Rejected(p.corners_px, eye, "no polygon of the other eye fits along its epipolar lines")
        for k, p in enumerate(polygons)
        if k not in matched
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
