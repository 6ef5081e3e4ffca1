"""Outlines fitted to the grey levels: corners to sub-pixel, with their covariance. Knows nothing of the other eye."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.vision.data import Polygon
from daemon.vision.eye import Sight
from daemon.vision.outlines import Outline
from daemon.vision.shapes import corners_of, is_simple
from daemon.vision.sides import Sides, fit_sides

Array = NDArray[np.float64]

_FARTHEST_PX = 6.0
_SHORTEST_PX = 4.0


@dataclass(frozen=True, eq=False)
class Fitted:
    """A polygon and the sides it was met from; side i goes from corner i to the next."""

    polygon: Polygon
    sides: Sides

    def rolled(self, shift: int) -> Fitted:
        """The same with corner `shift` first."""
        p = self.polygon
        corners, covariance, contrast = (np.roll(v, -shift, 0) for v in (p.corners_px, p.covariance_px2, p.contrast))
        sides = (np.roll(getattr(self.sides, k), -shift, 0) for k in Sides.__dataclass_fields__)
        return Fitted(Polygon(corners, covariance, contrast, p.border_px), Sides(*sides))


def fit_polygons(sight: Sight, outlines: list[Outline]) -> list[Fitted | None]:
    """Fit every side of every outline to the grey levels; None where the fit strays from the outline."""
    if not outlines:
        return []
    start = np.concatenate([o.corners for o in outlines])
    end = np.concatenate([np.roll(o.corners, -1, 0) for o in outlines])
    every = fit_sides(sight.image, sight.noise, start, end, sight.eye)
    fitted: list[Fitted | None] = []
    first = 0
    for o in outlines:
        part = slice(first, first + len(o.corners))
        first += len(o.corners)
        sides = Sides(*(getattr(every, k)[part] for k in Sides.__dataclass_fields__))
        corners = corners_of(sides.start, sides.end)
        shortest = np.linalg.norm(np.roll(corners, -1, 0) - corners, axis=1).min()
        if np.abs(corners - o.corners).max() < _FARTHEST_PX and shortest > _SHORTEST_PX and is_simple(corners):
            polygon = Polygon(corners, met_covariance(sides), np.abs(sides.step), o.border.astype(float))
            fitted.append(Fitted(polygon, sides))
        else:
            fitted.append(None)
    return fitted


def met_covariance(sides: Sides) -> Array:
    """Covariance (N, 2, 2) px^2 of corners where side k-1 ends and side k starts."""
    chord = sides.end - sides.start
    normal = np.stack([chord[:, 1], -chord[:, 0]], 1) / np.linalg.norm(chord, axis=1)[:, None]
    both = np.stack([np.roll(normal, 1, 0), normal], 1)
    inverse = np.linalg.pinv(both)
    variance = np.stack([np.roll(sides.covariance[:, 1, 1], 1), sides.covariance[:, 0, 0]], 1)
    return np.asarray(inverse * variance[:, None, :] @ np.swapaxes(inverse, 1, 2))
