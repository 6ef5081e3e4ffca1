"""Welded facets' corners estimated together, and the facets drawn anew from that estimate."""

from __future__ import annotations

import numpy as np

from daemon.arrays import Index
from daemon.vision.facets.candidates import Candidate
from daemon.vision.facets.corner_adjustment import AdjustedCorners, pulls, settle
from daemon.vision.geometry import Baseline
from daemon.vision.values import Facet, Group


def settled(members: list[Candidate], group: Group, geometry: Baseline) -> Group:
    """The group with its corners estimated together from the sides that its members were fitted to."""
    solid = group.polyhedron
    corners, edges = solid.rings, solid.edges
    here, after, _ = solid.steps
    ends = np.array([here, after]).T
    weight = np.array([0.5 if (b, a) in edges else 1.0 for a, b in ends.tolist()])
    left = pulls([c.left.sides for c in members], ends, weight, geometry.left)
    right = pulls([c.right.sides for c in members], ends, weight, geometry.right)
    adjusted = settle(solid.corners_mm, left, right, [c for c in corners if len(c) > 3], geometry)
    redrawn = (_redrawn(f, c, adjusted, geometry) for f, c in zip(group.facets, corners, strict=True))
    return Group(tuple(redrawn), group.rings)


def _redrawn(facet: Facet, corners: Index, solid: AdjustedCorners, geometry: Baseline) -> Facet:
    points = solid.corners_mm[corners]
    left, right = geometry.project(points)
    return Facet(
        points,
        solid.covariance_mm2[corners],
        geometry.left.pixels(left),
        geometry.right.pixels(right),
        facet.epipolar_px,
        facet.planarity_mm,
    )
