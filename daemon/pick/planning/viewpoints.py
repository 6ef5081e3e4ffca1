"""What shows of a part from a viewpoint. Pure: shapes and poses in, worths out."""

from collections.abc import Callable

import numpy as np

from daemon.arrays import Array, Flags
from daemon.vision.geometry import FACING, Polyhedron

Reachable = Callable[[Array], Flags]
"""Which of (N, 4, 4) world_from_tool the arm can have (daemon/arm/motion.py: Reach.allows_each)."""


def view_worth(shape: Polyhedron, world_from_part: Array, viewpoint: Array) -> float:
    """How well a look from the camera shows the part: facets well seen, the second one counting most (0 to 1).

    One facet alone fits too many parts; two that meet fix the part and its pose; a third adds little.
    """
    seen = np.sort(np.clip((shape.facing(world_from_part, viewpoint) - FACING) / (1 - FACING), 0, 1))[::-1]
    weights = np.array([0.3, 1.0, 0.3])[: len(seen)]
    return float(weights @ np.sqrt(seen[:3])) / 1.6


def angle_at(point: Array, a: Array, b: Array) -> float:
    """Angle in rad at which a and b (3,) are seen from point (3,)."""
    u, v = a - point, b - point
    return float(np.arccos(np.clip(u @ v / (np.linalg.norm(u) * np.linalg.norm(v)), -1.0, 1.0)))
