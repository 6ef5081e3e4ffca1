"""Corners of touching facets estimated together: every fitted side of both cameras pulls on the two corners it joins.

A corner shared by facets is one point; a facet's corners lie on its plane. Nothing else is assumed of the part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daemon.arrays import Array, Index
from daemon.vision.facets.one_look.candidates import Candidate
from daemon.vision.geometry import Baseline, RectifiedCamera, robust_weight, solve, whitener
from daemon.vision.image import Sides
from daemon.vision.values import Group

PLANE_MM = 0.02  # how flat a real facet is
_MODEL_PX = 0.02  # how far a real side is from a straight line; both set by eye
_ROUNDS, _LINEARISED = 6, 2
"""Number of rounds in which sides are weighed anew, and of the first rounds in which slopes and planes are taken anew
as well."""


def adjust_corners(members: list[Candidate], group: Group, geometry: Baseline) -> Group:
    """Adjust the corners of a group jointly, from the sides that its facets were fitted to."""
    solid = group.polyhedron
    corners, (here, after, _) = solid.rings, solid.steps
    ends = np.array([here, after]).T
    weight = np.array([0.5 if (b, a) in solid.edges else 1.0 for a, b in ends.tolist()])
    cameras = geometry.left, geometry.right
    sides = zip(*((c.left.sides, c.right.sides) for c in members), strict=True)
    lines = [_lines(own, camera) for own, camera in zip(sides, cameras, strict=True)]
    line, whiten = (np.stack(each) for each in zip(*lines, strict=True))
    seen = EdgeObservations(ends, line, whiten, weight)
    adjusted = solve_corners(solid.corners_mm, seen, [c for c in corners if len(c) > 3], geometry)
    ideal = geometry.project(adjusted.corners_mm)
    left_px, right_px = (camera.pixels(px) for camera, px in zip(cameras, ideal, strict=True))
    redrawn = (
        replace(
            f,
            corners_mm=adjusted.corners_mm[c],
            covariance_mm2=adjusted.covariance_mm2[c],
            left_px=left_px[c],
            right_px=right_px[c],
        )
        for f, c in zip(group.facets, corners, strict=True)
    )
    return Group(tuple(redrawn), group.rings)


@dataclass(frozen=True, eq=False)
class EdgeObservations:
    """Sides of the left and the right camera as observations of corners: ends (S, 2) corner numbers; line (2, S, 3) in
    ideal coordinates, unit normal; whiten (2, S, 2, 2) turns px offsets of the two corners into sigmas; weight (S,) 1,
    or 1/2 where two facets share it.
    """

    ends: Index
    line: Array
    whiten: Array
    weight: Array


def _lines(sides: Sequence[Sides], camera: RectifiedCamera) -> tuple[Array, Array]:
    """The lines and whiteners, as EdgeObservations has them, of all facets' sides in one camera, one facet's after the
    other's."""
    start, end = camera.ideal(np.concatenate([*(s.start for s in sides), *(s.end for s in sides)])).reshape(2, -1, 2)
    x, y = (end - start).T
    line = np.array([-y, x, start[:, 0] * y - start[:, 1] * x]) / np.hypot(x, y)
    covariance = np.concatenate([s.covariance for s in sides]) + _MODEL_PX**2 * np.eye(2)
    return line.T, whitener(covariance) * camera.focal_px


@dataclass(frozen=True, eq=False)
class AdjustedCorners:
    """corners_mm (V, 3) cyclopean; covariance_mm2 (V, 3, 3), of each corner; misfit: rms of the sides'
    residuals, sigmas.
    """

    corners_mm: Array
    covariance_mm2: Array
    misfit: float


