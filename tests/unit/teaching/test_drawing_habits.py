"""Drawings with the habits of the programs and people that wrote them: read as the same solid, or one right line."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from daemon.store.library import load_facets
from daemon.teaching.mesh import MeshError
from daemon.teaching.solid_from_mesh import Drawing, read_drawing
from tests.fakes import drawn

CORNERS, RINGS = drawn.prism(drawn.L_BLOCK, 40)
L_BLOCK = CORNERS, [(0, 5, 4, 3, 2, 1), *RINGS[1:]]
"""Its base begun at a corner that all others are seen from: the STL writers cut it as a fan."""
OBJ, STL, ASCII = drawn.obj(*L_BLOCK), drawn.binary_stl(*L_BLOCK), drawn.ascii_stl(*L_BLOCK)
CUBE = drawn.box(40, 50, 60)


def read(name: str, content: bytes) -> Drawing:
    return read_drawing(name, content, "mm", load_facets())


def is_the_l_block(found: Drawing) -> bool:
    """Eight facets, and every corner to a hundredth where it was drawn, both about their middle."""
    want = L_BLOCK[0] - L_BLOCK[0].mean(axis=0)
    have = found.solid.corners_mm
    near = np.linalg.norm(want[:, None] - have, axis=2).min(axis=1)
    sides = sorted(map(len, found.solid.facets))
    return len(have) == 12 and sides == [4] * 6 + [6] * 2 and found.solid.open_edges == 0 and bool(near.max() < 0.06)


def commas(content: bytes) -> bytes:
    return content.replace(b".", b",")


def rounded(step: float) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    """The L block, turned, its coordinates rounded."""
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    return np.round(L_BLOCK[0] @ (turn * np.sign(np.linalg.det(turn))) / step) * step, L_BLOCK[1]


def with_a_corner_in_an_edge() -> bytes:
    """One long side of the base is split on one of its two facets only."""
    corners, rings = L_BLOCK
    top = (6, 7, 12, 8, 9, 10, 11)  # between corners 7 and 8
    return drawn.obj(np.vstack([corners, (corners[7] + corners[8]) / 2]), [rings[0], top, *rings[2:]])


def lines_of(content: bytes, change: Callable[[str], str]) -> bytes:
    return "\n".join(change(line) for line in content.decode().split("\n")).encode()


def faces_first(content: bytes) -> bytes:
    lines = content.split(b"\n")
    return b"\n".join([*(x for x in lines if x[:2] == b"f "), *(x for x in lines if x[:2] != b"f ")])


FACES = [line for line in OBJ.split(b"\n") if line.startswith(b"f ")]
READ_ALL_THE_SAME: dict[str, tuple[str, bytes]] = {
    "a byte order mark before the first v": ("a.obj", b"\xef\xbb\xbf" + OBJ[OBJ.index(b"v ") :]),
    "a byte order mark before solid": ("a.stl", b"\xef\xbb\xbf" + ASCII),
    "UTF-16 with a mark": ("a.obj", OBJ.decode().encode("utf-16")),
    "UTF-16 of the other order": ("a.stl", b"\xfe\xff" + ASCII.decode().encode("utf-16-be")),
    "UTF-16 without a mark": ("a.obj", OBJ.decode().encode("utf-16-le")),
    "`end solid` in two words": ("a.stl", ASCII.replace(b"endsolid", b"end solid")),
    "capitals": ("a.stl", ASCII.upper()),
    "capital V and F": ("a.obj", OBJ.replace(b"v ", b"V ").replace(b"\nf ", b"\nF ")),
    "lines that end as on a Macintosh": ("a.stl", ASCII.replace(b"\n", b"\r")),
    "lines that end as under Windows": ("a.obj", OBJ.replace(b"\n", b"\r\n")),
    "a backslash that goes on": ("a.obj", OBJ.replace(FACES[0], FACES[0].replace(b" 3", b" \\\n3", 1))),
    "comments behind faces": ("a.obj", lines_of(OBJ, lambda x: x + " # here" if x[:2] == "f " else x)),
    "faces before corners": ("a.obj", faces_first(OBJ)),
    "corners that no face has": ("a.obj", b"v 900 900 900\n" + lines_of(OBJ, lambda x: " ".join(
        str(int(w.split("/")[0]) + 1) if w[0].isdigit() else w for w in x.split(" ")) if x[:2] == "f " else x)),
    "colours behind corners": ("a.obj", lines_of(OBJ, lambda x: x + " 0.5 0.5 0.5" if x[:2] == "v " else x)),
    "a count that was never filled in": ("a.stl", STL[:80] + bytes(4) + STL[84:]),
    "tabs and a blank first line": ("a.obj", b"\n\t" + OBJ.replace(b"v ", b"v\t")),
    "a triangle without an area": ("a.obj", OBJ + b"\nf 1 2 2"),
}  # fmt: skip
MENDED: dict[str, tuple[str, bytes, str]] = {
    "decimal commas": ("a.obj", commas(OBJ), "commas are read as decimal points"),
    "decimal commas in STL": ("a.stl", commas(ASCII), "commas are read as decimal points"),
    "bytes behind the last triangle": ("a.stl", STL + b"made by a program", "17 bytes behind the last triangle"),
    "doubled triangles": ("a.stl", drawn.binary_stl(L_BLOCK[0], L_BLOCK[1] * 2), "20 doubled triangles are left out"),
    "a corner in a neighbour's edge": ("a.obj", with_a_corner_in_an_edge(), "1 edges are split where"),
    "a word of somebody's own": ("a.obj", b"material_id steel\n" + OBJ, "line 1: `material_id` is no keyword"),
    "a hollow inside": ("a.obj", drawn.obj(np.vstack([L_BLOCK[0], CUBE[0] / 10 + 5]), [
        *L_BLOCK[1], *(tuple(k + 12 for k in ring[::-1]) for ring in CUBE[1])]), "a hollow that shows nowhere"),
}  # fmt: skip


def two(shift: float, size: float = 1.0) -> bytes:
    corners, rings = CUBE
    more = [tuple(k + 8 for k in ring) for ring in rings]
    return drawn.obj(np.vstack([corners, corners * size + [shift, 0, 0]]), [*rings, *more])


REFUSED: dict[str, tuple[str, bytes, str]] = {
    "commas and points": ("a.obj", b"v 1,5 2.5 3\n", "a.obj:1: decimal commas and decimal points in one file"),
    "a corner whose word is broken": ("a.obj", OBJ.replace(b"v 60", b"w 60", 1), "`w` is no keyword of an OBJ file"),
    "commas between numbers": ("a.obj", b"v 1,2,3\n", "a.obj:1: expected 3 numbers, found '1,2,3'"),
    "a facet of four corners": ("a.stl", ASCII.replace(b" endloop", b"  vertex 0 0 0\n endloop", 1), "of 4 corners"),
    "a free-form surface": ("a.obj", OBJ + b"\ncstype bezier\n", "`cstype`: a free-form surface"),
    "bodies that touch": ("a.obj", two(40.0), "bodies that touch there"),
    "bodies that overlap": ("a.obj", two(20.0, 1.1), "2 bodies that overlap: of 40 x 50 x 60 mm about"),
    "bodies apart": ("a.obj", two(90.0), "2 bodies that do not touch, one of 40 x 50 x 60 mm about (110 25 30)"),
    "cut short at a triangle": ("a.stl", STL[:-50], "cut short or not STL: 1034 bytes, 1084 expected"),
    "a corner behind the last": ("a.obj", OBJ + b"\nf 1 2 99", "numbered [1, 2, 99]; the file has 12"),
}


@pytest.mark.parametrize("habit", READ_ALL_THE_SAME)
def test_a_habit_that_changes_nothing_is_read_without_a_word(habit: str) -> None:
    found = read(*READ_ALL_THE_SAME[habit])
    assert is_the_l_block(found)
    assert found.notes == () or habit == "a count that was never filled in"


@pytest.mark.parametrize("habit", MENDED)
def test_what_is_mended_or_left_out_is_said_in_a_line(habit: str) -> None:
    name, content, want = MENDED[habit]
    found = read(name, content)
    assert is_the_l_block(found)
    (note,) = found.notes
    assert want in note


@pytest.mark.parametrize("habit", REFUSED)
def test_what_cannot_be_read_is_one_line_that_says_where(habit: str) -> None:
    name, content, want = REFUSED[habit]
    with pytest.raises(MeshError) as told:
        read(name, content)
    assert want in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("step", [0.1, 0.01, 0.001])
@pytest.mark.parametrize("way", [drawn.binary_stl, drawn.ascii_stl, drawn.obj])
def test_coordinates_that_were_rounded_split_no_flat_face(step: float, way: Callable[..., bytes]) -> None:
    corners, rings = rounded(step)
    found = read("a.obj" if way is drawn.obj else "a.stl", way(corners, rings)).solid
    assert sorted(map(len, found.facets)) == [4] * 6 + [6] * 2
    assert len(found.corners_mm) == 12


def test_a_step_that_a_file_of_full_precision_shows_is_a_facet() -> None:
    """Only a file that is rounded to tenths hides a tenth."""
    outline = [(0.0, 0.0), (60.0, 0.0), (60.0, 20.0312547), (30.0, 20.0312547), (30.0, 20.1512547), (0.0, 20.1512547)]
    found = read("a.obj", drawn.obj(*drawn.prism(outline, 30))).solid
    assert len(found.facets) == 8
