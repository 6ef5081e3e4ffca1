"""Robust least squares: the one solver for poses, corners, planes and all else that a look fits.

In: residual blocks (edges, corners, planes), whitened and linearised by the caller, of several problems side by side.
Out: what fits them best. A block that stays far off counts less and less. What the blocks are, and when they are
linearised anew, is the caller's. With it the rigid fit of taught models to seen corners: proper rotations only, as a
mirrored part is another part, and all correspondences at once, because a look has milliseconds. And what chi-squares
say, to the accuracy that decisions need.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags, Index, Real

OUTLIER = 3.0
"""Sigmas off at which a block counts a quarter. A kernel that leaves far blocks out (Tukey's) had corners of rendered
parts .196 mm off on average for .172 mm: where few sides hold a corner, to lose one opens it."""
SHARP = 1e9
"""Holds an unknown that would be negative to nought."""

MIN_VARIANCE = 1e-12
"""Smallest share of the largest variance of a covariance that any of its variances is taken for."""
STEPS = 2  # Gauss-Newton steps after the closed-form start; a third would be below a micrometre


class LeastSquaresFit(NamedTuple):
    """Of each of B problems: unknowns (B, N); information (B, N, N) of the blocks as they were weighed, and held (B, N,
    N), the same with all else that holds the unknowns; miss (B, M) chi-square of each block; trust (B, M) what each
    counts after that; excess (B,) by how much the misses exceed what their doubt says, where that was asked."""

    unknowns: Array
    information: Array
    held: Array
    miss: Array
    trust: Array
    excess: Array


def solve(
    rows: Array,
    off: Array,
    use: Array,
    prior: Array,
    towards: Array | float = 0.0,
    *,
    passes: int = 1,
    outlier: float = OUTLIER,
    trust: Array | None = None,
    spare: int | None = None,
    grows: bool = True,
) -> LeastSquaresFit:
    """Solve B robust least-squares problems: the unknowns that reduce residual blocks off (B, M, D), in sigmas, of
    which rows (B, M, D, N) are the Jacobians.

    use (B, M): what each block counts at most; prior (N, N) or (B, N, N): what else holds the unknowns, and towards
    (N,) or (B, N) what, in units of information; passes: how often blocks are weighed anew; outlier: sigmas off at
    which one counts a quarter; trust (B, M): what each counts at first, if not its use; spare: so many residuals the
    unknowns take up; told that, misses are in units of their own spread where that is more; grows: whether the last
    unknown may be negative.
    Source: iteratively reweighted least squares with the weights of Geman and McClure.
    """
    batch, blocks, size, number = rows.shape
    flat, wanted = rows.reshape(batch, blocks * size, number), off.reshape(batch, blocks * size, 1)
    weight, excess = np.asarray(use if trust is None else trust, float), np.ones(batch)
    for _ in range(passes):
        pull = (flat * np.repeat(weight, size, 1)[..., None]).swapaxes(1, 2)
        information = pull @ flat
        held, force = information + prior, (pull @ wanted)[..., 0] + towards
        unknowns = np.linalg.solve(held, force[..., None])
        if not grows and (unknowns[:, -1, 0] < 0).any():
            held[:, -1, -1] += SHARP * (unknowns[:, -1, 0] < 0)
            unknowns = np.linalg.solve(held, force[..., None])
        miss = ((wanted - flat @ unknowns).reshape(off.shape) ** 2).sum(-1)
        if spare is not None:
            excess = excess_of(miss, weight, size, spare)
        weight = np.asarray(use * robust_weight(miss / np.maximum(excess, 1.0)[:, None], outlier), float)
    return LeastSquaresFit(unknowns[..., 0], information, held, miss, weight, excess)


def robust_weight(miss: Real, outlier: float = OUTLIER) -> Array:
    """Return the Geman-McClure weight of residual blocks with these chi-squares (...): 1 at 0, 1/4 at `outlier`
    sigmas."""
    return np.asarray(1 / (1 + miss / outlier**2) ** 2)


def excess_of(miss: Array, trust: Array, size: int, spare: float) -> Array:
    """(B,) reduced chi-square, at least 1: by how much chi-squares (B, M) of blocks of so many residuals, trusted so
    much (B, M), exceed what their sigmas predict, given so many unknowns."""
    return np.asarray((miss * trust).sum(1) / np.maximum(size * trust.sum(1) - spare, 1.0))


def whitener(covariance: Array) -> Array:
    """(..., D, D) what turns residuals with such covariances (..., D, D) into sigmas; a covariance that rounding has
    made indefinite, of what is hardly known, counts as far as it is positive."""
    try:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
    except np.linalg.LinAlgError:
        squares, ways = np.linalg.eigh(covariance)
        least = MIN_VARIANCE * np.abs(squares).max(-1, keepdims=True)
        return np.asarray(np.swapaxes(ways, -1, -2) / np.sqrt(np.maximum(squares, least))[..., None])


def chi_square_tail(chi2: float, dof: int) -> float:
    """Probability that a chi-square variable of `dof` degrees of freedom exceeds chi2; 1 for dof 0.

    Source: closed series for whole and half-whole gamma (Abramowitz & Stegun 26.4.4, 26.4.5).
    """
    if dof <= 0 or chi2 <= 0:
        return 1.0
    half = chi2 / 2
    if half > 700:
        return 0.0
    if dof % 2:
        tail = math.erfc(math.sqrt(half))
        term, start = math.exp(-half) * math.sqrt(half) / math.gamma(1.5), 1.5
    else:
        tail, term, start = 0.0, math.exp(-half), 1.0
    for k in range(dof // 2):
        tail += term
        term *= half / (start + k)
    return min(tail, 1.0)


@lru_cache(maxsize=1024)
def chi_square_limit(dof: int, probability: float) -> float:
    """The value a chi-square variable of `dof` exceeds with this small probability; 0 for dof 0. By bisection."""
    if dof <= 0:
        return 0.0
    low, high = 0.0, 20.0 * dof + 60.0  # beyond any tail that is told from 0
    for _ in range(60):
        middle = (low + high) / 2
        if chi_square_tail(middle, dof) > probability:
            low = middle
        else:
            high = middle
    return high


@dataclass(frozen=True, eq=False)
class Fits:
    """B fits. poses (B, 4, 4) seen_from_model, mm; covariance (B, 6, 6) as daemon/frames.py; chi2, dof, rms_mm (B,)."""

    poses: Array
    covariance: Array
    chi2: Array
    dof: Index
    rms_mm: Array


def fit_poses(
    observed_mm: Array,
    observed_covariance: Array,
    model_mm: Array,
    model_covariance: Array,
    used: Flags,
    tau_mm: float,
    start: tuple[Array, Array] | None = None,
) -> Fits:
    """Fit B models of matched corners to the seen ones, each corner weighed by its own predicted error.

    seen_mm (K, 3) in the cyclopean frame with covariance (K, 3, 3); model_mm (B, K, 3) their counterparts in the part
    frame with covariance (B, K, 3, 3); used (B, K) which of them count (at least three each, not on a line); tau_mm:
    how far a real part may deviate from the taught one; start: as rough_fit has rotations and shifts, where that was
    asked already. Source: Kabsch's closed form, then Gauss-Newton on the weighted
    residuals, weighed anew at each step.
    """
    rotation, shift = start or closed_form(observed_mm, observed_covariance, model_mm, used)
    whiten = normal = np.zeros(0)
    use = used.astype(float)
    for _ in range(STEPS):
        turned = model_mm @ rotation.transpose(0, 2, 1)
        whiten = whitener(_spread(observed_covariance, model_covariance, rotation, tau_mm))
        off = (whiten @ (observed_mm - turned - shift[:, None, :])[..., None])[..., 0]
        found = solve(whiten @ frames.point_motion(turned), off, use, np.zeros((6, 6)))
        motion, normal = found.unknowns, found.information
        rotation = frames.rotations_from_vectors(motion[:, 3:]) @ rotation
        shift = shift + motion[:, :3]
    residual = observed_mm - model_mm @ rotation.transpose(0, 2, 1) - shift[:, None, :]
    chi2 = (((whiten @ residual[..., None])[..., 0] ** 2).sum(2) * use).sum(1)
    count = used.sum(1)
    rms = np.sqrt(((residual**2).sum(2) * used).sum(1) / count)
    return Fits(frames.rigid(rotation, shift), np.asarray(np.linalg.inv(normal)), chi2, 3 * count - 6, rms)


def rough_fit(
    observed_mm: Array, observed_covariance: Array, model_mm: Array, used: Flags
) -> tuple[Array, Array, Array]:
    """Rotations (B, 3, 3), shifts (B, 3) and rms distances (B,) in mm after the closed form alone: enough to see which
    of many models are far off."""
    rotation, shift = closed_form(observed_mm, observed_covariance, model_mm, used)
    residual = observed_mm - model_mm @ rotation.transpose(0, 2, 1) - shift[:, None, :]
    return rotation, shift, np.asarray(np.sqrt(((residual**2).sum(2) * used).sum(1) / used.sum(1)))


def _spread(observed: Array, model: Array, rotation: Array, tau_mm: float) -> Array:
    """(B, K, 3, 3) covariance of all that may part a seen corner from its counterpart."""
    spread = rotation[:, None] @ model @ rotation.transpose(0, 2, 1)[:, None]
    return np.asarray(observed[None] + spread + tau_mm**2 * np.eye(3))


def closed_form(observed: Array, covariance: Array, model: Array, used: Flags) -> tuple[Array, Array]:
    """Kabsch for B models with one weight a corner: rotations (B, 3, 3), shifts (B, 3)."""
    weight = used / np.maximum(np.trace(covariance, axis1=1, axis2=2), 1e-9)[None]
    weight = weight / weight.sum(1, keepdims=True)
    seen_mean = weight @ observed
    model_mean = (weight[:, :, None] * model).sum(1)
    spread = (observed[None] - seen_mean[:, None]).transpose(0, 2, 1) @ (
        (model - model_mean[:, None]) * weight[:, :, None]
    )
    rotation = frames.nearest_rotation(spread)
    return rotation, seen_mean - (rotation @ model_mean[..., None])[..., 0]