def solve_corners(
    start_mm: Array, seen: EdgeObservations, planes: Sequence[Index], geometry: Baseline
) -> AdjustedCorners:
    """Least-squares corners (V, 3) mm, from a start near the answer. planes: corner numbers of each facet of four or
    more.

    Source: least squares on offsets from the sides in px sigmas; a side that stays off by several loses its say.
    """
    turn, middle = geometry.cyclopean_from_baseline, geometry.middle_mm
    points = (start_mm - middle) @ turn
    count = 3 * len(points)
    weight, own = np.tile(seen.weight, 2), len(seen.ends)
    shift_mm = geometry.length_mm * np.array([0.5, -0.5])[:, None, None]  # from each camera to the middle
    by_size = planes_by_size(planes)
    trust, flat = weight, np.zeros((0, count))
    slopes, held = np.zeros((len(trust), 2, count)), 1e-9 * np.eye(count)
    for turn_number in range(_ROUNDS):
        residual = _offsets(points, seen, shift_mm)
        if turn_number < _LINEARISED:
            slopes = _slopes(points, seen, shift_mm)
            flat = flatness(points, by_size)
            held = flat.T @ flat + 1e-9 * np.eye(count)
        size = (residual**2).sum(1)
        squares, say = float(trust @ size), 2 * float(trust.sum())
        found = solve(slopes[None], -residual[None], trust[None], held, -flat.T @ (flat @ points.ravel()))
        step = found.unknowns[0]
        if turn_number >= 1:
            # The left's sides by their own spread, the right's by that of both: on the rendered scenes the worst of the
            # corners (95 %) are 6 % farther off with all by that of both, 8 % with each camera's by its own.
            spreads = [_spread(size[:own], trust[:own]), _spread(size, trust)]
            trust = weight * robust_weight(size / np.array(spreads).repeat([own, len(size) - own]))
        points = points + step.reshape(-1, 3)
        if turn_number >= 3 and np.abs(step).max() < 1e-4:
            break
    free = max(say - count + sum(len(p) - 3 for p in planes), 1.0)
    misfit = float(np.sqrt(squares / free))
    inverse = np.linalg.inv(found.held[0]) * max(1.0, misfit**2)
    n = len(points)
    blocks = inverse.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n), :]
    return AdjustedCorners(points @ turn.T + middle, turn @ blocks @ turn.T, misfit)


def _spread(size: Array, trust: Array) -> float:
    """Return how much larger than expected the squared offsets (S,) are, one at least."""
    return max(1.0, float(trust @ size) / max(2 * float(trust.sum()), 1.0))


def _offsets(points: Array, seen: EdgeObservations, shift_mm: Array) -> Array:
    """Whitened offsets (2 S, 2) of both corners of each side from its line."""
    x, y, z = points[seen.ends].transpose(2, 0, 1)
    a, b, c = seen.line.transpose(2, 0, 1)[..., None]
    off = (a * (x + shift_mm) + b * y) / z + c
    return np.asarray((seen.whiten @ off[..., None]).reshape(-1, 2))


def _slopes(points: Array, seen: EdgeObservations, shift_mm: Array) -> Array:
    """The offsets' derivatives (2 S, 2, 3 V) by all corners."""
    x, y, z = points[seen.ends].transpose(2, 0, 1)
    a, b, _ = seen.line.transpose(2, 0, 1)[..., None]
    slope = np.stack([a / z, b / z, -(a * (x + shift_mm) + b * y) / z**2], 3)
    sides, n = len(z), len(points)
    slopes = np.zeros((2, sides, n, 2, 3))
    slopes[:, np.arange(sides)[:, None], seen.ends] = seen.whiten.swapaxes(2, 3)[..., None] * slope[:, :, :, None]
    return slopes.transpose(0, 1, 3, 2, 4).reshape(2 * sides, 2, 3 * n)


def planes_by_size(planes: Sequence[Index]) -> list[Index]:
    """Corner numbers of planes, those of as many corners together: (P, K) each."""
    return [np.array([p for p in planes if len(p) == k]) for k in sorted({len(p) for p in planes})]


def flatness(points: Array, by_size: Sequence[Index]) -> Array:
    """Rows (R, 3 V) that take all corners' coordinates to how far those of each plane are off it, in PLANE_MM; a plane
    is free to move and tilt. by_size: from planes_by_size.
    """
    rows = [np.zeros((0, points.size))]
    for planes in by_size:
        p = points[planes]
        count, k = planes.shape
        own, _, axes = np.linalg.svd(p - p.mean(1, keepdims=True), full_matrices=False)
        out_of_plane = np.eye(k) - 1 / k - own[:, :, :2] @ own[:, :, :2].swapaxes(1, 2)
        off = np.zeros((count, len(points), k, 3))
        off[np.arange(count)[:, None], planes] = out_of_plane[..., None] * axes[:, 2][:, None, None] / PLANE_MM
        rows.append(off.transpose(0, 2, 1, 3).reshape(count * k, -1))
    return np.concatenate(rows)
