"""PLY, 3MF and STEP by the extra `drawings`: the same solid as in facetd's own formats, or one line."""

from __future__ import annotations

import builtins
import io
from typing import Any

import numpy as np
import pytest

from daemon.store.library import load_facets
from daemon.teaching.closed_surface import in_triangles
from daemon.teaching.foreign_drawings import in_own_format
from daemon.teaching.mesh import MeshError
from daemon.teaching.solid_from_mesh import Drawing, read_drawing
from tests.fakes import drawn
from tests.fakes.chosen import few
from tests.fakes.step_file import step_file

EVERY = ("a.stl", "a.obj", "a.ply", "a.3mf")


def read(name: str, content: bytes, unit: str = "mm") -> Drawing:
    return read_drawing(*in_own_format(name, content, unit), load_facets())


def exported(corners: np.ndarray, rings: list[tuple[int, ...]], kind: str) -> bytes:
    trimesh = pytest.importorskip("trimesh", reason="the extra `drawings` is not installed")
    if kind == "3mf":
        pytest.importorskip("networkx")
        pytest.importorskip("lxml")
    fans = [fan for ring in rings for fan in in_triangles(corners, list(ring))]
    mesh = trimesh.Trimesh(corners, fans, process=False)
    mesh.units = "millimeter"
    content = mesh.export(file_type=kind)
    return content if isinstance(content, bytes) else content.encode()


def same(found: Drawing, want: Drawing) -> bool:
    """Whether two solids have the same facets, corners and curved surfaces."""
    one, other = (np.sort(d.solid.corners_mm @ [1.0, 100.0, 10000.0]) for d in (found, want))
    facets = sorted(map(len, found.solid.facets)) == sorted(map(len, want.solid.facets))
    curved = sorted(map(str, found.curved)) == sorted(map(str, want.curved))
    return facets and curved and len(one) == len(other) and bool(np.abs(one - other).max() < 0.2)


def random_solid(seed: int) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    """A prism over a random outline that every side of is seen from its middle, turned at random."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 9))
    turns = (np.arange(count) + rng.uniform(-0.25, 0.25, count)) * 2 * np.pi / count
    radii = rng.uniform(15.0, 45.0, count)
    corners, rings = drawn.prism(
        [(r * np.cos(t), r * np.sin(t)) for r, t in zip(radii, turns, strict=True)], 20.0 + 40.0 * rng.random()
    )
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return corners @ (turn * np.sign(np.linalg.det(turn))).T, rings


@pytest.mark.parametrize("first", few(range(0, 60, 6), 1))
def test_random_solids_that_trimesh_wrote_are_read_back_as_the_same_solid_in_each_format(first: int) -> None:
    for seed in range(first, first + 6):
        corners, rings = random_solid(seed)
        want = read("a.obj", drawn.obj(corners, rings))
        for name in EVERY:
            assert same(read(name, exported(corners, rings, name[2:])), want), (seed, name)


@pytest.mark.parametrize(("unit", "scale"), [("MILLI", 1.0), ("CENTI", 10.0)])
def test_a_step_file_says_its_own_unit(unit: str, scale: float) -> None:
    pytest.importorskip("cascadio", reason="the extra `drawings` is not installed")
    corners, rings = drawn.prism(drawn.L_BLOCK, 40)
    found = read("part.STEP", step_file(corners / scale, rings, unit), "inch")
    assert same(found, read("a.obj", drawn.obj(corners, rings)))
    assert np.allclose(sorted(found.size_mm), [40, 60, 60], atol=1e-3)


def test_a_ply_is_in_the_unit_that_is_given() -> None:
    content = exported(*drawn.box(40, 50, 60), "ply")
    assert np.allclose(sorted(read("a.ply", content, "cm").size_mm), [400, 500, 600], atol=1e-2)


@pytest.mark.parametrize(("name", "content"), [
    ("a.ply", b""), ("a.ply", b"ply\nformat ascii 1.0\nend_header\n"), ("a.ply", b"hello"), ("a.3mf", b"hello"),
    ("a.3mf", b"PK\x03\x04" + bytes(60)), ("a.step", b"ISO-10303-21;\nnothing"), ("a.stp", b"")])  # fmt: skip
def test_a_file_that_is_none_of_its_kind_is_one_line(name: str, content: bytes) -> None:
    pytest.importorskip("trimesh", reason="the extra `drawings` is not installed")
    pytest.importorskip("cascadio", reason="the extra `drawings` is not installed")
    with pytest.raises(MeshError) as told:
        read(name, content)
    assert str(told.value).startswith(f"{name}: ")
    assert "\n" not in str(told.value)


def test_an_archive_that_unfolds_to_too_much_is_refused_unopened() -> None:
    import zipfile

    pytest.importorskip("trimesh", reason="the extra `drawings` is not installed")
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", bytes(70_000_000))
    with pytest.raises(MeshError, match="unfolds to 70 MB"):
        read("a.3mf", held.getvalue())


@pytest.mark.parametrize("name", ["a.ply", "a.3mf", "a.step", "a.STP"])
def test_without_the_extra_one_line_says_how_to_install_it(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = builtins.__import__

    def without(module: str, *more: Any) -> Any:
        if module == "trimesh":
            raise ImportError(module)
        return whole(module, *more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MeshError, match=r"needs its extra: pip install 'facetd\[drawings\]'"):
        read(name, b"anything")
    assert read("a.obj", drawn.obj(*drawn.box())).notes == ()
