"""Machined parts as the simulated cell shows them, made from drawings."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.store.library import load_facets
from daemon.teaching.solid_from_mesh import Drawing, read_drawing
from daemon.vision.geometry import Polyhedron, rough_fit
from daemon.vision.model import Model, empty_model, learn_solid
from drivers.simcell.drawn import drawn_shape
from drivers.simcell.parts import PartShape
from drivers.simcell.surface import DrawnSurface


@cache
def drawing(name: str, content: bytes) -> Drawing:
    """What a drawing in mm is read as. Tests share it."""
    return read_drawing(name, content, "mm", load_facets())


def shown_shape(label: str, drawn: Drawing) -> PartShape:
    """The shape with its bores and roundings."""
    looks, solid = drawn.surface, drawn.solid
    surface = DrawnSurface(looks.corners_mm, looks.triangles, looks.normals, looks.part_of, looks.flat)
    return drawn_shape(label, solid.corners_mm, solid.facets, surface)


def taught_from(drawings: Mapping[str, Drawing]) -> Model:
    """What drawings teach, by their labels."""
    model = empty_model(load_facets())
    for label, one in drawings.items():
        model = learn_solid(model, one.solid, label)
    return model


def drawing_from_taught(one: Drawing, own: Polyhedron) -> Array:
    """(4, 4) from the frame of what was taught from a drawing to that of the drawing."""
    there = one.solid.corners_mm + one.origin_mm
    alike, every = np.tile(np.eye(3), (len(there), 1, 1)), np.ones((1, len(there)), bool)
    rotation, shift, _ = rough_fit(there, alike, own.corners_mm[None], every)
    return frames.rigid(rotation[0], shift[0])


def shape_from_drawing(shape: PartShape, one: Drawing) -> Array:
    """(4, 4) from the frame of a drawing to that of the shape: the drawing's own where that has no surface."""
    if shape.surface is None:
        return np.eye(4)
    return frames.rigid(np.eye(3), (shape.surface.corners_mm - one.surface.corners_mm).mean(axis=0) - one.origin_mm)
