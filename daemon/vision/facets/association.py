"""Which corners and which facets, as several looks measured them, are one. Pure; where they then are is
looks_adjustment.py's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.vision.facets.grouping import connected
from daemon.vision.geometry import area_vector, axes_in, inside, newell_normal

Index = NDArray[np.intp]
Ring = tuple[int, ...]

LEAST_MM, MOST_MM, SIGMAS = 1.0, 4.0, 4.0
"""Corners this near are one, farther apart never; in between, those within so many predicted errors."""
OF_SHORTEST = 1 / 3  # the same as a share of the shorter of the sides that end there
TILT_DEG = 12.0  # how far the normals of pieces of one facet may differ


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


def one_facet(moved: list[Array], outlines: list[list[Ring]]) -> list[list[tuple[int, int]]]:
    """The looks' facets (look, facet) in sets of what is one facet or a piece of it, each set the largest first."""
    every = [(look, f) for look, rings in enumerate(outlines) for f in range(len(rings))]
    shapes = {(look, f): moved[look][list(outlines[look][f])] for look, f in every}
    every.sort(key=lambda at: -float(np.linalg.norm(area_vector(shapes[at]))))
    found = list[list[tuple[int, int]]]()
    for at in every:
        for one in found:
            if _same_plane(shapes[one[0]], shapes[at]) and any(_touch(shapes[k], shapes[at]) for k in one):
                one.append(at)
                break
        else:
            found.append([at])
    return found


def one_thing(marks: list[set[tuple[int, int]]]) -> list[list[int]]:
    """The sets of facets that hang together: whose marks, of corners and of groups that they were seen in, have one in
    common."""
    return connected(np.array([[one is other or not one.isdisjoint(other) for other in marks] for one in marks], bool))


def _same_plane(large: Array, small: Array) -> bool:
    """Whether two outlines (N, 3), (M, 3) lie in one plane."""
    normal, other = newell_normal(large), newell_normal(small)
    level = normal @ other > np.cos(np.radians(TILT_DEG))
    return bool(level and np.abs((small - large.mean(0)) @ normal).max() < MOST_MM)


def _touch(large: Array, small: Array) -> bool:
    """Whether two outlines of one plane overlap, or lie within MOST_MM of each other."""
    axes = axes_in(newell_normal(large))
    one, other = (points @ axes.T for points in (large, small))
    if inside(np.vstack([other, other.mean(0)]), one[None]).any() or inside(one, other[None]).any():
        return True
    return min(_gap_mm(one, other), _gap_mm(other, one)) < MOST_MM


def _gap_mm(ring: Array, points: Array) -> float:
    """Distance of the nearest of the points (M, 2) from the border of a ring (N, 2)."""
    way = np.roll(ring, -1, axis=0) - ring
    to = points[:, None] - ring
    along = np.clip((to * way).sum(2) / np.maximum((way * way).sum(1), 1e-12), 0.0, 1.0)
    return float(np.linalg.norm(to - along[..., None] * way, axis=2).min())
