"""Machined parts as the simulated cell shows them, made from drawings."""

from __future__ import annotations

from daemon.store.library import load_facets
from daemon.teaching.solid_from_mesh import Drawing, read_drawing
from drivers.simcell.drawn import drawn_shape
from drivers.simcell.parts import PartShape
from drivers.simcell.surface import DrawnSurface


def drawing(name: str, content: bytes) -> Drawing:
    """What a drawing in mm is read as."""
    return read_drawing(name, content, "mm", load_facets())


def shown_shape(label: str, drawn: Drawing) -> PartShape:
    """The shape with its bores and roundings."""
    looks, solid = drawn.surface, drawn.solid
    surface = DrawnSurface(looks.corners_mm, looks.triangles, looks.normals, looks.part_of, looks.flat)
    return drawn_shape(label, solid.corners_mm, solid.facets, surface)
