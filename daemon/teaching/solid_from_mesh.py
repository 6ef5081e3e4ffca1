"""Make a solid with flat facets, as the recogniser knows parts, from the polygons of a mesh. Pure.

Triangles of one plane are one facet; the rings run anticlockwise seen from outside. Strips of a curved surface are
none: where the surface goes on smoothly into one, the facet has no edge to be seen there. What no camera could see
(a corner in the middle of a straight side) goes. How the surface is closed is closed_surface.py's.
"""

from dataclasses import dataclass, replace

import numpy as np

from daemon.arrays import Array, Flags, Index
from daemon.teaching.blends import Blends, find_blends
from daemon.teaching.closed_surface import Surface, closed_surface
from daemon.teaching.curved_surfaces import CurvedSurface, curved_surfaces, owners
from daemon.teaching.flat_regions import FlatRegions, flat_regions
from daemon.teaching.holes import holes_of, sunk_loops
from daemon.teaching.mesh import Mesh, MeshError, read_mesh
from daemon.teaching.outlines import outlines
from daemon.vision.geometry import OutlineArc, Polyhedron
from daemon.vision.model import FacetLibrary, types_of_each

MAX_PIECES = 6000
"""Largest number of flat pieces of a surface that are examined; a machined part's drawing has fewer."""
MAX_FACETS = 200
WORN = "small fillets and chamfers ({} in all, those that meet as one) are taken for edges that are worn"
DRAWN_MM = 0.05
"""Error of corners in a drawing (one standard deviation); the model handles that of real parts."""


@dataclass(frozen=True, eq=False)
class ShadedSurface:
    """A drawing's surface for pictures of a simulated cell; the recogniser does not use it.

    corners_mm (K, 3) and triangles (T, 3), anticlockwise from outside; normals (T, 3, 3), unit, at their corners;
    part_of (T,): which flat face or curved surface each is of; flat (T,): which are of a flat face."""

    corners_mm: Array
    triangles: Index
    normals: Array
    part_of: Index
    flat: Flags


@dataclass(frozen=True, eq=False)
class Drawing:
    """A drawing as facetd understands it. solid: about the middle of its corners; origin_mm (3,): that middle in the
    drawing's frame, whose axes the solid has; size_mm (3,) along them; curved: surfaces that are no facets; holes:
    their number; surface: for pictures, about the same origin; notes: repairs and omissions, one line each."""

    solid: Polyhedron
    origin_mm: Array
    size_mm: Array
    curved: tuple[CurvedSurface, ...]
    holes: int
    surface: ShadedSurface
    notes: tuple[str, ...]


def read_drawing(name: str, content: bytes, unit: str, library: FacetLibrary) -> Drawing:
    """Read a drawing's file. Raises MeshError, UnitError, which name the file."""
    mesh = read_mesh(name, content, unit)
    try:
        return drawing_of(mesh, library)
    except MeshError as error:
        raise MeshError(f"{name}: {error}") from None


def solid_drawn(name: str, content: bytes, unit: str, library: FacetLibrary) -> Polyhedron:
    """Read the solid in a drawing's file. Raises MeshError, which names the file."""
    return read_drawing(name, content, unit, library).solid


def drawing_of(mesh: Mesh, library: FacetLibrary) -> Drawing:
    """The solid that a mesh bounds. Raises MeshError where it bounds none, or one without flat facets."""
    surface = closed_surface(mesh)
    regions = flat_regions(surface, mesh.step_mm)
    if len(regions.areas) > MAX_PIECES:
        raise MeshError(f"{len(regions.areas)} flat pieces, at most {MAX_PIECES}; export it with a coarser tolerance")
    curved = curved_surfaces(regions)
    owner = owners(regions, curved)
    small = find_blends(regions, owner)
    faces = np.flatnonzero(small.flat).tolist()
    if len(faces) < 2:
        raise MeshError(f"{len(faces)} flat facets: a curved surface; a part needs at least 2")
    if len(faces) > MAX_FACETS:
        raise MeshError(f"{len(faces)} flat facets; a part may have at most {MAX_FACETS}")
    solid, origin = _solid(regions, owner, small, mesh.step_mm, library)
    curved = tuple(one for one in curved if (small.cluster[list(one.regions)] < 0).any())
    solid = replace(solid, covers=np.concatenate([np.zeros((0, 4, 3)), *(one.covers - origin for one in curved)]))
    notes = surface.notes + ((WORN.format(len(small.joins)),) if small.joins else ())
    holes = sum(1 for face in faces for _ in sunk_loops(regions, face))
    used = sorted({k for triangle in surface.triangles for k in triangle})
    looks = shaded_surface(surface, regions, owner, origin)
    return Drawing(solid, origin, np.ptp(surface.corners[used], axis=0), curved, holes, looks, notes)


def _solid(
    regions: FlatRegions, owner: Index, small: Blends, step_mm: float, library: FacetLibrary
) -> tuple[Polyhedron, Array]:
    """The solid about the middle of its corners, and that middle."""
    made = outlines(regions, owner, small, step_mm)
    if any(len(ring) < 3 for ring in made.rings):
        raise MeshError("a facet without an area; repair the mesh")
    used = sorted({k for ring in made.rings for k in ring})
    place = {k: n for n, k in enumerate(used)}
    points = np.array([made.points[k] for k in used])
    middle = points.mean(axis=0)
    points -= middle
    facets = tuple(tuple(place[k] for k in ring) for ring in made.rings)
    covariance = np.repeat(max(DRAWN_MM, step_mm / 2) ** 2 * np.eye(3)[None], len(points), axis=0)
    round_ = [[along - middle for facet, along, _ in made.arcs if facet == k] for k in range(len(facets))]
    rings = [points[list(facet)] for facet in facets]
    spread = [covariance[: len(ring)] for ring in rings]
    types = tuple(own[0].name for own in types_of_each(rings, spread, library, round_))
    smooth = frozenset((place[a], place[b]) for a, b in made.smooth if a in place and b in place)
    rims = holes_of(regions, np.flatnonzero(small.flat), owner, step_mm)
    holes = tuple(replace(one, ring_mm=one.ring_mm - middle) for one in rims)
    arcs = tuple(OutlineArc(facet, along - middle) for facet, along, shows in made.arcs if shows)
    return Polyhedron(points, facets, covariance, types, smooth, holes=holes, arcs=arcs), middle


def shaded_surface(surface: Surface, regions: FlatRegions, owner: Index, origin_mm: Array) -> ShadedSurface:
    """The surface about a point (3,) of the drawing; owner (R,): the curved surface of each region, or -1."""
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
