"""What is free about a view of a part once its facets are known to be plane and so joined: its sizes.

In: corners as they should be, what binds them, how sure they were measured. Out: free sizes with covariance. What that
proves is confidence.py's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron, area_vector, cross_matrices, measure
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
        rigid = np.concatenate([np.tile(np.eye(3), count), -cross_matrices(corners).reshape(3 * count, 3).T])
        rows = np.concatenate([bound, rigid])
        rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-9)
        _, size, ways = np.linalg.svd(rows)
        # A length that grows by a millimetre moves half of the corners by half of it either way.
        free = ways[int((size > INDEPENDENT * size[0]).sum()) :].T * np.sqrt(count) / 2
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


def bonds(corners: Array, seen: Polyhedron, types: Sequence[str], library: FacetLibrary, *, right_only: bool) -> Array:
    """(R, 3K) derivatives by the corners (K, 3) of what binds them whatever the sizes: plane facets; right angles, in
    facets and between them; unless right_only, all that the facets' types say."""
    found = [np.zeros((0, 3 * len(corners)))]
    for ring, kind in zip(seen.rings, types, strict=True):
        points = corners[ring]
        a, b = conditions(points, kind, library)
        if right_only:
            right = (np.count_nonzero(a, axis=1) == 1) & (np.abs(b - np.pi / 2) < RIGHT)
            a = a[right]
        inside = np.concatenate([_plane(points), a @ measure(points).jacobian])
        rows = np.zeros((len(inside), 3 * len(corners)))
        rows[:, (3 * ring[:, None] + np.arange(3)).ravel()] = inside
        found.append(rows)
    found += [_square(corners, seen.rings[f], seen.rings[g]) for f, g in seen.seams]
    return np.concatenate(found)


def _plane(points: Array) -> Array:
    """(N, 3N) a facet's corners off its plane."""
    normal = area_vector(points)
    normal = normal / np.linalg.norm(normal)
    spanned = np.column_stack([np.ones(len(points)), points - points.mean(0)])
    off = np.eye(len(points)) - spanned @ np.linalg.pinv(spanned, rcond=1e-6)
    return np.kron(off, normal)


def _square(corners: Array, one: NDArray[np.intp], other: NDArray[np.intp]) -> Array:
    """(1, 3K) the cosine between two facets' planes, where it is next to none; else (0, 3K)."""
    areas = [area_vector(corners[ring]) for ring in (one, other)]
    sizes = [float(np.linalg.norm(a)) for a in areas]
    row = np.zeros((1, len(corners), 3))
    if abs(areas[0] @ areas[1]) > RIGHT * sizes[0] * sizes[1]:
        return row.reshape(1, -1)[:0]
    for ring, beside in ((one, areas[1]), (other, areas[0])):
        across = np.roll(corners[ring], -1, 0) - np.roll(corners[ring], 1, 0)
        np.add.at(row[0], ring, np.cross(across, beside) / 2 / sizes[0] / sizes[1])
    return row.reshape(1, -1)
