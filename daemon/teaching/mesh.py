"""A drawing's file -> corners and polygons in mm, by the format that its name says. Bytes in, arrays out, or one line
that says why not.

STL is stl.py's, OBJ obj.py's. How a solid is made of the polygons is solid_from_mesh.py's. Colours, textures, normals
and names in the files are not looked at.
"""

from dataclasses import dataclass, replace

import numpy as np

from daemon.arrays import Array
from daemon.errors import FacetdError

UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}
"""STL and OBJ do not say what their numbers are; millimetres unless the operator says otherwise."""
LARGEST_BYTES = 4_000_000
SMALLEST_MM, LARGEST_MM = 5.0, 1000.0
STEPS = (0.1, 0.01, 0.001, 0.0001)
"""Steps that programs round coordinates to. A file of whole numbers is taken as one of tenths: its author may have
drawn on whole millimetres."""
SINGLE = 3e-7
"""Relative error of a number that a file of single precision holds."""


class MeshError(FacetdError):
    """A mesh that cannot be used: one line, what is wrong and where."""


class UnitError(MeshError):
    """A part too small or too large in the unit that was given. question: whether it is in that; others: what else."""

    def __init__(self, question: str, others: str) -> None:
        super().__init__(f"{question} say {others} behind the file's name")
        self.question, self.others = question, others


@dataclass(frozen=True, eq=False)
class Mesh:
    """corners_mm (K, 3); polygons: corner indices of each, in the file's order; step_mm: what the file's coordinates
    are rounded to, 0 where to nothing; notes: what was mended or left out, a line each."""

    corners_mm: Array
    polygons: tuple[tuple[int, ...], ...]
    step_mm: float = 0.0
    notes: tuple[str, ...] = ()


def read_mesh(name: str, content: bytes, unit: str = "mm") -> Mesh:
    """The mesh in a file's content; its name tells the format. Raises MeshError, UnitError."""
    from daemon.teaching.obj import read_obj
    from daemon.teaching.stl import read_stl

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
        raise MeshError(f"{name}: holds no facet")
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
    """The coarsest of STEPS that every coordinate (K, 3) is a multiple of; 0 where none is."""
    for step in STEPS:
        off = np.abs(corners - np.round(corners / step) * step)
        if (off <= SINGLE * np.abs(corners) + 1e-9).all():
            return step
    return 0.0
