"""What a stereo camera gives: two frames of one moment. The one protocol every camera honours, and its errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

EyeName = Literal["left", "right"]


class CameraError(Exception):
    """A camera cannot deliver: the message says which one, what happened and what to do."""

    code = "camera_lost"


@dataclass(frozen=True, eq=False)
class Frame:
    """One image: pixels (H, W) uint8 grey; taken_s on the cell's monotonic clock at mid-exposure; its number."""

    pixels: NDArray[np.uint8]
    taken_s: float
    sequence: int


@dataclass(frozen=True, eq=False)
class StereoPair:
    """Two frames of one moment."""

    left: Frame
    right: Frame

    @property
    def skew_ms(self) -> float:
        """Right minus left, ms."""
        return (self.right.taken_s - self.left.taken_s) * 1000.0


class StereoCamera(Protocol):
    """The protocol. Blocking calls: the service runs them in a thread."""

    def use(self, alone: EyeName | None) -> None:
        """Look with one eye from now on, both frames of a pair being its one, or with both (None). Raises CameraError
        where there is no such eye."""

    def open(self) -> None:
        """Claim the devices. Raises CameraError."""

    def grab(self, not_before_s: float, timeout_s: float) -> StereoPair:
        """The newest pair whose frames were both exposed wholly after not_before_s. Raises CameraError on timeout."""

    def expose(self, left: float, right: float) -> tuple[float, float] | None:
        """Gather so many times as much light with each eye from now on; what was taken, None where that is not to be
        set: the operator has set it, or there is nothing to set. Raises CameraError."""

    def close(self) -> None:
        """Release the devices; safe to call twice."""

    def describe(self) -> str:
        """One line for people: which devices, format, rate."""
