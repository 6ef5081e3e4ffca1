"""The watch over a calibration in use: every look's own corners and known edges tell when an eye has moved. Pure.

Corners that no longer lie on their epipolar lines say how the right eye has pitched and rolled against the left; parts
whose edges come out long or short say how it has turned in or out. One look is noisy, a drift is slow and a knock is
sudden: an exponentially weighted mean is held against the spread of the looks just after calibrating.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.vision.geometry.rig import StereoRig

Array = NDArray[np.float64]

AXES = ("pitched", "rolled", "turned in")
"""About the right eye's x, z and y axes: what `turn` counts, in this order."""


FEWEST_VOTES = 6
VOTE_SIGMA_PX = 0.25
CLEAR_LEAD = 1.5
"""How many pairs must agree on an offset, how closely, and how far ahead of the next offset they must be."""
DEPTHS_MM = (120.0, 1500.0)
CORNER_SIGMA_PX = 0.1
LENGTH_SIGMA = 0.004
"""What a corner, and an edge length as a share of itself, are taken to be worth; how far that is wrong is learnt."""


@dataclass(frozen=True)
class Watching:
    """learn: looks that set what is usual; settled: after so many of them a look that does not fit ends the learning,
    so that an eye knocked in its first hour does not teach its new place; weight: of a new look in the mean; sigmas:
    how far from usual is too far; wild: how many sigmas a look may be off before it needs a second one to be believed;
    least_deg: what is never reported; stop_deg: what stops autonomous picking."""

    learn: int = 20
    settled: int = 8
    weight: float = 0.15
    sigmas: float = 6.0
    wild: float = 6.0
    least_deg: float = 0.03
    stop_deg: float = 0.1


@dataclass(frozen=True, eq=False)
class Clue:
    """What one look says: turn (3,) rad as in AXES and its sigma (3,) rad, infinite where it says nothing; at: when."""

    turn: Array
    sigma: Array
    at: str


@dataclass(frozen=True, eq=False)
class Watch:
    """What is known so far, by axis (3,). usual rad, from `learnt` looks of total information `known` and summed
    squared standardised residuals `squares`; mean rad of what came after, from information `fresh_known`, with
    `fresh_squares` the same information weighted twice; doubted: the side on which the last look was too wild to be
    believed alone; since: when the axis left its usual place."""

    usual: Array
    learnt: NDArray[np.int64]
    known: Array
    squares: Array
    mean: Array
    fresh_known: Array
    fresh_squares: Array
    doubted: Array
    since: tuple[str | None, ...] = (None, None, None)


@dataclass(frozen=True)
class Drift:
    """An eye has moved: which way, degrees, since when, whether that stops autonomous picking, and in words."""

    axis: str
    degrees: float
    since: str
    stops: bool
    text: str


def fresh() -> Watch:
    """A watch that has seen nothing: to be used after each calibration."""
    zero = np.zeros(3)
    return Watch(zero, np.zeros(3, np.int64), zero, zero, zero, zero, zero, zero)


def clue(rig: StereoRig, left_px: Array, right_px: Array, edges: Sequence[tuple[float, float, float]], at: str) -> Clue:
    """What one look says of the right eye's pose.

    left_px, right_px: (N, 2) matched corners, px. edges: (length found, length known, depth) of each known edge, mm.
    Pitch and roll need 4 corners spread over the image, turning in needs an edge.
    """
    turn, sigma = np.zeros(3), np.full(3, np.inf)
    if len(left_px) >= 4:
        turn[:2], sigma[:2] = _pitch_and_roll(rig, left_px, right_px)
    if edges:
        found, known, depth = np.array(edges, float).T
        # Lengths scale with depth, and depth with disparity: dZ / Z = Z / B * angle.
        angles = (found / known - 1.0) * rig.baseline_mm / depth
        turn[2] = float(np.median(angles))
        sigma[2] = LENGTH_SIGMA * float(np.median(rig.baseline_mm / depth)) / np.sqrt(len(edges))
    return Clue(turn, sigma, at)


