"""Patterned tables and printed parts: of our own making, and the same for a seed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from daemon.arrays import Array
from daemon.store import folders
from drivers.rigid import apply, inverse, rigid
from drivers.simcell.cell import SimulatedCell
from drivers.simcell.light import CellLight
from drivers.simcell.optics import Array32
from drivers.simcell.parts import part_shape
from drivers.simcell.render import PixelRays, RenderedSolid, radiance
from drivers.simcell.textures import Pattern, printed_faces, table_factors
from drivers.simcell.world import PartPlace
from tests.fakes.pictures import STARK, TABLE, TRUTH, looking, picture, projected

CAMERA = TRUTH.left.lens()
POSE = looking([320.0, -60.0, -60.0], [520.0, 0.0, -280.0])
REST = rigid(np.eye(3), [520.0, 0.0, -275.0])


def cube(*patterns: Pattern) -> Array32:
    return picture([RenderedSolid(part_shape("cube").hull, REST, 0.8, patterns)], POSE, CAMERA)


@pytest.mark.parametrize("seed", range(8))
def test_a_patterned_table_is_as_bright_as_a_plain_one_in_the_mean_and_uneven(seed: int) -> None:
    factors = table_factors(np.random.default_rng(seed), 400, 1.0)
    assert factors.shape == (400, 400)
    assert factors.mean() == pytest.approx(1.0, abs=0.03)
    assert factors.std() > 0.2
    assert np.array_equal(factors, table_factors(np.random.default_rng(seed), 400, 1.0))


def test_the_pattern_lies_in_the_table_and_moves_with_it_in_the_picture() -> None:
    light = CellLight(TABLE, structs.replace(STARK, table_albedo=0.3), np.random.default_rng(0))
    light.cast((), covered=True)
    plain = radiance(PixelRays(CAMERA, 640, 480), POSE, (), light)
    light.cast(())
    spot = np.array([[500.0, 20.0, -300.0], [560.0, -30.0, -300.0], [480.0, -50.0, -300.0], [530.0, 60.0, -300.0]])
    seen = []
    for pose in (POSE, looking([480.0, 100.0, 0.0], [520.0, 0.0, -300.0], 0.7)):
        image = radiance(PixelRays(CAMERA, 640, 480), pose, (), light)
        px = np.round(projected(CAMERA, pose, spot)).astype(int)
        seen.append([float(image[y - 1 : y + 2, x - 1 : x + 2].mean()) for x, y in px])
    assert np.ptp(seen[0]) > 5
    assert seen[0] == pytest.approx(seen[1], rel=0.25)
    assert np.array_equal(plain, picture([], POSE, CAMERA, structs.replace(STARK, table_albedo=0.3))), "under a cloth"


def test_print_reads_from_left_to_right_seen_from_outside() -> None:
    solid = part_shape("cube").hull
    for pattern in every_face("cube"):
        ring: Array = solid.vertices[list(solid.faces[pattern.face])]
        corners = apply(inverse(pattern.solid_from_print), ring)
        size = np.array(pattern.cells.shape[::-1]) * pattern.cell_mm
        assert np.abs(corners[:, 2]).max() < 1e-9
        assert (corners[:, :2] > -1e-6).all()
        assert (corners[:, :2] < size + 1e-6).all()
        x, down = pattern.solid_from_print[:3, 0], pattern.solid_from_print[:3, 1]
        assert np.cross(x, down) @ solid.normals[pattern.face] == pytest.approx(-1), "else letters are mirrored"


def every_face(label: str) -> list[Pattern]:
    found: dict[int, Pattern] = {}
    for seed in range(12):
        found |= {p.face: p for p in printed_faces(part_shape(label).hull, 0.85, np.random.default_rng(seed))}
    assert len(found) == len(part_shape(label).hull.faces)
    return list(found.values())


def test_print_changes_a_face_and_neither_its_outline_nor_what_is_beside_it() -> None:
    bare = cube()
    for pattern in every_face("cube"):
        changed = np.abs(cube(replace(pattern, cells=np.full_like(pattern.cells, 0.1))) - bare) > 0.5
        inside = np.zeros(bare.shape, bool)
        solid = part_shape("cube").hull
        px = projected(CAMERA, POSE, apply(REST, solid.vertices[list(solid.faces[pattern.face])]))
        low, high = np.floor(px.min(0)).astype(int) - 1, np.ceil(px.max(0)).astype(int) + 2
        inside[low[1] : high[1], low[0] : high[0]] = True
        assert not (changed & ~inside).any()


def test_a_part_keeps_its_print_where_it_lies_and_is_bare_while_it_is_taught() -> None:
    truth = folders.HOUSE / "etc" / "simcell.yaml"
    with SimulatedCell(truth, seed=5, time_scale=40.0, table="patterned", parts="printed") as cell:
        cell.scatter(["cube", "pyramid"])
        first, again = (cell._scene_at(0.0).solids for _ in range(2))
        assert [t.patterns for t in first] == [t.patterns for t in again]
        assert all(t.patterns for t in first)
        cell.place_for_teaching("cube", 0)
        (shown,) = (p for p in cell.world.parts if p.where is PartPlace.STAND)
        (thing,) = cell._scene_at(0.0).solids
        assert shown.label == "cube"
        assert thing.patterns == ()
        assert cell._scene_at(0.0).covered
    with SimulatedCell(truth, seed=5, time_scale=40.0) as plain:
        plain.scatter(["cube", "pyramid"])
        assert all(t.patterns == () for t in plain._scene_at(0.0).solids)
