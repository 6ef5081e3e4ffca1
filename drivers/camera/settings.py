"""Settings of the cameras (the section `cameras` of facetd.yaml)."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal

from msgspec import Meta

from drivers.camera.pair import CameraName
from drivers.camera.pixels import FORMATS

Device = Annotated[str, Meta(min_length=1, max_length=4096)]
Side = Annotated[int, Meta(ge=16, le=20_000)]
Mounting = Literal["hand", "world"]
Wish = Annotated[float, Meta(ge=-1e10, le=1e10)] | str
"""A number, or `auto`: the camera's automatic control, frozen during a look."""


@dataclass(frozen=True)
class CameraSettings:
    """Two V4L2 cameras as one stereo pair, or one camera alone, which the arm moves between two pictures."""

    left: Device | None = None
    """The left camera: a path (/dev/video0, /dev/v4l/by-id/...), a bare name under by-id or by-path, a card name as
    `facetctl cameras` lists it, or a number."""
    right: Device | None = None
    """The right camera, named as `left`. Unset: one camera alone."""
    width: Side = 640
    """Image width, px."""
    height: Side = 480
    """Image height, px."""
    fps: Annotated[float, Meta(gt=0, le=1000)] = 15.0
    """Frame rate, frames per second."""
    formats: tuple[str, ...] = tuple(FORMATS)
    """Pixel formats, in order of preference."""
    max_skew_ms: Annotated[float, Meta(gt=0, le=1000)] = 20.0
    """How far apart in time two frames of one pair may be, ms."""
    controls: Mapping[str, Wish] = field(default_factory=dict)
    """Camera controls by name: exposure_us, gain, white_balance_k, focus, or any that `facetctl cameras` lists; a
    number, or `auto` (the camera's own control, held during a look). What is not named stays as found; the daemon sets
    the exposure where neither exposure_us nor gain is named."""
    mounting: Mounting = "hand"
    """Where the cameras are: `hand`, where they move with the gripper (eye-in-hand), or `world`, fixed over the table
    (eye-to-hand). The calibration must be of the same."""

    def __post_init__(self) -> None:
        """Raise ValueError for settings that no camera could have."""
        if self.left is None and self.right is None:
            raise ValueError("left: expected a camera, found none")
        unknown = [name for name in self.formats if name not in FORMATS]
        if unknown or not self.formats:
            raise ValueError(f"formats: expected some of {', '.join(FORMATS)}; found {', '.join(unknown) or 'none'}")

    @property
    def devices(self) -> dict[CameraName, Device]:
        """The configured devices by camera."""
        both: dict[CameraName, Device | None] = {"left": self.left, "right": self.right}
        return {name: device for name, device in both.items() if device is not None}
