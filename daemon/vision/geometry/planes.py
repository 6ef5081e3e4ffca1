"""Planes through corners: the planarity test, the table, and what lies in it. Geometry only."""

from __future__ import annotations

import numpy as np

from daemon.arrays import Array
from daemon.vision.geometry.polygon_batch import Rings, rings


def fit_plane(points: Array) -> tuple[Array, float]:
    """Least-squares plane n . p = d of (N, 3) points: unit normal n towards the cameras (n_z <= 0), and d."""
    centre = points.mean(0)
    normal = np.linalg.svd(points - centre)[2][2]
    if normal @ centre > 0:
        normal = -normal
    return normal, float(normal @ centre)


def axes_in(normal: Array) -> Array:
    """(2, 3) unit axes, at right angles to each other, in a plane with a normal (3,) of any length."""
    return np.asarray(np.linalg.svd(normal[None])[2][1:])


def basis(x: Array, to: Array) -> Array:
    """(N, 3, 3) rotations whose columns are unit x (N, 3), the rest of `to` (N, 3) at right angles to it, and their
    cross product."""
    y = to - (x * to).sum(1, keepdims=True) * x
    y = y / np.maximum(np.linalg.norm(y, axis=1, keepdims=True), 1e-12)
    return np.stack([x, y, np.cross(x, y)], 2)


def apart2(one: Array, other: Array) -> Array:
    """(..., N, K) squares of the distances of points (..., N, 3) from each of others (..., K, 3)."""
    return np.asarray(sum((one[..., :, None, k] - other[..., None, :, k]) ** 2 for k in range(3)))


def fit_circle(points: Array) -> tuple[Array, float, float]:
    """Algebraic least-squares circle through (K, 2) points: centre, radius, and how far the worst point lies off it."""
    terms = np.column_stack([2 * points, np.ones(len(points))])
    solution = np.linalg.lstsq(terms, (points**2).sum(1), rcond=None)[0]
    centre = solution[:2]
    radius = float(np.sqrt(max(float(solution[2] + centre @ centre), 0.0)))
    return centre, radius, float(np.abs(np.linalg.norm(points - centre, axis=1) - radius).max())


def weighted_plane(points: Array, covariance: Array) -> tuple[Array, float, Array]:
    """Plane n . p = d with each corner weighted by how well it is known along the normal, and residuals in sigmas (N,).

    points (N, 3) mm, covariance (N, 3, 3) mm^2.
    """
    normal, d = fit_plane(points)
    for _ in range(2):
        sigma = np.sqrt(np.maximum(covariance @ normal @ normal, 1e-8))
        weight = 1 / sigma**2
        centre = (weight @ points) / weight.sum()
        normal = np.linalg.svd((points - centre) / sigma[:, None])[2][2]
        if normal @ centre > 0:
            normal = -normal
        d = float(normal @ centre)
    return normal, d, (points @ normal - d) / sigma


def planarity(points: Array) -> float:
    """Rms distance, mm, of the corners (N, 3) from their best plane."""
    return planarities(rings([points]))[0]


def planarities(shape: Rings) -> list[float]:
    """The same of many polygons in space."""
    count = shape.count[:, None]
    centred = shape.corners - np.repeat(shape.sums(shape.corners) / count, shape.count, axis=0)
    scatter = shape.sums(centred[:, :, None] * centred[:, None]) / count[:, None]
    least: list[float] = np.sqrt(np.maximum(np.linalg.eigvalsh(scatter)[:, 0], 0.0)).tolist()
    return least
