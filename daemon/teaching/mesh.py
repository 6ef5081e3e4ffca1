"""STL (ASCII or binary) and OBJ files -> corners and polygons in mm. Bytes in, arrays out, or one line that says why.

How a polyhedron is made of them is solid_from_mesh.py's. Colours, textures, normals and names in the files are not
looked at.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daemon.arrays import Array
from daemon.errors import FacetdError

UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}
"""Neither format says what its numbers are; millimetres unless told."""
LARGEST_BYTES = 4_000_000
SMALLEST_MM, LARGEST_MM = 5.0, 1000.0
STL_HEADER, STL_ROW = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("colour", "<u2")])
"""Bytes before the triangles of a binary STL, and what one of them is."""


class MeshError(FacetdError):
    """A mesh that cannot be used: one line, what is wrong and where."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """corners_mm (K, 3); polygons: corner indices of each, in the file's order."""

    corners_mm: Array
    polygons: tuple[tuple[int, ...], ...]


def read_mesh(name: str, content: bytes, unit: str = "mm") -> Mesh:
    """The mesh in a file's content; its name tells the format. Raises MeshError."""
    if len(content) > LARGEST_BYTES:
        raise MeshError(f"{name}: {len(content) / 1e6:.1f} MB: too large for a part with flat facets")
    kind = name.lower().rpartition(".")[2]
    readers = {"stl": _stl, "obj": _obj}
    if kind not in readers:
        raise MeshError(f"{name}: expected a name that ends in .stl or .obj")
    try:
        mesh = readers[kind](content)
    except MeshError as error:
        raise MeshError(f"{name}{error}") from None
    if not mesh.polygons:
        raise MeshError(f"{name}: holds no facet")
    if not np.isfinite(mesh.corners_mm).all():
        raise MeshError(f"{name}: a coordinate is not a number")
    mesh = Mesh(mesh.corners_mm * UNITS_MM[unit], mesh.polygons)
    used = mesh.corners_mm[np.unique(np.concatenate([np.array(p) for p in mesh.polygons]))]
    size_mm = float((used.max(axis=0) - used.min(axis=0)).max())
    if not SMALLEST_MM <= size_mm <= LARGEST_MM:
        others = ", ".join(u for u in UNITS_MM if u != unit)
        raise MeshError(f"{name}: {size_mm:.3g} mm long: is it in {unit}? say {others} behind the file's name")
    return mesh


def _stl(content: bytes) -> Mesh:
    """Many binary files begin with `solid` as well: what tells them apart is the length their count asks for."""
    if len(content) >= STL_HEADER:
        count = int.from_bytes(content[80:84], "little")
        if len(content) == STL_HEADER + STL_ROW.itemsize * count:
            return _binary_stl(content, count)
    if content.lstrip()[:5].lower() == b"solid" and b"\0" not in content:
        return _ascii_stl(content)
    if len(content) >= STL_HEADER:
        raise MeshError(
            f": cut short or not STL: {len(content)} bytes, {STL_HEADER + STL_ROW.itemsize * count} expected"
        )
    raise MeshError(": not STL")


def _binary_stl(content: bytes, count: int) -> Mesh:
    triangles = np.frombuffer(content, STL_ROW, count, STL_HEADER)["corners"].astype(float)
    return _of_triangles(triangles.reshape(-1, 3))


def _ascii_stl(content: bytes) -> Mesh:
    """Only the words `vertex X Y Z` and `endsolid` matter."""
    rows: list[tuple[float, ...]] = []
    ended = False
    for number, line in _lines(content):
        words = line.split()
        if words[0].lower() == "vertex":
            rows.append(_numbers(words[1:4], 3, number))
        ended = ended or words[0].lower() == "endsolid"
    if len(rows) % 3 or not ended:
        raise MeshError(": cut short: the last facet or `endsolid` is missing")
    return _of_triangles(np.array(rows, float).reshape(-1, 3))


def _of_triangles(corners: Array) -> Mesh:
    triangles = np.arange(len(corners)).reshape(-1, 3)
    return Mesh(corners, tuple(tuple(int(k) for k in row) for row in triangles))


def _obj(content: bytes) -> Mesh:
    """`v X Y Z` and `f I[/T][/N] ...`, counted from 1, or backwards from the last with negative numbers."""
    rows: list[tuple[float, ...]] = []
    polygons: list[tuple[int, ...]] = []
    for number, line in _lines(content):
        words = line.split()
        if words[0] == "v":
            rows.append(_numbers(words[1:4], 3, number))
        elif words[0] == "f":
            polygons.append(_polygon(words[1:], len(rows), number))
    return Mesh(np.array(rows, float).reshape(-1, 3), tuple(polygons))


def _polygon(words: list[str], corners: int, line: int) -> tuple[int, ...]:
    try:
        numbers = [int(word.split("/")[0]) for word in words]
    except ValueError:
        raise MeshError(f":{line}: expected numbers of corners, found {' '.join(words)[:40]!r}") from None
    found = tuple(k - 1 if k > 0 else corners + k for k in numbers)
    if len(found) < 3 or any(k == 0 for k in numbers) or any(not 0 <= k < corners for k in found):
        raise MeshError(f":{line}: a facet of {len(found)} corners, numbered {numbers}; {corners} are known here")
    return found


def _numbers(words: list[str], count: int, line: int) -> tuple[float, ...]:
    try:
        found = tuple(float(word) for word in words)
    except ValueError:
        found = ()
    if len(found) != count:
        raise MeshError(f":{line}: expected {count} numbers, found {' '.join(words)[:40]!r}")
    return found


def _lines(content: bytes) -> list[tuple[int, str]]:
    lines = (line.decode("latin-1") for line in content.splitlines())  # of the text, a letter such as Å would end one
    return [(n, line) for n, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
