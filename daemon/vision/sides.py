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
_TRIM_PX = 3.0
_OFFSETS = np.arange(-_REACH_PX, _REACH_PX + 1, dtype=float)


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


def find_sides(smoothed: Image32, start: Array, end: Array, inward: float, outward: float) -> tuple[Array, Array]:
    """Move rough sides (S, 2), (S, 2) px onto the nearest strong gradient across them, seen over their whole length.

    smoothed: unit-noise image. Searches from `inward` px inside to `outward` px outside. Returns the moved ends.
    """
    rulers = lay_rulers(start, end, None, _TRIM_PX)
    offsets = np.arange(-inward - 0.5, outward + 1.0, 0.5)
    values = sample(smoothed, rulers, offsets)
    slope = values[:, 2:] - values[:, :-2]
    centre = offsets[1:-1]
    mean = rulers.sums(slope) / rulers.count[:, None]
    sign = np.where(np.max(mean, 1) > -np.min(mean, 1), 1.0, -1.0)
    weight = np.maximum(slope * sign[rulers.side, None], 0.0) ** 4
    total = np.sum(weight, 1) + 1e-9
    position = weight @ centre / total
    return _apply_line(start, end, rulers, *_robust_line(rulers, position, np.sqrt(np.sqrt(total)), 1.0)[:2])


def fit_sides(image: Image32, noise: Noise, start: Array, end: Array, eye: Eye | None, blur_px: float) -> Sides:
    """Maximum-likelihood lines of blurred steps near the sides start -> end, (S, 2) px each, already within about 1 px.

    image: float32 grey levels. Each row gives where the step crosses it, by least squares against the step's own
    slope, with the grey levels on both sides free to drift along the side; a robust line goes through the rows.
    """
    for _ in range(2):
        rulers = lay_rulers(start, end, eye, _TRIM_PX)
        rows = _rows(image, noise, rulers, blur_px)
        offset, slope, covariance, support = _weighted_line(rulers, rows)
        start, end = _apply_line(start, end, rulers, offset, slope)
    ends = np.array([[1.0, -1.0], [1.0, 1.0]])
    step = rulers.sums(rows.step) / rulers.count
    return Sides(
        start,
        end,
        ends @ covariance @ ends.T,
        step,
        np.abs(step) / rows.step_sigma,
        support,
        np.full(len(start), blur_px),
    )


@dataclass(frozen=True, eq=False)
class _Rows:
    """Per row: where the step is, px from the base (R,); its sigma (R,); its height (R,). Per side: sigma of
    the mean height.
    """

    position: Array
    sigma: Array
    step: Array
    step_sigma: Array


def _rows(image: Image32, noise: Noise, rulers: Rulers, blur_px: float) -> _Rows:
    values = sample(image, rulers, _OFFSETS).astype(float)
    rise = _normal_cdf(_OFFSETS / blur_px)
    slope = np.exp(-0.5 * (_OFFSETS / blur_px) ** 2) / (blur_px * np.sqrt(2 * np.pi))
    far = np.stack([_OFFSETS < -2, _OFFSETS > 2], 1).astype(float)
    levels = _smooth_along(values @ (far / far.sum(0)), rulers)
    step = levels[:, 1] - levels[:, 0]
    side_step = rulers.sums(step) / rulers.count
    model = levels[:, :1] + step[:, None] * rise
    variance = noise.at(model) ** 2
    weight = np.where((model < SATURATED) & (values < SATURATED + 4), 1.0 / variance, 1e-6)
    template = -side_step[rulers.side, None] * slope
    information = np.sum(weight * template**2, 1)
    position = np.sum(weight * template * (values - model), 1) / np.maximum(information, 1e-12)
    level_variance = rulers.sums(np.mean(variance, 1)) / rulers.count / (far.sum(0).mean() * rulers.count)
    return _Rows(
        np.clip(position, -3.0, 3.0), 1 / np.sqrt(np.maximum(information, 1e-12)), step, np.sqrt(2 * level_variance)
    )


def _smooth_along(values: Array, rulers: Rulers, half: int = 6) -> Array:
    """Running mean of (R, K) values over 2 half + 1 rows of the same side (shorter at its ends)."""
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, 0)])
    rows = np.arange(len(values))
    last = rulers.first + rulers.count
    low = np.maximum(rows - half, rulers.first[rulers.side])
    high = np.minimum(rows + half + 1, last[rulers.side])
    return np.asarray((total[high] - total[low]) / (high - low)[:, None])


def _weighted_line(rulers: Rulers, rows: _Rows) -> tuple[Array, Array, Array, Array]:
    return _robust_line(rulers, rows.position, 1 / rows.sigma, None)


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
