"""Strips of pixels across many straight lines at once: rulers laid along sides, and samples of the image across them.

Lines are straight in ideal coordinates and slightly bowed in a distorted image; the rulers follow that bow.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.vision.epipolar import Eye

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Rulers:
    """Rows one pixel apart along S sides, all in one list of R rows.

    side (R,) which side a row belongs to; first (S,) its first row; at (R,) position along the side, -1 at its start
    to 1 at its end; base (R, 2) px on the bowed side; normal (S, 2) px unit vector pointing out of the polygon;
    length (S,) px.
    """

    side: Index
    first: Index
    count: Index
    at: Array
    base: Array
    normal: Array
    length: Array

    def sums(self, values: NDArray[np.floating[Any]]) -> Array:
        """Sum (R, ...) values over each side's rows -> (S, ...)."""
        return np.asarray(np.add.reduceat(values, self.first, axis=0))


def lay_rulers(
    start_px: Array, end_px: Array, eye: Eye | None, trim_px: float, spacing_px: float = 1.0, longest: int = 400
) -> Rulers:
    """Rulers along the sides start -> end, (S, 2) px each, polygon on the left hand as seen (anticlockwise corners).

    trim_px is left out at either end, at most a quarter of the side, because there the neighbouring side is in view.
    eye: takes the bow of the lens into account; None treats the image as undistorted.
    """
    chord = end_px - start_px
    length = np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-6)
    trim = np.minimum(trim_px, 0.25 * length)
    count = np.clip(np.ceil((length - 2 * trim) / spacing_px), 3, longest).astype(np.intp)
    first = np.concatenate([[0], np.cumsum(count)[:-1]]).astype(np.intp)
    side = np.repeat(np.arange(len(count)), count)
    step = (np.arange(len(side)) - first[side] + 0.5) / count[side]
    at = (2 * step - 1) * (1 - 2 * trim / length)[side]
    base = (start_px + end_px)[side] / 2 + at[:, None] * chord[side] / 2
    if eye is not None:
        base = base + _bow(start_px, end_px, eye)[side] * (1 - at**2)[:, None]
    normal = np.stack([chord[:, 1], -chord[:, 0]], 1) / length[:, None]
    return Rulers(side, first, count, at, base, -normal, length)


def _bow(start_px: Array, end_px: Array, eye: Eye) -> Array:
    """How far (S, 2) px the middle of each truly straight side lies from its chord in the distorted image.

    Along the side the bow is a parabola to well under 0.01 px for lenses of ordinary distortion.
    """
    ends = eye.ideal(np.concatenate([start_px, end_px]))
    n = len(start_px)
    middle = eye.pixels((ends[:n] + ends[n:]) / 2)
    chord = end_px - start_px
    off = middle - (start_px + end_px) / 2
    along = np.sum(off * chord, 1) / np.maximum(np.sum(chord * chord, 1), 1e-9)
    return np.asarray(off - along[:, None] * chord)


def sample(image: NDArray[np.float32], rulers: Rulers, offsets: Array, bias_px: Array) -> NDArray[np.float32]:
    """Image values (R, C), bilinear, at C offsets px, and each side's bias_px (S,), outwards of each row's base.

    Outside the image: its rim.
    """
    normal = rulers.normal[rulers.side]
    base = rulers.base + normal * bias_px[rulers.side, None]
    x = base[:, 0, None].astype(np.float32) + normal[:, 0, None].astype(np.float32) * offsets.astype(np.float32)
    y = base[:, 1, None].astype(np.float32) + normal[:, 1, None].astype(np.float32) * offsets.astype(np.float32)
    return bilinear(image, x, y)


def bilinear(image: NDArray[np.float32], x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.float32]:
    """Image values at real pixel coordinates (any shape), float32."""
    height, width = image.shape
    x = np.minimum(np.maximum(x, 0), np.float32(width - 1.001))
    y = np.minimum(np.maximum(y, 0), np.float32(height - 1.001))
    column, row = x.astype(np.int32), y.astype(np.int32)
    x -= column
    y -= row
    flat = image.ravel()
    i = row * width + column
    corner = flat.take(i)
    i += 1
    top = corner + x * (flat.take(i) - corner)
    i += width
    right = flat.take(i)
    i -= 1
    corner = flat.take(i)
    bottom = corner + x * (right - corner)
    return np.asarray(top + y * (bottom - top), np.float32)
