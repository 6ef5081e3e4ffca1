"""Make one closed body of triangles from the polygons of a mesh, wound anticlockwise seen from outside. Repairs what
slicers repair, and notes each repair in a line. Pure."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np

from daemon.arrays import Array, Flags, Index
from daemon.teaching.mesh import Mesh, MeshError
from daemon.vision.geometry import area_vector

Triangle = tuple[int, int, int]
Edge = tuple[int, int]
SAME_CORNER_MM = 0.01
"""Corners nearer than half of this along each axis are one corner."""
SPLITS = 8
"""Largest number of times that an edge is split again while corners lie in its pieces."""
MIN_VOLUME_MM3 = 1.0


@dataclass(frozen=True, eq=False)
class Surface:
    """corners (K, 3) mm and the triangles between them; notes: repairs and omissions, one line each."""

    corners: Array
    triangles: list[Triangle]
    notes: tuple[str, ...] = ()


def closed_surface(mesh: Mesh) -> Surface:
    """The surface of the one body that a mesh bounds. Raises MeshError, with the place, where it bounds none or
    several."""
    corners, triangles = _welded(mesh)
    triangles, doubled = _each_once(triangles)
    triangles, split = _split_at_corners(corners, triangles, max(SAME_CORNER_MM, mesh.step_mm))
    notes = [*mesh.notes]
    if doubled:
        notes.append(f"{doubled} doubled triangles are left out")
    if split:
        notes.append(f"{split} edges are split where a corner of a neighbour lies in them")
    bodies = [_outward(corners, body) for body in _oriented(corners, triangles)]
    body, more = _one_body(corners, bodies)
    return Surface(corners, body, (*notes, *more))


def _welded(mesh: Mesh) -> tuple[Array, list[Triangle]]:
    """Merge equal corners; keep the triangles that still have three."""
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
    """(K,) the first of the corners (K, 3) that are one corner: two that are closer along each axis than half of
    SAME_CORNER_MM share a cell of that size in one of the grids shifted by half a cell or not."""
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
    """Cut a polygon into triangles by ear clipping, as a notched one is no fan. Source: Meisters, 1975."""
    normal = area_vector(corners[ring])
    rest, found = list(ring), []
    while len(rest) > 3:
        ears = (k for k in range(len(rest)) if _is_ear(corners, rest, k, normal))
        k = next(ears, 0)  # crossing itself or without an area: whatever is wrong with it is found out later
        found.append((rest[k - 1], rest[k], rest[(k + 1) % len(rest)]))
        del rest[k]
    return [*found, (rest[0], rest[1], rest[2])]


def _is_ear(corners: Array, ring: list[int], place: int, normal: Array) -> bool:
    """Whether the corner at that place is convex, and no other corner lies in the triangle with its neighbours."""
    a, b, c = (corners[ring[k % len(ring)]] for k in (place - 1, place, place + 1))
    if np.cross(b - a, c - b) @ normal <= 0:
        return False
    others = corners[[k for k in ring if k not in (ring[place - 1], ring[place], ring[(place + 1) % len(ring)])]]
    sides = np.array([np.cross(e - s, others - s) @ normal for s, e in ((a, b), (b, c), (c, a))])
    return not bool((sides >= 0).all(axis=0).any())


def _each_once(triangles: list[Triangle]) -> tuple[list[Triangle], int]:
    """Remove repeated triangles, whatever their winding; returns the others and how many were removed."""
    once = {frozenset(triangle): triangle for triangle in reversed(triangles)}
    return list(reversed(once.values())), len(triangles) - len(once)


def _split_at_corners(corners: Array, triangles: list[Triangle], near_mm: float) -> tuple[list[Triangle], int]:
    """Split edges that have a triangle on one side only where a corner of another such edge lies on them; returns how
    many."""
    split = 0
    for _ in range(SPLITS):
        alone = _open_edges(triangles)
        loose = np.array(sorted({k for edge in alone for k in edge}), np.intp)
        cuts = {edge: inner for edge in alone if (inner := _corners_in(corners, edge, loose, near_mm))}
        if not cuts:
            break
        split += len(cuts)
        triangles = [piece for triangle in triangles for piece in _pieces(triangle, cuts)]
    return triangles, split


def _open_edges(triangles: list[Triangle]) -> list[Edge]:
    beside: dict[Edge, list[Edge]] = {}
    for triangle in triangles:
        for a, b in edges_of(triangle):
            beside.setdefault((min(a, b), max(a, b)), []).append((a, b))
    return [both[0] for both in beside.values() if len(both) == 1]


def _corners_in(corners: Array, edge: Edge, loose: Index, near_mm: float) -> list[int]:
    """The loose corners that lie within an edge, in the edge's order."""
    start, way = corners[edge[0]], corners[edge[1]] - corners[edge[0]]
    along = (corners[loose] - start) @ way / max(float(way @ way), 1e-12)
    off = np.linalg.norm(corners[loose] - start - along[:, None] * way, axis=1)
    margin = near_mm / max(float(np.linalg.norm(way)), 1e-9)
    inner = (off < near_mm) & (along > margin) & (along < 1 - margin)
    return [int(k) for k in loose[inner][np.argsort(along[inner])]]


