"""Strips of pixels across many straight lines at once: rulers laid along sides, and samples of the image across them.

Lines are straight in ideal coordinates and slightly bowed in a distorted image; the rulers follow that bow.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.vision.geometry.rectified import Eye

Array = NDArray[np.float64]
Index = NDArray[np.intp]
_FEWEST, _MOST = 3, 400  # rows of one side
_MOST_ROWS = 32000  # of a map that cv2.remap takes


@dataclass(frozen=True, eq=False)
class Rulers:
    """Rows along S sides, all in one list of R rows.

    side (R,) which side a row belongs to; first (S,) its first row; at (R,) position along the side, -1 at its start
    to 1 at its end; base (R, 2) px on the bowed side; normal (S, 2) px unit vector pointing out of the polygon;
    length (S,) px. spacing_px: of the rows, about.
    """

    side: Index
    first: Index
    count: Index
    at: Array
    base: Array
    normal: Array
    length: Array
    spacing_px: float

    def sums(self, values: NDArray[np.floating[Any]]) -> Array:
        """Sum (R, ...) values over each side's rows -> (S, ...)."""
        return np.asarray(np.add.reduceat(values, self.first, axis=0))


def lay_rulers(start_px: Array, end_px: Array, bow_px: Array | None, trim_px: float, spacing_px: float) -> Rulers:
    """Rulers along the sides start -> end, (S, 2) px each, polygon on the left hand as seen (anticlockwise corners).

    trim_px is left out at either end, at most a quarter of the side, because there the neighbouring side is in view.
    bow_px (S, 2): as lens_bow says; None where lines are straight in the image.
    """
    chord = end_px - start_px
    length = np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-6)
    trim = np.minimum(trim_px, 0.25 * length)
    count = np.clip(np.ceil((length - 2 * trim) / spacing_px), _FEWEST, _MOST).astype(np.intp)
    first = np.concatenate([[0], np.cumsum(count)[:-1]]).astype(np.intp)
    side = np.repeat(np.arange(len(count)), count)
    step = (np.arange(len(side)) - first[side] + 0.5) / count[side]
    at = (2 * step - 1) * (1 - 2 * trim / length)[side]
    base = (start_px + end_px)[side] / 2 + at[:, None] * chord[side] / 2
    if bow_px is not None:
        base += bow_px[side] * (1 - at**2)[:, None]
    normal = np.stack([chord[:, 1], -chord[:, 0]], 1) / length[:, None]
    return Rulers(side, first, count, at, base, -normal, length, spacing_px)


def lens_bow(start_px: Array, end_px: Array, eye: Eye | None) -> Array | None:
    """How far (S, 2) px the middle of each truly straight side lies from its chord in the distorted image.

    None where there is no eye whose lens would bend anything.

    Along the side the bow is a parabola to well under 0.01 px for lenses of ordinary distortion.
    """
    if eye is None:
        return None
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
    return _values(image, base, normal, offsets)


def sample_evenly(
    image: NDArray[np.float32], start_px: Array, end_px: Array, at: Array, offsets: Array, bias_px: Array
) -> NDArray[np.float32]:
    """Image values (S, K, C) across straight sides, at K places along each, -1 at its start to 1 at its end (S, K).

    As `sample`, with as many rows for a short side as for a long one, which makes one array of all.
    """
    chord = end_px - start_px
    normal = np.stack([-chord[:, 1], chord[:, 0]], 1) / np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-6)[:, None]
    middle = (start_px + end_px) / 2 + normal * bias_px[:, None]
    base = middle[:, None] + at[:, :, None] * (chord / 2)[:, None]
    rows = np.repeat(normal, at.shape[1], axis=0)
    return _values(image, base.reshape(-1, 2), rows, offsets).reshape(*at.shape, len(offsets))


def _values(image: NDArray[np.float32], base: Array, normal: Array, offsets: Array) -> NDArray[np.float32]:
    """Image values (R, C), bilinear, at base + offset * normal, (R, 2) px each."""
    x, y = base.T.astype(np.float32)[:, :, None] + normal.T.astype(np.float32)[:, :, None] * offsets.astype(np.float32)
    return bilinear(image, x, y)


def bilinear(image: NDArray[np.float32], x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.float32]:
    """Image values at real pixel coordinates (R, C), float32; outside the image its rim."""
    parts = [
        cv2.remap(
            image, x[r : r + _MOST_ROWS], y[r : r + _MOST_ROWS], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        for r in range(0, len(x), _MOST_ROWS)
    ]
    return np.asarray(parts[0] if len(parts) == 1 else np.concatenate(parts), np.float32)
