"""Perspective-three-point: poses from three corners in one image, thousands at once. Which corners those may be is
registration/pose_guesses.py's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array

STEPS = 4
NEAR = 1e-2  # of a squared distance, by which a solution may miss it
PAIRS = ((0, 1), (0, 2), (1, 2))


def p3p_poses(points_mm: Array, seen: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Where three points (T, 3, 3) mm would have to be to be seen at ideal coordinates (T, 3, 2): two guesses each.

    Returns poses (2 T, 4, 4) eye_from_part, the first guesses first, and which of them are solutions (2 T,). Source:
    Alter's closed form for a distant object (1994), then Newton's method on the three distances between the points.
    """
    length2 = np.stack([np.sum((points_mm[:, i] - points_mm[:, j]) ** 2, 1) for i, j in PAIRS])
    depths = _from_afar(length2, np.stack([np.sum((seen[:, i] - seen[:, j]) ** 2, 1) for i, j in PAIRS]))
    points, seen, length2 = (np.concatenate([x, x], axis) for x, axis in ((points_mm, 0), (seen, 0), (length2, 1)))
    rays = np.concatenate([seen, np.ones((*seen.shape[:2], 1))], 2)
    cosines = np.einsum("tik,tjk->tij", rays, rays)
    with np.errstate(all="ignore"):
        for _ in range(STEPS):
            miss, (a, b, c, d, e, f) = _distances(depths, cosines, length2)
            m, n, k = miss
            step = np.stack([b * d * k - d * e * m - b * f * n, a * f * n - a * d * k - c * f * m,
                             c * e * m - a * e * n - b * c * k], 1)  # fmt: skip
            depths = depths + step / (a * d * e + b * c * f)[:, None]
            depths = np.where(np.isfinite(depths), np.clip(depths, 1.0, 1e5), 1.0)
    solved = (np.abs(_distances(depths, cosines, length2)[0]) < NEAR * length2).all(0)
    there = rays * depths[..., None]
    turn = _frames(there) @ _frames(points).transpose(0, 2, 1)
    poses = np.zeros((len(rays), 4, 4))
    poses[:, :3, :3], poses[:, 3, 3] = turn, 1.0
    poses[:, :3, 3] = there.mean(1) - (turn @ points.mean(1)[..., None])[..., 0]
    return poses, np.asarray(solved & np.isfinite(poses).all((1, 2)))


def _distances(depths: Array, cosines: Array, length2: Array) -> tuple[Array, list[Array]]:
    """What the squared distances 01, 02, 12 are off (3, T), and their slopes by depth: 0 and 1, 0 and 2, 1 and 2."""
    miss, slopes = [], []
    for row, (i, j) in enumerate(PAIRS):
        one, other, own, far = depths[:, i], depths[:, j], cosines[:, i, i], cosines[:, j, j]
        both = cosines[:, i, j]
        miss.append(own * one**2 + far * other**2 - 2 * both * one * other - length2[row])
        slopes += [2 * (own * one - both * other), 2 * (far * other - both * one)]
    return np.stack(miss), slopes


def _from_afar(length2: Array, seen2: Array) -> Array:
    """Depths (2 T, 3) of three points under scaled orthographic projection, from squared distances (3, T) between them
    in space and in the image, in the order 01, 02, 12.
    """
    (p, q, r), (a, b, c) = length2, seen2
    area = 2 * (p * q + q * r + r * p) - p * p - q * q - r * r
    flat = 2 * (a * b + b * c + c * a) - a * a - b * b - c * c
    mixed = a * (q + r - p) + b * (p + r - q) + c * (p + q - r)
    scale2 = (mixed + np.sqrt(np.maximum(mixed**2 - area * flat, 0.0))) / np.maximum(area, 1e-9)
    first = np.sqrt(np.maximum(scale2 * p - a, 0.0))
    sign = np.where(a + b - c <= scale2 * (p + q - r), 1.0, -1.0)
    second = sign * np.sqrt(np.maximum(scale2 * q - b, 0.0))
    rise = np.stack([np.zeros_like(first), first, second], 1)
    scale = np.sqrt(np.maximum(scale2, 1e-12))[:, None]
    return np.concatenate([(1 + rise) / scale, (1 - rise) / scale])


def _frames(points: Array) -> Array:
    """(T, 3, 3) an orthonormal frame, in columns, that three points (T, 3, 3) carry with them."""
    x = points[:, 1] - points[:, 0]
    x = x / np.maximum(np.linalg.norm(x, axis=1), 1e-12)[:, None]
    z = np.cross(x, points[:, 2] - points[:, 0])
    z = z / np.maximum(np.linalg.norm(z, axis=1), 1e-12)[:, None]
    return np.stack([x, np.cross(z, x), z], 2)
