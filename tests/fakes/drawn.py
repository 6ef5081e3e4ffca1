"""Drawings for tests: convex polyhedra as STL (binary, text) and OBJ, and the solids read from them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import pairwise

import numpy as np

from daemon.store.library import load_facets
from daemon.teaching.solid_from_mesh import solid_drawn
from daemon.vision.geometry.polyhedron import Polyhedron

CUBE_RINGS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def box(a: float = 50, b: float = 50, c: float = 50) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    """Corners (8, 3) and rings, anticlockwise from outside."""
    corners = np.array([[x, y, z] for x in (0, a) for y in (0, b) for z in (0, c)], float)
    return corners, list(CUBE_RINGS)


def prism(outline: Sequence[tuple[float, float]], height: float) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    """A prism over an outline that runs anticlockwise; its base may be concave."""
    flat, count = np.array(outline, float), len(outline)
    corners = np.vstack([np.column_stack([flat, np.full(count, z)]) for z in (0.0, height)])
    sides = [(i, (i + 1) % count, (i + 1) % count + count, i + count) for i in range(count)]
    return corners, [tuple(range(count))[::-1], tuple(range(count, 2 * count)), *sides]


def bored_block(a: float, b: float, c: float, radius: float, strips: int) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    """A box with a bore through its middle along z, its flat sides cut into triangles about the bore."""
    turns = 2 * np.pi * np.arange(strips) / strips
    ring = np.column_stack([a / 2 + radius * np.cos(turns), b / 2 + radius * np.sin(turns)])
    outer = np.array([[a, b], [0, b], [0, 0], [a, 0]], float)
    level = [np.column_stack([np.vstack([ring, outer]), np.full(strips + 4, z)]) for z in (0.0, c)]
    high = strips + 4
    rings: list[tuple[int, ...]] = []
    for k in range(strips):
        after, corner = (k + 1) % strips, strips + 4 * k // strips
        rings += [(high + k, corner + high, high + after), (k, after, corner)]  # top, bottom
        rings.append((k, high + k, high + after, after))  # the bore's wall, seen from inside it
        beyond = strips + 4 * ((k + 1) % strips) // strips
        if beyond != corner:
            rings += [(high + after, high + corner, high + beyond), (after, beyond, corner)]
            rings.append((corner, beyond, beyond + high, corner + high))
    return np.vstack(level), rings


def ball(radius: float, strips: int = 24) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    """A ball in strips of quadrilaterals, and triangles at its poles."""
    heights, turns = np.linspace(0, np.pi, strips // 2 + 1)[1:-1], 2 * np.pi * np.arange(strips) / strips
    rows = [[np.sin(h) * np.cos(t), np.sin(h) * np.sin(t), np.cos(h)] for h in heights for t in turns]
    corners = radius * np.array([*rows, [0, 0, 1], [0, 0, -1]])
    last, top, bottom = len(rows) - strips, len(rows), len(rows) + 1
    after = [(k, (k + 1) % strips) for k in range(strips)]
    rings: list[tuple[int, ...]] = [*((top, a, b) for a, b in after), *((bottom, last + b, last + a) for a, b in after)]
    rings += [(r + a, r + strips + a, r + strips + b, r + b) for r in range(0, last, strips) for a, b in after]
    return corners, rings


L_BLOCK = [(0, 0), (60, 0), (60, 25), (25, 25), (25, 60), (0, 60)]


def obj(corners: np.ndarray, rings: list[tuple[int, ...]]) -> bytes:
    """As an OBJ file, with what such files are full of."""
    lines = ["# drawn by hand", "mtllib none.mtl", "o part"]
    lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in corners]
    lines += ["vn 0 0 1"] + ["f " + " ".join(f"{k + 1}//1" for k in ring) for ring in rings]
    return "\n".join(lines).encode()


def triangles(corners: np.ndarray, rings: list[tuple[int, ...]]) -> np.ndarray:
    """(N, 3, 3) corners of a fan over each ring."""
    return np.array([corners[[ring[0], b, c]] for ring in rings for b, c in pairwise(ring[1:])])


def binary_stl(corners: np.ndarray, rings: list[tuple[int, ...]]) -> bytes:
    """With a header that begins as an ASCII file does, as many programs write it."""
    found = triangles(corners, rings).astype("<f4")
    body = b"".join(np.zeros(3, "<f4").tobytes() + one.tobytes() + b"\0\0" for one in found)
    return b"solid of some program".ljust(80) + len(found).to_bytes(4, "little") + body


def ascii_stl(corners: np.ndarray, rings: list[tuple[int, ...]]) -> bytes:
    """In words."""
    lines = ["solid part"]
    for one in triangles(corners, rings):
        lines += ["facet normal 0 0 0", " outer loop", *(f"  vertex {x:e} {y:e} {z:e}" for x, y, z in one),
                  " endloop", "endfacet"]  # fmt: skip
    return "\n".join([*lines, "endsolid part"]).encode()


@cache
def solid(name: str, content: bytes, unit: str = "mm") -> Polyhedron:
    """What a drawing is read as. Tests share it."""
    return solid_drawn(name, content, unit, load_facets())


def block(*sides: float) -> Polyhedron:
    """A box, drawn and read."""
    return solid("box.obj", obj(*box(*sides)))
