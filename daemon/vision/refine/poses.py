"""Poses and corners as both images have them: where a shape's corners show, how those move with its pose, how far edges
that were found are off. Which edges to look for, and what to make of the pose, is not decided here.
"""

from __future__ import annotations

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Camera, outward

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