def _pieces(triangle: Triangle, cuts: dict[Edge, list[int]]) -> list[Triangle]:
    """Cut a triangle from the corner opposite to its first edge with corners in it."""
    a, b, c = triangle
    for p, q, r in ((a, b, c), (b, c, a), (c, a, b)):
        if inner := cuts.get((p, q)):
            stops = [p, *inner, q]
            return [(m, n, r) for m, n in pairwise(stops) if len({m, n, r}) == 3]
    return [triangle]


def _oriented(corners: Array, triangles: list[Triangle]) -> list[list[Triangle]]:
    """The connected pieces, each wound consistently. Raises MeshError where the surface has a gap, more than two
    triangles at an edge, or only one side."""
    beside: dict[frozenset[int], list[int]] = {}
    for t, triangle in enumerate(triangles):
        for edge in edges_of(triangle):
            beside.setdefault(frozenset(edge), []).append(t)
    gaps = [edge for edge, both in beside.items() if len(both) == 1]
    crowded = [edge for edge, both in beside.items() if len(both) > 2]
    if gaps and not crowded:
        raise MeshError(
            f"not closed: {len(gaps)} edges have a triangle on one side only, one {_from_to(corners, gaps[0])}; "
            "repair the mesh"
        )
    if crowded:
        raise MeshError(
            f"more than two triangles share an edge, one {_from_to(corners, crowded[0])}: bodies that touch there, or "
            "a sheet without thickness; join them into one"
        )
    bodies, turned = [], dict[int, Triangle]()
    for seed in range(len(triangles)):
        if seed in turned:
            continue
        turned[seed] = triangles[seed]
        body, queue = [seed], deque([seed])
        while queue:
            here = turned[t := queue.popleft()]
            for a, b in edges_of(here):
                other = sum(beside[frozenset((a, b))]) - t
                if other in turned:
                    if (a, b) in edges_of(turned[other]):
                        raise MeshError(
                            f"the surface has only one side, seen {_from_to(corners, (a, b))}; repair the mesh"
                        )
                    continue
                p, q, r = triangles[other]
                turned[other] = (p, r, q) if (a, b) in edges_of(triangles[other]) else (p, q, r)
                body.append(other)
                queue.append(other)
        bodies.append([turned[t] for t in sorted(body)])
    return bodies


def _outward(corners: Array, triangles: list[Triangle]) -> list[Triangle]:
    """Wind the triangles so that the volume is positive. Raises MeshError where there is none."""
    volume_mm3 = _volume(corners, triangles)
    if abs(volume_mm3) < MIN_VOLUME_MM3:
        raise MeshError(f"{_extent(corners, triangles)} has no inside; repair the mesh")
    return triangles if volume_mm3 > 0 else [(p, r, q) for p, q, r in triangles]


