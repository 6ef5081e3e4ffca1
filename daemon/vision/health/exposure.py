"""Whether there is the right light where the parts are, and by how much each camera's exposure would mend it. Pure.

The sensor is taken to be linear: twice the exposure, twice the level. Where it is not, the next look says so again.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.vision.image import SATURATED, block_means
from daemon.vision.values import Part

Image = NDArray[np.uint8]
Pictures = tuple[Image, Image]

AROUND_PX = 8  # of its surroundings counts as the part's: its edges need light on both sides
BRIGHT_PERCENT = 99.0
MIN_LEVEL, GOOD_LEVEL = 70.0, 180.0
"""Grey levels of what is brightest about the parts: below the first, edges between their faces drown in noise."""
MIN_EMPTY, GOOD_EMPTY = 25.0, 90.0
"""Least and good brightness of a picture without a part: a dark table is as it should be."""
MAX_BURNT = 0.05
"""Share of the parts and their surroundings that may be burnt out: glints."""
UNEQUAL = 1.15
"""Largest ratio of the brightness of the two cameras."""
LARGEST_STEP = 8.0


def hull(points_px: Sequence[Array]) -> Array:
    """(N, 2) corners of the convex hull of points (..., 2)."""
    points = np.concatenate([np.asarray(p, np.float32).reshape(-1, 2) for p in points_px])
    return np.asarray(cv2.convexHull(points)[:, 0, :], float)


def outlines(part: Part) -> tuple[Array, Array]:
    """(N, 2) px: the convex outline of a part's facets in the left and in the right camera."""
    return hull([f.left_px for f in part.facets]), hull([f.right_px for f in part.facets])


def ground(outlines_px: Sequence[Array], picture: Image) -> Image:
    """The grey levels (N,) inside convex outlines and next to them."""
    mask = np.zeros(picture.shape, np.uint8)
    for corners in outlines_px:
        cv2.fillConvexPoly(mask, np.rint(corners).astype(np.int32), 1)
    return picture[cv2.dilate(mask, np.ones((2 * AROUND_PX + 1, 2 * AROUND_PX + 1), np.uint8)) > 0]


def exposure_factors(pictures: Pictures, parts: Sequence[Part]) -> tuple[float, float] | None:
    """Return the factors for the exposure of the left and the right camera; None where the light will do.

    Both end up alike: the brighter camera is brought to the darker one, then both to a good level.
    """
    seen = [outlines(part) for part in parts if part.facets]
    grounds = [
        ground([both[camera] for both in seen], picture) if seen else picture for camera, picture in enumerate(pictures)
    ]
    least, good = (MIN_LEVEL, GOOD_LEVEL) if seen else (MIN_EMPTY, GOOD_EMPTY)
    means = [max(float(np.median(block_means(picture))), 1.0) for picture in pictures]
    ratio = means[0] / means[1]
    unequal = not 1 / UNEQUAL < ratio < UNEQUAL
    bright = min(float(np.percentile(levels, BRIGHT_PERCENT)) for levels in grounds)
    shares = [float(np.mean(levels >= SATURATED)) for levels in grounds]
    burnt = min(shares) if unequal else max(shares)
    both = 1.0
    if burnt > MAX_BURNT:
        both = good / 255.0 * (1.0 - 0.6 * burnt)  # how far above the top the level is, nobody can see
    elif bright < least:
        both = good / max(bright, 1.0)
    elif not unequal:
        return None
    left, right = (both / ratio, both) if unequal and ratio > 1 else (both, both * ratio) if unequal else (both, both)
    return _bounded(left), _bounded(right)


def _bounded(factor: float) -> float:
    return float(np.clip(factor, 1 / LARGEST_STEP, LARGEST_STEP))
