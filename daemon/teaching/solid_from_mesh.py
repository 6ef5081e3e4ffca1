"""Polygons of a mesh -> a solid with flat facets, as the recogniser knows parts. Pure.

Corners that coincide become one, triangles of one plane one facet; the rings run anticlockwise seen from outside. What
a camera could not tell (a corner in the middle of a straight side) goes.
"""

from __future__ import annotations

from collections import deque
from itertools import product

import numpy as np

from daemon.arrays import Array, Index
from daemon.teaching.mesh import Mesh, MeshError, read_mesh
from daemon.vision.geometry import Polyhedron, area_vector, border_loops
from daemon.vision.model import FacetLibrary, type_facet

Triangle = tuple[int, int, int]
Edge = tuple[int, int]
SAME_CORNER_MM = 0.01
"""Corners nearer than half of this each way are one."""
SAME_PLANE_DEG, SAME_PLANE_MM = 0.5, 0.05
STRAIGHT_DEG = 1.0
MOST_FACETS = 40
"""More than that, and it is a curved surface cut into strips; it has no facets to be recognised by."""
DRAWN_MM = 0.05
"""How far corners on a drawing are off (one standard deviation); how far real parts are off is the model's business."""


def solid_drawn(name: str, content: bytes, unit: str, library: FacetLibrary) -> Polyhedron:
    """The solid in a drawing's file. Raises MeshError, which names the file."""
    mesh = read_mesh(name, content, unit)
    try:
        return solid_of(mesh, library)
    except MeshError as error:
        raise MeshError(f"{name}: {error}") from None


def solid_of(mesh: Mesh, library: FacetLibrary) -> Polyhedron:
    """The solid a mesh bounds. Raises MeshError where it bounds none, or one without flat facets."""
    corners, triangles = _welded(mesh)
    triangles = _outward(corners, _oriented(triangles))
    regions = _flat_regions(corners, triangles)
    if len(regions) > MOST_FACETS:
        raise MeshError(f"{len(regions)} facets: a curved surface? at most {MOST_FACETS} flat ones tell a part")
    rings = [_straightened(corners, _outline(corners, [triangles[k] for k in region])) for region in regions]
    if any(len(ring) < 3 for ring in rings):
        raise MeshError("a facet without an area; mend the mesh")
    used = sorted({k for ring in rings for k in ring})
    place = {k: n for n, k in enumerate(used)}
    points = corners[used] - corners[used].mean(axis=0)
    facets = tuple(tuple(place[k] for k in ring) for ring in rings)
    covariance = np.repeat(DRAWN_MM**2 * np.eye(3)[None], len(points), axis=0)
    types = tuple(type_facet(points[list(f)], covariance[list(f)], library)[0].name for f in facets)
    return Polyhedron(points, facets, covariance, types)


def _welded(mesh: Mesh) -> tuple[Array, list[Triangle]]:
    """Corners that are not one, and the triangles between them that have an area."""
    first = _first_of_each(mesh.corners_mm)
    kept = np.unique(first)
    kept = kept[np.lexsort(np.round(mesh.corners_mm[kept] / SAME_CORNER_MM).T[::-1])]
    owner = np.zeros(len(first), np.intp)
    owner[kept] = np.arange(len(kept))
    corners, owner = mesh.corners_mm[kept], owner[first]
    triangles = []
    for polygon in mesh.polygons:
        ring = [int(owner[k]) for k in polygon]
        triangles += [one for one in in_triangles(corners, ring) if len(set(one)) == 3]
    if len(triangles) < 4:
        raise MeshError(f"{len(triangles)} triangles bound no solid")
    return corners, triangles


def _first_of_each(corners: Array) -> Index:
    """(K,) the first of those that each of corners (K, 3) is one with: what lies nearer together each way than half of
    SAME_CORNER_MM has a cell of that size in common, in one of the grids that are shifted by half a cell or not."""
    first = here = np.arange(len(corners))
    for shift in product((0.0, 0.5), repeat=3):
        cells = np.floor(corners / SAME_CORNER_MM + shift).astype(np.int64)
        cell = np.unique(cells, axis=0, return_inverse=True)[1].ravel()
        while True:
            least, onto = np.full(len(corners), len(corners)), here.copy()
            np.minimum.at(least, cell, first)
            np.minimum.at(onto, first, least[cell])
            if (onto == here).all():
                break
            first = onto[first]
    return first


