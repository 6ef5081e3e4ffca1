"""What is free about a view of a part once its facets are known to be plane and so joined: its sizes.

In: corners as they should be, what binds them, how sure they were measured. Out: free sizes with covariance. What that
proves is confidence.py's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron, area_vector, measure
from daemon.vision.model import FacetLibrary, conditions

RIGHT = 0.02  # cosine, or radians off, within which an angle is meant to be right
INDEPENDENT = 0.03  # of the largest singular value: bonds that say less say nothing new


@dataclass(frozen=True, eq=False)
class FreeSizes:
    """covariance (N, N) of the free sizes, each in mm of length; chi2 of the fit with the sizes as taught, and least,
    with those that fit best."""

    covariance: Array
    chi2: float
    least: float

    @classmethod
    def of(cls, corners: Array, bound: Array, weight: Array, residual: Array, range_mm: float) -> FreeSizes:
        """corners (K, 3) mm as taught; bound (R, 3K) what binds them; weight (K, 3, 3) inverse covariance and residual
        (K, 3) mm of the measured ones; range_mm: how far sizes may be from any at all, a standard deviation."""
        count = len(corners)
        about = corners - corners.mean(0)  # far from the origin a turn is next to a shift, and would be lost
        rigid = np.concatenate([np.tile(np.eye(3), count), -frames.cross_matrices(about).reshape(3 * count, 3).T])
        rows = np.concatenate([bound, rigid])
        rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-9)
        squares, ways = np.linalg.eigh(rows.T @ rows)
        # A length that grows by a millimetre moves half of the corners by half of it either way.
        free = ways[:, squares < INDEPENDENT**2 * squares[-1]] * np.sqrt(count) / 2
        number = free.shape[1]
        design = np.concatenate([free, rigid.T], 1)
        weighted = (weight @ design.reshape(count, 3, -1)).reshape(3 * count, -1)
        normal = design.T @ weighted
        normal[np.arange(number), np.arange(number)] += range_mm**-2
        spread = np.linalg.inv(normal)
        right = weighted.T @ residual.ravel()
        chi2 = float(np.einsum("ki,kij,kj->", residual, weight, residual))
        return cls(spread[:number, :number], chi2, chi2 - float(right @ spread @ right))

    def nats(self, noise2: float, range_mm: float) -> float:
        """Log likelihood ratio of the sizes as taught against any in their range, errors having noise2 times the
        predicted variance."""
        logdet = np.linalg.slogdet(2 * np.pi * noise2 * self.covariance)[1]
        return float(len(self.covariance) * np.log(range_mm) - logdet / 2 - (self.chi2 - self.least) / (2 * noise2))


def bonds(corners: Array, seen: Polyhedron, types: Sequence[str], library: FacetLibrary) -> tuple[Array, Array]:
    """(R, 3K) derivatives by the corners (K, 3) of what binds them whatever the sizes: plane facets, right angles in
    facets and between them; and (S, 3K), these and all that the facets' types say.
    """
    count = len(corners)
    areas = [area_vector(corners[ring]) for ring in seen.rings]
    firm, more = [np.zeros((0, 3 * count))], [np.zeros((0, 3 * count))]
    for ring, kind, area in zip(seen.rings, types, areas, strict=True):
        points = corners[ring]
        measures = measure(points)
        a, b = conditions(measures, kind, library)
        said = a @ measures.jacobian
        right = ((a != 0).sum(1) == 1) & (np.abs(b - np.pi / 2) < RIGHT)
        at = (3 * ring[:, None] + np.arange(3)).ravel()
        for kept, rows in ((firm, [_plane(points, area), said[right]]), (more, [said[~right]])):
            inside = np.concatenate(rows)
            placed = np.zeros((len(inside), 3 * count))
            placed[:, at] = inside
            kept.append(placed)
    for f, g in seen.seams:
        sizes = float(np.sqrt((areas[f] @ areas[f]) * (areas[g] @ areas[g])))
        if abs(float(areas[f] @ areas[g])) < RIGHT * sizes:
            row = np.zeros((count, 3))
            row[seen.rings[f]] += _turning(corners[seen.rings[f]], areas[g]) / sizes
            row[seen.rings[g]] += _turning(corners[seen.rings[g]], areas[f]) / sizes
            firm.append(row.reshape(1, -1))
    return np.concatenate(firm), np.concatenate([*firm, *more])


def _plane(points: Array, area: Array) -> Array:
    """(N, 3N) a facet's corners off its plane."""
    normal = area / np.sqrt(area @ area)
    x = points[1] - points[0]
    flat = np.stack([x, frames.cross_matrices(normal) @ x], 1)
    spanned = np.concatenate([np.ones((len(points), 1)), (points - points.mean(0)) @ flat], 1)
    off = np.eye(len(points)) - spanned @ np.linalg.solve(spanned.T @ spanned, spanned.T)
    return np.asarray((off[:, :, None] * normal).reshape(len(points), -1))


def _turning(points: Array, area: Array) -> Array:
    """(N, 3) derivatives of a facet's area vector along another's (3,), by the facet's corners."""
    here = np.arange(len(points))
    across = points[(here + 1) % len(points)] - points[here - 1]
    return np.asarray(across @ frames.cross_matrices(area) / 2)
