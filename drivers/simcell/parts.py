"""Shapes of parts: convex polyhedra, or several joined ones, and their stable poses.

In the part's own frame (mm, origin at the centroid of the corners).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from drivers.arrays import Array
from drivers.rigid import rigid, turn, turn_between
from drivers.simcell.surface import DrawnSurface

FLAT_MM = 1e-6
MARGIN_MM = 3.0
AT_ONCE = 20_000
"""Triples of corners tested at once: memory against time."""


@dataclass(frozen=True, eq=False)
class ConvexSolid:
    """A convex polyhedron: vertices (V, 3) mm; faces as vertex indices, anticlockwise from outside.

    normals (F, 3) unit, outward; offsets (F,) mm with normals @ x <= offsets inside.
    """

    vertices: Array
    faces: tuple[tuple[int, ...], ...]
    normals: Array
    offsets: Array


@dataclass(frozen=True, eq=False)
class PartShape:
    """A part's shape: label, its convex pieces, their common hull, its centre of mass (3,) mm.

    rests: stable poses, each the (4, 4) rests_from_part that puts a face of the hull on z = 0 with the centre of mass
    above the origin. surface: what cameras see of a part from a drawing, whose bores and roundings the pieces lack.
    """

    label: str
    pieces: tuple[ConvexSolid, ...]
    hull: ConvexSolid
    centre_of_mass: Array
    rests: tuple[Array, ...]
    surface: DrawnSurface | None = None


def hull(points: Array, flat_mm: float = FLAT_MM) -> ConvexSolid:
    """Convex hull of (N, 3) points, up to a hundred; triangles coplanar within flat_mm are one face."""
    found: dict[bytes, Array] = {}
    triples = np.array(list(combinations(range(len(points)), 3)))
    for some in np.array_split(triples, len(triples) // AT_ONCE + 1):
        a, b, c = (points[some[:, k]] for k in range(3))
        crossed = np.cross(b - a, c - a)
        length = np.maximum(np.linalg.norm(crossed, axis=1), 1e-300)
        off = (points @ (crossed / length[:, None]).T) - np.sum(a * crossed, axis=1) / length
        outside = (length >= flat_mm) & ((off.max(axis=0) < flat_mm) | (off.min(axis=0) > -flat_mm))
        outward = np.where(off.min(axis=0) > -flat_mm, -1.0, 1.0)[outside]
        on = (off[:, outside] * outward > -flat_mm).T
        for members, normal in zip(on, (outward / length[outside])[:, None] * crossed[outside], strict=True):
            found[members.tobytes()] = normal
    faces = tuple(
        _loop(points, tuple(np.flatnonzero(np.frombuffer(members, bool))), normal) for members, normal in found.items()
    )
    normals = np.array(list(found.values()))
    offsets = np.array([normals[i] @ points[f[0]] for i, f in enumerate(faces)])
    return ConvexSolid(points, faces, normals, offsets)


def _loop(points: Array, members: tuple[int, ...], normal: Array) -> tuple[int, ...]:
    """The extreme points among coplanar members, anticlockwise about the outward normal."""
    spread = points[list(members)] - points[list(members)].mean(axis=0)
    across = spread[np.argmax(np.linalg.norm(spread, axis=1))]
    flat = np.column_stack([spread @ across, spread @ np.cross(normal, across)])
    ring = list(np.argsort(np.arctan2(flat[:, 1], flat[:, 0])))
    flat /= np.linalg.norm(across)
    i = int(np.argmax(np.linalg.norm(spread[ring], axis=1)))
    ring = ring[i:] + ring[:i]
    k, kept = 1, 0
    while kept < len(ring):
        (x0, y0), (x1, y1), (x2, y2) = (flat[ring[(k + step) % len(ring)]].tolist() for step in (-1, 0, 1))
        if (x1 - x0) * (y2 - y1) - (y1 - y0) * (x2 - x1) > FLAT_MM:
            k, kept = k + 1, kept + 1
        else:
            ring.pop(k % len(ring))
            k, kept = k - 1, 0
    return tuple(int(members[i]) for i in ring)


def volume_and_centre(solid: ConvexSolid) -> tuple[float, Array]:
    """Volume in mm^3 and centre of mass (3,) mm, by tetrahedra from the origin."""
    volume, moment = 0.0, np.zeros(3)
    for face in solid.faces:
        a = solid.vertices[face[0]]
        for b, c in zip(solid.vertices[list(face[1:-1])], solid.vertices[list(face[2:])], strict=True):
            part = float(np.dot(a, np.cross(b, c))) / 6.0
            volume += part
            moment += part * (a + b + c) / 4.0
    return volume, moment / volume


def stable_rests(solid: ConvexSolid, centre_of_mass: Array) -> tuple[Array, ...]:
    """The (4, 4) rests_from_part of each face with the centre of mass above it, at least MARGIN_MM from its sides."""
    rests = []
    for face, normal in zip(solid.faces, solid.normals, strict=True):
        corners = solid.vertices[list(face)]
        along = np.roll(corners, -1, axis=0) - corners
        inward = np.cross(normal, along / np.linalg.norm(along, axis=1, keepdims=True))
        if np.min(np.sum(inward * (centre_of_mass - corners), axis=1)) >= MARGIN_MM:
            down = turn_between(normal, np.array([0.0, 0.0, -1.0]))
            centre = down @ centre_of_mass
            rests.append(rigid(down, [-centre[0], -centre[1], -(down @ corners[0])[2]]))
    return tuple(rests)


def shape(label: str, *clouds: Array, flat_mm: float = FLAT_MM) -> PartShape:
    """The shape with the hulls of (N, 3) point clouds as convex pieces, which may touch but not overlap."""
    centroid = np.unique(np.vstack(clouds), axis=0).mean(axis=0)
    pieces = tuple(hull(cloud - centroid, flat_mm) for cloud in clouds)
    masses = [volume_and_centre(piece) for piece in pieces]
    centre = np.sum([v * c for v, c in masses], axis=0) / sum(v for v, _ in masses)
    common = (
        pieces[0] if len(pieces) == 1 else hull(np.unique(np.vstack([p.vertices for p in pieces]), axis=0), flat_mm)
    )
    return PartShape(label, pieces, common, centre, stable_rests(common, centre))


def prism(sides: int, side_mm: float, length_mm: float) -> Array:
    """(2 * sides, 3) corners of a regular prism along z, mm."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    ring = side_mm / (2.0 * np.sin(np.pi / sides)) * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.vstack([np.column_stack([ring, np.full(sides, z)]) for z in (0.0, length_mm)])


