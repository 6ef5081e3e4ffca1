"""OBJ files, as programs and people write them, to a mesh. Pure."""

import numpy as np

from daemon.teaching.mesh import Mesh, MeshError
from daemon.teaching.mesh_text import Numbers, Words, joined, lines, plain

NO_SHAPE = {*"ogslp", "vt", "vn", "vp", "mtllib", "usemtl", "maplib", "usemap", "mg", "bevel", "c_interp", "d_interp",
            "lod", "shadow_obj", "trace_obj", "call", "csh"}  # fmt: skip
"""First words that say nothing of a solid's shape."""
FREE_FORM = {"cstype", "deg", "bmat", "step", "curv", "curv2", "surf", "parm", "trim", "hole", "scrv", "sp", "end",
             "con", "bzp", "bsp", "cdc", "cdp", "res", "ctech", "stech"}  # fmt: skip


def read_obj(content: bytes) -> Mesh:
    """`v X Y Z` and `f I[/T][/N] ...`, counted from 1, or backwards from the last with negative numbers; a face may
    stand before its corners. Raises MeshError."""
    rows: list[tuple[float, ...]] = []
    faces: list[tuple[int, list[str], int]] = []
    numbers, odd = Numbers(), Words("OBJ")
    for line, text in joined(lines(plain(content))):
        words = text.split()
        first = words[0].lower()
        if first == "v":
            rows.append(numbers.three(words[1:], line))
        elif first in ("f", "fo"):
            faces.append((line, words[1:], len(rows)))
        elif first in FREE_FORM:
            raise MeshError(f":{line}: `{first}`: a free-form surface; export it as triangles")
        elif first not in NO_SHAPE:
            odd.add(words, line)
    polygons = tuple(_polygon(words, before, len(rows), line) for line, words, before in faces)
    return Mesh(np.array(rows, float).reshape(-1, 3), polygons, notes=numbers.notes + odd.notes)


def _polygon(words: list[str], before: int, corners: int, line: int) -> tuple[int, ...]:
    """before: how many corners stood before this line; corners: how many the whole file has."""
    try:
        numbers = [int(word.split("/")[0]) for word in words]
    except ValueError:
        raise MeshError(f":{line}: expected numbers of corners, found {' '.join(words)[:40]!r}") from None
    found = tuple(k - 1 if k > 0 else before + k for k in numbers)
    if len(found) < 3 or any(k == 0 for k in numbers) or any(not 0 <= k < corners for k in found):
        raise MeshError(f":{line}: a facet of {len(found)} corners, numbered {numbers}; the file has {corners}")
    return found
