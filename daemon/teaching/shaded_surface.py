"""A drawing's surface as it looks: its triangles, with normals that turn evenly along curved surfaces. For pictures
of a simulated cell; nothing is recognised by it. Pure.
"""

from dataclasses import dataclass

import numpy as np

from daemon.arrays import Array, Flags, Index
from daemon.teaching.closed_surface import Surface
from daemon.teaching.flat_regions import FlatRegions


@dataclass(frozen=True, eq=False)
class ShadedSurface:
    """corners_mm (K, 3) and triangles (T, 3), anticlockwise from outside; normals (T, 3, 3), unit, at their corners;
    part_of (T,): which flat face or curved surface each is of; flat (T,): which are of a flat face."""

    corners_mm: Array
    triangles: Index
    normals: Array
    part_of: Index
    flat: Flags


def shaded_surface(surface: Surface, regions: FlatRegions, owner: Index, origin_mm: Array) -> ShadedSurface:
    """The surface about a point (3,) of the drawing; owner (R,): the curved surface each region is of, or -1."""
    triangles = np.array(surface.triangles, np.intp)
    region = np.zeros(len(triangles), np.intp)
    for number, members in enumerate(regions.members):
        region[list(members)] = number
    part_of = np.where(owner[region] < 0, region, len(owner) + owner[region])
    normals = regions.normals[region][:, None].repeat(3, 1)
    for number in np.unique(owner[owner >= 0]).tolist():
        own = np.flatnonzero(owner[region] == number)
        pairs = np.unique(np.stack([triangles[own].ravel(), region[own].repeat(3)], 1), axis=0)
        total = np.zeros_like(surface.corners)
        np.add.at(total, pairs[:, 0], regions.normals[pairs[:, 1]])
        there = total[triangles[own]]
        normals[own] = there / np.maximum(np.linalg.norm(there, axis=2, keepdims=True), 1e-9)
    flat = np.asarray(owner[region] < 0)
    return ShadedSurface(surface.corners - origin_mm, triangles, normals, part_of, flat)
