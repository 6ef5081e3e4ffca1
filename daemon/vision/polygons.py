"""One image -> the straight-sided polygons of its closed regions, corners to sub-pixel. Knows nothing of the
other eye.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.vision.data import Polygon
from daemon.vision.epipolar import Eye
from daemon.vision.image import Grey, Noise, measure_noise
from daemon.vision.regions import closed_regions, gradient, rough_polygon, signed_area, smooth
from daemon.vision.settings import VisionSettings
from daemon.vision.sides import Sides, find_sides, fit_sides

Array = NDArray[np.float64]

_STRAIGHT_DEG = 9.0
_INWARD_PX, _OUTWARD_PX = 2.0, 5.0
_BLUR_PX = 0.9


@dataclass(frozen=True, eq=False)
class Outline:
    """A polygon being worked on: corners (N, 2) px anticlockwise as seen, the border it came from, how well it
    fits (0..1).
    """

    corners: Array
    border: NDArray[np.int32]
    quality: float = 0.0
    sides: Sides | None = None


def find_polygons(image: Grey, eye: Eye, settings: VisionSettings) -> tuple[tuple[Polygon, ...], float]:
    """Polygons of one checked image, and its noise sigma at mid grey."""
    noise = measure_noise(image)
    smoothed = smooth(image, noise, settings.smoothing_px)
    strength = gradient(smoothed, settings.smoothing_px)
    outlines = []
    for level in settings.edge_levels:
        for border in closed_regions(strength, level, settings):
            corners = rough_polygon(border, settings)
            if corners is not None and len(corners) <= 14:
                outlines.append(Outline(corners, border))
    outlines = snap(smoothed, outlines, settings)
    outlines = fit(image.astype(np.float32), noise, outlines, eye, settings)
    chosen = choose(outlines)
    return tuple(_polygon(o) for o in chosen), float(noise.sigma[128])


def snap(smoothed: NDArray[np.float32], outlines: list[Outline], settings: VisionSettings) -> list[Outline]:
    """Move the sides of rough outlines onto the gradient; drop corners that turn too little and sides too short."""
    if not outlines:
        return []
    start = np.concatenate([o.corners for o in outlines])
    end = np.concatenate([np.roll(o.corners, -1, 0) for o in outlines])
    start, end = find_sides(smoothed, start, end, _INWARD_PX, _OUTWARD_PX)
    cuts = np.cumsum([len(o.corners) for o in outlines])[:-1]
    kept = []
    for o, s, e in zip(outlines, np.split(start, cuts), np.split(end, cuts), strict=True):
        corners = tidy(corners_of(s, e), settings.min_side_px)
        if corners is not None and is_simple(corners):
            kept.append(Outline(corners, o.border))
    return kept


def fit(
    image: NDArray[np.float32], noise: Noise, outlines: list[Outline], eye: Eye, settings: VisionSettings
) -> list[Outline]:
    """Fit every side to the grey levels; keep outlines all of whose sides are really there."""
    if not outlines:
        return []
    start = np.concatenate([o.corners for o in outlines])
    end = np.concatenate([np.roll(o.corners, -1, 0) for o in outlines])
    all_sides = fit_sides(image, noise, start, end, eye, _BLUR_PX)
    kept, first = [], 0
    for o in outlines:
        n = len(o.corners)
        part = slice(first, first + n)
        first += n
        sides = Sides(*(getattr(all_sides, k)[part] for k in Sides.__dataclass_fields__))
        corners = corners_of(sides.start, sides.end)
        moved = np.abs(corners - o.corners).max()
        if (
            moved < 6
            and sides.evidence.min() > settings.min_evidence
            and sides.support.min() > 0.5
            and is_simple(corners)
        ):
            length = np.linalg.norm(o.corners - np.roll(o.corners, -1, 0), axis=1)
            quality = float(np.sum(sides.support * length) / length.sum()) - 0.01 * n
            kept.append(Outline(corners, o.border, quality, sides))
    return kept


def choose(outlines: list[Outline]) -> list[Outline]:
    """Of outlines of the same region (overlap over 70 %) the one that fits best."""
    chosen: list[Outline] = []
    for o in sorted(outlines, key=lambda o: -o.quality):
        if all(overlap(o.corners, c.corners) < 0.7 for c in chosen):
            chosen.append(o)
    return chosen


def overlap(a: Array, b: Array) -> float:
    """Intersection over union of two polygons, (N, 2) px; exact when both are convex."""
    low, high = np.maximum(a.min(0), b.min(0)), np.minimum(a.max(0), b.max(0))
    if np.any(high <= low):
        return 0.0
    common = float(cv2.intersectConvexConvex(a.astype(np.float32), b.astype(np.float32))[0])
    union = abs(signed_area(a)) + abs(signed_area(b)) - common
    return common / max(union, 1e-9)


def corners_of(start: Array, end: Array) -> Array:
    """Meeting points (N, 2) of each side's line with the one before it; sides (N, 2) start -> end, in order
    round the polygon.
    """
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
            k = int(np.argmin(length))
            corners = _drop_side(corners, k)
            continue
        before = np.roll(chord, 1, 0)
        turn = np.abs(
            np.degrees(np.arctan2(before[:, 0] * chord[:, 1] - before[:, 1] * chord[:, 0], np.sum(before * chord, 1)))
        )
        if turn.min() > _STRAIGHT_DEG:
            return corners
        corners = np.delete(corners, int(np.argmin(turn)), axis=0)
    return None


def _drop_side(corners: Array, k: int) -> Array:
    """Replace side k by the corner where its neighbours' lines meet, or by its middle where they meet far away."""
    n = len(corners)
    a, b, c, d = (corners[(k + i) % n] for i in (-1, 0, 1, 2))
    meet = corners_of(np.array([a, c]), np.array([b, d]))[1]
    middle = (b + c) / 2
    if not np.all(np.isfinite(meet)) or np.linalg.norm(meet - middle) > 6:
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


def _polygon(o: Outline) -> Polygon:
    assert o.sides is not None
    return Polygon(o.corners, corner_covariance(o.sides), np.abs(o.sides.step), o.border.astype(float))


def corner_covariance(sides: Sides) -> Array:
    """Covariance (N, 2, 2) px^2 of corners where side k-1 ends and side k starts."""
    chord = sides.end - sides.start
    normal = np.stack([chord[:, 1], -chord[:, 0]], 1) / np.linalg.norm(chord, axis=1)[:, None]
    both = np.stack([np.roll(normal, 1, 0), normal], 1)
    inverse = np.linalg.pinv(both)
    variance = np.stack([np.roll(sides.covariance[:, 1, 1], 1), sides.covariance[:, 0, 0]], 1)
    return np.asarray(inverse * variance[:, None, :] @ np.swapaxes(inverse, 1, 2))
