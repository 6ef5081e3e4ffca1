"""Render one picture of solids on a table, from any viewpoint, under a stark lamp."""

from __future__ import annotations

import cv2
import numpy as np

from daemon.arrays import Array
from daemon.store import folders
from drivers.rigid import apply, inverse, rigid, turn
from drivers.simcell.light import CellLight
from drivers.simcell.optics import Array32, LensCamera
from drivers.simcell.render import PixelRays, RenderedSolid, radiance
from drivers.simcell.truth import Lamp, Lighting, TableTruth, load_truth

TRUTH = load_truth(folders.HOUSE / "etc" / "simcell.yaml")
TABLE = TableTruth(height_mm=-300.0, centre_mm=[520.0, 0.0], scatter_radius_mm=115.0, half_size_mm=450.0)
STARK = Lighting(
    ambient=40.0,
    lamps=[Lamp(position_mm=[100.0, -700.0, 500.0], radius_mm=20.0, level=220.0)],
    gloss=0.0,
    facet_albedo=0.8,
    table_albedo=0.02,
)
"""Facets against a nearly black table, so that shadows do not blur the measured edges."""


def looking(viewpoint_mm: list[float], at_mm: list[float], roll_rad: float = 0.0) -> Array:
    """world_from_cyclopean that looks at a point."""
    z = np.array(at_mm) - np.array(viewpoint_mm)
    z = z / np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x = x / np.linalg.norm(x)
    return rigid(np.column_stack([x, np.cross(z, x), z]) @ turn([0, 0, 1], roll_rad), viewpoint_mm)


def projected(camera: LensCamera, world_from_cyclopean: Array, points: Array) -> Array:
    """(N, 3) world -> (N, 2) px by OpenCV's projection."""
    camera_from_world = inverse(world_from_cyclopean @ camera.cyclopean_from_camera)
    seen, _ = cv2.projectPoints(
        apply(camera_from_world, points), np.zeros(3), np.zeros(3), camera.matrix, camera.distortion
    )
    return np.asarray(seen[:, 0, :], float)


def picture(things: list[RenderedSolid], pose: Array, camera: LensCamera, lighting: Lighting = STARK) -> Array32:
    light = CellLight(TABLE, lighting)
    light.cast([apply(thing.world_from_solid, thing.solid.vertices) for thing in things])
    return radiance(PixelRays(camera, 640, 480), pose, things, light)
