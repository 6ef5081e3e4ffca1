"""Straight sides to a hundredth of a pixel: from a rough line to the maximum-likelihood line of a blurred step.

In: image, rough end points. Out: corrected end points, how sure, how strong. What the sides form is decided elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Flags, Image32, Index, Real
from daemon.vision.geometry import RectifiedCamera, outward
from daemon.vision.image.calipers import (
    BLOCKS,
    CLEAR,
    IN_BLOCK,
    OFFSETS,
    REACH_PX,
    Calipers,
    Images,
    bilinear,
    face_planes,
    lay_calipers,
    lens_bow,
    measured_reach,
    profiles,
    stretch_profiles,
    stretches,
    unclipped,
)
from daemon.vision.image.grey import SATURATED, Fine, Noise, noise_of_many
from daemon.vision.image.regions import SMOOTHING_PX

# Set by eye on rendered sides, like the other numbers here that name no source.
_TRIM_PX = 4.0
"""Left out at either end of a side, where its neighbour is in view."""
_FITS = (3.0, 2), (1.0, 4)
"""Px between calipers, and robust rounds, of the rough fit of a side and of the fine one."""
_FIRST_BLUR_PX = 0.7
_FAINT_BLOCK = 0.4
"""A stretch of a side that shows less than this share of the side's mean slope shows no edge."""
_WHOLE = 0.75
"""Share of its stretches that show an edge, where a line lies along one; where fewer do, it may only cross it."""
_TILTS = np.linspace(-1, 1, 7)
"""Slopes at which a line is tried, as shares of the steepest."""
_BESIDE_PX = 8.5
"""Distance, px, to either hand at which shading and grain are compared."""
_OUTERMOST_PX = np.array([[-REACH_PX], [REACH_PX]])
_ROWS_PX = np.array([-3.0, -1.5, 0.0, 1.5, 3.0])
"""Places, px along an edge, at which its level at one place is taken."""
SMOOTHING_ROW_PX = float(np.sqrt(4 * np.pi) * SMOOTHING_PX)
"""Distance, px, between rows of a smoothed image whose noise is as good as independent."""
SLOPE_NOISE = float(np.sqrt(2 * (1 - np.exp(-0.25 / SMOOTHING_PX**2)) / (4 * np.pi)) / SMOOTHING_PX)
"""Standard deviation of the difference of two points a pixel apart in white unit noise after a Gaussian."""

