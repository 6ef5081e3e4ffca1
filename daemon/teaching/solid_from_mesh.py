"""Polygons of a mesh -> a solid with flat facets, as the recogniser knows parts. Pure.

Triangles of one plane are one facet; the rings run anticlockwise seen from outside. What a camera could not tell (a
corner in the middle of a straight side) goes. How the surface is closed is closed_surface.py's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daemon.arrays import Array, Flags
from daemon.teaching.closed_surface import Surface, Triangle, closed_surface, edges_of
from daemon.teaching.mesh import Mesh, MeshError, read_mesh
from daemon.vision.geometry import Polyhedron, area_vector, border_loops
from daemon.vision.model import FacetLibrary, type_facet

SAME_PLANE_DEG, SAME_PLANE_MM = 0.5, 0.05
STRAIGHT_DEG = 1.0
FIRST_GUESS = 3.0
"""A plane through one triangle with rounded corners is so much worse than one through all of a facet."""
NO_AREA_MM2 = 1e-3
MOST_FACETS = 40
"""More than that, and it is a curved surface cut into strips; it has no facets to be recognised by."""
DRAWN_MM = 0.05
"""How far corners on a drawing are off (one standard deviation); how far real parts are off is the model's business."""


@dataclass(frozen=True, eq=False)
class Drawing:
    """A drawing as it was understood: the solid, and what was mended or left out, a line each."""

    solid: Polyhedron
    notes: tuple[str, ...]


def read_drawing(name: str, content: bytes, unit: str, library: FacetLibrary) -> Drawing:
    """What a drawing's file shows. Raises MeshError, UnitError, which name the file."""
    mesh = read_mesh(name, content, unit)
    try:
        return drawing_of(mesh, library)
    except MeshError as error:
        raise MeshError(f"{name}: {error}") from None


def solid_drawn(name: str, content: bytes, unit: str, library: FacetLibrary) -> Polyhedron:
    """The solid in a drawing's file. Raises MeshError, which names the file."""
    return read_drawing(name, content, unit, library).solid


def drawing_of(mesh: Mesh, library: FacetLibrary) -> Drawing:
    """The solid a mesh bounds. Raises MeshError where it bounds none, or one without flat facets."""
    surface = closed_surface(mesh)
    corners, triangles = surface.corners, surface.triangles
    regions = _flat_regions(surface, mesh.step_mm)
    if len(regions) > MOST_FACETS:
        raise MeshError(f"{len(regions)} facets: a curved surface? at most {MOST_FACETS} flat ones tell a part")
    rings = [_straightened(corners, _outline(corners, [triangles[k] for k in region])) for region in regions]
    if any(len(ring) < 3 for ring in rings):
        raise MeshError("a facet without an area; mend the mesh")
    used = sorted({k for ring in rings for k in ring})
    place = {k: n for n, k in enumerate(used)}
    points = corners[used] - corners[used].mean(axis=0)
    facets = tuple(tuple(place[k] for k in ring) for ring in rings)
    covariance = np.repeat(max(DRAWN_MM, mesh.step_mm / 2) ** 2 * np.eye(3)[None], len(points), axis=0)
    types = tuple(type_facet(points[list(f)], covariance[list(f)], library)[0].name for f in facets)
    return Drawing(Polyhedron(points, facets, covariance, types), surface.notes)


def _flat_regions(surface: Surface, step_mm: float) -> list[list[int]]:
    """Triangles that hang together in one plane, largest triangle first: small ones do not tell a plane well.

    step_mm: what the coordinates are rounded to. The plane is then that of all the corners found at first, and a thin
    triangle may be turned by as much as rounding turns it.
    """
    mesh = _Triangles.of(surface, step_mm)
    off_most = max(SAME_PLANE_MM, step_mm)
    free = np.ones(len(mesh.areas), bool)
    regions = []
    for seed in np.argsort(-mesh.areas, kind="stable").tolist():
        if not free[seed]:
            continue
        plane = mesh.corners[seed, 0], mesh.normals[seed]
        if step_mm:
            first = mesh.grown(seed, plane, off_most * FIRST_GUESS, free)
            plane = _plane_through(mesh.corners[first].reshape(-1, 3), plane[1])
        region = mesh.grown(seed, plane, off_most, free)
        free[region] = False
        regions.append(region)
    return regions


@dataclass(frozen=True, eq=False)
class _Triangles:
    """corners (T, 3, 3), normals (T, 3), areas (T,) twice; turned_rad (T,): by as much may rounding turn each; beside
    (T, 3): the triangle at each edge."""

    corners: Array
    normals: Array
    areas: Array
    turned_rad: Array
    beside: list[list[int]]

    @classmethod
    def of(cls, surface: Surface, step_mm: float) -> _Triangles:
        corners = surface.corners[np.array(surface.triangles)]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(normals, axis=1)
        longest = np.linalg.norm(np.roll(corners, -1, 1) - corners, axis=2).max(axis=1)
        owner = {edge: t for t, triangle in enumerate(surface.triangles) for edge in edges_of(triangle)}
        beside = [[owner[q, p] for p, q in edges_of(triangle)] for triangle in surface.triangles]
        return cls(
            corners, normals / np.maximum(areas, 1e-12)[:, None], areas, np.arctan2(step_mm, areas / longest), beside
        )

    def grown(self, seed: int, plane: tuple[Array, Array], off_mm: float, free: Flags) -> list[int]:
        """The free triangles that hang together with the seed in a plane (a point, a normal)."""
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
    """The plane nearest to points (N, 3), its normal on the side of another."""
    middle = points.mean(axis=0)
    normal = np.linalg.svd(points - middle, full_matrices=False)[2][2]
    return middle, normal * (1.0 if normal @ towards > 0 else -1.0)


def _outline(corners: Array, triangles: list[Triangle]) -> list[int]:
    """The outer border of a flat region; holes in it are not looked at."""
    own = {edge for triangle in triangles for edge in edges_of(triangle)}
    loops = border_loops((a, b) for a, b in own if (b, a) not in own)
    return max(loops, key=lambda ring: float(np.linalg.norm(area_vector(corners[ring]))))


def _straightened(corners: Array, ring: list[int]) -> list[int]:
    """Without corners at which the border goes straight on."""
    kept = list(ring)
    at = 0
    while at < len(kept) and len(kept) > 2:
        before, here, after = (corners[kept[(at + step) % len(kept)]] for step in (-1, 0, 1))
        one, two = here - before, after - here
        cosine = float(one @ two / (np.linalg.norm(one) * np.linalg.norm(two)))
        if cosine > np.cos(np.radians(STRAIGHT_DEG)):
            kept.pop(at)
            at = max(at - 1, 0)
        else:
            at += 1
    return kept
