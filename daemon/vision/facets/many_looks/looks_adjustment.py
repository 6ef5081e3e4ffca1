"""Corners that several looks measured, the places they were measured from and the errors that all of them share,
estimated together. Pure; which corners are one is association.py's.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.arrays import Array, Index
from daemon.vision.facets.one_look.corner_adjustment import flatness, planes_by_size
from daemon.vision.geometry import robust_weight, solve, whitener

OUTLIER = 8.0  # sigmas off at which a corner counts a quarter: three residuals each, of errors that are predicted well
ROUNDS = 6
MIN_MM2 = 1e-6  # keeps the weight of a corner known exactly finite
FREE_MM = 1.0  # how far a corner that nothing holds may lie from where it began
NONE = np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class LookCorners:
    """Corners of one look: points_mm (N, 3), cyclopean, with covariance_mm2 (N, 3, 3); owner (N,) which corner of the
    thing each is; base_from_cyclopean (4, 4) as the arm says, covariance (6, 6) of what errs in it anew each time;
    focal_px, baseline_mm of the rig."""

    points_mm: Array
    covariance_mm2: Array
    owner: Index
    base_from_cyclopean: Array
    covariance: Array
    focal_px: float
    baseline_mm: float


@dataclass(frozen=True, eq=False)
class FusedCorners:
    """corners_mm (V, 3) base; covariance_mm2 (3 V, 3 V) of all together; places (L, 4, 4) base_from_cyclopean; error
    (9,), which all looks share; misfit: rms of what is left, sigmas."""

    corners_mm: Array
    covariance_mm2: Array
    places: Array
    error: Array
    misfit: float


def shared_motion(points_mm: Array, focal_px: float, baseline_mm: float) -> Array:
    """(N, 3, 9) how points (N, 3), cyclopean, move with the errors that all looks share: hand-eye (6), in the cyclopean
    frame, then u, v and disparity offsets of the cameras, px."""
    x, y, z = points_mm.T
    rows = np.zeros((len(points_mm), 3, 9))
    rows[:, :, :6] = frames.point_motion(points_mm)
    rows[:, 0, 6] = rows[:, 1, 7] = z / focal_px
    rows[:, :, 8] = -np.stack([x, y, z], 1) * (z / (focal_px * baseline_mm))[:, None]
    return rows


def adjust_looks(
    looks: Sequence[LookCorners], planes: Sequence[Index], shared: Array, unseen: Array = NONE
) -> FusedCorners:
    """Least-squares corners, places and shared errors. planes: corner numbers of each facet of four or more; shared
    (9, 9): covariance of the shared errors; unseen (U, 3): where corners begin that no look measured, which come behind
    the others, and which planes alone hold.

    Source: least squares with priors; a corner that stays off by several sigmas loses its say.
    """
    owner = np.concatenate([one.owner for one in looks])
    own = np.repeat(np.arange(len(looks)), [len(one.points_mm) for one in looks])
    measured, here = int(owner.max()) + 1, np.arange(len(owner))
    count = measured + len(unseen)
    held = np.where(np.arange(count) < measured, 1e-9, FREE_MM**-2)
    corners = np.concatenate([np.zeros((measured, 3)), unseen])
    np.add.at(corners, owner, np.concatenate([frames.apply(k.base_from_cyclopean, k.points_mm) for k in looks]))
    corners[:measured] /= np.bincount(owner, minlength=measured)[:, None]
    first, last = 3 * count, 3 * count + 6 * len(looks)
    prior = np.zeros((last + 9, last + 9))
    for k, one in enumerate(looks):
        at = slice(first + 6 * k, first + 6 * k + 6)
        prior[at, at] = np.linalg.inv(one.covariance)
    prior[last:, last:] = np.linalg.inv(shared)
    alike = planes_by_size(planes)
    places, off, trust = [one.base_from_cyclopean for one in looks], np.zeros(last + 9), np.ones(len(owner))
    hessian, squares = prior, 0.0
    for turn in range(ROUNDS):
        seen = [_seen(one, place, off[last:]) for one, place in zip(looks, places, strict=True)]
        moved, slopes, whiten = (np.concatenate(every) for every in zip(*seen, strict=True))
        far = (whiten @ (moved - corners[owner])[..., None])[..., 0]
        miss = (far**2).sum(1)
        squares = float(trust @ miss)
        if turn:
            trust = robust_weight(miss / max(1.0, squares / (3 * trust.sum())), OUTLIER)
        rows = np.zeros((len(owner), 3, last + 9))
        rows[here[:, None, None], np.arange(3)[:, None], (3 * owner[:, None] + np.arange(3))[:, None]] = -np.eye(3)
        rows[here[:, None, None], np.arange(3)[:, None], (first + 6 * own[:, None] + np.arange(6))[:, None]] = slopes[
            :, :, :6
        ]
        rows[:, :, last:] = slopes[:, :, 6:]
        flat = flatness(corners, alike)
        hold, towards = prior.copy(), -prior @ off
        hold[:first, :first] += flat.T @ flat + np.diag(np.repeat(held, 3))
        towards[:first] -= flat.T @ (flat @ corners.ravel())
        found = solve((whiten @ rows)[None], -far[None], trust[None], hold, towards)
        step, hessian = found.unknowns[0], found.held[0]
        corners = corners + step[:first].reshape(-1, 3)
        off[first:] += step[first:]
        moves = off[first:last].reshape(-1, 6)
        places = [frames.perturb(k.base_from_cyclopean, move) for k, move in zip(looks, moves, strict=True)]
        if turn > 1 and np.abs(step[:first]).max() < 1e-4:
            break
    free = max(3 * float(trust.sum()) - first + sum(len(p) - 3 for p in planes), 1.0)
    misfit = float(np.sqrt(squares / free))
    covariance = np.asarray(np.linalg.inv(hessian), float)[:first, :first] * max(1.0, misfit**2)
    return FusedCorners(corners, covariance, np.array(places), off[last:], misfit)


def _seen(one: LookCorners, place: Array, error: Array) -> tuple[Array, Array, Array]:
    """A look's corners in the base (N, 3), how they move with its place and the shared errors (N, 3, 15), and the
    what turns each into sigmas (N, 3, 3)."""
    turn = place[:3, :3]
    shared = shared_motion(one.points_mm, one.focal_px, one.baseline_mm)
    moved = frames.apply(place, one.points_mm + shared @ error)
    slopes = np.concatenate([frames.point_motion(one.points_mm @ turn.T), turn @ shared], axis=2)
    return moved, slopes, whitener(turn @ one.covariance_mm2 @ turn.T + MIN_MM2 * np.eye(3))
