"""The Robot of a cell without an arm (recorded pairs): it refuses every motion in one clear line."""

from typing import NoReturn

import numpy as np

from daemon.arm import Beliefs, MotionPermission, Reading
from daemon.arrays import Array
from daemon.cell.puma_arm import PumaArm
from daemon.errors import FacetdError
from drivers.puma560 import ArmGeometry


class CellError(FacetdError):
    """The cell does not work as configured: what, where, what to do."""


class NoReach(PumaArm):
    """The arm of a cell without one: a PUMA's body, and nothing is reachable."""

    def reachable(self, world_from_tool: Array, joints_rad: Array) -> Array | None:
        return None

    def between(self, joints_rad: Array, to_rad: Array, share: float) -> Array:
        return np.eye(4)

    def frames(self, joints_rad: Array) -> Array:
        return np.tile(np.eye(4), (len(joints_rad), 8, 1, 1))

    def along(self, world_from_tool: Array, joints_rad: Array) -> Array:
        return np.full((len(world_from_tool), 6), np.nan)


class NoArm:
    """A cell without an arm (recorded pairs): the cameras are at the world's origin, and nothing moves."""

    heard_s: float | None = None
    controller = None
    aside = stopped_on_opening = False
    connected = True

    def __init__(self, beliefs: Beliefs, geometry: ArmGeometry) -> None:
        self.kinematics = NoReach(geometry)
        self.permission = MotionPermission()
        self.beliefs = beliefs

    async def _nothing(self) -> None:
        """There is nothing to open, close or check."""

    open = close = check = stop_motion = _nothing

    async def at_rest(self) -> bool:
        return True

    async def where(self) -> Reading:
        return Reading(np.eye(4), np.zeros(6))

    wait_until_at_rest = where

    async def _refuse(self, *_: object, **__: object) -> NoReturn:
        raise CellError(NONE)

    move = set_gripper = test_stop = set_outputs = work_valves = ask_input = _refuse

    def use_tool(self, _: Array) -> None:
        """There is nothing to mount a gripper on."""


NONE = "this cell is recorded: there is no arm to move, no gripper and no controller"
