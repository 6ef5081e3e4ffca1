"""Free space on the table: the obstacles beside a part, and where a part can be placed. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daemon.arm import Limits, hand_of, upright_bounds
from daemon.arrays import Array, Flags
from daemon.pick.settings import Settings
from daemon.vision.geometry import off_segments

SPOT_MM, SPOTS_OUT_MM = 40.0, 160.0
"""Spots on the table: their spacing, and the largest distance from the surveyed point."""
CLEARANCE_MM = 15.0
"""Clearance of the gripper and of a part set down from obstacles: looks err, and show only some of an obstacle."""
BIN_MM = 150.0
"""No part is set down this near to the bin."""


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Other objects on the table, as upright cylinders: middles (M, 2), radii and tops (M,), world mm."""

    middles: Array
    radii: Array
    tops: Array

    def free(self, spot: Array, radius_mm: float) -> bool:
        """Whether a part of this radius at a spot (2,) is clear of all obstacles."""
        away = np.linalg.norm(self.middles - spot, axis=1)
        return bool((away > self.radii + radius_mm + CLEARANCE_MM).all())

    def hides(self, points: Array, viewpoint: Array) -> bool:
        """Whether an obstacle may hide one of (N, 3) points from a viewpoint (3,) above them."""
        rays = viewpoint - points
        share = np.clip((self.tops - points[:, 2:]) / rays[:, 2:], 0.0, 1.0)
        ends = points[:, None, :2] + share[..., None] * rays[:, None, :2]
        return bool((off_segments(self.middles, points[:, None, :2], ends) < self.radii).any())

    def clear(self, tools: Array, limits: Limits) -> Flags:
        """(N,) whether the hand (fingers, palm, cameras; not the arm) at (N, 4, 4) is clear of all obstacles."""
        hand = hand_of(limits)
        ends = hand.ends_mm @ np.swapaxes(tools[:, None, :3, :3], 2, 3) + tools[:, None, None, :3, 3]
        away = off_segments(self.middles, ends[:, :, None, 0, :2], ends[:, :, None, 1, :2])
        low = ends[..., 2].min(axis=2) - hand.radius_mm
        near = away < self.radii + hand.radius_mm[:, None] + CLEARANCE_MM
        return np.asarray(~(near & (low[..., None] < self.tops + CLEARANCE_MM)).any(axis=(1, 2)))


def obstacles_of(corners: Sequence[Array]) -> Obstacles:
    """Obstacles around the known corners (M, 3) of objects, world mm."""
    spans = [(each.min(axis=0), each.max(axis=0)) for each in corners]
    middles = np.array([(low[:2] + high[:2]) / 2 for low, high in spans]).reshape(-1, 2)
    radii = [np.linalg.norm(c[:, :2] - m, axis=1).max() for c, m in zip(corners, middles, strict=True)]
    return Obstacles(middles, np.array(radii, float), np.array([high[2] for _, high in spans], float))


def free_spots(obstacles: Obstacles, radius_mm: float, settings: Settings) -> list[Array]:
    """Spots (2,) on the table where a part of this radius may be placed, those nearest to the surveyed point first:
    clear of obstacles, keep-out boxes and the bin."""
    middle = np.array(settings.surveys[0].centre_mm[:2])
    steps = np.arange(-SPOTS_OUT_MM, SPOTS_OUT_MM + 1.0, SPOT_MM)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    away = np.linalg.norm(grid, axis=1)
    spots = middle + grid[np.argsort(away, kind="stable")][: int((away <= SPOTS_OUT_MM).sum())]
    bin_at = np.array(settings.bin.point_mm[:2])
    bounds = upright_bounds(settings.limits.keep_out)[..., :2]
    low, high = np.array(settings.limits.box_low_mm[:2]), np.array(settings.limits.box_high_mm[:2])
    return [
        spot
        for spot in spots
        if obstacles.free(spot, radius_mm)
        and np.linalg.norm(spot - bin_at) > BIN_MM + radius_mm
        and (spot > low + radius_mm).all()
        and (spot < high - radius_mm).all()
        and not any(_near(spot, box) < radius_mm + CLEARANCE_MM for box in bounds)
    ]


def _near(spot: Array, box: Array) -> float:
    """Distance of a point (2,) from a rectangle with corners (2, 2)."""
    return float(np.linalg.norm(np.maximum(np.maximum(box[0] - spot, spot - box[1]), 0.0)))
