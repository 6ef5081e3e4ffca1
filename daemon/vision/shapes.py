"""Plane polygons as arrays of corners (N, 2), anticlockwise as seen with v down. Plain geometry, no pixels are
looked at.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_STRAIGHT_DEG = 9.0


def split(values: Array, counts: list[int]) -> list[Array]:
    """Cut (sum of counts, ...) into one array per count."""
    return np.split(values, np.cumsum(counts)[:-1])


def signed_area(corners: Array) -> float:
    """Shoelace area in px^2; negative for corners that run anticlockwise as seen (v points down)."""
    x, y = corners[:, 0], corners[:, 1]
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def overlap(a: Array, b: Array) -> tuple[float, float]:
    """Common area of two polygons over that of their union, and over the smaller one; exact when both are convex."""
    low, high = np.maximum(a.min(0), b.min(0)), np.minimum(a.max(0), b.max(0))
    if np.any(high <= low):
        return 0.0, 0.0
    common = float(cv2.intersectConvexConvex(a.astype(np.float32), b.astype(np.float32))[0])
    areas = abs(signed_area(a)), abs(signed_area(b))
    return common / max(sum(areas) - common, 1e-9), common / max(min(areas), 1e-9)


def corners_of(start: Array, end: Array) -> Array:
    """Meeting points (N, 2) of each side's line with the one before it; sides (N, 2) start -> end in order."""
    line = np.cross(_homogeneous(start), _homogeneous(end))
    meet = np.cross(np.roll(line, 1, 0), line)
    scale = np.where(np.abs(meet[:, 2:]) < 1e-9, 1e-9, meet[:, 2:])
    return np.asarray(meet[:, :2] / scale)


def _homogeneous(p: Array) -> Array:
    return np.concatenate([p, np.ones((len(p), 1))], 1)


def tidy(corners: Array, min_side_px: float) -> Array | None:
    """Take out corners that hardly turn, and sides too short to measure; None when fewer than three corners
    are left.
    """
    while len(corners) >= 3:
        chord = np.roll(corners, -1, 0) - corners
        length = np.linalg.norm(chord, axis=1)
        if not np.all(np.isfinite(length)) or length.max() > 2000:
            return None
        if length.min() < min_side_px:
            corners = drop_side(corners, int(np.argmin(length)))
            continue
        turn = turns_deg(corners)
        if np.abs(turn).min() < _STRAIGHT_DEG:
            corners = np.delete(corners, int(np.argmin(np.abs(turn))), axis=0)
            continue
        return corners
    return None


def turns_deg(corners: Array) -> Array:
    """How far the outline turns at each corner, degrees (N,); negative where a convex polygon turns."""
    chord = np.roll(corners, -1, 0) - corners
    before = np.roll(chord, 1, 0)
    cross = before[:, 0] * chord[:, 1] - before[:, 1] * chord[:, 0]
    return np.asarray(np.degrees(np.arctan2(cross, np.sum(before * chord, 1))))


def drop_side(corners: Array, k: int) -> Array:
    """Replace side k by the corner where its neighbours' lines meet, or by its middle where they meet far away."""
    n = len(corners)
    a, b, c, d = (corners[(k + i) % n] for i in (-1, 0, 1, 2))
    meet = corners_of(np.array([a, c]), np.array([b, d]))[1]
    middle = (b + c) / 2
    reach = 25.0 if n > 3 else 0.0
    if not np.all(np.isfinite(meet)) or np.linalg.norm(meet - middle) > reach:
        meet = middle
    out = corners.copy()
    out[k] = meet
    return np.delete(out, (k + 1) % n, axis=0)


def is_simple(corners: Array) -> bool:
    """Whether the polygon runs anticlockwise as seen and no two sides cross."""
    if not np.all(np.isfinite(corners)) or signed_area(corners) >= 0:
        return False
    n = len(corners)
    a, b = corners, np.roll(corners, -1, 0)
    side = b - a
    rel = a[None, :, :] - a[:, None, :]
    cross = side[:, None, 0] * side[None, :, 1] - side[:, None, 1] * side[None, :, 0]
    safe = np.where(np.abs(cross) < 1e-12, np.inf, cross)
    s = (rel[..., 0] * side[None, :, 1] - rel[..., 1] * side[None, :, 0]) / safe
    t = (rel[..., 0] * side[:, None, 1] - rel[..., 1] * side[:, None, 0]) / safe
    i, j = np.indices((n, n))
    apart = (i != j) & ((i + 1) % n != j) & ((j + 1) % n != i)
    return not bool(np.any(apart & (s > 0) & (s < 1) & (t > 0) & (t < 1)))
