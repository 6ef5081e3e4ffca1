"""Read a drawing's file into corners and polygons in mm, by the format of its name; one line says why one cannot be
read.

First what every format shares, then OBJ and STL, as programs and people write them, and the text of either: encoding,
lines, numbers. How a solid is made of the polygons is solid_from_mesh.py's. Colours, textures, normals and names in the
files are not looked at.
"""

import codecs
import re
from dataclasses import dataclass, replace

import numpy as np

from daemon.arrays import Array
from daemon.errors import FacetdError

UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}
"""Units that an operator may give: STL and OBJ do not have one, and count as millimetres otherwise."""
LARGEST_BYTES = 4_000_000
SMALLEST_MM, LARGEST_MM = 5.0, 1000.0
STEPS = (0.1, 0.01, 0.001, 0.0001)
"""Steps to which programs round coordinates. A file of whole numbers counts as one of tenths: it may have been drawn on
whole millimetres."""
SINGLE = 3e-7
"""Relative error of a number in a file of single precision."""


class MeshError(FacetdError):
    """A mesh that cannot be used: one line, what is wrong and where."""


class UnitError(MeshError):
    """A part that is too small or too large in the given unit. question: whether that is the unit; others: the other
    units."""

    def __init__(self, question: str, others: str) -> None:
        super().__init__(f"{question} type {others} after the file's name")
        self.question, self.others = question, others


@dataclass(frozen=True, eq=False)
class Mesh:
    """corners_mm (K, 3); polygons: corner indices of each, in the file's order; step_mm: rounding of the file's
    coordinates, 0 for none; notes: repairs and omissions, one line each."""

    corners_mm: Array
    polygons: tuple[tuple[int, ...], ...]
    step_mm: float = 0.0
    notes: tuple[str, ...] = ()


def read_mesh(name: str, content: bytes, unit: str = "mm") -> Mesh:
    """Read the mesh in a file's content, in the format of its name. Raises MeshError, UnitError."""
    if len(content) > LARGEST_BYTES:
        raise MeshError(f"{name}: {len(content) / 1e6:.1f} MB: too large for a part with flat facets")
    kind = name.lower().rpartition(".")[2]
    readers = {"stl": read_stl, "obj": read_obj}
    if kind not in readers:
        raise MeshError(f"{name}: expected a name that ends in .stl, .obj, .ply, .3mf or .step")
    try:
        mesh = readers[kind](content)
    except MeshError as error:
        raise MeshError(f"{name}{error}") from None
    if not mesh.polygons:
        raise MeshError(f"{name}: contains no facet")
    if not np.isfinite(mesh.corners_mm).all():
        raise MeshError(f"{name}: a coordinate is not a number")
    step = _step(mesh.corners_mm)
    mesh = replace(mesh, corners_mm=mesh.corners_mm * UNITS_MM[unit], step_mm=step * UNITS_MM[unit])
    used = mesh.corners_mm[np.unique(np.concatenate([np.array(p) for p in mesh.polygons]))]
    size_mm = float((used.max(axis=0) - used.min(axis=0)).max())
    if not SMALLEST_MM <= size_mm <= LARGEST_MM:
        others = ", ".join(u for u in UNITS_MM if u != unit)
        raise UnitError(f"{name}: {size_mm:.3g} mm long: is it in {unit}?", others)
    return mesh


def _step(corners: Array) -> float:
    """The coarsest of STEPS of which every coordinate (K, 3) is a multiple; 0 if there is none."""
    for step in STEPS:
        off = np.abs(corners - np.round(corners / step) * step)
        if (off <= SINGLE * np.abs(corners) + 1e-9).all():
            return step
    return 0.0


# OBJ

NO_SHAPE = {*"ogslp", "vt", "vn", "vp", "mtllib", "usemtl", "maplib", "usemap", "mg", "bevel", "c_interp", "d_interp",
            "lod", "shadow_obj", "trace_obj", "call", "csh"}  # fmt: skip
"""First words of lines without meaning for the solid's shape."""
FREE_FORM = {"cstype", "deg", "bmat", "step", "curv", "curv2", "surf", "parm", "trim", "hole", "scrv", "sp", "end",
             "con", "bzp", "bsp", "cdc", "cdp", "res", "ctech", "stech"}  # fmt: skip


