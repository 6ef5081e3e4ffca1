"""Poses along a path: steps within limits, backing off, lifting; and the speed near a part and far from it. Pure."""

import numpy as np

from daemon import frames
from daemon.arrays import Array

NEAR_MM, FAR_MM = 100.0, 400.0


def backed_off(world_from_tool: Array, distance_mm: float) -> Array:
    """The pose distance_mm back along the tool's own z."""
    return world_from_tool @ frames.rigid(np.eye(3), np.array([0.0, 0.0, -distance_mm]))


def lifted(world_from_tool: Array, height_mm: float) -> Array:
    """The pose height_mm straight up."""
    pose = world_from_tool.copy()
    pose[2, 3] += height_mm
    return pose


def steps(at: Array, target: Array, most_mm: float, most_deg: float) -> list[Array]:
    """Poses on a straight line from `at` (not included) to target (included), each within the limits of the previous
    one."""
    motion = frames.difference(target, at)
    far_mm, turn = frames.size(motion)
    share = max(far_mm / most_mm, float(np.degrees(turn)) / most_deg, 1e-9)
    count = int(np.ceil(share / 0.98))
    return [frames.perturb(at, motion * (k / count)) for k in range(1, count)] + [target]


def within(a: Array, b: Array, most_mm: float, most_deg: float) -> bool:
    """Whether one move from a to b stays within the limits, with a margin of 2 %."""
    far_mm, turn = frames.size(frames.difference(b, a))
    return far_mm < 0.98 * most_mm and float(np.degrees(turn)) < 0.98 * most_deg


def speed_pct(distance_mm: float, travel_pct: float, near_pct: float) -> float:
    """Speed for a distance from the part: near_pct within NEAR_MM, travel_pct beyond FAR_MM, linear between."""
    share = float(np.clip((distance_mm - NEAR_MM) / (FAR_MM - NEAR_MM), 0.0, 1.0))
    return near_pct + share * (travel_pct - near_pct)
