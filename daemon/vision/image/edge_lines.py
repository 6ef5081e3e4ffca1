"""Straight sides to a hundredth of a pixel: from a rough line to the maximum-likelihood line of a blurred step.

In: image, rough end points. Out: corrected end points, how sure, how strong. What the sides form is decided elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.vision.geometry.rectified import Eye
from daemon.vision.image.grey import SATURATED, Noise
from daemon.vision.image.profiles import Rulers, lay_rulers, lens_bow, sample, sample_evenly
from daemon.vision.image.regions import SMOOTHING_PX
from daemon.vision.image.step_model import FAR, OFFSETS, REACH_PX, normal_cdf, shaded_levels, unclipped

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Image32 = NDArray[np.float32]

_TRIM_PX = 4.0
_FIRST_SPACING_PX = 3.0
_BLOCKS, _IN_BLOCK = 6, 6  # stretches of a side, rows in each
_FAINT_BLOCK = 0.4
_BESIDE_PX = 8.5
_ROW_PX = float(np.sqrt(4 * np.pi) * SMOOTHING_PX)
"""How far apart rows of a smoothed image are whose noise is as good as independent."""
_SLOPE_NOISE = float(np.sqrt(2 * (1 - np.exp(-0.25 / SMOOTHING_PX**2)) / (4 * np.pi)) / SMOOTHING_PX)
"""Standard deviation of the difference of two points a pixel apart in white unit noise after a Gaussian."""


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

    def chosen(self, which: Index, turned: NDArray[np.bool_] | None = None) -> Sides:
        """Some of the sides, in this order; those `turned` run the other way, with the polygon on their other hand."""
        if turned is None or not turned.any():
            return Sides(*(getattr(self, name)[which] for name in Sides.__dataclass_fields__))
        back = turned[:, None]
        start, end, covariance = self.start[which], self.end[which], self.covariance[which]
        return Sides(
            np.where(back, end, start),
            np.where(back, start, end),
            np.where(back[:, None], covariance[:, ::-1, ::-1], covariance),
            np.where(turned, -self.step[which], self.step[which]),
            self.evidence[which],
            self.support[which],
            self.blur[which],
        )


def find_sides(
    smooth: Image32, start: Array, end: Array, reach_px: float, expected_px: Array, sigma_px: Array
) -> tuple[Array, Array]:
    """Move rough sides (S, 2), (S, 2) px onto the strongest straight gradient near them, seen over their whole length.

    smooth: unit-noise image after a Gaussian of SMOOTHING_PX. Looks up to reach_px either way of expected_px (S,)
    outwards, and at tilts that move either end by a few pixels; gradients count by how near they are
    to what is expected, with sigma_px (S,). Returns moved ends.
    """
    length, at = _places(start, end, _TRIM_PX, _BLOCKS * _IN_BLOCK)
    pitch = 1.0 if reach_px > 2 else 0.5
    offsets = np.arange(-reach_px - pitch, reach_px + 1.5 * pitch, pitch)
    values = sample_evenly(smooth, start, end, at, offsets, expected_px)
    blocks = _block_means(values[:, :, 2:] - values[:, :, :-2])
    at = _block_means(at[:, :, None])[:, :, 0]
    tilts = np.linspace(-1, 1, 7) * np.clip(0.06 * length, 0.4, 3.5)[:, None]
    width = blocks.shape[2]
    shifted = np.rint(at[:, :, None] * (tilts / pitch)[:, None, :]).astype(np.int32)[:, :, :, None]
    shifted = np.minimum(np.maximum(shifted + np.arange(width, dtype=np.int32), 0), width - 1)
    shifted += (np.arange(len(start) * blocks.shape[1], dtype=np.int32) * width).reshape(len(start), -1, 1, 1)
    lines = np.abs(blocks.ravel().take(shifted).sum(1))
    lines *= np.exp(-0.5 * (offsets[1:-1] / sigma_px[:, None, None]) ** 2)
    best = np.argmax(lines.reshape(len(start), -1), 1)
    tilt, offset = tilts[np.arange(len(start)), best // width], offsets[1:-1][best % width] + expected_px
    chord = end - start
    normal = np.stack([-chord[:, 1], chord[:, 0]], 1) / length[:, None]
    slope = tilt / np.maximum(1 - 2 * _TRIM_PX / length, 0.5)
    return start + (offset - slope)[:, None] * normal, end + (offset + slope)[:, None] * normal


def probe_sides(smooth: Image32, start: Array, end: Array, grain: float = 1.0) -> tuple[Array, Array]:
    """How strong the gradient across each side is: its mean in sigmas (S,), and the fraction of the side that shows
    it (S,).

    smooth: unit-noise image after a Gaussian of SMOOTHING_PX, whose noise is therefore known along and across the
    side; grain: that noise over what white noise would leave.
    """
    length, at = _places(start, end, 1.0, _BLOCKS * _IN_BLOCK)
    values = sample_evenly(smooth, start, end, at, np.array([-0.5, 0.5]), np.zeros(len(start)))
    blocks = _block_means(values[:, :, 1:] - values[:, :, :1])[:, :, 0]
    one = grain * _SLOPE_NOISE
    rows = np.clip(length / _ROW_PX, 1.0, _BLOCKS * _IN_BLOCK)
    mean = np.mean(blocks, 1)
    sigma = one / np.sqrt(np.maximum(rows / _BLOCKS, 1.0))
    block_z = blocks * np.sign(mean)[:, None] / sigma[:, None]
    seen = np.mean(block_z > np.clip(_FAINT_BLOCK * np.abs(mean) / sigma, 0.5, 2.5)[:, None], 1)
    return mean / (one / np.sqrt(rows)), seen


def edge_sigmas(smooth: Image32, start: Array, end: Array) -> Array:
    """How surely an edge lies along each line (S,): the slope across it, over its whole length, in sigmas.

    smooth: as for probe_sides. The slope is the median over stretches of the line, so that an edge that only crosses
    it does not count; it is taken against what lines beside this one show, shading and grain alike, on the quieter
    hand: on the other the next edge may be near.
    """
    length, at = _places(start, end, _TRIM_PX, _BLOCKS * _IN_BLOCK)
    offsets = np.arange(-_BESIDE_PX, _BESIDE_PX + 0.1, 0.5)
    values = sample_evenly(smooth, start, end, at, offsets, np.zeros(len(start)))
    slope = np.median(_block_means(values[:, :, 2:] - values[:, :, :-2]), 1)
    place = offsets[1:-1]
    shading, grain = np.zeros(len(start)), np.full(len(start), np.inf)
    for side in (place < -2.4, place > 2.4):
        level = np.median(slope[:, side], 1)
        spread = 1.4826 * np.median(np.abs(slope[:, side] - level[:, None]), 1)
        shading, grain = np.where(spread < grain, level, shading), np.minimum(spread, grain)
    rows = np.clip(length / _ROW_PX, 1.0, _BLOCKS * _IN_BLOCK)
    noise = 1.25 * _SLOPE_NOISE / np.sqrt(rows)
    edge = np.abs(slope[:, np.abs(place) < 0.9] - shading[:, None]).max(1)
    return np.asarray(edge / np.hypot(noise, grain))


def _places(start: Array, end: Array, trim_px: float, count: int) -> tuple[Array, Array]:
    """Lengths (S,) px of sides, and (S, count) places along each, -1 to 1, with trim_px left out at either end."""
    length = np.maximum(np.hypot(*(end - start).T), 1e-6)
    step = (np.arange(count) + 0.5) / count * 2 - 1
    return length, step * (1 - 2 * np.minimum(trim_px, 0.25 * length) / length)[:, None]


def _block_means(values: NDArray[np.floating[Any]]) -> Array:
    """Means of (S, K, C) values over equal stretches of each side: (S, _BLOCKS, C)."""
    count, _, width = values.shape
    return np.asarray(values.reshape(count, _BLOCKS, -1, width).mean(2), float)


def fit_sides(
    image: Image32,
    noise: Noise,
    start: Array,
    end: Array,
    eye: Eye | None,
    blur_px: float = 0.7,
    *,
    roughly: bool = False,
) -> Sides:
    """Least-squares lines of blurred steps near the sides start -> end, (S, 2) px each, already within about 1 px.

    image: float32 grey levels. Each row gives where the step crosses it, by least squares against the step's own
    slope, with the grey levels on both sides free to drift along the side; a robust line goes through the rows.
    blur_px is only where the search for the image's one blur starts. Columns are weighed alike on both sides, so
    that a wrong blur cannot shift the line. roughly: one step only, from fewer rows.
    """
    bow = lens_bow(start, end, eye)
    passes = ((_FIRST_SPACING_PX, 2), (1.0, 4))
    for spacing_px, rounds in passes[:1] if roughly else passes:
        rulers = lay_rulers(start, end, bow, _TRIM_PX, spacing_px)
        rows = _rows(image, noise, rulers, blur_px)
        offset, slope, covariance, support = _robust_line(rulers, rows.position, 1 / rows.sigma, rounds)
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
    values = sample(image, rulers, OFFSETS, np.zeros(len(rulers.length))).astype(float)
    mean = rulers.sums(values) / rulers.count[:, None]
    x = OFFSETS / blur_px
    rise, slope = normal_cdf(x), np.exp(-0.5 * x**2) / (blur_px * np.sqrt(2 * np.pi))
    inside, outside, clear = shaded_levels(values, mean, noise, rulers)
    inside, outside = unclipped(mean, rulers, inside, outside, blur_px)
    step = outside[:, REACH_PX] - inside[:, REACH_PX]
    side_step = rulers.sums(step) / rulers.count
    model = inside + (outside - inside) * rise
    usable = clear * ((model < SATURATED) & (values < SATURATED + 4))
    residual = (values - model) * usable
    template = (-side_step[rulers.side, None] * slope) * usable
    power = np.maximum(np.einsum("rc,rc->r", template, template), 1e-9)
    position = np.einsum("rc,rc->r", template, residual) / power
    sigma_grey = (noise.at(inside[:, 0]) + noise.at(outside[:, -1])) / 2
    wide = (step * usable.min(1))[:, None] * (-slope * x) * usable
    wide -= (np.einsum("rc,rc->r", wide, template) / power)[:, None] * template
    blur_error = np.vdot(wide, residual) / max(float(np.vdot(wide, wide)), 1e-9)
    level_sigma = rulers.sums(sigma_grey) / rulers.count / np.sqrt(FAR.sum(0).mean() * rulers.count)
    return _Rows(
        np.clip(position, -3.0, 3.0), sigma_grey / np.sqrt(power), step, np.sqrt(2) * level_sigma, float(blur_error)
    )


def _robust_line(rulers: Rulers, position: Array, weight: Array, rounds: int) -> tuple[Array, Array, Array, Array]:
    """Robust lines position ~ offset + slope * at through the rows of each side.

    weight: 1 / sigma of each row; an ordinary residual's size is taken from the residuals, never below what the weights
    say. Returns offset (S,), slope (S,), their covariance (S, 2, 2), fraction of rows within three sigmas (S,).
    """
    keep, at = np.ones_like(position), rulers.at
    weight2 = weight**2
    terms = np.stack([weight2, weight2 * at, weight2 * at**2, weight2 * position, weight2 * position * at])
    for turn in range(rounds):
        s0, s1, s2, b0, b1 = np.add.reduceat(terms * keep if turn else terms, rulers.first, axis=1)
        determinant = np.maximum(s0 * s2 - s1 * s1, 1e-12)
        offset, slope = (s2 * b0 - s1 * b1) / determinant, (s0 * b1 - s1 * b0) / determinant
        normal = (position - offset[rulers.side] - slope[rulers.side] * at) * weight
        spread = np.maximum(1.0, np.sqrt(rulers.sums(keep * normal**2) / np.maximum(rulers.sums(keep), 1.0)))
        z = normal / (3.0 * spread[rulers.side])
        keep = np.maximum(1 - z * z, 0.0) ** 2
    covariance = np.stack([s2, -s1, -s1, s0], 1).reshape(-1, 2, 2) / determinant[:, None, None]
    support = rulers.sums((np.abs(z) < 1).astype(float)) / rulers.count
    return offset, slope, covariance * (spread**2)[:, None, None], support


def _apply_line(start: Array, end: Array, rulers: Rulers, offset: Array, slope: Array) -> tuple[Array, Array]:
    move_start, move_end = offset - slope, offset + slope
    return start + move_start[:, None] * rulers.normal, end + move_end[:, None] * rulers.normal
