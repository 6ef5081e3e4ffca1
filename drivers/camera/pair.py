"""Stereo pairs, and the protocol and error of every stereo camera."""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

CameraName = Literal["left", "right"]


class CameraError(Exception):
    """A camera cannot deliver; the message says which one, what happened and what to do."""

    code = "camera_lost"


@dataclass(frozen=True, eq=False)
class Frame:
    """One image: pixels (H, W) grey; taken_s: mid-exposure on the cell's monotonic clock; sequence: the driver's
    number."""

    pixels: NDArray[np.uint8]
    taken_s: float
    sequence: int


@dataclass(frozen=True, eq=False)
class StereoPair:
    """Two frames exposed at the same time."""

    left: Frame
    right: Frame

    @property
    def skew_ms(self) -> float:
        """Right minus left, ms."""
        return (self.right.taken_s - self.left.taken_s) * 1000.0


class StereoCamera(Protocol):
    """A stereo camera. Its calls block: the service runs them in a thread."""

    def use(self, alone: CameraName | None) -> None:
        """Use one camera, whose frame is then both frames of a pair, or both cameras (None). Raises CameraError where
        there is no such camera."""

    def open(self) -> None:
        """Claim the devices. Raises CameraError."""

    def grab(self, not_before_s: float, timeout_s: float) -> StereoPair:
        """The newest pair with both exposures entirely after not_before_s. Raises CameraError on timeout."""

    def expose(self, left: float, right: float) -> tuple[float, float] | None:
        """Multiply each camera's exposure by a factor. Returns the factors that the devices accepted; None where the
        operator has set the exposure, or the device has no control for it. Raises CameraError."""

    def close(self) -> None:
        """Release the devices; safe to call twice."""

    def describe(self) -> str:
        """One line for people: devices, format, rate."""