def same_height(rig: StereoRig, left_px: Array, right_px: Array, reach_px: float = 8.0) -> tuple[Array, Array]:
    """Corners of both eyes that agree on one offset from their epipolar lines: (N, 2) left and right px, empty where no
    offset stands out.

    left_px (P, 2), right_px (Q, 2): all corners found, in any order. A recogniser pairs corners by their epipolar
    lines, so that after a knock it pairs none, or the wrong ones; here every pair at a possible depth votes for its
    offset, and the true ones vote alike.
    """
    if min(len(left_px), len(right_px)) < FEWEST_VOTES:
        return np.zeros((0, 2)), np.zeros((0, 2))
    i, j = (k.ravel() for k in np.indices((len(left_px), len(right_px))))
    lines, rays = _lines_and_rays(rig, left_px, right_px)
    gaps = np.einsum("ni,ni->n", lines[i], rays[j]) * rig.right.matrix[0, 0]
    nearness = rig.baseline_mm / np.maximum(_disparity(rig, left_px, right_px, i, j), 1e-9)
    likely = (np.abs(gaps) < reach_px) & (nearness > DEPTHS_MM[0]) & (nearness < DEPTHS_MM[1])
    i, j, gaps = i[likely], j[likely], gaps[likely]
    if len(gaps) < FEWEST_VOTES:
        return np.zeros((0, 2)), np.zeros((0, 2))
    offsets = np.arange(-reach_px, reach_px, 0.1)
    votes = np.exp(-0.5 * ((offsets[:, None] - gaps[None]) / VOTE_SIGMA_PX) ** 2).sum(axis=1)
    best = offsets[int(np.argmax(votes))]
    rival = float(votes[np.abs(offsets - best) > 4 * VOTE_SIGMA_PX].max())
    near = np.abs(gaps - best) < 3 * VOTE_SIGMA_PX
    if near.sum() < FEWEST_VOTES or float(votes.max()) < CLEAR_LEAD * rival:
        return np.zeros((0, 2)), np.zeros((0, 2))
    return left_px[i[near]], right_px[j[near]]


def _disparity(rig: StereoRig, left_px: Array, right_px: Array, i: NDArray[np.intp], j: NDArray[np.intp]) -> Array:
    """Baseline over depth of each pair, from the angles of both rays in the plane of the baseline and the view."""
    slopes = []
    for eye, px in ((rig.left, left_px), (rig.right, right_px)):
        rays = np.column_stack([eye.normalised(px), np.ones(len(px))]) @ eye.cyclopean_from_camera[:3, :3].T
        slopes.append(rays[:, 0] / rays[:, 2])
    difference: Array = slopes[0][i] - slopes[1][j]
    return difference


def _lines_and_rays(rig: StereoRig, left_px: Array, right_px: Array) -> tuple[Array, Array]:
    """(P, 3) epipolar lines of the left points in the right eye's plane z = 1, unit normals; (Q, 3) the right rays."""
    right_from_left = frames.inverse(rig.right.cyclopean_from_camera) @ rig.left.cyclopean_from_camera
    x, y, z = right_from_left[:3, 3]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    lines = np.column_stack([rig.left.normalised(left_px), np.ones(len(left_px))]) @ (cross @ right_from_left[:3, :3]).T
    lines /= np.linalg.norm(lines[:, :2], axis=1, keepdims=True)
    # The normal's own sense is free: with its y made positive, an offset means the same for every line.
    lines *= np.where(lines[:, 1:2] < 0, -1.0, 1.0)
    return lines, np.column_stack([rig.right.normalised(right_px), np.ones(len(right_px))])


def _pitch_and_roll(rig: StereoRig, left_px: Array, right_px: Array) -> tuple[Array, Array]:
    """The right eye's turn (2,) rad about its x and z, by least squares on epipolar distances, and its sigma."""
    lines, rays = _lines_and_rays(rig, left_px, right_px)
    gaps = np.einsum("ni,ni->n", lines, rays)
    # A camera that turns by w moves a ray to ray - w x ray; along the line's normal that shows as -(w x ray) . line.
    turned = np.cross(rays[:, None, :], np.array([[1.0, 0, 0], [0, 0, 1.0]])[None])
    slopes = np.einsum("nki,ni->nk", turned - turned[..., 2:] * rays[:, None, :], lines)
    covariance = np.linalg.pinv(slopes.T @ slopes, rcond=1e-9)
    sigma = np.sqrt(np.diag(covariance)) * CORNER_SIGMA_PX * np.sqrt(2) / rig.right.matrix[0, 0]
    return covariance @ slopes.T @ gaps, np.where(sigma > 0, sigma, np.inf)


