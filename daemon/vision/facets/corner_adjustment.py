"""Corners of touching facets estimated together: every fitted side of both eyes pulls on the two corners it joins.

A corner shared by facets is one point; a facet's corners lie on its plane. Nothing else is assumed of the part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.vision.geometry.rectified import Baseline, Eye
from daemon.vision.image.edge_lines import Sides

Array = NDArray[np.float64]
Index = NDArray[np.intp]

PLANE_MM = 0.02
_MODEL_PX = 0.02
_OUTLIER = 3.0
_ROUNDS = 6


@dataclass(frozen=True, eq=False)
class Pull:
    """Sides of one eye as observations of corners: from_, to (S,) corner numbers; line (S, 3) in ideal coordinates,
    unit normal; whiten (S, 2, 2) turns px offsets of the two corners into sigmas; weight (S,) 1, or 1/2 where two
    facets share it.
    """

    from_: Index
    to: Index
    line: Array
    whiten: Array
    weight: Array


def pulls(sides: list[Sides], corners: list[Index], eye: Eye, shared: set[tuple[int, int]]) -> Pull:
    """All facets' sides in one eye; corners[k][i] is the number of facet k's corner i; shared holds edges of
    two facets.
    """
    start = eye.ideal(np.concatenate([s.start for s in sides]))
    end = eye.ideal(np.concatenate([s.end for s in sides]))
    chord = end - start
    normal = np.stack([-chord[:, 1], chord[:, 0]], 1) / np.linalg.norm(chord, axis=1)[:, None]
    line = np.concatenate([normal, -np.sum(normal * start, 1)[:, None]], 1)
    covariance = np.concatenate([s.covariance for s in sides]) + _MODEL_PX**2 * np.eye(2)
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    from_ = np.concatenate(corners)
    to = np.concatenate([np.roll(c, -1) for c in corners])
    weight = np.array([0.5 if (min(a, b), max(a, b)) in shared else 1.0 for a, b in zip(from_, to, strict=True)])
    return Pull(from_, to, line, whiten * eye.focal_px, weight)


@dataclass(frozen=True, eq=False)
class AdjustedCorners:
    """corners_mm (V, 3) cyclopean; covariance_mm2 (V, 3, 3), of each corner; misfit: rms of the sides'
    residuals, sigmas.
    """

    corners_mm: Array
    covariance_mm2: Array
    misfit: float


def settle(start_mm: Array, left: Pull, right: Pull, planes: list[Index], eyes: Baseline) -> AdjustedCorners:
    """Least-squares corners (V, 3) mm, from a start near the answer. planes: corner numbers of each facet of four or
    more.

    Gauss-Newton on offsets from the sides in px sigmas; a side that stays off by several sigmas loses its say
    (Geman-McClure).
    """
    turn, middle = eyes.cyclopean_from_baseline, eyes.middle_mm
    points = (start_mm - middle) @ turn
    count = 3 * len(points)
    half = eyes.length_mm / 2
    trust = [p.weight.copy() for p in (left, right)]
    for turn_number in range(_ROUNDS):
        hessian, gradient = np.eye(count) * 1e-9, np.zeros(count)
        squares, say = 0.0, 0.0
        for k, (pull, shift) in enumerate(((left, half), (right, -half))):
            residual, jacobian = _offsets(points, pull, shift)
            size = np.sum(residual**2, 1)
            squares += float(np.sum(trust[k] * size))
            say += float(2 * np.sum(trust[k]))
            _gather(hessian, gradient, pull, residual, jacobian, trust[k])
            if turn_number >= 1:
                trust[k] = pull.weight / (1 + size / _OUTLIER**2 / max(1.0, squares / max(say, 1.0))) ** 2
        for plane in planes:
            _flatten(hessian, gradient, points, plane)
        step = np.linalg.solve(hessian, gradient)
        points = points - step.reshape(-1, 3)
        if turn_number >= 3 and np.abs(step).max() < 1e-4:
            break
    free = max(say - count + sum(len(p) - 3 for p in planes), 1.0)
    misfit = float(np.sqrt(squares / free))
    inverse = np.linalg.inv(hessian) * max(1.0, misfit**2)
    n = len(points)
    blocks = inverse.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n), :]
    return AdjustedCorners(points @ turn.T + middle, turn @ blocks @ turn.T, misfit)


def _offsets(points: Array, pull: Pull, shift: float) -> tuple[Array, Array]:
    """Whitened offsets (S, 2) of both corners of each side from its line, and their derivatives (S, 2, 2
    corners, 3).
    """
    inverse_z = 1 / points[:, 2]
    u, v = (points[:, 0] + shift) * inverse_z, points[:, 1] * inverse_z
    ends = np.stack([pull.from_, pull.to], 1)
    a, b, c = pull.line[:, 0, None], pull.line[:, 1, None], pull.line[:, 2, None]
    raw = a * u[ends] + b * v[ends] + c
    w = inverse_z[ends]
    slope = np.stack([a * w, b * w, -(a * u[ends] + b * v[ends]) * w], 2)
    return np.einsum("sij,sj->si", pull.whiten, raw), pull.whiten[:, :, :, None] * slope[:, None, :, :]


def _gather(hessian: Array, gradient: Array, pull: Pull, residual: Array, jacobian: Array, trust: Array) -> None:
    """Add the sides' normal equations in place."""
    j = jacobian.reshape(len(residual), 2, 6)
    weighted = j * trust[:, None, None]
    blocks = np.swapaxes(weighted, 1, 2) @ j
    slopes = np.einsum("sri,sr->si", weighted, residual)
    columns = np.concatenate([pull.from_[:, None] * 3 + np.arange(3), pull.to[:, None] * 3 + np.arange(3)], 1)
    np.add.at(hessian, (columns[:, :, None], columns[:, None, :]), blocks)
    np.add.at(gradient, columns, slopes)


def _flatten(hessian: Array, gradient: Array, points: Array, plane: Index) -> None:
    """Add the condition that these corners lie on some plane, free to move and tilt, in place."""
    p = points[plane]
    centred = p - p.mean(0)
    own, _, axes = np.linalg.svd(centred, full_matrices=False)
    out_of_plane = np.eye(len(p)) - 1 / len(p) - own[:, :2] @ own[:, :2].T
    j = (out_of_plane[:, :, None] * axes[2]).reshape(len(p), -1) / PLANE_MM
    residual = out_of_plane @ (centred @ axes[2]) / PLANE_MM
    columns = (plane[:, None] * 3 + np.arange(3)).ravel()
    hessian[np.ix_(columns, columns)] += j.T @ j
    gradient[columns] += j.T @ residual
