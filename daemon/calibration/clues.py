"""What a look offers to the watch over the calibration: corners and edges as clues. Pure.

What the clues mean is drift.py's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.calibration.drift import Clue, clue, same_height
from daemon.vision.geometry.polyhedron import Polyhedron
from daemon.vision.geometry.rig import StereoRig
from daemon.vision.values import FacetView, Part, Scene

Array = NDArray[np.float64]
ShapeOf = Callable[[str], Polyhedron | None]
NAMES = ("pitch", "roll", "vergence")
"""As drift.AXES, in the fields <name>_deg and <name>_sigma_deg of a look's health."""

SURE = 0.9
"""Confidence below which a part's edges are not taken for known lengths."""
NEAR_MM = 6.0
SHORTEST_MM = 15.0


def clue_of(scene: Scene, rig: StereoRig, shape_of: ShapeOf) -> Clue:
    """What one look offers: all corners of all outlines of both eyes, named or not, and the edges of sure parts."""
    corners = [_corners(scene.view, "left"), _corners(scene.view, "right")]
    left, right = same_height(rig, corners[0], corners[1])
    sure = [p for p in scene.parts if p.recognition.label != "unknown" and p.recognition.confidence >= SURE]
    return clue(rig, left, right, [edge for part in sure for edge in _edges(part, shape_of)], "")


def health_fields(clue: Clue) -> dict[str, float]:
    """A clue as fields of a look's health in the run log; what the look says nothing of is left out."""
    fields: dict[str, float] = {}
    for name, turn, sigma in zip(NAMES, clue.turn, clue.sigma, strict=True):
        if np.isfinite(sigma):
            fields |= {f"{name}_deg": float(np.degrees(turn)), f"{name}_sigma_deg": float(np.degrees(sigma))}
    return fields


def _corners(view: FacetView, eye: Literal["left", "right"]) -> Array:
    """(N, 2) px: the corners of every outline of one eye, used or refused. After a knock most are refused."""
    used = view.polygons_left if eye == "left" else view.polygons_right
    found = [p.corners_px for p in used] + [r.corners_px for r in view.rejected if r.eye == eye]
    return np.concatenate(found) if found else np.zeros((0, 2))


def _edges(part: Part, shape_of: ShapeOf) -> list[tuple[float, float, float]]:
    """(length found, length taught, depth) of each edge of which both corners are met by taught ones, mm."""
    shape = shape_of(part.recognition.label)
    if shape is None:
        return []
    placed = frames.apply(part.cyclopean_from_part, shape.corners_mm)
    found = []
    for facet in part.facets:
        seen = facet.corners_mm
        gaps = np.linalg.norm(seen[:, None] - placed[None], axis=2)
        nearest, near = gaps.argmin(axis=1), gaps.min(axis=1) < NEAR_MM
        for k in range(len(seen)):
            n = (k + 1) % len(seen)
            taught = float(np.linalg.norm(placed[nearest[k]] - placed[nearest[n]]))
            if near[k] and near[n] and taught > SHORTEST_MM:
                found.append((float(np.linalg.norm(seen[k] - seen[n])), taught, float(seen[[k, n], 2].mean())))
    return found
