"""What the two faces beside an edge look like by themselves: grey levels across many sides, row by row.

In: samples across sides (profiles.py). Out: the levels of either face carried on under the edge. Where the edge is, is
for edge_lines.py.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daemon.vision.image.grey import Noise
from daemon.vision.image.profiles import Rulers

Array = NDArray[np.float64]

REACH_PX = 4
OFFSETS = np.arange(-REACH_PX, REACH_PX + 1, dtype=float)
FAR = np.stack([OFFSETS < -1.9, OFFSETS > 1.9], 1).astype(float)  # columns clear of the edge: inside, outside
_SHARE = FAR / FAR.sum(0)
_LEVER = FAR * (OFFSETS[:, None] - OFFSETS @ _SHARE)
_LEVER2 = np.sum(_LEVER**2, 0)
_SLOPE_SIGMAS = 2.0
_CLIPPED = 247.0
_HEIGHTS = np.geomspace(1.0, 2.5, 14)


def shaded_levels(values: Array, mean: Array, noise: Noise, rulers: Rulers) -> tuple[Array, Array, Array]:
    """Grey levels (R, C) that each face of the step would show at every offset if the other were not there.

    Each is a plane: a level that may drift along the side, and one slope across it, as near a contact shadow. The
    third array (R, C) is 0 where another edge has come into view, as in the thin end of a face seen edge-on, and 1
    elsewhere. mean (S, C): the values' mean over each side.
    """
    clear = _in_the_clear(values, noise, rulers)
    count = rulers.count[:, None]
    open_here = clear @ FAR
    total = _smooth_along(np.concatenate([(values * clear) @ FAR, open_here], 1), rulers, 6.0)
    level = total[:, :2] / np.maximum(total[:, 2:], 1e-3)
    whole = rulers.sums(open_here) / count > 0.9 * FAR.sum(0)
    sigma = rulers.sums(noise.at(level)) / count / np.sqrt(_LEVER2 * count)
    across = np.where(whole, mean @ (_LEVER / _LEVER2), 0.0)
    across *= np.maximum(0.0, 1.0 - (_SLOPE_SIGMAS * sigma / np.maximum(np.abs(across), 1e-9)) ** 2)
    tilt = across[rulers.side]
    middle = OFFSETS @ _SHARE
    inside, outside = (level[:, k, None] + tilt[:, k, None] * (OFFSETS - middle[k]) for k in (0, 1))
    return inside, outside, clear


def _in_the_clear(values: Array, noise: Noise, rulers: Rulers) -> Array:
    """(R, C): 0 from where, going away from the side, the grey level leaves what it was two pixels off the side."""
    level = _smooth_along(values, rulers, 2.0)
    clear = np.ones_like(values)
    slack = 0.02 * np.abs(level[:, 0] - level[:, -1])
    for step in (-1, 1):
        near = level[:, REACH_PX + 2 * step]
        limit = 3.0 / np.sqrt(2.5) * noise.at(near) + slack
        for k in range(3, REACH_PX + 1):
            column = REACH_PX + k * step
            clear[:, column] = clear[:, column - step] * (np.abs(level[:, column] - near) < (k - 1) / 2 * limit)
    return clear


def unclipped(mean: Array, rulers: Rulers, inside: Array, outside: Array, blur_px: float) -> tuple[Array, Array]:
    """The levels with those of saturated faces replaced: how bright such a face is shows in how steeply its edge
    sets in.

    Per side the mean profile (S, C) below saturation is fitted by steps of several heights, each free to shift; the
    best is taken.
    """
    bright_in, bright_out = (mean @ _SHARE > _CLIPPED).T
    shifts = np.linspace(-0.75, 0.75, 31)
    for s in np.flatnonzero(bright_in != bright_out):
        rows = slice(rulers.first[s], rulers.first[s] + rulers.count[s])
        bright, dark = (inside, outside) if bright_in[s] else (outside, inside)
        base = dark[rows].mean(0)
        use = (mean[s] < _CLIPPED) & (np.abs(OFFSETS) < 3)
        height = (255.0 - base[REACH_PX]) * _HEIGHTS
        away = (OFFSETS[use] - shifts[:, None]) * (1.0 if bright_in[s] else -1.0)
        residual = (mean[s] - base)[use] - height[:, None, None] * (1 - normal_cdf(away / blur_px))
        best = np.argmin(np.sum(residual**2, 2).min(1))
        bright[rows] = base + height[best]
    return inside, outside


def _smooth_along(values: Array, rulers: Rulers, reach_px: float) -> Array:
    """Running mean of (R, K) values over the rows of the same side within so many px, its neighbours at least."""
    total = np.zeros((len(values) + 1, values.shape[1]))
    np.cumsum(values, 0, out=total[1:])
    rows = np.arange(len(values))
    half = max(round(reach_px / rulers.spacing_px), 1)
    low = np.maximum(rows - half, rulers.first[rulers.side])
    high = np.minimum(rows + half + 1, (rulers.first + rulers.count)[rulers.side])
    return np.asarray((total.take(high, 0) - total.take(low, 0)) / (high - low)[:, None])


def normal_cdf(x: Array) -> Array:
    """Cumulative normal distribution, to 1e-7 (Abramowitz and Stegun 7.1.26)."""
    t = 1 / (1 + 0.3275911 * np.abs(x) / np.sqrt(2))
    tail = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))))
    erf = 1 - tail * np.exp(-x * x / 2)
    return np.asarray(0.5 * (1 + np.sign(x) * erf))
