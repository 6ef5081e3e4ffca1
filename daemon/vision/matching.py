"""Which polygon of the left eye is which of the right, corner by corner: epipolar, ordered, facet-wise.

D'Souza matches corner by corner inside an epipolar band (section 4.2.3) and loses its way where sides are short;
whole facets, taken round their border in order, leave far fewer ways to be wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.vision.data import Polygon
from daemon.vision.epipolar import Baseline
from daemon.vision.settings import VisionSettings

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Match:
    """Left polygon `left` is right polygon `right`; its corner i is the right's corner (i + shift) mod N.
    cost: px rms.
    """

    left: int
    right: int
    shift: int
    cost: float


def match_polygons(
    left: tuple[Polygon, ...], right: tuple[Polygon, ...], rig: Baseline, settings: VisionSettings
) -> tuple[Match, ...]:
    """Best one-to-one matches, cheapest first."""
    ideal_left = [rig.left.ideal(p.corners_px) for p in left]
    ideal_right = [rig.right.ideal(p.corners_px) for p in right]
    candidates = []
    for i, a in enumerate(ideal_left):
        for j, b in enumerate(ideal_right):
            if len(a) == len(b) and _band(a, b, rig.left.focal_px, settings):
                found = _best_shift(a, b, rig, settings)
                if found is not None:
                    candidates.append(Match(i, j, *found))
    taken_left, taken_right, chosen = set[int](), set[int](), []
    for m in sorted(candidates, key=lambda m: m.cost):
        if m.left not in taken_left and m.right not in taken_right:
            taken_left.add(m.left)
            taken_right.add(m.right)
            chosen.append(m)
    return tuple(chosen)


def _band(a: Array, b: Array, focal_px: float, settings: VisionSettings) -> bool:
    """Whether both polygons span the same epipolar band."""
    gap = max(abs(a[:, 1].min() - b[:, 1].min()), abs(a[:, 1].max() - b[:, 1].max()))
    return float(gap) * focal_px < settings.max_epipolar_px


def _best_shift(a: Array, b: Array, rig: Baseline, settings: VisionSettings) -> tuple[int, float] | None:
    nearest, farthest = settings.depth_range_mm
    best: tuple[int, float] | None = None
    for shift in range(len(a)):
        c = np.roll(b, -shift, axis=0)
        off = (a[:, 1] - c[:, 1]) * rig.left.focal_px
        disparity = a[:, 0] - c[:, 0]
        if np.abs(off).max() > settings.max_epipolar_px:
            continue
        if disparity.min() < rig.length_mm / farthest or disparity.max() > rig.length_mm / nearest:
            continue
        warp = _plane_residual(a, disparity) * rig.left.focal_px
        cost = float(np.sqrt(np.mean(off**2) + np.mean(warp**2)))
        if warp.max() < 2 * settings.max_epipolar_px and (best is None or cost < best[1]):
            best = shift, cost
    return best


def _plane_residual(points: Array, disparity: Array) -> Array:
    """How far each disparity is off the best plane: over a plane in space disparity is affine in the image."""
    if len(points) < 4:
        return np.zeros(len(points))
    design = np.concatenate([points, np.ones((len(points), 1))], 1)
    return np.asarray(np.abs(design @ np.linalg.lstsq(design, disparity, rcond=None)[0] - disparity))