def observe(watch: Watch, seen: Clue, settings: Watching) -> tuple[Watch, Drift | None]:
    """Take one look into account. The Drift is the largest that stands, or None."""
    strange = (watch.learnt >= settings.settled) & (np.abs(_standardised(watch, seen)) > settings.wild)
    unsettled = (watch.learnt < settings.learn) & (watch.fresh_known == 0)
    learning = np.isfinite(seen.sigma) & unsettled & ~strange
    judging = np.isfinite(seen.sigma) & ~learning
    watch = _judged(_learnt(watch, seen, learning), seen, judging, settings)
    far = _too_far(watch, settings)
    since = tuple((old or seen.at) if now else None for old, now in zip(watch.since, far, strict=True))
    watch = replace(watch, since=since)
    return watch, _drift(watch, far, settings)


def _learnt(watch: Watch, seen: Clue, learning: NDArray[np.bool_]) -> Watch:
    """Weighted mean and spread of the first looks (West 1979)."""
    information = np.where(learning, seen.sigma**-2.0, 0.0)
    known = watch.known + information
    step = np.where(learning, seen.turn - watch.usual, 0.0)
    usual = watch.usual + step * information / np.maximum(known, 1e-30)
    squares = watch.squares + information * step * np.where(learning, seen.turn - usual, 0.0)
    return replace(watch, usual=usual, learnt=watch.learnt + learning, known=known, squares=squares)


def _scale(watch: Watch) -> Array:
    """(3,) how many times larger the looks' spread is than their sigmas said; at least half, so that luck in the first
    looks makes no later one look wild."""
    scale: Array = np.sqrt(np.maximum(watch.squares / np.maximum(watch.learnt - 1, 1), 0.25))
    return scale


def _standardised(watch: Watch, seen: Clue) -> Array:
    """(3,) how many sigmas a look is off from what was usual and what has become of it; 0 where it says nothing."""
    off: Array = seen.turn - watch.usual - watch.mean
    return off / np.where(np.isfinite(seen.sigma), seen.sigma * _scale(watch), np.inf)


def _judged(watch: Watch, seen: Clue, judging: NDArray[np.bool_], settings: Watching) -> Watch:
    """The exponentially weighted mean of the looks since, each with its information. One wild look (a misread corner)
    is kept out; when the next is off on the same side, the eye has moved, and it counts."""
    news = seen.turn - watch.usual
    off = _standardised(watch, seen)
    side = np.where(judging & (np.abs(off) > settings.wild), np.sign(off), 0.0)
    believed = judging & ((side == 0) | (side == watch.doubted))
    fade = np.where(believed, 1 - settings.weight, 1.0)
    information = np.where(believed, seen.sigma**-2.0, 0.0)
    known = fade * watch.fresh_known + information
    mean = watch.mean + (news - watch.mean) * information / np.maximum(known, 1e-30)
    return replace(
        watch,
        mean=mean,
        fresh_known=known,
        fresh_squares=fade**2 * watch.fresh_squares + information,
        doubted=np.where(judging, side, watch.doubted),
    )


def _too_far(watch: Watch, settings: Watching) -> NDArray[np.bool_]:
    """Which axes have left their usual place: beyond `sigmas` of the two means' own doubt, and worth saying."""
    known = np.maximum(watch.fresh_known, 1e-30)
    doubt = _scale(watch) * np.sqrt(watch.fresh_squares / known**2 + 1 / np.maximum(watch.known, 1e-30))
    far: NDArray[np.bool_] = np.abs(watch.mean) > np.maximum(settings.sigmas * doubt, np.radians(settings.least_deg))
    return far & (watch.fresh_known > 0)


def _drift(watch: Watch, far: NDArray[np.bool_], settings: Watching) -> Drift | None:
    if not far.any():
        return None
    worst = int(np.argmax(np.where(far, np.abs(watch.mean), 0.0)))
    degrees = float(np.degrees(watch.mean[worst]))
    since = watch.since[worst] or ""
    stops = abs(degrees) >= settings.stop_deg
    text = f"right camera {AXES[worst]} by {degrees:+.2f} degrees against the left since {since}: "
    text += "calibrate before picking goes on" if stops else "see that its mount is tight, and calibrate soon"
    return Drift(AXES[worst], degrees, since, stops, text)
