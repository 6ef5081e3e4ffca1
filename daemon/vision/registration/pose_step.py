"""One step of laying a known shape onto image edges: where its corners show, how those move with its pose, and the
motion that brings the edges onto those that were found. Which edges to look for, and what to make of the pose, is not
decided here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Camera

TUKEY = 5.6
"""So many sigmas off, an edge counts no more."""


@dataclass(frozen=True, eq=False)
class Solved:
    """motion (..., 6) as daemon/frames.py has it; information (..., 6, 6) of the edges that agree; excess (...): how
    much worse these fit than they should (chi-square a degree of freedom, 1 at least)."""

    motion: Array
    information: Array
    excess: Array


def corners_in(camera: Camera, cyclopean_from_part: Array, corners_mm: Array) -> tuple[Array, Array]:
    """Where an eye sees corners (K, 3) of a part, at one pose (4, 4) or each at its own (K, 4, 4): (K, 2) px, and their
    derivative (K, 2, 6) by a motion of the pose."""
    levers = (cyclopean_from_part[..., :3, :3] @ corners_mm[..., None])[..., 0]
    px, slope = camera.project_with_slope(levers + cyclopean_from_part[..., :3, 3])
    return px, slope @ frames.point_motion(levers)


def moved(poses: Array, motions: Array) -> Array:
    """Poses (P, 4, 4), each by its motion (P, 6)."""
    found = poses.copy()
    found[:, :3, :3] = frames.rotations_from_vectors(motions[:, 3:]) @ poses[:, :3, :3]
    found[:, :3, 3] += motions[:, :3]
    return found


def across(start: Array, end: Array) -> Array:
    """(E, 2) unit vectors across edges start -> end, (E, 2) each."""
    chord = end - start
    length = np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-6)
    return np.asarray(np.stack([chord[:, 1], -chord[:, 0]], 1) / length[:, None])


def off_places(start: Array, end: Array, found_start: Array, found_end: Array) -> Array:
    """(E, 2) px how far the ends of edges found are from the ends expected, across the expected edge; each (E, 2)."""
    normal = across(start, end)
    return np.stack([((found_start - start) * normal).sum(1), ((found_end - end) * normal).sum(1)], 1)


def solve(off: Array, jacobian: Array, weight: Array, usable: Array, prior: Array, tukey: float, passes: int) -> Solved:
    """The motion that takes the edges' ends off (..., E, 2) px away, robustly, and not much farther than the prior
    (6, 6); one for each of the leading axes, on which poses are solved for side by side.

    jacobian (..., E, 2, 6) of the ends by the motion; weight (..., E, 2, 2), the inverse of their covariance; usable
    (..., E), 0 or 1; tukey: so many sigmas off, an edge counts no more.
    Source: Gauss-Newton with Tukey's weights, as Harris's RAPiD does point by point.
    """
    by_row = (*off.shape[:-2], -1)
    pull = np.swapaxes((weight @ jacobian).reshape(*by_row, 6), -1, -2)
    rows, wanted = jacobian.reshape(*by_row, 6), (weight @ off[..., None]).reshape(by_row)
    trust: NDArray[Any] = usable
    motion, information, chi2 = np.zeros(6), np.zeros((6, 6)), np.zeros(())
    for _ in range(passes):
        each = np.repeat(trust, 2, -1)
        information = (pull * each[..., None, :]) @ rows
        towards = np.swapaxes(rows, -1, -2) @ (wanted * each)[..., None]
        motion = np.linalg.solve(information + prior, towards)[..., 0]
        left = off - (rows @ motion[..., None]).reshape(off.shape)
        miss = ((weight @ left[..., None])[..., 0] * left).sum(-1)
        chi2 = (miss * trust).sum(-1) / np.maximum(2.0 * trust.sum(-1) - 6.0, 1.0)
        trust = usable * np.maximum(1 - miss / tukey**2, 0.0) ** 2
    return Solved(motion, information, np.maximum(chi2, 1.0))
