"""Which corners and which facets, as several looks measured them, are one. Pure; where they then are is
looks_adjustment.py's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.vision.geometry import area_vector, inside, newell_normal

Index = NDArray[np.intp]
Ring = tuple[int, ...]

LEAST_MM, MOST_MM, SIGMAS = 1.0, 4.0, 4.0
"""Corners this near are one, farther apart never; in between, those within so many predicted errors."""
OF_SHORTEST = 1 / 3  # the same as a share of the shorter of the sides that end there
TILT_DEG, OVERLAP = 12.0, 0.3
"""Facets of one plane: how far their normals may differ, and how much of the smaller lies in the larger."""
GRID = 12


def one_corner(moved: list[Array], spread: list[Array], outlines: list[list[Ring]]) -> list[Index]:
    """For each look its corners' numbers, one number where looks measured one corner. moved (N, 3) base."""
    centres, doubts, widths, counts = list[Array](), list[Array](), list[float](), list[int]()
    owner = []
    for points, covariance, rings in zip(moved, spread, outlines, strict=True):
        widths_here = _widths(points, rings)
        pairs = list[tuple[float, int, int]]()
        if centres and len(points):
            apart = np.linalg.norm(points[:, None] - np.array(centres), axis=2)
            both = np.trace(covariance, axis1=1, axis2=2)[:, None] + np.trace(np.array(doubts), axis1=1, axis2=2)
            limit = np.clip(SIGMAS * np.sqrt(both), LEAST_MM, MOST_MM)
            limit = np.minimum(limit, OF_SHORTEST * np.minimum(widths_here[:, None], np.array(widths)))
            pairs = sorted((float(apart[k, j]), int(k), int(j)) for k, j in np.argwhere(apart < limit))
        numbers, taken = np.full(len(points), -1, np.intp), set[int]()
        for _, k, j in pairs:
            if numbers[k] < 0 and j not in taken:
                numbers[k] = j
                taken.add(j)
        for k in range(len(points)):
            j = int(numbers[k])
            if j < 0:
                numbers[k] = len(centres)
                centres.append(points[k])
                doubts.append(covariance[k])
                widths.append(float(widths_here[k]))
                counts.append(1)
                continue
            counts[j] += 1
            centres[j] = centres[j] + (points[k] - centres[j]) / counts[j]
            widths[j] = min(widths[j], float(widths_here[k]))
        owner.append(numbers)
    return owner


def _widths(points: Array, rings: list[Ring]) -> Array:
    """(N,) the shortest side that ends in each corner."""
    widths = np.full(len(points), np.inf)
    for ring in rings:
        corners = points[list(ring)]
        sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        widths[list(ring)] = np.minimum(widths[list(ring)], np.minimum(sides, np.roll(sides, 1)))
    return widths


def one_facet(moved: list[Array], outlines: list[list[Ring]], owner: list[Index]) -> list[list[tuple[int, int]]]:
    """The looks' facets (look, facet) in sets of what is one, each set the largest first."""
    every = [(look, f) for look, rings in enumerate(outlines) for f in range(len(rings))]
    shapes = {(look, f): moved[look][list(outlines[look][f])] for look, f in every}
    every.sort(key=lambda at: -float(np.linalg.norm(area_vector(shapes[at]))))
    found = list[list[tuple[int, int]]]()
    for at in every:
        mine = {int(k) for k in owner[at[0]][list(outlines[at[0]][at[1]])]}
        for one in found:
            first = one[0]
            common = mine & {int(k) for k in owner[first[0]][list(outlines[first[0]][first[1]])]}
            if _same_plane(shapes[first], shapes[at], len(common)):
                one.append(at)
                break
        else:
            found.append([at])
    return found


def _same_plane(large: Array, small: Array, common: int) -> bool:
    """Whether two outlines (N, 3), (M, 3) are of one facet. common: how many corners they have in common."""
    normal, other = newell_normal(large), newell_normal(small)
    if normal @ other < np.cos(np.radians(TILT_DEG)):
        return False
    if common > 2:
        return True
    off = (small - large.mean(0)) @ normal
    if np.abs(off).max() > MOST_MM:
        return False
    across = np.linalg.svd(normal[None])[2][1:]
    a, b = (p @ across.T for p in (large, small))
    return _overlap(a, b) > OVERLAP


def _overlap(large: Array, small: Array) -> float:
    """Share of the smaller outline (M, 2) that lies in the larger (N, 2), by a grid of points."""
    low, high = small.min(0), small.max(0)
    steps = (np.arange(GRID) + 0.5) / GRID
    points = low + np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2) * (high - low)
    own = points[inside(points, small[None])[0]]
    return float(inside(own, large[None])[0].mean()) if len(own) else 0.0
