"""Outlines fitted to the grey levels: corners to sub-pixel, with their covariance. Knows nothing of the other eye."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daemon.arrays import Array, Flags, Index
from daemon.vision.geometry import Rings, convex, different, is_simple, met, outward, rings
from daemon.vision.image.edge_lines import MeasuredImage, Sides, fit_sides
from daemon.vision.image.outlines import Outline
from daemon.vision.values import Polygon

# Set by eye on the rendered scenes.
_FARTHEST_PX = 6.0  # from its outline a fitted corner may be
_SHORTEST_PX = 4.0
_SAME_PX = 1.0  # sides whose ends are this near are fitted once
MODEL_PX = 0.04  # how far a real side is from a blurred step between even faces


@dataclass(frozen=True, eq=False)
class Fitted:
    """A polygon and the sides it was met from; side i goes from corner i to the next."""

    polygon: Polygon
    sides: Sides

    def rolled(self, shift: int) -> Fitted:
        """The same with corner `shift` first."""
        p, n = self.polygon, len(self.polygon.corners_px)
        order = (np.arange(n) + shift) % n
        polygon = Polygon(p.corners_px[order], p.covariance_px2[order], p.contrast[order], p.border_px)
        return Fitted(polygon, self.sides.chosen(order))


def fit_polygons(of_images: Sequence[tuple[MeasuredImage, Sequence[Outline]]]) -> list[Fitted | None]:
    """Fit every side of every outline, image after image, to the grey levels; None where the fit strays from the
    outline. The images are fitted side by side and have nothing to do with each other."""
    outlines = [o for _, own in of_images for o in own]
    if not outlines:
        return []
    shape = rings([o.corners for o in outlines])
    starts, ends, chosen, turns = list[Array](), list[Array](), list[Index](), list[Flags]()
    counts, first = list[tuple[MeasuredImage, int]](), 0
    for exposure, own in of_images:
        here = slice(first, first + sum(len(o.corners) for o in own))
        if here.start < here.stop:
            start, end = shape.corners[here], shape.corners[shape.next[here]]
            kept, which, turned = different(start, end, _SAME_PX)
            chosen.append(which + sum(count for _, count in counts))
            starts.append(start[kept])
            ends.append(end[kept])
            turns.append(turned)
            counts.append((exposure, len(kept)))
        first = here.stop
    sides = fit_sides(counts, np.concatenate(starts), np.concatenate(ends))
    every = sides.chosen(np.concatenate(chosen), np.concatenate(turns))
    rough, shape = shape.corners, shape.moved(met(shape, every.start, every.end))
    covariance = met_covariance(shape, every)
    astray = np.maximum.reduceat(np.abs(shape.corners - rough).max(1), shape.first)
    shortest = shape.least(np.hypot(*(shape.corners - shape.corners[shape.next]).T))
    good, sound = (astray < _FARTHEST_PX) & (shortest > _SHORTEST_PX), convex(shape)
    fitted: list[Fitted | None] = []
    for k, (o, corners) in enumerate(zip(outlines, shape.split(), strict=True)):
        if good[k] and (sound[k] or is_simple(corners)):
            part = shape.first[k] + np.arange(shape.count[k])
            sides = every.chosen(part)
            polygon = Polygon(corners, covariance[part], np.abs(sides.step), o.border.astype(float))
            fitted.append(Fitted(polygon, sides))
        else:
            fitted.append(None)
    return fitted


def fitted_from(sides: Sides, border_px: Array) -> Fitted:
    """The polygon of sides (N) that were fitted already, each meeting the next; border_px (K, 2)."""
    shape = rings([sides.start])
    shape = shape.moved(met(shape, sides.start, sides.end))
    return Fitted(Polygon(shape.corners, met_covariance(shape, sides), np.abs(sides.step), border_px), sides)


def met_covariance(shape: Rings, sides: Sides) -> Array:
    """Covariance (M, 2, 2) px^2 of corners where the side before ends and the corner's own side starts."""
    chord = sides.end - sides.start
    normal = outward(-chord, np.hypot(chord[:, 0], chord[:, 1]))
    before = normal[shape.before]
    sine = before[:, 0] * normal[:, 1] - before[:, 1] * normal[:, 0]
    sine = np.where(np.abs(sine) < 0.02, 0.02, sine)
    along = np.stack([normal[:, 1], -normal[:, 0]], 1) / sine[:, None]
    across = np.stack([-before[:, 1], before[:, 0]], 1) / sine[:, None]
    ends, starts = sides.covariance[shape.before, 1, 1] + MODEL_PX**2, sides.covariance[:, 0, 0] + MODEL_PX**2
    one = along[:, :, None] * along[:, None, :] * ends[:, None, None]
    return np.asarray(one + across[:, :, None] * across[:, None, :] * starts[:, None, None])
