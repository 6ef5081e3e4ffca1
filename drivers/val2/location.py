"""Convert between VAL II locations (X Y Z O A T, degrees) and 4x4 matrices.

With [n s a] the tool axes in the world, a = (sin O cos A, -cos O cos A, -sin A); O = A = T = 0 points the hand
along -Y with the fingers along +X.
"""

from dataclasses import dataclass
from math import atan2, cos, degrees, hypot, radians, sin

import numpy as np

from drivers.arrays import Array
from drivers.rigid import angle_of

SINGULAR_COS_A = 1e-10


@dataclass(frozen=True)
class Location:
    """A pose of the tool in the world, as VAL II writes it: mm and degrees."""

    x_mm: float
    y_mm: float
    z_mm: float
    o_deg: float
    a_deg: float
    t_deg: float

    def values(self) -> tuple[float, float, float, float, float, float]:
        """The six numbers in VAL II's order."""
        return (self.x_mm, self.y_mm, self.z_mm, self.o_deg, self.a_deg, self.t_deg)


def matrix_from_location(location: Location) -> Array:
    """world_from_tool (4, 4), translation in mm."""
    o, a, t = (radians(v) for v in (location.o_deg, location.a_deg, location.t_deg))
    so, co, sa, ca, st, ct = sin(o), cos(o), sin(a), cos(a), sin(t), cos(t)
    return np.array(
        [
            [-so * sa * ct + co * st, so * sa * st + co * ct, so * ca, location.x_mm],
            [co * sa * ct + so * st, -co * sa * st + so * ct, -co * ca, location.y_mm],
            [-ca * ct, ca * st, -sa, location.z_mm],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def location_from_matrix(world_from_tool: Array, current_o_deg: float = 0.0) -> Location:
    """The location of a (4, 4) world_from_tool; A within +-90, O and T within +-180 degrees.

    At A = +-90 degrees (gripper straight down or up) only T - O or T + O is determined. Then O is current_o_deg, the
    present O of the arm, so that a vertical approach does not spin the wrist.
    """
    n, a = world_from_tool[:3, 0], world_from_tool[:3, 2]
    level = hypot(a[0], a[1])
    a_rad = atan2(-a[2], level)
    if level > SINGULAR_COS_A:
        o_rad = atan2(a[0], -a[1])
        t_rad = atan2(world_from_tool[2, 1], -n[2])
    elif a[2] < 0:
        o_rad = radians(current_o_deg)
        t_rad = o_rad + atan2(n[0], n[1])
    else:
        o_rad = radians(current_o_deg)
        t_rad = atan2(n[0], -n[1]) - o_rad
    x, y, z = (float(v) for v in world_from_tool[:3, 3])
    return Location(x, y, z, wrapped_deg(degrees(o_rad)), degrees(a_rad), wrapped_deg(degrees(t_rad)))


def wrapped_deg(angle_deg: float) -> float:
    """The same angle within [-180, 180)."""
    return (angle_deg + 180.0) % 360.0 - 180.0


def apart(first: Location, second: Location) -> tuple[float, float]:
    """The difference of two locations: mm between the tool centre points, degrees of rotation.

    Compared as matrices, because near A = +-90 very different O and T mean the same orientation.
    """
    a, b = matrix_from_location(first), matrix_from_location(second)
    return float(np.linalg.norm(a[:3, 3] - b[:3, 3])), degrees(angle_of(a[:3, :3].T @ b[:3, :3]))