def read_obj(content: bytes) -> Mesh:
    """Read `v X Y Z` and `f I[/T][/N] ...`: indices count from 1, negative ones backwards; a face may come before its
    corners. Raises MeshError."""
    rows: list[tuple[float, ...]] = []
    faces: list[tuple[int, list[str], int]] = []
    numbers, odd = Numbers(), Words("OBJ")
    for line, text in join_lines(lines(plain(content))):
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
    """Corner indices of a face. before: number of corners before this line; corners: in the whole file."""
    try:
        numbers = [int(word.split("/")[0]) for word in words]
    except ValueError:
        raise MeshError(f":{line}: expected numbers of corners, found {' '.join(words)[:40]!r}") from None
    found = tuple(k - 1 if k > 0 else before + k for k in numbers)
    if len(found) < 3 or any(k == 0 for k in numbers) or any(not 0 <= k < corners for k in found):
        raise MeshError(f":{line}: a facet of {len(found)} corners, numbered {numbers}; the file has {corners}")
    return found


# STL

STL_HEADER, STL_ROW = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("colour", "<u2")])
"""Bytes before the triangles of a binary STL, and the layout of a triangle."""


def read_stl(content: bytes) -> Mesh:
    """Read a binary or a text STL. Many binary files begin with `solid`, too: their length by the count, and a zero
    byte behind it, distinguish them. Raises MeshError."""
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
    """Read a binary file with bytes behind its last triangle, or with a count that was never set."""
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
    """Read `vertex X Y Z`, three to a facet, up to `endsolid` or `end solid`. Several solids become one mesh."""
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


# The text of a file

Line = tuple[int, str]
"""A line's number, counted from 1 as an editor does, and its text."""
MARKS = ((codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"))
NUMBERS = re.compile(r"[+-]?[\d.,]+([eE][+-]?\d+)?(/[\d/-]*)?")
WITH_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")


def plain(content: bytes) -> bytes:
    """The bytes of a text without a byte order mark, one byte a letter where it was UTF-16. Bytes, because in the text
    a letter such as Å would end a line."""
    for mark, name in MARKS:
        if content.startswith(mark):
            content = content[len(mark) :]
            return content if name == "utf-8" else _narrow(content, name)
    if content[1:2] == b"\0" and content[3:4] == b"\0" and content[:1] > b"\0":
        return _narrow(content, "utf-16-le")
    return content


def _narrow(content: bytes, name: str) -> bytes:
    return content.decode(name, "replace").encode("latin-1", "replace")


def lines(content: bytes) -> list[Line]:
    """Lines that hold more than a comment, which may follow on the same line."""
    texts = enumerate((raw.decode("latin-1").partition("#")[0].strip() for raw in content.splitlines()), 1)
    return [(number, text) for number, text in texts if text]


def join_lines(numbered: list[Line]) -> list[Line]:
    """Join each line that ends in a backslash with the next, under the number of the first."""
    whole: list[Line] = []
    going_on = False
    for number, text in numbered:
        if going_on:
            number, before = whole.pop()
            text = f"{before} {text}"
        going_on = text.endswith("\\")
        whole.append((number, text.rstrip("\\")))
    return whole


class Words:
    """First words of lines that the format does not have. A line that may be a broken corner or face is an error."""

    def __init__(self, kind: str) -> None:
        self.kind, self.odd = kind, dict[str, int]()

    def add(self, words: list[str], line: int) -> None:
        """Note a word. Raises MeshError where three or more numbers follow it."""
        first = words[0][:20].encode("ascii", "backslashreplace").decode()
        if len(words) > 3 and all(NUMBERS.fullmatch(word) for word in words[1:]):
            raise MeshError(
                f":{line}: `{first}` is no keyword of an {self.kind} file, and numbers follow it; correct the line"
            )
        self.odd.setdefault(first, line)

    @property
    def notes(self) -> tuple[str, ...]:
        """Each word once, with its first line."""
        return tuple(
            f"line {line}: `{word}` is no keyword of an {self.kind} file; left out" for word, line in self.odd.items()
        )


class Numbers:
    """Reads three coordinates a line. Decimal commas are accepted where the whole file has them."""

    def __init__(self) -> None:
        self.commas = self.points = 0
        """The line on which a number first had one; 0: none did."""

    def three(self, words: list[str], line: int) -> tuple[float, ...]:
        """The first three words as numbers. Raises MeshError with the line."""
        words = [word.rstrip(",") for word in words[:3]]
        if any(WITH_COMMA.fullmatch(word) for word in words):
            self.commas = self.commas or line
        if any("." in word for word in words):
            self.points = self.points or line
        if self.commas and self.points:
            raise MeshError(
                f":{line}: decimal commas and decimal points in one file (lines {self.commas}, {self.points}): which "
                "is meant? export it again"
            )
        try:
            found = tuple(float(word.replace(",", ".") if WITH_COMMA.fullmatch(word) else word) for word in words)
        except ValueError:
            found = ()
        if len(found) != 3:
            raise MeshError(f":{line}: expected 3 numbers, found {' '.join(words)[:40]!r}")
        return found

    @property
    def notes(self) -> tuple[str, ...]:
        return ("commas are read as decimal points",) if self.commas else ()
