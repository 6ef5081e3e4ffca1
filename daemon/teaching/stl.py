"""STL files, ASCII or binary, as programs write them, to a mesh. Pure."""

import numpy as np

from daemon.arrays import Array
from daemon.teaching.mesh import Mesh, MeshError
from daemon.teaching.mesh_text import Numbers, Words, lines, plain

STL_HEADER, STL_ROW = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("colour", "<u2")])
"""Bytes before the triangles of a binary STL, and what one of them is."""


def read_stl(content: bytes) -> Mesh:
    """Many binary files begin with `solid` as well: the length that their count asks for, and then a
    zero byte, distinguish them. Raises MeshError."""
    if len(content) >= STL_HEADER:
        count = int.from_bytes(content[80:84], "little")
        if len(content) == STL_HEADER + STL_ROW.itemsize * count:
            return _binary(content, count)
    text = plain(content)
    if text.lstrip()[:5].lower() == b"solid" and b"\0" not in text:
        return _ascii(text)
    if len(content) < STL_HEADER:
        raise MeshError(": not STL")
    return _of_another_length(content, count)


def _of_another_length(content: bytes, count: int) -> Mesh:
    """A binary file with bytes behind its last triangle, or whose count was never filled in."""
    wanted = STL_HEADER + STL_ROW.itemsize * count
    there, rest = divmod(len(content) - STL_HEADER, STL_ROW.itemsize)
    if 0 < count <= there:
        left = len(content) - wanted
        return _binary(content, count, f"{left} bytes behind the last triangle are left out")
    if rest == 0 and there and count in (0, 0xFFFFFFFF):
        return _binary(content, there, f"its count of triangles is {count}; all {there} are read")
    raise MeshError(f": cut short or not STL: {len(content)} bytes, {wanted} expected")


def _binary(content: bytes, count: int, *notes: str) -> Mesh:
    corners = np.frombuffer(content, STL_ROW, count, STL_HEADER)["corners"].astype(float).reshape(-1, 3)
    return _of_triangles(corners, notes)


def _ascii(content: bytes) -> Mesh:
    """`vertex X Y Z`, three to a facet; `endsolid` or `end solid` at the end. Several solids are read as one mesh."""
    rows: list[tuple[float, ...]] = []
    numbers, odd, ended, began = Numbers(), Words("STL"), False, 0
    for line, text in lines(content):
        words = text.split()
        first = words[0].lower()
        if first == "vertex":
            rows.append(numbers.three(words[1:], line))
        elif first in ("facet", "endfacet"):
            if len(rows) - began not in (0, 3):
                raise MeshError(f":{line}: a facet of {len(rows) - began} corners; an STL's has 3")
            began = len(rows)
        elif first not in ("solid", "outer", "endloop", "endsolid", "end", "color", "colour"):
            odd.add(words, line)
        ended = first in ("endsolid", "end")
    if len(rows) % 3 or not ended:
        raise MeshError(": cut short: the last facet or `endsolid` is missing")
    return _of_triangles(np.array(rows, float).reshape(-1, 3), numbers.notes + odd.notes)


def _of_triangles(corners: Array, notes: tuple[str, ...]) -> Mesh:
    triangles = np.arange(len(corners)).reshape(-1, 3).tolist()
    return Mesh(corners, tuple((a, b, c) for a, b, c in triangles), notes=notes)
