"""Parts from drawings as the simulated cell's cameras see them: bores, roundings, and what such parts rest on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daemon.arrays import Array
from drivers.rigid import apply, rigid, turn
from drivers.simcell.optics import Array32
from drivers.simcell.parts import PartShape
from drivers.simcell.render import rendered
from tests.fakes import drawn
from tests.fakes.machined import drawing, shown_shape
from tests.fakes.pictures import STARK, TRUTH, looking, picture, projected

TURNS = np.radians(np.linspace(-120, 120, 41))
D_SHAPE = [(20 * np.cos(t), 20 * np.sin(t)) for t in TURNS]
CAMERA = TRUTH.left.lens()
FROM_ABOVE = looking([460.0, -120.0, 10.0], [520.0, 0.0, -290.0])


def of(corners: Array, rings: list[tuple[int, ...]]) -> PartShape:
    return shown_shape("part", drawing("part.obj", drawn.obj(corners, rings)))


def lying(shape: PartShape, normal: Array, turn_rad: float = 0.4) -> Array:
    """world_from_part with a face of that normal upwards."""
    up = max(shape.rests, key=lambda rest: float((rest[:3, :3] @ normal)[2]))
    return rigid(turn([0, 0, 1], turn_rad), [520.0, 0.0, -300.0]) @ up


def seen(shape: PartShape, pose: Array) -> Array32:
    return picture(list(rendered(shape, pose, STARK.facet_albedo)), FROM_ABOVE, CAMERA)


@pytest.mark.parametrize("outline", [[(0, 0), (50, 0), (50, 30), (0, 30)], drawn.L_BLOCK])
def test_a_part_without_curves_looks_the_same_by_its_surface_as_by_its_pieces(
    outline: list[tuple[float, float]],
) -> None:
    shape = of(*drawn.prism(outline, 30.0))
    pose = lying(shape, np.array([0.0, 0.0, 1.0]))
    by_surface, by_pieces = seen(shape, pose), seen(replace(shape, surface=None), pose)
    off = np.abs(by_surface - by_pieces)
    assert off.max() < 25.0  # a seam between pieces mixes two faces in a pixel
    assert np.percentile(off, 99.5) < 0.5


def test_a_bore_shows_its_wall_and_the_table_behind() -> None:
    shape = of(*drawn.bored_block(60, 50, 16, 10.0, 60))
    pose = lying(shape, np.array([0.0, 0.0, 1.0]))
    plain = of(*drawn.box(60, 50, 16))
    image, whole = seen(shape, pose), seen(plain, lying(plain, np.array([0.0, 0.0, 1.0])))
    turns = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = np.column_stack([np.cos(turns), np.sin(turns), np.full(24, 0.8)]) * [1, 1, 10]
    for radius, inside in ((8.5, True), (11.5, False)):
        px = np.rint(projected(CAMERA, FROM_ABOVE, apply(pose, ring * [radius, radius, 1]))).astype(int)
        off = np.abs(image - whole)[px[:, 1], px[:, 0]]
        assert (off > 8).mean() > 0.8 if inside else (off < 2).all()


def test_a_rounding_is_shaded_evenly_and_rests_on_nothing_round() -> None:
    shape = of(*drawn.prism(D_SHAPE, 26.0))
    assert len(shape.rests) == 3
    downs = sorted(round(abs(float(rest[2, 2])), 3) for rest in shape.rests)
    assert downs == [0.0, 1.0, 1.0]
    flat = next(rest for rest in shape.rests if abs(rest[2, 2]) < 0.5)
    pose = rigid(turn([0, 0, 1], 0.4), [520.0, 0.0, -300.0]) @ flat
    assert shape.surface is not None
    around = np.radians(np.linspace(-70, 70, 60))
    axis_x = shape.surface.corners_mm[:, 0].max() - 20.0
    rim = np.column_stack([axis_x + 20 * np.cos(around), 20 * np.sin(around), np.zeros(60)])
    px = np.rint(projected(CAMERA, FROM_ABOVE, apply(pose, rim))).astype(int)
    levels = seen(shape, pose)[px[:, 1], px[:, 0]]
    assert np.abs(np.diff(levels)).max() < 12.0
    assert np.ptp(levels) > 30.0


def test_a_bore_has_no_mass() -> None:
    shape = of(*drawn.bored_block(60, 50, 16, 10.0, 60))
    assert shape.surface is not None
    volume, centre = shape.surface.volume_and_centre
    assert volume == pytest.approx(60 * 50 * 16 - np.pi * 10**2 * 16, rel=0.005)
    assert centre == pytest.approx(shape.centre_of_mass)