def in_triangles(corners: Array, ring: list[int]) -> list[Triangle]:
    """A polygon cut into triangles, ear by ear: one with a notch is no fan. Source: Meisters, 1975."""
    normal = area_vector(corners[ring])
    rest, found = list(ring), []
    while len(rest) > 3:
        ears = (k for k in range(len(rest)) if _is_ear(corners, rest, k, normal))
        k = next(ears, 0)  # crossing itself or without an area: whatever is wrong with it is found out later
        found.append((rest[k - 1], rest[k], rest[(k + 1) % len(rest)]))
        del rest[k]
    return [*found, (rest[0], rest[1], rest[2])]


def _is_ear(corners: Array, ring: list[int], place: int, normal: Array) -> bool:
    """Whether the corner at that place juts out, and no other corner lies in the triangle with its neighbours."""
    a, b, c = (corners[ring[k % len(ring)]] for k in (place - 1, place, place + 1))
    if np.cross(b - a, c - b) @ normal <= 0:
        return False
    others = corners[[k for k in ring if k not in (ring[place - 1], ring[place], ring[(place + 1) % len(ring)])]]
    sides = np.array([np.cross(e - s, others - s) @ normal for s, e in ((a, b), (b, c), (c, a))])
    return not bool((sides >= 0).all(axis=0).any())


def _oriented(triangles: list[Triangle]) -> list[Triangle]:
    """All wound the same way round. Raises MeshError where the surface has a gap, a crossing, or several pieces."""
    beside: dict[frozenset[int], list[int]] = {}
    for t, triangle in enumerate(triangles):
        for edge in _edges(triangle):
            beside.setdefault(frozenset(edge), []).append(t)
    gaps = sum(len(both) == 1 for both in beside.values())
    if gaps:
        raise MeshError(f"not closed: {gaps} edges have a triangle on one side only; mend the mesh")
    if any(len(both) > 2 for both in beside.values()):
        raise MeshError("more than two triangles share an edge: bodies that touch or cross; join them into one")
    turned = {0: triangles[0]}
    queue = deque([0])
    while queue:
        here = turned[t := queue.popleft()]
        for a, b in _edges(here):
            (other,) = [k for k in beside[frozenset((a, b))] if k != t]
            if other in turned:
                if (a, b) in _edges(turned[other]):
                    raise MeshError("the surface has only one side; mend the mesh")
                continue
            p, q, r = triangles[other]
            turned[other] = (p, r, q) if (a, b) in _edges(triangles[other]) else (p, q, r)
            queue.append(other)
    if len(turned) < len(triangles):
        raise MeshError("several bodies that do not touch; a part is one")
    return [turned[t] for t in range(len(triangles))]


def _outward(corners: Array, triangles: list[Triangle]) -> list[Triangle]:
    """Wound so that the volume inside is positive."""
    a, b, c = (corners[[t[k] for t in triangles]] for k in range(3))
    volume_mm3 = float((a * np.cross(b, c)).sum() / 6)
    if abs(volume_mm3) < 1.0:
        raise MeshError("it has no inside; mend the mesh")
    return triangles if volume_mm3 > 0 else [(p, r, q) for p, q, r in triangles]


def _flat_regions(corners: Array, triangles: list[Triangle]) -> list[list[int]]:
    """Triangles that hang together in one plane, largest triangle first: small ones do not tell a plane well."""
    a, b, c = (corners[[t[k] for t in triangles]] for k in range(3))
    normals = np.cross(b - a, c - a)
    areas = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(areas, 1e-12)[:, None]
    owner = {edge: t for t, triangle in enumerate(triangles) for edge in _edges(triangle)}
    free = set(range(len(triangles)))
    regions = []
    for seed in np.argsort(-areas):
        if int(seed) not in free:
            continue
        free.discard(int(seed))
        region, queue = [int(seed)], deque([int(seed)])
        while queue:
            for p, q in _edges(triangles[queue.popleft()]):
                other = owner[q, p]
                off_mm = np.abs((corners[list(triangles[other])] - a[seed]) @ normals[seed]).max()
                thin = areas[other] < 1e-3
                flat = normals[other] @ normals[seed] > np.cos(np.radians(SAME_PLANE_DEG))
                if other in free and off_mm < SAME_PLANE_MM and (flat or thin):
                    free.discard(other)
                    region.append(other)
                    queue.append(other)
        regions.append(region)
    return regions


def _outline(corners: Array, triangles: list[Triangle]) -> list[int]:
    """The outer border of a flat region; holes in it are not looked at."""
    own = {edge for triangle in triangles for edge in _edges(triangle)}
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


def _edges(triangle: Triangle) -> tuple[Edge, Edge, Edge]:
    a, b, c = triangle
    return (a, b), (b, c), (c, a)
