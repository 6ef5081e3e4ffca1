"""Straight sides to a hundredth of a pixel: from a rough line to the maximum-likelihood line of a blurred step.

In: image, rough end points. Out: corrected end points, how sure, how strong. What the sides form is decided elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.vision.epipolar import Eye
from daemon.vision.image import SATURATED, Noise
from daemon.vision.strips import Rulers, lay_rulers, sample

Array = NDArray[np.float64]
Image32 = NDArray[np.float32]

_REACH_PX = 4
_TRIM_PX = 4.0
_FAINT_BLOCK = 0.4
_SLOPE_SIGMAS = 2.0
_CLIPPED = 247.0
_HEIGHTS = np.geomspace(1.0, 2.5, 14)
_OFFSETS = np.arange(-_REACH_PX, _REACH_PX + 1, dtype=float)
_IN, _OUT = _OFFSETS < -1.9, _OFFSETS > 1.9
_FAR = np.stack([_IN, _OUT], 1).astype(float)


@dataclass(frozen=True, eq=False)
class Sides:
    """S fitted sides. start, end (S, 2) px on the line where the rough ends were; covariance (S, 2, 2) px^2 of the
    offsets of start and end across the line; step (S,) grey levels, outside minus inside; evidence (S,) step over
    its own noise; support (S,) fraction of rows that agree with the line; blur (S,) px.
    """

    start: Array
    end: Array
    covariance: Array
    step: Array
    evidence: Array
    support: Array
    blur: Array


def find_sides(
    smoothed: Image32, start: Array, end: Array, reach_px: float, expected_px: Array, sigma_px: Array
) -> tuple[Array, Array]:
    """Move rough sides (S, 2), (S, 2) px onto the strongest straight gradient near them, seen over their whole length.

    smoothed: unit-noise image. Looks up to reach_px either way of expected_px (S,) outwards, and at tilts that move
    either end by a few pixels; gradients count by how near they are to what is expected, with sigma_px (S,). Returns
    moved ends.
    """
    rulers = lay_rulers(start, end, None, _TRIM_PX, spacing_px=2.0, longest=60)
    pitch = 1.0 if reach_px > 2 else 0.5
    offsets = np.arange(-reach_px - pitch, reach_px + 1.5 * pitch, pitch)
    values = sample(smoothed, rulers, offsets, expected_px)
    blocks, at = _block_means(values[:, 2:] - values[:, :-2], rulers)
    tilts = np.linspace(-1, 1, 7) * np.clip(0.06 * rulers.length, 0.4, 3.5)[:, None]
    width = blocks.shape[2]
    shifted = np.rint(at[:, :, None] * (tilts / pitch)[:, None, :]).astype(np.int32)[:, :, :, None]
    shifted = np.minimum(np.maximum(shifted + np.arange(width, dtype=np.int32), 0), width - 1)
    shifted += (np.arange(len(start) * blocks.shape[1], dtype=np.int32) * width).reshape(len(start), -1, 1, 1)
    lines = np.abs(blocks.ravel().take(shifted).sum(1))
    lines *= np.exp(-0.5 * (offsets[1:-1] / sigma_px[:, None, None]) ** 2)
    best = np.argmax(lines.reshape(len(start), -1), 1)
    tilt, offset = tilts[np.arange(len(start)), best // width], offsets[1:-1][best % width] + expected_px
    return _apply_line(start, end, rulers, offset, tilt / np.maximum(1 - 2 * _TRIM_PX / rulers.length, 0.5))


def probe_sides(smoothed: Image32, start: Array, end: Array, sigma_px: float = 1.0) -> tuple[Array, Array]:
    """How strong the gradient across each side is: its mean in sigmas (S,), and the fraction of the side that shows
    it (S,).

    smoothed: unit-noise image after a Gaussian of sigma_px, whose noise is therefore known along and across the side.
    """
    rulers = lay_rulers(start, end, None, 1.0, longest=200)
    values = sample(smoothed, rulers, np.array([-0.5, 0.5]), np.zeros(len(start)))
    blocks, _ = _block_means(values[:, 1:] - values[:, :1], rulers)
    one = np.sqrt(2 * (1 - np.exp(-0.25 / sigma_px**2)) / (4 * np.pi)) / sigma_px
    rows = rulers.length / (np.sqrt(4 * np.pi) * sigma_px)
    mean = np.mean(blocks[:, :, 0], 1)
    sigma = one / np.sqrt(np.maximum(rows / blocks.shape[1], 1.0))
    block_z = blocks[:, :, 0] * np.sign(mean)[:, None] / sigma[:, None]
    seen = np.mean(block_z > np.clip(_FAINT_BLOCK * np.abs(mean) / sigma, 0.5, 2.5)[:, None], 1)
    return mean / (one / np.sqrt(np.maximum(rows, 1.0))), seen


def _block_means(values: NDArray[np.float32], rulers: Rulers, blocks: int = 6) -> tuple[Array, Array]:
    """Means of (R, C) values over equal stretches of each side: (S, blocks, C), and the stretches' middles (S,
    blocks).
    """
    count = rulers.count[:, None]
    edge = (np.arange(blocks + 1) * count) // blocks
    low = np.minimum(edge[:, :-1], count - 1)
    high = np.maximum(edge[:, 1:], low + 1)
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, 0, dtype=float)])
    first = rulers.first[:, None]
    means = (total[first + high] - total[first + low]) / (high - low)[:, :, None]
    return means, ((low + high) / count - 1.0)


def fit_sides(image: Image32, noise: Noise, start: Array, end: Array, eye: Eye | None, blur_px: float = 0.7) -> Sides:
    """Least-squares lines of blurred steps near the sides start -> end, (S, 2) px each, already within about 1 px.

    image: float32 grey levels. Each row gives where the step crosses it, by least squares against the step's own
    slope, with the grey levels on both sides free to drift along the side; a robust line goes through the rows.
    blur_px is only where the search for the image's one blur starts. Columns are weighed alike on both sides, so
    that a wrong blur cannot shift the line.
    """
    for _ in range(2):
        rulers = lay_rulers(start, end, eye, _TRIM_PX)
        rows = _rows(image, noise, rulers, blur_px)
        offset, slope, covariance, support = _robust_line(rulers, rows.position, 1 / rows.sigma, None)
        start, end = _apply_line(start, end, rulers, offset, slope)
        blur_px = float(np.clip(blur_px + rows.blur_error_px, 0.4, 2.5))
    ends = np.array([[1.0, -1.0], [1.0, 1.0]])
    step = rulers.sums(rows.step) / rulers.count
    evidence = np.abs(step) / rows.step_sigma
    return Sides(start, end, ends @ covariance @ ends.T, step, evidence, support, np.full(len(start), blur_px))


@dataclass(frozen=True, eq=False)
class _Rows:
    """Per row: where the step is, px from the base (R,); its sigma (R,); its height (R,). Per side: sigma of the
    mean height.

    blur_error_px: how much wider all the steps together are than was assumed.
    """

    position: Array
    sigma: Array
    step: Array
    step_sigma: Array
    blur_error_px: float


def _rows(image: Image32, noise: Noise, rulers: Rulers, blur_px: float) -> _Rows:
    values = sample(image, rulers, _OFFSETS, np.zeros(len(rulers.length))).astype(float)
    rise = _normal_cdf(_OFFSETS / blur_px)
    slope = np.exp(-0.5 * (_OFFSETS / blur_px) ** 2) / (blur_px * np.sqrt(2 * np.pi))
    widen = -slope * _OFFSETS / blur_px
    inside, outside, clear = _shaded_levels(values, noise, rulers)
    inside, outside = _unclipped(values, rulers, inside, outside, blur_px)
    step = outside[:, _REACH_PX] - inside[:, _REACH_PX]
    side_step = rulers.sums(step) / rulers.count
    model = inside + (outside - inside) * rise
    usable = clear * ((model < SATURATED) & (values < SATURATED + 4))
    residual = (values - model) * usable
    template = -side_step[rulers.side, None] * slope * usable
    power = np.maximum(np.sum(template**2, 1), 1e-9)
    position = np.sum(template * residual, 1) / power
    sigma_grey = np.mean(noise.at(np.stack([inside[:, 0], outside[:, -1]], 1)), 1)
    whole = usable.min(1, keepdims=True)
    wide = step[:, None] * widen * usable * whole
    wide_free = wide - (np.sum(wide * template, 1) / power)[:, None] * template
    blur_error = np.sum(wide_free * residual) / max(float(np.sum(wide_free * wide)), 1e-9)
    level_sigma = rulers.sums(sigma_grey) / rulers.count / np.sqrt(_FAR.sum(0).mean() * rulers.count)
    return _Rows(
        np.clip(position, -3.0, 3.0), sigma_grey / np.sqrt(power), step, np.sqrt(2) * level_sigma, float(blur_error)
    )


def _shaded_levels(values: Array, noise: Noise, rulers: Rulers) -> tuple[Array, Array, Array]:
    """Grey levels (R, C) that each face of the step would show at every offset if the other were not there.

    Each is a plane: a level that may drift along the side, and one slope across it, as near a contact shadow. The
    third array (R, C) is 0 where another edge has come into view, as in the thin end of a face seen edge-on, and 1
    elsewhere.
    """
    clear = _in_the_clear(values, noise, rulers)
    planes = []
    for columns in (_IN, _OUT):
        d = _OFFSETS[columns] - _OFFSETS[columns].mean()
        open_here = clear[:, columns]
        sums = np.stack([np.sum(values[:, columns] * open_here, 1), np.sum(open_here, 1)], 1)
        total = _smooth_along(sums, rulers)
        mean = rulers.sums(values[:, columns]) / rulers.count[:, None]
        whole = rulers.sums(open_here.mean(1)) / rulers.count > 0.9
        level = total[:, 0] / np.maximum(total[:, 1], 1e-3)
        sigma = rulers.sums(noise.at(level)) / rulers.count / np.sqrt(d @ d * rulers.count)
        across = np.where(whole, mean @ d / (d @ d), 0.0)
        across *= np.maximum(0.0, 1.0 - (_SLOPE_SIGMAS * sigma / np.maximum(np.abs(across), 1e-9)) ** 2)
        planes.append(level[:, None] + across[rulers.side, None] * (_OFFSETS - _OFFSETS[columns].mean()))
    return planes[0], planes[1], clear


def _in_the_clear(values: Array, noise: Noise, rulers: Rulers) -> Array:
    """(R, C): 0 from where, going away from the side, the grey level leaves what it was two pixels off the side."""
    level = _smooth_along(values, rulers, 2)
    clear = np.ones_like(values)
    for step in (-1, 1):
        near = level[:, _REACH_PX + 2 * step]
        limit = 3.0 * noise.at(near) / np.sqrt(2.5) + 0.02 * np.abs(level[:, 0] - level[:, -1])
        for k in range(3, _REACH_PX + 1):
            column = _REACH_PX + k * step
            clear[:, column] = clear[:, column - step] * (np.abs(level[:, column] - near) < (k - 1) / 2 * limit)
    return clear


def _unclipped(values: Array, rulers: Rulers, inside: Array, outside: Array, blur_px: float) -> tuple[Array, Array]:
    """The levels with those of saturated faces replaced: how bright such a face is shows in how steeply its edge
    sets in.

    Per side the mean profile below saturation is fitted by steps of several heights, each free to shift; the best is
    taken.
    """
    mean = rulers.sums(values) / rulers.count[:, None]
    bright_in = np.mean(mean[:, _IN], 1) > _CLIPPED
    bright_out = np.mean(mean[:, _OUT], 1) > _CLIPPED
    shifts = np.linspace(-0.75, 0.75, 31)
    for s in np.flatnonzero(bright_in != bright_out):
        rows = slice(rulers.first[s], rulers.first[s] + rulers.count[s])
        bright, dark = (inside, outside) if bright_in[s] else (outside, inside)
        base = dark[rows].mean(0)
        use = (mean[s] < _CLIPPED) & (np.abs(_OFFSETS) < 3)
        height = (255.0 - base[_REACH_PX]) * _HEIGHTS
        away = (_OFFSETS[use] - shifts[:, None]) * (1.0 if bright_in[s] else -1.0)
        residual = (mean[s] - base)[use] - height[:, None, None] * (1 - _normal_cdf(away / blur_px))
        best = np.argmin(np.sum(residual**2, 2).min(1))
        bright[rows] = base + height[best]
    return inside, outside


def _smooth_along(values: Array, rulers: Rulers, half: int = 6) -> Array:
    """Running mean of (R, K) values over 2 half + 1 rows of the same side (shorter at its ends)."""
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, 0)])
    rows = np.arange(len(values))
    last = rulers.first + rulers.count
    low = np.maximum(rows - half, rulers.first[rulers.side])
    high = np.minimum(rows + half + 1, last[rulers.side])
    return np.asarray((total[high] - total[low]) / (high - low)[:, None])


def _robust_line(
    rulers: Rulers, position: Array, weight: Array, scale: float | None
) -> tuple[Array, Array, Array, Array]:
    """Robust lines position ~ offset + slope * at through the rows of each side.

    weight: 1 / sigma of each row. scale: px of an ordinary residual, or None to take it from the residuals (never
    below what the weights say). Returns offset (S,), slope (S,), their covariance (S, 2, 2), fraction of rows within
    three sigmas (S,).
    """
    keep = np.ones_like(position)
    for _ in range(4):
        w = weight**2 * keep
        s0, s1, s2 = (rulers.sums(w * rulers.at**k) for k in range(3))
        b0, b1 = rulers.sums(w * position), rulers.sums(w * position * rulers.at)
        determinant = np.maximum(s0 * s2 - s1 * s1, 1e-12)
        offset, slope = (s2 * b0 - s1 * b1) / determinant, (s0 * b1 - s1 * b0) / determinant
        residual = position - offset[rulers.side] - slope[rulers.side] * rulers.at
        if scale is None:
            normal = residual * weight
            spread = np.maximum(1.0, np.sqrt(rulers.sums(keep * normal**2) / np.maximum(rulers.sums(keep), 1.0)))
            z = normal / (3.0 * spread[rulers.side])
        else:
            spread = np.ones(len(offset))
            z = residual / (2.0 * scale)
        keep = np.maximum(1 - z * z, 0.0) ** 2
    covariance = np.stack([s2, -s1, -s1, s0], 1).reshape(-1, 2, 2) / determinant[:, None, None]
    support = rulers.sums((np.abs(z) < 1).astype(float)) / rulers.count
    return offset, slope, covariance * (spread**2)[:, None, None], support


def _apply_line(start: Array, end: Array, rulers: Rulers, offset: Array, slope: Array) -> tuple[Array, Array]:
    move_start, move_end = offset - slope, offset + slope
    return start + move_start[:, None] * rulers.normal, end + move_end[:, None] * rulers.normal


def _normal_cdf(x: Array) -> Array:
    """Cumulative normal distribution, to 1e-7 (Abramowitz and Stegun 7.1.26)."""
    t = 1 / (1 + 0.3275911 * np.abs(x) / np.sqrt(2))
    tail = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))))
    erf = 1 - tail * np.exp(-x * x / 2)
    return np.asarray(0.5 * (1 + np.sign(x) * erf))