def _one_body(corners: Array, bodies: list[list[Triangle]]) -> tuple[list[Triangle], list[str]]:
    """The largest body; hollows inside are left out, as no camera sees them. Raises MeshError for further bodies."""
    largest, *others = sorted(bodies, key=lambda body: -_volume(corners, body))
    notes = []
    for body in others:
        what = _extent(corners, body)
        if crossing(corners, largest, body):
            raise MeshError(f"{len(bodies)} bodies that overlap: {what} crosses the largest; join them into one")
        if not inside(corners[body[0][:1]], corners, largest)[0]:
            raise MeshError(f"{len(bodies)} bodies that do not touch, one {what}; a part is one body: save one a file")
        notes.append(f"a hollow that shows nowhere is left out: {what}")
    return largest, notes


def inside(points: Array, corners: Array, triangles: list[Triangle]) -> Flags:
    """(N,) whether points (N, 3) are inside a closed surface, by the solid angle that it fills. Source: Van Oosterom
    and Strackee, 1983."""
    total = np.zeros(len(points))
    for k, point in enumerate(points):
        rays = corners[np.array(triangles)] - point
        a, b, c = np.moveaxis(rays / np.maximum(np.linalg.norm(rays, axis=2, keepdims=True), 1e-12), 1, 0)
        below = 1 + (a * b).sum(1) + (b * c).sum(1) + (c * a).sum(1)
        total[k] = 2 * np.arctan2((a * np.cross(b, c)).sum(1), below).sum()
    return np.abs(total) > 2 * np.pi


def crossing(corners: Array, one: list[Triangle], other: list[Triangle]) -> bool:
    """Whether an edge of one surface passes through a triangle of the other."""
    return _pierced(corners, one, other) or _pierced(corners, other, one)


def _pierced(corners: Array, triangles: list[Triangle], by: list[Triangle]) -> bool:
    """Source: Moeller and Trumbore, 1997."""
    a, b, c = np.moveaxis(corners[np.array(triangles)], 1, 0)
    one, two = b - a, c - a
    for edge in {(min(e), max(e)) for triangle in by for e in edges_of(triangle)}:
        start, way = corners[edge[0]], corners[edge[1]] - corners[edge[0]]
        p = np.cross(way, two)
        det = (one * p).sum(1)
        det = np.where(np.abs(det) < 1e-9, np.nan, det)
        t = start - a
        u = (t * p).sum(1) / det
        q = np.cross(t, one)
        v, along = q @ way / det, (two * q).sum(1) / det
        if ((u > 0) & (v > 0) & (u + v < 1) & (along > 0) & (along < 1)).any():
            return True
    return False


def _volume(corners: Array, triangles: list[Triangle]) -> float:
    a, b, c = np.moveaxis(corners[np.array(triangles)] - corners[triangles[0][0]], 1, 0)
    return float((a * np.cross(b, c)).sum() / 6)


def _extent(corners: Array, triangles: Iterable[Triangle]) -> str:
    points = corners[sorted({k for triangle in triangles for k in triangle})]
    size = " x ".join(f"{side:.3g}" for side in np.ptp(points, axis=0))
    return f"of {size} mm about ({_place(points.mean(axis=0))})"


def _from_to(corners: Array, edge: Iterable[int]) -> str:
    one, other = sorted(edge)
    return f"from ({_place(corners[one])}) to ({_place(corners[other])})"


def _place(point: Array) -> str:
    return " ".join(f"{value + 0.0:.4g}" for value in np.round(point, 3))


def edges_of(triangle: Triangle) -> tuple[Edge, Edge, Edge]:
    """The sides of a triangle, in its winding."""
    a, b, c = triangle
    return (a, b), (b, c), (c, a)
