"""One image -> the straight-sided polygons of its closed regions, corners to sub-pixel. Knows nothing of the
other eye.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daemon.vision.data import Polygon
from daemon.vision.epipolar import Eye
from daemon.vision.image import Noise
from daemon.vision.outlines import Outline
from daemon.vision.shapes import corners_of, is_simple
from daemon.vision.sides import Sides, fit_sides

Array = NDArray[np.float64]

_BLUR_PX = 0.9
_FARTHEST_PX = 6.0


def fit_polygons(
    image: NDArray[np.float32], noise: Noise, outlines: list[Outline], eye: Eye
) -> list[tuple[Polygon, Sides] | None]:
    """Fit every side of every outline to the grey levels, (H, W) float32; None where the fit does not hold."""
    if not outlines:
        return []
    start = np.concatenate([o.corners for o in outlines])
    end = np.concatenate([np.roll(o.corners, -1, 0) for o in outlines])
    every = fit_sides(image, noise, start, end, eye, _BLUR_PX)
    fitted: list[tuple[Polygon, Sides] | None] = []
    first = 0
    for o in outlines:
        part = slice(first, first + len(o.corners))
        first += len(o.corners)
        sides = Sides(*(getattr(every, k)[part] for k in Sides.__dataclass_fields__))
        corners = corners_of(sides.start, sides.end)
        if np.abs(corners - o.corners).max() < _FARTHEST_PX and is_simple(corners):
            polygon = Polygon(corners, corner_covariance(sides), np.abs(sides.step), o.border.astype(float))
            fitted.append((polygon, sides))
        else:
            fitted.append(None)
    return fitted


def corner_covariance(sides: Sides) -> Array:
    """Covariance (N, 2, 2) px^2 of corners where side k-1 ends and side k starts."""
    chord = sides.end - sides.start
    normal = np.stack([chord[:, 1], -chord[:, 0]], 1) / np.linalg.norm(chord, axis=1)[:, None]
    both = np.stack([np.roll(normal, 1, 0), normal], 1)
    inverse = np.linalg.pinv(both)
    variance = np.stack([np.roll(sides.covariance[:, 1, 1], 1), sides.covariance[:, 0, 0]], 1)
    return np.asarray(inverse * variance[:, None, :] @ np.swapaxes(inverse, 1, 2))
