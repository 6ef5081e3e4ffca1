"""Drawings of a part, whatever wrote them, to one solid, or one line that says what is wrong and where."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.store.library import load_facets
from daemon.teaching.mesh import LARGEST_BYTES, MeshError
from tests.fakes import drawn
from tests.fakes.drawn import solid

LIBRARY = load_facets()
WAYS: dict[str, Callable[..., bytes]] = {
    "a.stl": drawn.binary_stl, "b.STL": drawn.ascii_stl, "c.obj": drawn.obj,
}  # fmt: skip


@pytest.mark.parametrize("name", WAYS)
def test_every_format_gives_the_same_solid(name: str) -> None:
    found = solid(name, WAYS[name](*drawn.box(40, 50, 60)))
    assert len(found.corners_mm) == 8
    assert sorted(map(len, found.facets)) == [4] * 6
    assert set(found.types) == {"rectangle"}
    assert found.open_edges == 0
    assert np.allclose(found.areas_mm2.sum(axis=0), 0, atol=1e-3)
    extent = found.corners_mm.max(axis=0) - found.corners_mm.min(axis=0)
    assert np.allclose(extent, [40, 50, 60], atol=1e-3)


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), flip=st.booleans())
def test_turning_shuffling_and_winding_a_mesh_changes_nothing(seed: int, flip: bool) -> None:
    rng = np.random.default_rng(seed)
    corners, rings = drawn.prism(drawn.L_BLOCK, 40)
    rings = [(0, 5, 4, 3), (0, 3, 2, 1), (6, 7, 8, 9), (6, 9, 10, 11), *rings[2:]]  # the concave base in two pieces
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    rings = [ring[k:] + ring[:k] for ring, k in zip(rings, rng.integers(0, 4, len(rings)), strict=True)]
    rng.shuffle(rings)
    wound = [ring[::-1] if flip or rng.random() < 0.3 else ring for ring in rings]
    found = solid("l.stl", drawn.binary_stl(corners @ turn.T + rng.uniform(-200, 200, 3), wound))
    assert sorted(map(len, found.facets)) == [4] * 6 + [6] * 2
    assert found.open_edges == 0
    areas = found.areas_mm2
    volume = sum(found.corners_mm[ring[0]] @ area for ring, area in zip(found.facets, areas, strict=True)) / 3
    assert volume == pytest.approx(40 * (60 * 25 + 25 * 35), rel=1e-4), "the rings run anticlockwise from outside"


def test_corners_on_a_straight_side_and_a_hole_in_a_facet_are_not_looked_at() -> None:
    outline = [(0.0, 0.0), (30.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0)]
    found = solid("p.obj", drawn.obj(*drawn.prism(outline, 30)))
    assert sorted(map(len, found.facets)) == [4] * 6
    outer, inner = drawn.box(50, 50, 20), drawn.box(10, 10, 20)
    corners = np.vstack([outer[0], inner[0] + [20, 20, 0]])
    frames = [(0, 8, 10, 2), (2, 10, 14, 6), (6, 14, 12, 4), (4, 12, 8, 0)]  # around the hole, z = 0
    ring = [tuple(k + 1 for k in f[::-1]) for f in frames]  # z = 20
    walls = [tuple(k + 8 for k in f[::-1]) for f in drawn.CUBE_RINGS[:4]]
    pierced = solid("hole.obj", drawn.obj(corners, [*drawn.CUBE_RINGS[:4], *frames, *ring, *walls]))
    assert len(pierced.facets) == 10
    assert max(float(np.linalg.norm(a)) for a in pierced.areas_mm2) == pytest.approx(2500)


@pytest.mark.parametrize("off_mm", [1e-6, 1e-4, 2e-3])
@pytest.mark.parametrize("sides", [(9.525, 31.75, 19.045), (40.005, 50.0, 60.015)])
def test_corners_that_a_program_wrote_a_little_apart_are_one_wherever_they_lie(
    sides: tuple[float, float, float], off_mm: float
) -> None:
    """At three eighths of an inch and a micrometre apart they fell to two cells: `not closed`, of a closed box."""
    corners, rings = drawn.box(*sides)
    own = [tuple(range(k, k + 4)) for k in range(0, 24, 4)]
    apart = np.concatenate([corners[list(ring)] for ring in rings])
    apart += np.random.default_rng(2).uniform(-off_mm, off_mm, apart.shape)
    found = solid("box.obj", drawn.obj(apart, own))
    assert (len(found.corners_mm), len(found.facets), found.open_edges) == (8, 6, 0)


def test_units_are_believed_when_said_and_doubted_when_absurd() -> None:
    inches = drawn.obj(*drawn.box(2, 2, 2))
    with pytest.raises(MeshError, match=r"cube\.obj: 2 mm long: is it in mm\? type cm, m, inch after"):
        solid("cube.obj", inches)
    found = solid("cube.obj", inches, "inch")
    assert np.allclose(np.ptp(found.corners_mm, axis=0), 50.8)
    assert set(found.types) == {"square"}


CUBE = drawn.box()
GAP = drawn.obj(CUBE[0], CUBE[1][:5])
TWO = drawn.obj(np.vstack([CUBE[0], CUBE[0] + 100]), [*CUBE[1], *(tuple(k + 8 for k in ring) for ring in CUBE[1])])
FIN = drawn.obj(np.vstack([CUBE[0], [[0, 0, 90], [50, 0, 90]]]), [*CUBE[1], (1, 5, 9, 8), (8, 9, 5, 1)])
BALL = drawn.obj(*drawn.ball(30.0))


@pytest.mark.parametrize(
    ("name", "content", "want"),
    [
        ("part.step", b"", "part.step: expected a name that ends in .stl, .obj, .ply, .3mf or .step"),
        ("part.stl", b"", "part.stl: not STL"),
        ("part.stl", b"hello", "part.stl: not STL"),
        ("part.stl", drawn.binary_stl(*CUBE)[:-7], "cut short or not STL: 677 bytes, 684 expected"),
        ("part.stl", drawn.ascii_stl(*CUBE)[:-40], "cut short: the last facet or `endsolid` is missing"),
        ("part.stl", b"solid x\nvertex 1 2\nendsolid", "part.stl:2: expected 3 numbers, found '1 2'"),
        ("part.stl", b"solid x\nendsolid x", "part.stl: contains no facet"),
        ("part.obj", b"v 0 0 0\nf 1 2 3\n", "part.obj:2: a facet of 3 corners, numbered [1, 2, 3]; the file has 1"),
        ("part.obj", b"v 0 0 0\nf 1 one 3\n", "part.obj:2: expected numbers of corners"),
        ("part.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "part.obj: a coordinate is not a number"),
        ("part.obj", drawn.obj(*drawn.box(5000, 1, 1)), "part.obj: 5e+03 mm long: is it in mm?"),
        ("part.obj", b"#" * (LARGEST_BYTES + 1), "4.0 MB: too large"),
        ("part.obj", GAP, "not closed: 4 edges have a triangle on one side only, one from ("),
        ("part.obj", TWO, "2 bodies that do not touch, one of 50 x 50 x 50 mm about (125 125 125)"),
        ("part.obj", FIN, "more than two triangles share an edge, one from ("),
        ("part.obj", BALL, "0 flat facets: a curved surface"),
        ("part.obj", b"v 0 0 0\nv 9 0 0\nv 0 9 0\nf 1 2 3\n", "1 triangles bound no solid"),
        ("part.obj", drawn.obj(CUBE[0] * [1, 1, 0], CUBE[1]), "not closed: 4 edges have a triangle on"),
    ],
)  # fmt: skip
def test_a_bad_mesh_is_one_line_that_says_what_and_where(name: str, content: bytes, want: str) -> None:
    with pytest.raises(MeshError) as told:
        solid(name, content)
    assert want in str(told.value)
    assert "\n" not in str(told.value)


@settings(max_examples=80)
@given(cut=st.integers(0, 700), at=st.integers(0, 683), byte=st.integers(0, 255), kind=st.sampled_from(sorted(WAYS)))
def test_a_damaged_file_is_an_error_or_a_mesh_and_never_a_crash(cut: int, at: int, byte: int, kind: str) -> None:
    content = bytearray(WAYS[kind](*CUBE))
    content[min(at, len(content) - 1)] = byte
    with np.errstate(all="ignore"), contextlib.suppress(MeshError):
        solid(kind, bytes(content[: len(content) - 700 + cut] if cut < 700 else content))


@pytest.mark.parametrize("first", range(6))
def test_a_polygon_with_a_notch_is_one_facet_wherever_its_ring_begins(first: int) -> None:
    corners, rings = drawn.prism(drawn.L_BLOCK, 40.0)
    turned = [(*ring[first:], *ring[:first]) if len(ring) == 6 else ring for ring in rings]
    found = solid("l.obj", drawn.obj(corners, turned))
    assert sorted(map(len, found.facets)) == [4] * 6 + [6] * 2
    assert found.open_edges == 0