_SLOPE_OF_ROWS = np.sqrt(2.5) / SLOPE_NOISE
"""Sigmas of a slope of 1 in the mean of _ROWS_PX, which are as good as half as many that are independent."""


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

    def chosen(self, which: Index, turned: Flags | None = None) -> Sides:
        """Some of the sides, in this order; those `turned` run the other way, with the polygon on their other hand."""
        if turned is None or not turned.any():
            return Sides(
                self.start[which], self.end[which], self.covariance[which], self.step[which], self.evidence[which],
                self.support[which], self.blur[which],
            )  # fmt: skip
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
    images: Images, start: Array, end: Array, reach_px: Array | float, expected_px: Array, sigma_px: Array
) -> tuple[Array, Array, Array]:
    """Move rough sides (S, 2), (S, 2) px onto the strongest straight gradient near them, seen over their whole length.

    images: of unit noise, after a Gaussian of SMOOTHING_PX. Looks up to reach_px, (S,) or one for all, either way of
    expected_px (S,) outwards, and at tilts that move either end by a few pixels; gradients count by how near they are
    to what is expected, with sigma_px (S,), unless that leads to a line which only crosses an edge. Returns moved ends,
    and (S, BLOCKS) the slopes across the moved sides, stretch by stretch, over a pixel (over two where it looks farther
    than two).
    """
    length, at = stretches(start, end, _TRIM_PX)
    farthest = float(np.max(reach_px))
    pitch = 1.0 if farthest > 2 else 0.5
    offsets = np.arange(-farthest - pitch, farthest + 1.5 * pitch, pitch)
    late = np.zeros(len(start)) + (farthest - reach_px)  # each side's offsets begin at its own reach
    values = stretch_profiles(images, start, end, _TRIM_PX, offsets, (expected_px + late)[:, None])
    places = offsets[1:-1] + late[:, None]
    within = places < farthest - late[:, None] + 0.5 * pitch
    last = within.sum(1, dtype=np.int32)[:, None, None, None] - 1
    slopes = values[:, :, 2:] - values[:, :, :-2]
    tilts = _TILTS * (0.06 * length).clip(0.4, 3.5)[:, None]
    width = slopes.shape[2]
    shifted = np.rint(at[:, :, None] * (tilts / pitch)[:, None, :]).astype(np.int32)[:, :, :, None]
    shifted = np.minimum(np.maximum(shifted + np.arange(width, dtype=np.int32), 0), last)
    shifted += (np.arange(len(start) * BLOCKS, dtype=np.int32) * width).reshape(len(start), -1, 1, 1)
    across = slopes.ravel().take(shifted)
    lines = np.abs(across.sum(1))
    likely = (np.exp(-0.5 * (places / sigma_px[:, None]) ** 2) * within).astype(np.float32)
    each, across = np.arange(len(start)), across.reshape(len(start), BLOCKS, -1)
    best = (lines * likely[:, None]).reshape(len(start), -1).argmax(1)
    crossing = np.flatnonzero(_shown(across[each, :, best]) < _WHOLE)
    if len(crossing):
        there = (lines[crossing] * within[crossing, None]).reshape(len(crossing), -1).argmax(1)
        whole = _shown(across[crossing, :, there]) >= _WHOLE
        best[crossing[whole]] = there[whole]
    tilt, offset = tilts[each, best // width], places[each, best % width] + expected_px
    chord = end - start
    normal = outward(chord, length)
    slope = tilt / np.maximum(1 - 2 * _TRIM_PX / length, 0.5)
    moved = start + (offset - slope)[:, None] * normal, end + (offset + slope)[:, None] * normal
    return *moved, across[each, :, best]


def _shown(slopes: Image32) -> Array:
    """(S,) the share of stretches of a line, with these slopes (S, BLOCKS) across it, that show an edge."""
    whole = slopes.sum(1, keepdims=True)
    return np.asarray((slopes * np.sign(whole) > _FAINT_BLOCK / BLOCKS * np.abs(whole)).sum(1) / BLOCKS)


def probe_sides(images: Images, start: Array, end: Array) -> tuple[Array, Array]:
    """Measure the gradient across each side: its mean in sigmas (S,), and the fraction of the side that shows it (S,).

    images: of unit noise, after a Gaussian of SMOOTHING_PX; their noise is therefore known along and across the side.
    """
    length = np.maximum(np.hypot(*(end - start).T), 1e-6)
    values = stretch_profiles(images, start, end, 1.0, np.array([-0.5, 0.5]), np.zeros((len(start), 1)))
    return strengths(values[:, :, 1] - values[:, :, 0], length)


def strengths(slopes: Real, length: Array, grain: Array | float = 1.0) -> tuple[Array, Array]:
    """probe_sides of sides (S,) px long across which these are the slopes (S, BLOCKS) over a pixel; grain: their noise
    over what white noise would leave, (S,) or one for all."""
    one = grain * SLOPE_NOISE
    rows = np.clip(length / SMOOTHING_ROW_PX, 1.0, BLOCKS * IN_BLOCK)
    mean = slopes.mean(1)
    sigma = one / np.sqrt(np.maximum(rows / BLOCKS, 1.0))
    slope_z = slopes * np.sign(mean)[:, None] / sigma[:, None]
    seen = np.mean(slope_z > np.clip(_FAINT_BLOCK * np.abs(mean) / sigma, 0.5, 2.5)[:, None], 1)
    return mean / (one / np.sqrt(rows)), seen


def stretch_slopes(images: Images, start: Array, end: Array, reach_px: int, bow_px: Array) -> Image32:
    """Slopes across stretches of sides (S, 2), (S, 2) px, in sigmas, at whole px up to the reach on either hand,
    inwards first: (S, BLOCKS, 2 reach_px + 1). images: as for probe_sides; bow_px (S, 3): how far out of the straight
    line each side is at its start, middle and end."""
    if not len(start):
        return np.zeros((0, BLOCKS, 2 * reach_px + 1), np.float32)
    length, at = stretches(start, end, _TRIM_PX)
    offsets = np.arange(-reach_px - 0.5, reach_px + 1.0)
    first, middle, last = bow_px[:, :, None].swapaxes(0, 1)
    bow = middle + at * (last - first) / 2 + at * at * ((first + last) / 2 - middle)
    values = stretch_profiles(images, start, end, _TRIM_PX, offsets, bow)
    rows = np.clip(length / SMOOTHING_ROW_PX / BLOCKS, 1.0, IN_BLOCK)
    slopes: Image32 = values[:, :, 1:] - values[:, :, :-1]
    return slopes * (np.sqrt(rows) / SLOPE_NOISE).astype(np.float32)[:, None, None]


def levels_across(smooth: Fine, at: Array, normal: Array, offsets: Array, rows_px: Array = _ROWS_PX) -> Image32:
    """Levels (N, C) at offsets (C,) px along unit normals (N, 2) of edges through places (N, 2) px, each the mean of
    rows_px along its edge. smooth: as for stretch_slopes."""
    if not len(at):
        return np.zeros((0, len(offsets)), np.float32)
    x, y = (
        np.asarray(at[:, k] + rows_px[:, None] * way + offsets[:, None, None] * normal[:, k], np.float32)
        for k, way in enumerate((-normal[:, 1], normal[:, 0]))
    )
    values = bilinear(smooth, x.reshape(-1, len(at)), y.reshape(-1, len(at)))
    return np.ascontiguousarray(values.reshape(len(offsets), len(rows_px), -1).mean(1).T)


def slopes_across(levels: Image32) -> Image32:
    """Slopes (..., C - 1), sigmas, between the levels (..., C) of levels_across at offsets a pixel apart."""
    return np.diff(levels, axis=-1) * np.float32(_SLOPE_OF_ROWS)


LEAST_SIGMAS = 4.0
"""Least slope of an edge, in sigmas of the noise."""


def peaks(slopes: Array, least: Array | float) -> Flags:
    """(..., C - 2) where sizes of slopes (..., C), but for the first and the last, are no less than so much, nor than
    the one before, and more than the one after."""
    middle = slopes[..., 1:-1]
    return np.asarray((middle >= least) & (middle >= slopes[..., :-2]) & (middle > slopes[..., 2:]))


def peak_places(sizes: Real, best: Index) -> tuple[Array, Array]:
    """Return how high rows of slopes (..., C) are at their highest, best (...,), which is neither the first nor the
    last; and how far from there, px, a parabola through the three slopes about it has its top."""
    low, top, high = np.moveaxis(np.take_along_axis(sizes, best[..., None] + np.arange(-1, 2), -1), -1, 0)
    bend = low - 2 * top + high
    between = np.where(bend < -1e-6, 0.5 * (low - high) / np.minimum(bend, -1e-6), 0.0)
    return top, between.clip(-1, 1)


def edge_sigmas(images: Images, start: Array, end: Array) -> Array:
    """Return how surely an edge lies along each line (S,): the slope across it, over its whole length, in sigmas.

    images: as for probe_sides. The slope is the median over stretches of the line, so that an edge that only crosses it
    does not count; it is taken against what lines beside this one show, shading and grain alike, on the quieter hand:
    on the other the next edge may be near.
    """
    length = np.maximum(np.hypot(*(end - start).T), 1e-6)
    offsets = np.arange(-_BESIDE_PX, _BESIDE_PX + 0.1, 0.5)
    values = stretch_profiles(images, start, end, _TRIM_PX, offsets, np.zeros((len(start), 1)))
    slope = np.median(values[:, :, 2:] - values[:, :, :-2], 1)
    place = offsets[1:-1]
    shading, grain = np.zeros(len(start)), np.full(len(start), np.inf)
    for side in (place < -2.4, place > 2.4):
        level = np.median(slope[:, side], 1)
        spread = 1.4826 * np.median(np.abs(slope[:, side] - level[:, None]), 1)
        shading, grain = np.where(spread < grain, level, shading), np.minimum(spread, grain)
    rows = np.clip(length / SMOOTHING_ROW_PX, 1.0, BLOCKS * IN_BLOCK)
    noise = 1.25 * SLOPE_NOISE / np.sqrt(rows)
    edge = np.abs(slope[:, np.abs(place) < 0.9] - shading[:, None]).max(1)
    return np.asarray(edge / np.hypot(noise, grain))


@dataclass(frozen=True, eq=False)
class MeasuredImage:
    """What sides are fitted to: fine grey levels (H, W), their noise, and the camera whose lens bends lines, if any."""

    image: Fine
    noise: Noise
    camera: RectifiedCamera | None


def fit_sides(
    exposures: Sequence[tuple[MeasuredImage, int]],
    start: Array,
    end: Array,
    sets: Index | None = None,
    known_blurs: Array | None = None,
) -> Sides:
    """Least-squares lines of blurred steps near the sides start -> end, (S, 2) px each, already within about 1 px; half
    of that where their blurs are known, which are then spared a first rough fit.

    exposures: with how many of the sides, one after the other, lie in each. Each profile gives where the step crosses
    it, by least squares against the step's own slope, with the grey levels on both sides free to drift along the side;
    a robust line goes through these places.
    Each image has one blur; sets: how many sides, one after the other, have one of their own, where not all of them
    need be edges. Columns are weighed alike on both sides, so that a wrong blur cannot shift the line.
    """
    counts = np.array([count for _, count in exposures])
    in_image = counts.cumsum() - counts
    bow = _bows(exposures, start, end)
    sides_of = counts if sets is None else sets
    blurs = np.full(len(sides_of), _FIRST_BLUR_PX) if known_blurs is None else known_blurs
    for spacing_px, rounds in _FITS[0 if known_blurs is None else 1 :]:
        calipers = lay_calipers(start, end, bow, _TRIM_PX, spacing_px)
        steps = _steps([e for e, _ in exposures], in_image, calipers, blurs, sides_of)
        offset, slope, covariance, support = _robust_line(calipers, steps.position, 1 / steps.sigma, rounds)
        start = start + (offset - slope)[:, None] * calipers.normal
        end = end + (offset + slope)[:, None] * calipers.normal
        blurs = np.minimum(np.maximum(blurs + steps.blur_error_px, 0.4), 2.5)
    ends = np.array([[1.0, -1.0], [1.0, 1.0]])
    evidence = np.abs(steps.height) / steps.height_sigma
    return Sides(start, end, ends @ covariance @ ends.T, steps.height, evidence, support, blurs.repeat(sides_of))


def line_beside(bow_px: Array, length_px: Array) -> Array:
    """(S, 2) px how far out of the chord the straight line lies, at its start and end, that fit_sides lays along sides
    (S,) px long that are bent: bow_px (S, 3), as stretch_slopes has it. It measures the middle alone, where the side is
    farthest out."""
    first, middle, last = bow_px.T
    among = measured_reach(np.maximum(length_px, 1e-6), _TRIM_PX) ** 2 / 3
    mean, half = (1 - among) * middle + among * (first + last) / 2, (last - first) / 2
    return np.stack([mean - half, mean + half], 1)


def _bows(exposures: Sequence[tuple[MeasuredImage, int]], start: Array, end: Array) -> Array:
    """lens_bow of the sides in each image, (S, 2) px."""
    bows, first = np.zeros_like(start), 0
    for exposure, count in exposures:
        own = slice(first, first + count)
        bow = lens_bow(start[own], end[own], exposure.camera)
        if bow is not None:
            bows[own] = bow
        first += count
    return bows


@dataclass(frozen=True, eq=False)
class _Steps:
    """Per caliper: where the step is, px from the base (R,); its sigma (R,). Per side: mean height (S,); its sigma.

    blur_error_px (B,): how much wider all the steps of one blur together are than was assumed.
    """

    position: Array
    sigma: Array
    height: Array
    height_sigma: Array
    blur_error_px: Array


def _steps(
    exposures: Sequence[MeasuredImage], in_image: Index, calipers: Calipers, blurs: Array, sides_of: Index
) -> _Steps:
    """Measure where the blurred step crosses each caliper: its residual against the model, over the model's slope.
    blurs (B,) px, each of so many sides (B,), one after the other; the first exposure's sides begin at in_image[0], and
    so on."""
    cuts = [*calipers.first[in_image].tolist(), len(calipers.side)]
    values = profiles([e.image for e in exposures], cuts, calipers, OFFSETS)
    noise = noise_of_many([e.noise for e in exposures], np.diff(cuts))
    mean = calipers.means(values)
    x = OFFSETS / blurs[:, None]
    rise = np.array([[0.5 + 0.5 * math.erf(value * math.sqrt(0.5)) for value in row] for row in x.tolist()])
    slope = np.exp(-0.5 * x**2) / (blurs[:, None] * np.sqrt(2 * np.pi))
    planes, clear = face_planes(values, mean, noise, calipers)
    planes = unclipped(mean, calipers, planes, blurs.repeat(sides_of))
    begins = calipers.first[sides_of.cumsum() - sides_of]
    faces = np.stack([1 - rise, OFFSETS * (1 - rise), rise, OFFSETS * rise], 2)
    model = _by_blur(faces, planes, begins)
    usable = (clear & (np.maximum(model, values - 4) < SATURATED)).astype(np.float32)
    residual = (values - model) * usable
    # The step's derivatives by place and by blur, height apart; sums over the usable columns of each caliper.
    widening = -slope * x
    by_place, by_blur = _by_blur(np.stack([slope, widening], 1), residual, begins)
    pairs = np.stack([slope**2, slope * widening, widening**2, np.ones_like(slope)], 1)
    place2, mixed, blur2, columns = _by_blur(pairs, usable, begins)
    step = planes[2] - planes[0]
    height = calipers.means(step)
    here = height.take(calipers.side)
    power = np.maximum(here**2 * place2, 1e-9)
    position = -here * by_place / power
    outermost = planes[::2] + _OUTERMOST_PX * planes[1::2]
    sigma_grey = noise.at(outermost).sum(0) / 2
    wide = step * (columns > len(OFFSETS) - 0.5)
    shift = -here * (wide * mixed * here) / power  # what of the widening a shift explains
    widened = wide * by_blur + shift * by_place, wide**2 * blur2 + 2 * wide * shift * mixed + shift**2 * place2
    blur_error, blur_power = (np.add.reduceat(each, begins) for each in widened)
    height_sigma = np.sqrt(2) * calipers.means(sigma_grey) / np.sqrt(CLEAR * calipers.count)
    return _Steps(
        np.minimum(np.maximum(position, -3.0), 3.0),
        sigma_grey / np.sqrt(power),
        height,
        height_sigma,
        blur_error / np.maximum(blur_power, 1e-9),
    )


def _by_blur(factors: Array, values: NDArray[np.floating[Any]], begins: Index) -> Image32:
    """Each blur's factors (B, K, C) times the values (C, R) of its own calipers, which begin at begins (B,): (K, R)."""
    factors, values = factors.astype(np.float32), values.astype(np.float32, copy=False)
    products = np.empty((factors.shape[1], values.shape[1]), np.float32)
    for factor, (first, end) in zip(factors, pairwise([*begins.tolist(), values.shape[1]]), strict=True):
        np.matmul(factor, values[:, first:end], out=products[:, first:end])
    return products


def _robust_line(calipers: Calipers, position: Array, weight: Array, rounds: int) -> tuple[Array, Array, Array, Array]:
    """Robust lines position ~ offset + slope * at through the places found along each side.

    weight: 1 / sigma of each; an ordinary residual's size is taken from the residuals, never below what the weights
    say. Returns offset (S,), slope (S,), their covariance (S, 2, 2), fraction of places within three sigmas (S,).
    """
    at, side = calipers.at, calipers.side
    terms = np.empty((7, len(side)))  # by weight: of the normal equations, of the squares left over, of how many count
    terms[0], terms[6] = weight**2, 1.0
    np.multiply(terms[0], at, out=terms[1])
    np.multiply(terms[1], at, out=terms[2])
    np.multiply(terms[:2], position, out=terms[3:5])
    np.multiply(terms[3], position, out=terms[5])
    keep = np.ones_like(position)
    for _ in range(rounds):
        s0, s1, s2, b0, b1, p2, kept = calipers.sums(terms * keep)
        determinant = np.maximum(s0 * s2 - s1 * s1, 1e-12)
        offset, slope = (s2 * b0 - s1 * b1) / determinant, (s0 * b1 - s1 * b0) / determinant
        squares = np.maximum(p2 - offset * b0 - slope * b1, 0.0)  # of a least-squares line's residuals
        spread = np.maximum(1.0, np.sqrt(squares / np.maximum(kept, 1.0)))
        line = np.array([offset, slope, 3.0 * spread]).take(side, 1)
        z2 = ((position - line[0] - line[1] * at) * weight / line[2]) ** 2
        keep = np.maximum(1 - z2, 0.0) ** 2
    covariance = np.array([[s2, -s1], [-s1, s0]]) * (spread**2 / determinant)
    return offset, slope, covariance.transpose(2, 0, 1), calipers.means(z2 < 1)
