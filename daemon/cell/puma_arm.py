"""The model of a PUMA: kinematics, reach, collision shapes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daemon.arm import Capsule, links_like
from daemon.arrays import Array
from drivers import puma560

NEAR_SINGULAR_RAD = float(np.radians(3.0))
"""A pose with joint 5 this near to zero counts as unreachable: joints 4 and 6 would turn far for little. A straight
line is checked at points at most 6 mm apart (sweep.py), between which joint 5 may come nearer by tenths of a degree."""


@dataclass(frozen=True)
class PumaArm:
    """ArmModel (daemon/arm/robot.py) of a PUMA with these lengths."""

    geometry: puma560.ArmGeometry

    def reachable(self, world_from_tool: Array, joints_rad: Array) -> Array | None:
        """Joints (6,) rad that reach the pose in the present configuration, clear of a singular wrist, or None."""
        configuration = puma560.configuration_of(joints_rad, self.geometry)
        try:
            joints = puma560.inverse(world_from_tool, configuration, self.geometry, joints_rad)
        except puma560.UnreachableError:
            return None
        return None if puma560.wrist_is_singular(joints, within_rad=NEAR_SINGULAR_RAD) else joints

    def between(self, joints_rad: Array, to_rad: Array, share: float) -> Array:
        """Tool pose (4, 4) after that share of a joint-interpolated move."""
        return puma560.forward(joints_rad + share * (to_rad - joints_rad), self.geometry)

    def frames(self, joints_rad: Array) -> Array:
        """Poses of base, links and tool, (N, 8, 4, 4)."""
        return puma560.link_frames(joints_rad, self.geometry)

    def along(self, world_from_tool: Array, joints_rad: Array) -> Array:
        """Joints (N, 6) along a straight line, starting from (6,) or near to (N, 6); nan where out of reach or near a
        singular wrist."""
        joints = puma560.inverse_along(world_from_tool, joints_rad, self.geometry)
        joints[np.abs(np.sin(joints[:, 4])) < np.sin(NEAR_SINGULAR_RAD)] = np.nan
        return joints

    def ways(self, world_from_tool: Array) -> Sequence[Array]:
        """Joints (6,) rad of every configuration that reaches the pose."""
        return [joints for _, joints in puma560.solutions(world_from_tool, self.geometry)]

    @property
    def reach_mm(self) -> float:
        return self.geometry.reach_mm

    @property
    def shoulder_mm(self) -> Array:
        return np.asarray(self.geometry.world_from_base[:3, 3])

    @property
    def links(self) -> tuple[Capsule, ...]:
        """A PUMA 560's, scaled to this arm's lengths."""
        return links_like(self.geometry.a2_mm, self.geometry.d3_mm, self.geometry.d4_mm)
