"""The two eyes of one look, side by side, for all that runs over them. Nothing is compared here."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import degrees
from typing import Any

from numpy.typing import NDArray

from daemon.vision.geometry import Baseline, RectifiedCamera, StereoRig, baseline
from daemon.vision.image.camera_image import CameraImage
from daemon.vision.image.grey import VisionError, as_grey, check_size
from daemon.vision.settings import VisionSettings

LEAST_ASIDE_DEG = 15.0
"""Of every sight against the line from eye to eye: along that line no depth can be measured, and near to it what both
eyes see of one thing is of as many sizes as there are depths. Eyes that look straight ahead have this in pictures 150
degrees wide."""


@dataclass(frozen=True, eq=False)
class StereoImages:
    """A stereo pair: what each eye sees, the rig, and the rig as its baseline has it."""

    left: CameraImage
    right: CameraImage
    rig: StereoRig
    geometry: Baseline

    @property
    def views(self) -> tuple[CameraImage, CameraImage]:
        """Left and right, to loop over."""
        return self.left, self.right

    def uncluttered(self, settings: VisionSettings) -> bool:
        """Whether little but parts shows edges in either."""
        return all(view.uncluttered(settings) for view in self.views)


def open_stereo(left: NDArray[Any], right: NDArray[Any], rig: StereoRig) -> StereoImages:
    """Check a stereo pair, (H, W) uint8 or what as_grey takes; nothing is measured yet.

    Raises VisionError where an image cannot be used or is not of the size the rig was calibrated for, and where the rig
    cannot give depth.
    """
    geometry = baseline(rig)
    views = []
    for image, eye, name in ((left, geometry.left, "left image"), (right, geometry.right, "right image")):
        grey = as_grey(image, name)
        check_size(grey, rig.image_size, name)
        check_aside(eye, rig.image_size, name)
        views.append(CameraImage(eye, grey))
    return StereoImages(views[0], views[1], rig, geometry)


def check_aside(eye: RectifiedCamera, image_size: tuple[int, int], name: str) -> None:
    """Raise VisionError unless an eye looks across the line from eye to eye in all of its image (width, height)."""
    aside = _aside_deg(eye, image_size)
    if not aside >= LEAST_ASIDE_DEG:
        raise VisionError(
            f"{name}: taken along the line from camera to camera ({aside:.0f} degrees off it at the rim, at least "
            f"{LEAST_ASIDE_DEG:.0f} are needed), which gives no depth: set the cameras side by side and run "
            "`facetctl calibrate stereo`; one camera that is moved: move it sideways"
        )


@lru_cache(maxsize=8)
def _aside_deg(eye: RectifiedCamera, image_size: tuple[int, int]) -> float:
    return degrees(eye.least_aside(image_size))
