"""Outlines: polygons still being worked on. From the borders of closed regions to sides that lie on the gradient.

Several outlines of one region may live side by side (with and without a doubtful corner); which of them is true is
decided when both eyes are compared. Final corners come from fit.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.vision.regions import Scale, closed_regions, rough_polygons
from daemon.vision.settings import VisionSettings
from daemon.vision.shapes import corners_of, drop_side, is_simple, signed_area, split, tidy
from daemon.vision.sides import find_sides, probe_sides

Array = NDArray[np.float64]

_FIRST_REACH_PX = (2.0, 5.0)
_SECOND_REACH_PX = (1.5, 1.5)
_DOUBTFUL_SIDE = 0.6


@dataclass(frozen=True, eq=False)
class Outline:
    """corners (N, 2) px anticlockwise as seen; border (K, 2) px it came from; per side (N,): slope across it in
    sigmas of its mean over the side, and the fraction of its length where an edge is seen.
    """

    corners: Array
    border: NDArray[np.int32]
    strength: Array
    seen: Array

    @property
    def support(self) -> float:
        """Fraction of the perimeter where an edge is seen."""
        length = np.linalg.norm(np.roll(self.corners, -1, 0) - self.corners, axis=1)
        return float(np.sum(length * self.seen) / np.sum(length))


def find_outlines(scales: tuple[Scale, ...], settings: VisionSettings) -> list[Outline]:
    """Outlines of the closed regions at every scale and level, without repeats, best supported first."""
    rough = [
        (corners, border)
        for scale in scales
        for level in scale.levels
        for border in closed_regions(scale.strength, level, settings)
        for corners in rough_polygons(border, settings)
    ]
    rough.sort(key=lambda r: signed_area(r[0]))
    rough = _distinct(rough)[: settings.max_regions]
    fine = scales[0].smoothed
    first = snap(fine, [c for c, _ in rough], _FIRST_REACH_PX)
    variants = [(v, b) for corners, (_, b) in zip(first, rough, strict=True) for v in _variants(corners, settings)]
    variants = _distinct(variants)
    second = snap(fine, [c for c, _ in variants], _SECOND_REACH_PX)
    kept = [
        (c, b)
        for c, (_, b) in zip(second, variants, strict=True)
        if is_simple(c) and -signed_area(c) > settings.min_area_px
    ]
    probed = sorted(probe(fine, kept, settings), key=lambda o: -o.support)
    keep = _first_of_each([o.corners for o in probed])
    return [probed[k] for k in keep]


def _distinct(polygons: list[tuple[Array, NDArray[np.int32]]]) -> list[tuple[Array, NDArray[np.int32]]]:
    return [polygons[k] for k in _first_of_each([c for c, _ in polygons])]


def _first_of_each(polygons: list[Array], tolerance_px: float = 2.0) -> list[int]:
    """Indices of the polygons that do not repeat an earlier one corner by corner."""
    kept: list[int] = []
    middles = np.array([p.mean(0) for p in polygons]).reshape(-1, 2)
    counts = np.array([len(p) for p in polygons])
    for k, p in enumerate(polygons):
        earlier = np.array(kept, dtype=np.intp)
        near = earlier[
            (counts[earlier] == len(p))
            & (np.abs(middles[earlier] - middles[k]).max(axis=1, initial=0.0) < tolerance_px)
        ]
        if not any(_same(p, polygons[e], tolerance_px) for e in near):
            kept.append(k)
    return kept


def _same(a: Array, b: Array, tolerance_px: float) -> bool:
    first = int(np.argmin(np.abs(b - a[0]).max(1)))
    return bool(np.abs(np.roll(b, -first, 0) - a).max() < tolerance_px)


def snap(smoothed: NDArray[np.float32], polygons: list[Array], reach_px: tuple[float, float]) -> list[Array]:
    """Each polygon with its sides moved onto the gradient and met again in corners."""
    if not polygons:
        return []
    start = np.concatenate(polygons)
    end = np.concatenate([np.roll(p, -1, 0) for p in polygons])
    start, end = find_sides(smoothed, start, end, reach_px)
    counts = [len(p) for p in polygons]
    return [corners_of(s, e) for s, e in zip(split(start, counts), split(end, counts), strict=True)]


def probe(
    smoothed: NDArray[np.float32], polygons: list[tuple[Array, NDArray[np.int32]]], settings: VisionSettings
) -> list[Outline]:
    """Measure the gradient along each polygon's sides; keep those whose every side is there."""
    if not polygons:
        return []
    counts = [len(p) for p, _ in polygons]
    start = np.concatenate([p for p, _ in polygons])
    end = np.concatenate([np.roll(p, -1, 0) for p, _ in polygons])
    strength, seen = probe_sides(smoothed, start, end)
    outlines = [
        Outline(p, border, z, s)
        for (p, border), z, s in zip(polygons, split(strength, counts), split(seen, counts), strict=True)
    ]
    return [
        o for o in outlines if np.abs(o.strength).min() > settings.min_evidence and o.support > settings.min_support
    ]


def _variants(corners: Array, settings: VisionSettings) -> list[Array]:
    """The polygon with its shortest sides left out one after the other, while they are short beside the rest.

    A short side may be real, or a tip blunted by the edges' own width, or a leak where an edge fades: the image
    decides.
    """
    found: list[Array] = []
    current = tidy(corners, settings.min_side_px)
    while current is not None:
        found.append(current)
        length = np.linalg.norm(np.roll(current, -1, 0) - current, axis=1)
        if len(current) <= 3 or length.min() > max(_DOUBTFUL_SIDE * float(np.median(length)), 12.0):
            break
        current = tidy(drop_side(current, int(np.argmin(length))), settings.min_side_px)
    return found
