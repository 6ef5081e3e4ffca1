"""One step of laying a known shape onto image edges: where its corners show, how those move with its pose, and the
motion that brings the edges onto those that were found. Which edges to look for, and what to make of the pose, is not
decided here.
"""

from __future__ import annotations

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Camera, outward

TUKEY = 5.6
"""So many sigmas off, an edge counts no more."""
SCALE = np.array([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
"""Turns are weighed at a lever of some 30 mm, so that mm and rad compare."""


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


def turned(poses: Array, turns: Array, points: Array) -> Array:
    """Poses (P, 4, 4), each turned (P, 3, 3) about a point (P, 3) of the frame they lead to."""
    found = poses.copy()
    found[:, :3, :3] = turns @ poses[:, :3, :3]
    found[:, :3, 3] = points + (turns @ (poses[:, :3, 3] - points)[..., None])[..., 0]
    return found


def across(start: Array, end: Array) -> Array:
    """(E, 2) unit vectors across edges start -> end, (E, 2) each."""
    chord = start - end
    return outward(chord, np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-6))


def off_places(start: Array, end: Array, found_start: Array, found_end: Array) -> Array:
    """(E, 2) px how far the ends of edges found are from the ends expected, across the expected edge; each (E, 2)."""
    normal = across(start, end)
    return np.stack([((found_start - start) * normal).sum(1), ((found_end - end) * normal).sum(1)], 1)


def solve(
    off: Array, jacobian: Array, weight: Array, usable: Array, prior: Array, tukey: float, passes: int
) -> tuple[Array, Array]:
    """The motion (6,) that takes the edges' ends off (E, 2) px away, robustly, and not much farther than the prior
    (6, 6), as daemon/frames.py has it; and the information (6, 6) of the edges that agree.

    jacobian (E, 2, 6) of the ends by the motion; weight (E, 2, 2), the inverse of their covariance; usable (E,), 0 or
    1; tukey: so many sigmas off, an edge counts no more.
    Source: Gauss-Newton with Tukey's weights, as Harris's RAPiD does point by point.
    """
    rows, wanted = jacobian.reshape(-1, 6), (weight @ off[..., None]).reshape(-1)
    pull = (weight @ jacobian).reshape(-1, 6).T
    trust = usable
    motion: Array = np.zeros(6)
    information: Array = np.zeros((6, 6))
    for _ in range(passes):
        each = np.repeat(trust, 2)
        information = (pull * each) @ rows
        motion = np.asarray(np.linalg.solve(information + prior, rows.T @ (wanted * each)), float)
        left = off - (rows @ motion).reshape(off.shape)
        miss = ((weight @ left[..., None])[..., 0] * left).sum(-1)
        trust = usable * np.maximum(1 - miss / tukey**2, 0.0) ** 2
    return motion, information
