"""What the two cameras of one look see, prepared once: each thing is made when it is first asked for, and kept. Nothing
is compared here."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import product
from math import degrees
from statistics import median
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Image32
from daemon.vision.geometry import Baseline, RectifiedCamera, StereoRig, baseline
from daemon.vision.image.edge_lines import MeasuredImage
from daemon.vision.image.ellipses import Ellipse, find_ellipses
from daemon.vision.image.grey import FINE, Fine, Grey, Noise, VisionError, as_grey, check_size, measure_noise
from daemon.vision.image.outlines import (
    Fitted,
    Outline,
    OutlineRequest,
    best_first,
    find_outlines,
    fit_polygons,
    rough_polygons,
)
from daemon.vision.image.regions import (
    Region,
    RoughPolygon,
    Scale,
    Stretched,
    Window,
    closed_regions,
    edge_window,
    full_size,
    is_uncluttered,
    shrunk,
    smoothed,
    unit_noise,
)
from daemon.vision.image.segments import ABOUT_PX, Segments, find_segments
from daemon.vision.settings import VisionSettings

GRAIN_PX = 5
MIN_ASIDE_DEG = 15.0
"""Least angle, degrees, of every sight against the line from camera to camera: along that line no depth can be
measured, and near to it what both cameras see of one thing is of as many sizes as there are depths. Cameras that look
straight ahead have this in pictures 150 degrees wide."""


@dataclass(frozen=True, eq=False)
class CameraImage:
    """One camera's camera and its checked image (H, W); scales by their shrink, windows by how strong edges count,
    rough polygons by what was asked for, what outlines lie near these, and what was fitted to outlines.
    """

    rectified: RectifiedCamera
    grey: Grey
    scales: dict[int, Scale] = field(default_factory=dict)
    windows: dict[float, Window | None] = field(default_factory=dict)
    sketched: dict[VisionSettings, list[RoughPolygon]] = field(default_factory=dict)
    outlined: dict[RoughPolygon, list[Outline]] = field(default_factory=dict)
    fitted: dict[Outline, Fitted | None] = field(default_factory=dict)

    @cached_property
    def noise(self) -> Noise:
        """The noise by grey level: how strongly pixels of each flicker."""
        return measure_noise(self.grey)

    @cached_property
    def unit(self) -> Stretched:
        """The image (H, W) stretched to a noise of sigma 1 everywhere."""
        return unit_noise(self.grey, self.noise)

    @cached_property
    def smooth(self) -> Fine:
        """The image of unit noise after a Gaussian of SMOOTHING_PX."""
        return smoothed(self.unit)

    @cached_property
    def grainless(self) -> Image32:
        """The smooth image in means of GRAIN_PX each way: finer than that there is more noise than print."""
        return np.multiply(cv2.blur(self.smooth, (GRAIN_PX, GRAIN_PX)), 1 / FINE, dtype=np.float32)

    @property
    def grain(self) -> float:
        """The noise of smoothed pixels over that of white noise smoothed alike."""
        return self.scale(2).sigma

    def scale(self, shrink: int) -> Scale:
        """The gradient of all of the image where pixels are `shrink` full-size ones wide, two or more."""
        if shrink not in self.scales:
            self.scales[shrink] = shrunk(self.unit, shrink)
        return self.scales[shrink]

    def uncluttered(self, settings: VisionSettings) -> bool:
        """Whether little but parts shows edges: then full-size pixels cost little."""
        return is_uncluttered(self.scale(2), settings.faintest)

    def rough(self, settings: VisionSettings) -> list[RoughPolygon]:
        """Polygons of closed regions, the largest first."""
        if settings not in self.sketched:
            self.sketched[settings] = rough_polygons(self.closed_regions(settings), settings)
        return self.sketched[settings]

    def closed_regions(self, settings: VisionSettings) -> list[Region]:
        """Closed regions at every scale and level, the largest of each; at full size only where scale 2 shows edges,
        and none where it shows none.
        """
        window = self.window(settings.faintest)
        if window is None:
            return []
        if 1 in settings.shrinks and 1 not in self.scales:
            self.scales[1] = full_size(self.smooth, window, self.grain)
        largest = settings.max_area_fraction * self.grey.size
        found = list[Region]()
        for shrink, level in product(settings.shrinks, settings.levels):
            least, most = settings.min_area_px, settings.max_regions
            found += closed_regions(self.scale(shrink), window, level, least, largest, most)
        return found

    def window(self, level: float) -> Window | None:
        """The part of the image in which scale 2 shows edges so many sigmas strong, or None."""
        if level not in self.windows:
            self.windows[level] = edge_window(self.scale(2), level, self.grey.shape)
        return self.windows[level]

    @cached_property
    def segments(self) -> Segments:
        """The straight segments of the image, where scale 2 shows edges and near to there, the longest first."""
        window = self.window(VisionSettings.faintest)
        if window is None:
            return Segments(np.zeros((0, 2)), np.zeros((0, 2)))
        first, last = np.maximum(window[0] - ABOUT_PX, 0), window[1] + ABOUT_PX
        found = find_segments(self.grey[first[1] : last[1], first[0] : last[0]])
        return Segments(found.start + first, found.end + first)

    @cached_property
    def ellipses(self) -> list[Ellipse]:
        """The ellipses of the image, where scale 2 shows edges."""
        return find_ellipses(self.smooth, self.window(VisionSettings.faintest), self.grain)

    @cached_property
    def exposure(self) -> MeasuredImage:
        """The image as sides are fitted to it."""
        return MeasuredImage(np.multiply(self.grey, FINE, dtype=np.uint16), self.noise, self.rectified)

    @property
    def blur_px(self) -> float | None:
        """The width, px, of the edges that outlines were fitted to; None where none was."""
        blurs = [float(f.sides.blur[0]) for f in self.fitted.values() if f is not None]
        return median(blurs) if blurs else None


def outlines_near(
    requests: Sequence[tuple[CameraImage, Sequence[RoughPolygon]]], settings: VisionSettings
) -> list[tuple[Outline, ...]]:
    """Each camera's outlines near rough polygons, best supported first; all cameras' side by side."""
    new = [(view, [p for p in rough if p not in view.outlined]) for view, rough in requests]
    found = iter(find_outlines([OutlineRequest(view.smooth, view.grain, own) for view, own in new if own], settings))
    for view, own in new:
        view.outlined.update((p, next(found)) for p in own)
    return [best_first([o for p in rough for o in view.outlined[p]]) for view, rough in requests]


def fitted_outlines(requests: Sequence[tuple[CameraImage, Sequence[Outline]]]) -> list[list[Fitted | None]]:
    """Each camera's outlines fitted to its grey levels, or None where the fit strays from it; all cameras' side by
    side."""
    new = [[o for o in dict.fromkeys(outlines) if o not in view.fitted] for view, outlines in requests]
    found = iter(fit_polygons([(view.exposure, own) for (view, _), own in zip(requests, new, strict=True)]))
    for (view, _), own in zip(requests, new, strict=True):
        view.fitted.update((o, next(found)) for o in own)
    return [[view.fitted[o] for o in outlines] for view, outlines in requests]


@dataclass(frozen=True, eq=False)
class StereoImages:
    """A stereo pair: what each camera sees, the rig, and the rig as its baseline has it."""

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
    for image, camera, name in ((left, geometry.left, "left image"), (right, geometry.right, "right image")):
        grey = as_grey(image, name)
        check_size(grey, rig.image_size, name)
        check_aside(camera, rig.image_size, name)
        views.append(CameraImage(camera, grey))
    return StereoImages(views[0], views[1], rig, geometry)


def check_aside(camera: RectifiedCamera, image_size: tuple[int, int], name: str) -> None:
    """Raise VisionError unless a camera looks across the line from camera to camera in all of its image (width,
    height)."""
    aside = _aside_deg(camera, image_size)
    if not aside >= MIN_ASIDE_DEG:
        raise VisionError(
            f"{name}: the camera looks along the line between the two cameras ({aside:.0f} degrees off it at the rim, "
            f"at least {MIN_ASIDE_DEG:.0f} are needed), which gives no depth: set the cameras side by side and run "
            "`facetctl calibrate stereo`; one camera that is moved: move it sideways"
        )


@lru_cache(maxsize=8)
def _aside_deg(camera: RectifiedCamera, image_size: tuple[int, int]) -> float:
    return degrees(camera.least_aside(image_size))
