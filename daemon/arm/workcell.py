"""What a pick cycle works with: the robot, the cameras, the run log, the clock. Protocols and values; no hardware.

daemon/cell/pick_cell.py assembles a Workcell from the real, recorded or simulated hardware that daemon/cell/build.py
builds; tests use fakes. Any exception of the robot or the cameras ends the motion: the cycle stops the arm first and
then reports the exception's text.
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

CameraName = Literal["left", "right"]
CAMERA_NAMES: tuple[CameraName, CameraName] = ("left", "right")


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
        """Multiply the exposure of each camera by these factors. Returns the factors in effect; None where exposure
        cannot be set."""


class Recorder(Protocol):
    """The interface to the run log."""

    def record(self, kind: str, /, **fields: object) -> None:
        """Write one record without waiting for the disk.

        Fields are JSON values, numpy arrays (written as nested lists), or, under the name `images`, a dict of
        name -> (H, W) uint8 array, which is stored as PNG files and replaced by their names.
        """


@dataclass(frozen=True, eq=False)
class Workcell:
    """A cell to pick in. clock: seconds, monotonic; it stamps the images. mounting: where the cameras are. compute:
    runs looks, fusion and plans outside the event loop that stops the arm.

    alone: the only camera in use, where the other one is missing. Then `cameras` return its image twice, and a stereo
    pair is taken from two positions of the arm (daemon/pick/moved_pair.py); rig and mounting are those of such a pair.
    """

    robot: Robot
    cameras: Cameras
    log: Recorder
    clock: Callable[[], float]
    rig: StereoRig
    mounting: CameraMounting
    compute: Compute
    alone: CameraName | None = None
