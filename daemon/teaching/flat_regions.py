"""Divide the triangles of a closed surface into flat regions: the triangles in one plane, their borders, and the region
beyond each edge. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from daemon.arrays import Array, Flags
from daemon.teaching.closed_surface import Edge, Surface, edges_of
from daemon.vision.geometry import area_vector, border_loops, cross, sides_of

SAME_PLANE_DEG, SAME_PLANE_MM = 0.5, 0.05
FIRST_GUESS = 3.0
"""Factor by which a plane through one triangle with rounded corners is worse than one through all of a facet."""
NO_AREA_MM2 = 1e-3


@dataclass(frozen=True, eq=False)
class FlatRegions:
    """R regions. corners (K, 3) mm; loops: the borders of each, by corners, the outer one first, each anticlockwise
    about its inside seen from outside the part; normals (R, 3) outward; areas (R,) mm2, without holes; members: the
    triangles of each."""

    corners: Array
    loops: tuple[tuple[tuple[int, ...], ...], ...]
    normals: Array
    areas: Array
    members: tuple[tuple[int, ...], ...]

    @cached_property
    def beyond(self) -> dict[Edge, int]:
        """{(corner, next corner) of a border: the region on its other side}."""
        owner = {side: r for r, loops in enumerate(self.loops) for loop in loops for side in sides_of(loop)}
        return {(a, b): owner[b, a] for a, b in owner if (b, a) in owner}

    @cached_property
    def longest_mm(self) -> dict[int, float]:
        """{region: length of its longest shared border}."""
        found: dict[int, float] = {}
        for (region, _), mm in self.shared_mm.items():
            found[region] = max(found.get(region, 0.0), mm)
        return found

    @cached_property
    def shared_mm(self) -> dict[tuple[int, int], float]:
        """{(region, other): length of their shared border}."""
        found: dict[tuple[int, int], float] = {}
        for (a, b), other in self.beyond.items():
            pair = self.beyond[b, a], other
            found[pair] = found.get(pair, 0.0) + float(np.linalg.norm(self.corners[b] - self.corners[a]))
        return found

    def turn_rad(self, one: int, other: int) -> float:
        """Angle by which the surface turns from one region to another."""
        normals = self.normals[[one, other]]
        return float(np.arctan2(np.linalg.norm(cross(normals[:1], normals[1:])), normals[0] @ normals[1]))


def flat_regions(surface: Surface, step_mm: float) -> FlatRegions:
    """Grow each region from its largest triangle: small ones do not determine a plane well.

    step_mm: what the coordinates are rounded to. The plane is then that of all the corners found at first, and a thin
    triangle may be turned by as much as rounding turns it.
    """
    mesh = _Triangles.of(surface, step_mm)
    off_most = max(SAME_PLANE_MM, step_mm)
    free = np.ones(len(mesh.areas), bool)
    found = []
    for seed in np.argsort(-mesh.areas, kind="stable").tolist():
        if not free[seed]:
            continue
        plane = mesh.corners[seed, 0], mesh.normals[seed]
        if step_mm:
            first = mesh.grown(seed, plane, off_most * FIRST_GUESS, free)
            plane = _plane_through(mesh.corners[first].reshape(-1, 3), plane[1])
        region = mesh.grown(seed, plane, off_most, free)
        free[region] = False
        found.append(region)
    loops = tuple(_borders(surface, region) for region in found)
    vectors = np.array([sum(area_vector(surface.corners[list(loop)]) for loop in one) for one in loops])
    areas = np.linalg.norm(vectors, axis=1)
    normals = vectors / np.maximum(areas, 1e-12)[:, None]
    return FlatRegions(surface.corners, loops, normals, areas, tuple(map(tuple, found)))


@dataclass(frozen=True, eq=False)
class _Triangles:
    """corners (T, 3, 3), normals (T, 3), areas (T,) doubled; turned_rad (T,): the turn of each that rounding explains;
    beside (T, 3): the triangle at each edge."""

    corners: Array
    normals: Array
    areas: Array
    turned_rad: Array
    beside: list[list[int]]

    @classmethod
    def of(cls, surface: Surface, step_mm: float) -> _Triangles:
        corners = surface.corners[np.array(surface.triangles)]
        normals = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(normals, axis=1)
        longest = np.linalg.norm(np.roll(corners, -1, 1) - corners, axis=2).max(axis=1)
        owner = {edge: t for t, triangle in enumerate(surface.triangles) for edge in edges_of(triangle)}
        beside = [[owner[q, p] for p, q in edges_of(triangle)] for triangle in surface.triangles]
        turned = np.arctan2(step_mm, areas / longest)
        return cls(corners, normals / np.maximum(areas, 1e-12)[:, None], areas, turned, beside)

    def grown(self, seed: int, plane: tuple[Array, Array], off_mm: float, free: Flags) -> list[int]:
        """The free triangles connected with the seed in a plane (a point, a normal)."""
        middle, normal = plane
        flat = np.cos(np.minimum(np.radians(SAME_PLANE_DEG) + self.turned_rad + self.turned_rad[seed], np.pi / 2))
        fits = free & (np.abs((self.corners - middle) @ normal).max(axis=1) < off_mm)
        fits &= (self.normals @ normal > flat) | (self.areas < NO_AREA_MM2)
        fits[seed] = False
        region = [seed]
        for here in region:  # grows as it is gone through
            for other in self.beside[here]:
                if fits[other]:
                    fits[other] = False
                    region.append(other)
        return region


def _plane_through(points: Array, towards: Array) -> tuple[Array, Array]:
    """The best plane through points (N, 3), its normal on the side of `towards`."""
    middle = points.mean(axis=0)
    normal = np.linalg.svd(points - middle, full_matrices=False)[2][2]
    return middle, normal * (1.0 if normal @ towards > 0 else -1.0)


def _borders(surface: Surface, region: list[int]) -> tuple[tuple[int, ...], ...]:
    own = {edge for t in region for edge in edges_of(surface.triangles[t])}
    loops = border_loops((a, b) for a, b in own if (b, a) not in own)
    largest = sorted(loops, key=lambda ring: -float(np.linalg.norm(area_vector(surface.corners[ring]))))
    return tuple(map(tuple, largest))
