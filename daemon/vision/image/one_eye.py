"""What one eye sees, prepared once a look: each thing is made when it is first asked for, and kept."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from daemon.vision.geometry.rectified import Eye
from daemon.vision.image.grey import Grey, Noise, measure_noise
from daemon.vision.image.outlines import Outline, find_outlines
from daemon.vision.image.polygon_fit import Fitted, fit_polygons
from daemon.vision.image.regions import Image32, Scale, edge_window, full_size, shrunk, smoothed, unit_noise
from daemon.vision.settings import VisionSettings


@dataclass(frozen=True, eq=False)
class OneEye:
    """One eye's camera and its checked image (H, W); scales by their shrink, outlines by the effort that found
    them, and what was fitted to them."""

    eye: Eye
    grey: Grey
    scales: dict[int, Scale] = field(default_factory=dict)
    found: dict[VisionSettings, list[Outline]] = field(default_factory=dict)
    fitted: dict[Outline, Fitted | None] = field(default_factory=dict)

    @cached_property
    def image(self) -> Image32:
        """Grey levels (H, W) as float32."""
        return self.grey.astype(np.float32)

    @cached_property
    def noise(self) -> Noise:
        """How strongly pixels of each grey level flicker."""
        return measure_noise(self.grey)

    @cached_property
    def unit(self) -> Image32:
        """The image (H, W) stretched to a noise of sigma 1 everywhere."""
        return unit_noise(self.grey, self.noise)

    @cached_property
    def smooth(self) -> Image32:
        """The same after a Gaussian of SMOOTHING_PX."""
        return smoothed(self.unit)

    @property
    def grain(self) -> float:
        """How much stronger the noise of smoothed pixels is than that of white noise would be."""
        return self.scale(2).sigma

    def scale(self, shrink: int) -> Scale:
        """The gradient of all of the image where pixels are `shrink` full-size ones wide, two or more."""
        if shrink not in self.scales:
            self.scales[shrink] = shrunk(self.unit, shrink)
        return self.scales[shrink]

    def outlines(self, settings: VisionSettings) -> list[Outline]:
        """Outlines of what the image shows, best supported first."""
        if settings not in self.found:
            self.found[settings] = find_outlines(self.smooth, self.grain, self._scales(settings), settings)
        return self.found[settings]

    def _scales(self, settings: VisionSettings) -> list[Scale]:
        """The scales to look at, the finest only where scale 2 shows edges; none where it shows none."""
        window = edge_window(self.scale(2), settings.faintest, self.grey.shape)
        if window is None:
            return []
        if 1 in settings.shrinks and 1 not in self.scales:
            self.scales[1] = full_size(self.smooth, window, self.grain)
        return [self.scale(s) for s in settings.shrinks]

    def fits(self, outlines: list[Outline]) -> list[Fitted | None]:
        """Each outline fitted to the grey levels, or None where the fit strays from it."""
        new = [o for o in dict.fromkeys(outlines) if o not in self.fitted]
        self.fitted.update(zip(new, fit_polygons(self.image, self.noise, self.eye, new), strict=True))
        return [self.fitted[o] for o in outlines]
