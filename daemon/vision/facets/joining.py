"""Touching facets joined: which corners are one, their common estimate, and the facets drawn anew from it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from daemon.vision.facets.candidates import Candidate
from daemon.vision.facets.corner_adjustment import AdjustedCorners, pulls, settle
from daemon.vision.facets.grouping import shared_edge
from daemon.vision.geometry.planes import planarity
from daemon.vision.geometry.rectified import Baseline
from daemon.vision.values import Facet

Array = NDArray[np.float64]
Index = NDArray[np.intp]


def number_corners(facets: list[Facet], tolerance_px: float) -> tuple[list[Index], set[tuple[int, int]]]:
    """Numbers of each facet's corners, the same number where touching facets share one; and the edges two
    facets share.
    """
    first = np.concatenate([[0], np.cumsum([len(f.left_px) for f in facets])])
    root = np.arange(first[-1])
    edges = []
    for a in range(len(facets)):
        for b in range(a + 1, len(facets)):
            found = shared_edge(facets[a], facets[b], tolerance_px)
            if found is not None:
                i, j = found
                one = first[a] + i, first[a] + (i + 1) % len(facets[a].left_px)
                other = first[b] + (j + 1) % len(facets[b].left_px), first[b] + j
                for p, q in zip(one, other, strict=True):
                    root[root == root[q]] = root[p]
                edges.append(one)
    numbers = np.unique(root, return_inverse=True)[1]
    shared = {(int(min(numbers[p], numbers[q])), int(max(numbers[p], numbers[q]))) for p, q in edges}
    return [numbers[s:e] for s, e in pairwise(first)], shared


def join(members: list[Candidate], eyes: Baseline, tolerance_px: float = 4.0) -> tuple[list[Facet], AdjustedCorners]:
    """The members' facets with corners estimated together."""
    facets = [c.facet for c in members]
    corners, shared = number_corners(facets, tolerance_px)
    every, numbers = np.concatenate([f.corners_mm for f in facets]), np.concatenate(corners)
    count = np.bincount(numbers)
    start = np.stack([np.bincount(numbers, every[:, k]) / count for k in range(3)], 1)
    left = pulls([c.left.sides for c in members], corners, eyes.left, shared)
    right = pulls([c.right.sides for c in members], corners, eyes.right, shared)
    solid = settle(start, left, right, [c for c in corners if len(c) > 3], eyes)
    return [_redrawn(f, c, solid, eyes) for f, c in zip(facets, corners, strict=True)], solid


def _redrawn(facet: Facet, corners: Index, solid: AdjustedCorners, eyes: Baseline) -> Facet:
    points = solid.corners_mm[corners]
    left, right = eyes.project(points)
    return Facet(
        points,
        solid.covariance_mm2[corners],
        eyes.left.pixels(left),
        eyes.right.pixels(right),
        facet.epipolar_px,
        planarity(facet.corners_mm),
    )
