"""Shadows: away from the lamp, softer the farther, onto neighbours too."""

from __future__ import annotations

import numpy as np

from drivers.rigid import apply, rigid
from drivers.simcell.light import CellLight
from drivers.simcell.parts import part_shape
from drivers.simcell.render import PixelRays, RenderedSolid
from drivers.simcell.truth import Lighting
from tests.fakes.pictures import STARK, TABLE, TRUTH, looking, picture, projected


def test_a_part_casts_its_shadow_away_from_the_lamp_and_softer_the_farther() -> None:
    bright = Lighting(ambient=40.0, lamps=STARK.lamps, gloss=0.0, facet_albedo=0.8, table_albedo=0.6)
    light = CellLight(TABLE, bright)
    pose = looking([520.0, -1.0, 200.0], [520.0, 0.0, -300.0])
    centres = PixelRays(TRUTH.left.lens(), 640, 480).centres
    world_from_camera = pose @ TRUTH.left.lens().cyclopean_from_camera
    bare = light.table_levels(centres, world_from_camera)
    corners = apply(rigid(np.eye(3), [520.0, 0.0, -275.0]), part_shape("cube").hull.vertices)
    light.cast([corners])
    lost = bare - light.table_levels(centres, world_from_camera)

    def at(x_mm: float, y_mm: float) -> float:
        u, v = np.round(projected(TRUTH.left.lens(), pose, np.array([[x_mm, y_mm, -300.0]]))[0]).astype(int)
        return float(lost[v, u] / bare[v, u])

    assert at(545.0, 45.0) > 0.5, "behind the part, seen from the lamp"
    assert abs(at(500.0, -80.0)) < 0.05, "towards the lamp"
    assert abs(at(520.0, 170.0)) < 0.05, "beyond the shadow's end"


def test_a_tall_part_throws_its_shadow_onto_its_neighbour_and_only_where_the_lamp_is_hidden() -> None:
    camera, pose = TRUTH.left.lens(), looking([520.0, 150.0, 100.0], [520.0, 40.0, -280.0])
    low = RenderedSolid(part_shape("cube").hull, rigid(np.eye(3), [530.0, 60.0, -275.0]), 0.8)
    tall = RenderedSolid(part_shape("triangular_prism").hull, rigid(np.eye(3), [500.0, 5.0, -265.0]), 0.8)
    alone, shaded = picture([low], pose, camera), picture([low, tall], pose, camera)

    def lost(x_mm: float, y_mm: float) -> float:
        u, v = np.round(projected(camera, pose, np.array([[x_mm, y_mm, -250.0]]))[0]).astype(int)
        return float((alone - shaded)[v, u] / alone[v, u])

    assert lost(508.0, 37.0) > 0.3, "the corner of the top that lies behind the tall part as the lamp sees it"
    assert lost(553.0, 83.0) == 0.0, "the far corner"
