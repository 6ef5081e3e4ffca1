"""Poses of a gripper that points down over the simulated cell's table."""

from __future__ import annotations

import numpy as np

from daemon.arrays import Array
from daemon.store import folders
from drivers.rigid import rigid, turn
from drivers.simcell.truth import load_truth

TRUTH = load_truth(folders.HOUSE / "etc" / "simcell.yaml")
DOWN = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
TABLE_MM = TRUTH.table.height_mm


def tool(x_mm: float, y_mm: float, z_mm: float, turn_rad: float = 0.0, lean_rad: float = 0.0) -> Array:
    """world_from_tool of a gripper pointing down, tool y along world x before it is turned about the vertical."""
    return rigid(turn([0, 0, 1], turn_rad) @ DOWN @ turn([0, 1, 0], lean_rad), [x_mm, y_mm, z_mm])
