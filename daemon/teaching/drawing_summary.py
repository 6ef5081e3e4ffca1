"""Describe what facetd understood of a drawing, for a person who confirms that this is the part. Pure."""

from itertools import combinations

import numpy as np

from daemon.arrays import Array
from daemon.teaching.curved_surfaces import counted
from daemon.teaching.solid_from_mesh import Drawing
from daemon.vision.geometry import Polyhedron, inside
from daemon.vision.model import facets_counted

ALONG_COS = np.cos(np.radians(0.5))
OPPOSITE_COS = -np.cos(np.radians(3.0))


def describe_drawing(drawing: Drawing, opening_mm: float | None) -> list[str]:
    """Size, facets, holes, other surfaces, repairs, the part's frame, and how a gripper could hold it, as lines of
    text."""
    size = " x ".join(f"{side:.4g}" for side in drawing.size_mm)
    solid = drawing.solid
    facets = f"{len(solid.facets)} facets ({facets_counted(solid.types)})"
    holes = f", {drawing.holes} {'hole' if drawing.holes == 1 else 'holes'} in them" if drawing.holes else ""
    lines = [f"{size} mm along the drawing's x, y, z. {facets}{holes}."]
    if drawing.curved:
        lines.append(f"Curved, so no facets: {counted(str(one) for one in drawing.curved)}.")
    lines += [f"In the file: {note}." for note in drawing.notes]
    origin = " ".join(f"{value + 0.0:.4g}" for value in np.round(drawing.origin_mm, 2))
    axes = ", ".join(_axis(row) for row in solid.flat_from_solid[0, :3, :3])
    lines.append(f"The part's frame: its origin at ({origin}) of the drawing, its x, y, z along the drawing's {axes}.")
    lines += [] if opening_mm is None else [_held(solid, opening_mm)]
    return lines


def _axis(direction: Array) -> str:
    """+x, -y, or a direction in numbers."""
    k = int(np.abs(direction).argmax())
    if abs(direction[k]) > ALONG_COS:
        return f"{'+' if direction[k] > 0 else '-'}{'xyz'[k]}"
    return f"({' '.join(f'{value + 0.0:.2f}' for value in np.round(direction, 2))})"


def _held(solid: Polyhedron, opening_mm: float) -> str:
    """Say between which flat facets a gripper can hold the part."""
    widths = sorted({round(width, 1) for width in _widths(solid)})
    fitting = [f"{width:g}" for width in widths if width < opening_mm]
    if fitting:
        return f"The gripper can hold it by flat facets {', '.join(fitting)} mm apart (it opens {opening_mm:g} mm)."
    if widths:
        return f"The gripper opens {opening_mm:g} mm; flat facets to hold it by are {widths[0]:g} mm apart or more."
    return "No two flat facets lie opposite each other: the gripper may not hold it."


def _widths(solid: Polyhedron) -> list[float]:
    """Distances, mm, between opposite facets that face apart."""
    found = []
    for one, other in combinations(range(len(solid.facets)), 2):
        normal = solid.normals[one]
        width = float((solid.centres_mm[one] - solid.centres_mm[other]) @ normal)
        if normal @ solid.normals[other] < OPPOSITE_COS and width > 0:
            across = solid.flat_from_solid[one, :3, :3][:2]
            rings = [solid.corners_mm[solid.rings[facet]] @ across.T for facet in (one, other)]
            middles = [solid.centres_mm[facet] @ across.T for facet in (other, one)]
            if any(inside(middle[None], ring[None])[0, 0] for middle, ring in zip(middles, rings, strict=True)):
                found.append(width)
    return found