def box(low: Sequence[float], high: Sequence[float]) -> Array:
    """(8, 3) corners of an upright box, mm."""
    pick: NDArray[np.int_] = np.indices((2, 2, 2)).reshape(3, 8).T
    return np.where(pick == 1, np.asarray(high), np.asarray(low)).astype(float)


def _pyramid() -> PartShape:
    base = prism(4, 50.0, 1.0)[:4] @ turn([0, 0, 1], np.pi / 4).T
    return shape("pyramid", np.vstack([base, [[0.0, 0.0, 50.0]]]))


def _tetrahedron() -> PartShape:
    side = 60.0
    base = prism(3, side, 1.0)[:3]
    return shape("tetrahedron", np.vstack([base, [[0.0, 0.0, side * np.sqrt(2.0 / 3.0)]]]))


_MAKERS: dict[str, Callable[[], PartShape]] = {
    "cube": lambda: shape("cube", box((0, 0, 0), (50, 50, 50))),
    "pyramid": _pyramid,
    "triangular_prism": lambda: shape("triangular_prism", prism(3, 50.0, 70.0)),
    "pentagonal_prism": lambda: shape("pentagonal_prism", prism(5, 32.0, 70.0)),
    "hexagonal_prism": lambda: shape("hexagonal_prism", prism(6, 26.0, 60.0)),
    "l_block": lambda: shape("l_block", box((0, 0, 0), (60, 25, 40)), box((0, 25, 0), (25, 50, 40))),
    "tetrahedron": _tetrahedron,
}
TAUGHT = ("cube", "pyramid", "triangular_prism", "pentagonal_prism")
STRANGERS = ("hexagonal_prism", "l_block", "tetrahedron")


@cache
def part_shape(label: str) -> PartShape:
    """The built-in shape of a label. Raises KeyError with the valid labels."""
    if label not in _MAKERS:
        raise KeyError(f"no part named {label!r}; there are {', '.join(_MAKERS)}")
    return _MAKERS[label]()
