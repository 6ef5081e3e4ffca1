"""The arm of a cell that has none (recorded pairs): everything about it is refused in one clear line.

Honours daemon/arm/workcell.py's Robot, and what the console asks of an arm besides.
"""

from __future__ import annotations

from typing import NoReturn

import numpy as np

from daemon.arm import Beliefs, MotionPermit, Reading
from daemon.arrays import Array
from daemon.errors import FacetdError
from drivers.puma560 import PUMA560


class CellError(FacetdError):
    """The cell cannot be had as configured: what, where, what to do."""


class NoKinematics:
    """Of an arm that is not there."""

    def reachable(self, world_from_tool: Array, joints_rad: Array) -> Array | None:
        """Nowhere."""
        return None

    def between(self, joints_rad: Array, to_rad: Array, share: float) -> Array:
        """Where it stands."""
        return np.eye(4)

    def frames(self, joints_rad: Array) -> Array:
        """No links: all of it is where it stands."""
        return np.tile(np.eye(4), (len(joints_rad), 8, 1, 1))

    def along(self, world_from_tool: Array, joints_rad: Array) -> Array:
        """No way."""
        return np.full((len(world_from_tool), 6), np.nan)


class NoArm:
    """A cell without an arm (recorded pairs): it is looked from where the world's origin is, and nothing moves."""

    heard_s: float | None = None
    question: str | None = None
    aside = stopped_on_opening = asks_whether_to_move = False
    connected = True
    arm = PUMA560
    kinematics = NoKinematics()

    def __init__(self, beliefs: Beliefs) -> None:
        self.permit = MotionPermit()
        self.beliefs = beliefs

    async def _nothing(self) -> None:
        """Nothing is there to open, close or check, and nothing moves."""

    open = close = check = abort = _nothing

    async def at_rest(self) -> bool:
        """Always."""
        return True

    async def where(self) -> Reading:
        """The origin."""
        return Reading(np.eye(4), np.zeros(6))

    rest = where

    async def _refuse(self, *_: object, **__: object) -> NoReturn:
        raise CellError(NONE)

    move = hand = power_up = calibrate = monitor = prove_stop = _refuse

    def check_typable(self, _: str) -> None:
        """Whatever it is, it is refused when it is typed."""

    def terminal(self, _: object) -> NoReturn:
        """Refused."""
        raise CellError(NONE)


NONE = "this cell is recorded: there is no arm to move, no gripper and no controller"
