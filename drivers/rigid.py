"""Rigid transforms of the drivers: 4x4 matrices `b_from_a`, mm and radians. The daemon has its own."""

import numpy as np
from numpy.typing import ArrayLike

from drivers.arrays import Array


def rigid(rotation: ArrayLike, translation_mm: ArrayLike) -> Array:
    """Rigid transform (4, 4) of a (3, 3) rotation and (3,) mm."""
    b_from_a = np.eye(4)
    b_from_a[:3, :3] = rotation
    b_from_a[:3, 3] = translation_mm
    return b_from_a


def inverse(b_from_a: Array) -> Array:
    """Inverse a_from_b of a rigid (4, 4) b_from_a."""
    turned_back = b_from_a[:3, :3].T
    return rigid(turned_back, -turned_back @ b_from_a[:3, 3])


def apply(b_from_a: Array, points: Array) -> Array:
    """Transform (..., 3) points from a to b."""
    return points @ b_from_a[:3, :3].T + b_from_a[:3, 3]


def turn(axis: ArrayLike, angle_rad: float) -> Array:
    """Rotation (3, 3) by angle_rad about a (3,) axis of any length but zero (Rodrigues)."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle_rad) * cross + (1.0 - np.cos(angle_rad)) * (cross @ cross))


def turn_between(start: Array, end: Array) -> Array:
    """Smallest rotation (3, 3) from the direction start (3,) to the direction end (3,)."""
    a, b = start / np.linalg.norm(start), end / np.linalg.norm(end)
    axis = np.cross(a, b)
    sine, cosine = float(np.linalg.norm(axis)), float(a @ b)
    if sine < 1e-12:
        axis = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
    return turn(axis, float(np.arctan2(sine, cosine)))


def axis_and_angle(rotation: Array) -> tuple[Array, float]:
    """Unit axis (3,) and angle, rad, 0 to pi, of a (3, 3) rotation."""
    r = rotation
    skew = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    sine = float(np.linalg.norm(skew)) / 2
    angle = float(np.arctan2(sine, (np.trace(r) - 1.0) / 2.0))
    if sine > 1e-9:
        return skew / (2 * sine), angle
    outer = (r + np.eye(3)) / 2
    k = int(np.argmax(np.diag(outer)))
    return outer[:, k] / np.linalg.norm(outer[:, k]), angle


def angle_of(rotation: Array) -> float:
    """Angle in rad, 0 to pi, of a (3, 3) or (4, 4) rotation."""
    return axis_and_angle(rotation[:3, :3])[1]
