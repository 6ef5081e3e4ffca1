"""Edges across a closed curve in one image: the slopes along its normals, the mean of neighbours along the curve.

In: places on the curve, about STEP_PX apart. Out: slopes in sigmas of the noise.
"""

import numpy as np

from daemon.arrays import Array, Image32
from daemon.vision.image.calipers import bilinear
from daemon.vision.image.edge_lines import SLOPE_NOISE, SMOOTHING_ROW_PX
from daemon.vision.image.grey import Fine

STEP_PX = 1.25
ROWS = 2
"""Places to either hand along the curve of which the mean is taken: as many px as an edge is smoothed across."""


def rim_slopes(smooth: Fine, px: Array, normal: Array, reach_px: int) -> Image32:
    """(N, 2 reach_px + 1) slopes across a closed curve at places (N, 2) px, along unit normals (N, 2), at whole px up
    to the reach on either hand. smooth: of unit noise, after a Gaussian of SMOOTHING_PX."""
    offsets = np.arange(-reach_px - 0.5, reach_px + 1.0)[:, None]
    x, y = (np.asarray(px[:, k] + offsets * normal[:, k], np.float32) for k in (0, 1))
    levels = bilinear(smooth, x, y)
    count, round_ = levels.shape[1], np.concatenate([levels[:, -ROWS:], levels, levels[:, :ROWS]], 1)
    mean = sum(round_[:, row : row + count] for row in range(2 * ROWS + 1)) * np.float32(1 / (2 * ROWS + 1))
    independent = max((2 * ROWS + 1) * STEP_PX / SMOOTHING_ROW_PX, 1.0)
    return np.asarray(np.diff(mean, axis=0).T * np.float32(np.sqrt(independent) / SLOPE_NOISE))
