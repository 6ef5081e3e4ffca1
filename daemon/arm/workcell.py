"""What the pick cycle is given to work with: a robot, eyes, a log, a clock. Protocols and values only; no hardware.

daemon/cell/pick_cell.py puts a Workcell together from the real, recorded or simulated parts that daemon/cell/build.py
builds; tests hand in fakes. Anything a robot or camera raises ends the motion: the cycle stops the arm first and then
reports the exception's own text.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from daemon.arm.mounting import CameraMounting
from daemon.arm.robot import Robot
from daemon.compute.calls import Compute
from daemon.vision.geometry import StereoRig

EyeName = Literal["left", "right"]
EYES: tuple[EyeName, EyeName] = ("left", "right")


class Picture(Protocol):
    """One image: pixels (H, W) uint8, taken_s on the cell's clock (mid-exposure)."""

    @property
    def pixels(self) -> NDArray[np.uint8]: ...

    @property
    def taken_s(self) -> float: ...


class Pictures(Protocol):
    """A stereo pair of one moment (drivers.camera.pair.StereoPair has this shape)."""

    @property
    def left(self) -> Picture: ...

    @property
    def right(self) -> Picture: ...


class Cameras(Protocol):
    """The stereo camera, asynchronous (daemon/cell runs the driver's blocking grab in a thread)."""

    async def grab(self, not_before_s: float, timeout_s: float) -> Pictures:
        """The newest pair whose frames were both exposed wholly after not_before_s, on the cell's clock."""

    async def expose(self, left: float, right: float) -> tuple[float, float] | None:
        """Gather so many times as much light with each eye; what was taken, None where that is not to be set."""


class Recorder(Protocol):
    """The run log as the cycle sees it."""

    def record(self, kind: str, /, **fields: object) -> None:
        """Write one record; never blocks on a disk.

        Fields are JSON values, numpy arrays (written as nested lists), or, under the name `images`, a dict of
        name -> (H, W) uint8 array that is kept as PNG and replaced by file names.
        """


@dataclass(frozen=True, eq=False)
class Workcell:
    """All of it. clock: seconds, monotonic, the one that stamps frames. mounting: where the cameras are.
    compute: where looks, fusing and plans are computed, beside the loop that stops the arm.

    alone: the one eye that looks, where the other is not there: `eyes` give its picture twice, and a pair is taken from
    two places of the arm (daemon/pick/moved_pair.py). rig and mounting are then those of a usual such pair.
    """

    robot: Robot
    eyes: Cameras
    log: Recorder
    clock: Callable[[], float]
    rig: StereoRig
    mounting: CameraMounting
    compute: Compute
    alone: EyeName | None = None
