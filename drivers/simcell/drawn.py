"""Shape of a part from a drawing: cut the solid into convex pieces. Pure; corners and facets in."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np

from drivers.arrays import Array
from drivers.simcell.parts import ConvexSolid, PartShape, hull, shape, stable_rests, volume_and_centre
from drivers.simcell.surface import DrawnSurface

NEAR_MM = 1e-3
"""Tolerance of a drawing's corners: STL has single precision."""
SAME_VOLUME, SAME_WAY = 1e-4, 1e-9
CHORD_MM = 0.1
"""The hull's face and the surface are as near where the part can rest; a chord of a rounding has its middle inside."""
MOST_CORNERS = 90
MOST_PIECES = 24
Ring = Sequence[int]


class DrawnError(Exception):
    """A drawing that the simulated cell cannot show; the message says why."""


def drawn_shape(
    label: str, corners_mm: Array, facets: Sequence[Ring], surface: DrawnSurface | None = None
) -> PartShape:
    """The shape with these (K, 3) corners and flat facets, anticlockwise from outside. Raises DrawnError.

    The plane of every facet with corners beyond it cuts the hull. Pieces inside the solid are kept, and joined again
    where two are convex together. surface: the part's true one, in the same frame; the part rests on nothing that
    is round there, and its centre of mass is that of this surface.
    """
    if len(corners_mm) > MOST_CORNERS:
        raise DrawnError(f"{len(corners_mm)} corners; the simulated cell shows parts of at most {MOST_CORNERS}")
    pieces, cuts = [_hull(corners_mm)], _cuts(corners_mm, facets)
    for normal, offset in cuts:
        pieces = [half for piece in pieces for half in _halves(piece, normal, offset)]
        if len(pieces) > 8 * MOST_PIECES:
            raise DrawnError("too many hollows for the simulated cell")
    inside = [piece for piece in pieces if not cuts or _inside(piece.vertices.mean(axis=0), corners_mm, facets)]
    if not inside:
        raise DrawnError("no inside: its facets are not closed")
    kept = _joined(inside)
    if len(kept) > MOST_PIECES:
        raise DrawnError(f"{len(kept)} convex pieces; the simulated cell shows parts of at most {MOST_PIECES}")
    made = shape(label, *(piece.vertices for piece in kept), flat_mm=NEAR_MM)
    if surface is not None:
        made = _with_surface(made, surface.moved(made.pieces[0].vertices[0] - kept[0].vertices[0]))
    if not made.rests:
        raise DrawnError("it has no stable face")
    return made


def _with_surface(made: PartShape, surface: DrawnSurface) -> PartShape:
    """The shape with a surface for its appearance; it rests on the flat faces of the surface's hull."""
    centre = surface.volume_and_centre[1]
    touching = [
        abs(surface.beyond(normal) - offset) < CHORD_MM
        for normal, offset in zip(made.hull.normals, made.hull.offsets, strict=True)
    ]
    true = [k for k, touches in enumerate(touching) if touches]
    flat = replace(
        made.hull,
        faces=tuple(made.hull.faces[k] for k in true),
        normals=made.hull.normals[true],
        offsets=made.hull.offsets[true],
    )
    return replace(made, centre_of_mass=centre, rests=stable_rests(flat, centre), surface=surface)


def _cuts(corners: Array, facets: Sequence[Ring]) -> list[tuple[Array, float]]:
    """Planes of facets with corners beyond them, each once."""
    found: list[tuple[Array, float]] = []
    for ring in facets:
        points = corners[list(ring)]
        area = np.sum(np.cross(points, np.roll(points, -1, axis=0)), axis=0)
        normal = area / np.linalg.norm(area)
        offset = float(points[0] @ normal)
        duplicate = any(
            abs(abs(n @ normal) - 1) < SAME_WAY and abs(o - offset * np.sign(n @ normal)) < NEAR_MM for n, o in found
        )
        if (corners @ normal).max() > offset + NEAR_MM and not duplicate:
            found.append((normal, offset))
    return found


def _halves(piece: ConvexSolid, normal: Array, offset: float) -> list[ConvexSolid]:
    """A convex piece cut by a plane."""
    above = piece.vertices @ normal - offset
    if above.max() < NEAR_MM or above.min() > -NEAR_MM:
        return [piece]
    edges = {tuple(sorted(edge)) for face in piece.faces for edge in pairwise((*face, face[0]))}
    crossings = [
        piece.vertices[a] + (piece.vertices[b] - piece.vertices[a]) * above[a] / (above[a] - above[b])
        for a, b in edges
        if above[a] * above[b] < 0 and min(abs(above[a]), abs(above[b])) > NEAR_MM
    ]
    on = np.array(crossings).reshape(-1, 3)
    return [_hull(np.vstack([piece.vertices[side], on])) for side in (above > -NEAR_MM, above < NEAR_MM)]


def _inside(point: Array, corners: Array, facets: Sequence[Ring]) -> bool:
    """Whether a point (3,) is inside the facets: their solid angles add up to 4 pi, else to 0."""
    total = 0.0
    for ring in facets:
        rays = corners[list(ring)] - point
        rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        for b, c in pairwise(rays[1:]):
            a = rays[0]
            total += 2 * np.arctan2(a @ np.cross(b, c), 1 + a @ b + b @ c + c @ a)
    return bool(abs(total) > 2 * np.pi)


def _joined(pieces: list[ConvexSolid]) -> list[ConvexSolid]:
    """The same solid in fewer convex pieces, by joining pairs as long as possible."""
    sized = [(piece, volume_and_centre(piece)[0]) for piece in pieces]
    apart = set[tuple[ConvexSolid, ConvexSolid]]()
    while True:
        for i, j in combinations(range(len(sized)), 2):
            (one, size), (two, more) = sized[i], sized[j]
            if (one, two) in apart or not _touch(one, two):
                continue
            apart.add((one, two))
            both = _hull(np.vstack([one.vertices, two.vertices]))
            if abs(volume_and_centre(both)[0] - size - more) < SAME_VOLUME * (size + more):
                rest = [pair for k, pair in enumerate(sized) if k not in (i, j)]
                sized = [*rest, (both, size + more)]
                break
        else:
            return [piece for piece, _ in sized]


def _touch(one: ConvexSolid, other: ConvexSolid) -> bool:
    """Whether two pieces have corners on one plane, on which the faces of either look at each other."""
    across = one.normals @ other.normals.T < SAME_WAY - 1
    return bool((across & (np.abs(one.offsets[:, None] + other.offsets) < NEAR_MM)).any())


def _hull(points: Array) -> ConvexSolid:
    """Convex hull of (N, 3) points, with its corners only, each once."""
    _, first = np.unique(np.round(points / NEAR_MM).astype(np.int64), axis=0, return_index=True)
    full = hull(points[np.sort(first)], NEAR_MM)
    used = sorted({k for face in full.faces for k in face})
    return hull(full.vertices[used], NEAR_MM) if len(used) < len(full.vertices) else full
