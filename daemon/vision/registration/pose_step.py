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
from daemon.vision.geometry.rig import Camera

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Solved:
    """motion (6,) as daemon/frames.py has it; information (6, 6) of the edges that agree; excess: how much worse these
    fit than they should (chi-square a degree of freedom, 1 at least)."""

    motion: Array
    information: Array
    excess: float


def corners_in(camera: Camera, cyclopean_from_part: Array, corners_mm: Array) -> tuple[Array, Array]:
    """Where an eye sees a part's corners (K, 3): (K, 2) px, and their derivative (K, 2, 6) by a motion of the pose."""
    levers = corners_mm @ cyclopean_from_part[:3, :3].T
    px, slope = camera.project_with_slope(levers + cyclopean_from_part[:3, 3])
    return px, slope @ frames.point_motion(levers)


def across(start: Array, end: Array) -> Array:
    """(E, 2) unit vectors across edges start -> end, (E, 2) each."""
    chord = end - start
    length = np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-6)
    return np.asarray(np.stack([chord[:, 1], -chord[:, 0]], 1) / length[:, None])


def off_places(start: Array, end: Array, found_start: Array, found_end: Array) -> Array:
    """(E, 2) px how far the ends of edges found are from the ends expected, across the expected edge; each (E, 2)."""
    normal = across(start, end)
    return np.stack([((found_start - start) * normal).sum(1), ((found_end - end) * normal).sum(1)], 1)


def solve(
    off: Array, jacobian: Array, weight: Array, usable: Array, prior: Array, tukey: float, passes: int, floor: float = 0
) -> Solved:
    """The motion that takes the edges' ends off (E, 2) px away, robustly, and not much farther than the prior (6, 6).

    jacobian (E, 2, 6) of the ends by the motion; weight (E, 2, 2), the inverse of their covariance; usable (E,), 0 or
    1; tukey: so many sigmas off, an edge counts no more than floor.
    Source: Gauss-Newton with Tukey's weights, as Harris's RAPiD does point by point.
    """
    pull = weight @ jacobian
    rows, wanted = jacobian.reshape(-1, 6), (weight @ off[..., None])[..., 0]
    trust: NDArray[Any] = usable
    motion, information, chi2 = np.zeros(6), np.zeros((6, 6)), 0.0
    for _ in range(passes):
        each = np.repeat(trust, 2)
        information = (pull.reshape(-1, 6) * each[:, None]).T @ rows
        motion = np.linalg.solve(information + prior, rows.T @ (wanted.reshape(-1) * each))
        left = off - jacobian @ motion
        miss = ((weight @ left[..., None])[..., 0] * left).sum(1)
        chi2 = float(miss @ trust) / max(2.0 * float(trust.sum()) - 6.0, 1.0)
        trust = usable * np.maximum(1 - miss / tukey**2, 0.0) ** 2 + floor
    return Solved(motion, information, max(chi2, 1.0))
