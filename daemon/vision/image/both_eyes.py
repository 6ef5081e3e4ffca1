"""The two eyes of one look, side by side, for all that runs over them. Nothing is compared here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from daemon.vision.geometry import Baseline, StereoRig, baseline
from daemon.vision.image.grey import as_grey, check_size
from daemon.vision.image.one_eye import OneEye
from daemon.vision.settings import VisionSettings


@dataclass(frozen=True, eq=False)
class Eyes:
    """A stereo pair: what each eye sees, the rig, and the rig as its baseline has it."""

    left: OneEye
    right: OneEye
    rig: StereoRig
    geometry: Baseline

    @property
    def views(self) -> tuple[OneEye, OneEye]:
        """Left and right, to loop over."""
        return self.left, self.right

    def quiet(self, settings: VisionSettings) -> bool:
        """Whether little but parts shows edges in either."""
        return all(view.quiet(settings) for view in self.views)


def open_eyes(left: NDArray[Any], right: NDArray[Any], rig: StereoRig) -> Eyes:
    """Check a stereo pair, (H, W) uint8 or what as_grey takes; nothing is measured yet.

    Raises VisionError where an image cannot be used or is not of the size the rig was calibrated for.
    """
    geometry = baseline(rig)
    views = []
    for image, eye, name in ((left, geometry.left, "left image"), (right, geometry.right, "right image")):
        grey = as_grey(image, name)
        check_size(grey, rig.image_size, name)
        views.append(OneEye(eye, grey))
    return Eyes(views[0], views[1], rig, geometry)
