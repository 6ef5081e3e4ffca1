"""Rigid fit of a taught metric model to seen corners: pose, its covariance, and the chi-square of what is left.

In: matched corners in mm with covariances. Out: poses. Proper rotations only: a mirrored part is another part.
All correspondences are fitted at once, because a look has milliseconds.
"""

from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags, Index
from daemon.vision.geometry.robust_least_squares import solve, whitener

STEPS = 2  # Gauss-Newton steps after the closed-form start; a third would be below a micrometre


@dataclass(frozen=True, eq=False)
class Fits:
    """B fits. poses (B, 4, 4) seen_from_model, mm; covariance (B, 6, 6) as daemon/frames.py; chi2, dof, rms_mm (B,)."""

    poses: Array
    covariance: Array
    chi2: Array
    dof: Index
    rms_mm: Array


def fit_poses(
    seen_mm: Array,
    seen_covariance: Array,
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
    rotation, shift = start or closed_form(seen_mm, seen_covariance, model_mm, used)
    whiten = normal = np.zeros(0)
    use = used.astype(float)
    for _ in range(STEPS):
        turned = model_mm @ rotation.transpose(0, 2, 1)
        whiten = whitener(_spread(seen_covariance, model_covariance, rotation, tau_mm))
        off = (whiten @ (seen_mm - turned - shift[:, None, :])[..., None])[..., 0]
        found = solve(whiten @ frames.point_motion(turned), off, use, np.zeros((6, 6)))
        motion, normal = found.unknowns, found.information
        rotation = frames.rotations_from_vectors(motion[:, 3:]) @ rotation
        shift = shift + motion[:, :3]
    residual = seen_mm - model_mm @ rotation.transpose(0, 2, 1) - shift[:, None, :]
    chi2 = (((whiten @ residual[..., None])[..., 0] ** 2).sum(2) * use).sum(1)
    count = used.sum(1)
    rms = np.sqrt(((residual**2).sum(2) * used).sum(1) / count)
    return Fits(frames.rigid(rotation, shift), np.asarray(np.linalg.inv(normal)), chi2, 3 * count - 6, rms)


def rough_fit(seen_mm: Array, seen_covariance: Array, model_mm: Array, used: Flags) -> tuple[Array, Array, Array]:
    """Rotations (B, 3, 3), shifts (B, 3) and rms distances (B,) in mm after the closed form alone: enough to see which
    of many models are far off."""
    rotation, shift = closed_form(seen_mm, seen_covariance, model_mm, used)
    residual = seen_mm - model_mm @ rotation.transpose(0, 2, 1) - shift[:, None, :]
    return rotation, shift, np.asarray(np.sqrt(((residual**2).sum(2) * used).sum(1) / used.sum(1)))


def _spread(seen: Array, model: Array, rotation: Array, tau_mm: float) -> Array:
    """(B, K, 3, 3) covariance of all that may part a seen corner from its counterpart."""
    spread = rotation[:, None] @ model @ rotation.transpose(0, 2, 1)[:, None]
    return np.asarray(seen[None] + spread + tau_mm**2 * np.eye(3))


def closed_form(seen: Array, covariance: Array, model: Array, used: Flags) -> tuple[Array, Array]:
    """Kabsch for B models with one weight a corner: rotations (B, 3, 3), shifts (B, 3)."""
    weight = used / np.maximum(np.trace(covariance, axis1=1, axis2=2), 1e-9)[None]
    weight = weight / weight.sum(1, keepdims=True)
    seen_mean = weight @ seen
    model_mean = (weight[:, :, None] * model).sum(1)
    spread = (seen[None] - seen_mean[:, None]).transpose(0, 2, 1) @ ((model - model_mean[:, None]) * weight[:, :, None])
    rotation = frames.nearest_rotation(spread)
    return rotation, seen_mean - (rotation @ model_mean[..., None])[..., 0]
