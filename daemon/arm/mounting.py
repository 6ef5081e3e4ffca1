"""How the cameras are mounted: on the hand (eye-in-hand), where they move with the tool. Pure: arrays in, arrays out.

Every pose of the cameras, and every pose of the arm for a look, comes from here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.arrays import Array


@dataclass(frozen=True, eq=False)
class OnHand:
    """Eye-in-hand: tool_from_cyclopean, (4, 4) mm, is constant."""

    tool_from_cyclopean: Array

    def world_from_cyclopean_at(self, world_from_tool: Array) -> Array:
        """(4, 4) mm of the cameras while the tool is at world_from_tool (4, 4)."""
        return np.asarray(world_from_tool @ self.tool_from_cyclopean)

    def tool_from_cyclopean_at(self, _world_from_tool: Array) -> Array:
        """(4, 4) mm of the cameras on the tool while that is at world_from_tool (4, 4)."""
        return self.tool_from_cyclopean

    def look_pose(self, rotation: Array, centre: Array, stand_off_mm: float) -> Array:
        """world_from_tool (4, 4) with the tool turned to rotation (3, 3) and the cameras' axis through centre (3,),
        world, from stand_off_mm away."""
        view = rotation @ self.tool_from_cyclopean[:3, :3]
        world_from_cyclopean = frames.rigid(view, centre - stand_off_mm * view[:, 2])
        return world_from_cyclopean @ frames.inverse(self.tool_from_cyclopean)


CameraMounting = OnHand
