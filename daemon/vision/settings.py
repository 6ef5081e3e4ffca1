"""What a person may choose about seeing facets. Values and their meaning only; no behaviour.

Thresholds are in units of the measured noise, of pixels, or of predicted errors, so that none of them knows a scene.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import Annotated, Literal

from msgspec import Meta

from daemon.quantities import Few, Pixels, Seconds, Share

CornerDetector = Literal["line_fit", "mic", "median", "slope"]
Sigmas = Annotated[float, Meta(gt=0, le=1000)]
Depth = Annotated[float, Meta(gt=0, le=100_000)]
DepthReading = tuple[Depth, Annotated[float, Meta(ge=-10_000, le=10_000)]]
StereoFormula = Literal["exact", "thesis", "thesis_compensated"]


TOLERANCE_MM = 0.25
"""How far a real part may deviate from the taught one, a standard deviation per axis; what a model says goes before."""


@dataclass(frozen=True)
class MemorySettings:
    """How the memory learns and recalls. A model keeps the settings that it was trained with."""

    rho: Share = 1.0
    """Baseline vigilance of learning. At 1, views that differ by more than the measuring error get nodes of their
    own."""
    alpha: Annotated[float, Meta(ge=0, le=1000)] = 0.01
    """Choice parameter of Fuzzy ARTMAP. Without effect on what is named (tests/bench/vigilance.py)."""
    beta: Share = 1.0
    """Learning rate; 1 is fast learning. Without effect on what is named (tests/bench/vigilance.py)."""
    vigilance: Share = 0.999
    """Least match at which a node is recalled. From 1 to 0.98 as much is named correctly; the lower it is, the more
    hypotheses are measured, most of them below 0.995 (tests/bench/vigilance.py)."""
    tolerance_mm: Annotated[float, Meta(gt=0, le=10)] = TOLERANCE_MM
    """How far a real part may deviate from the taught one, standard deviation per axis, mm. Added to all predicted
    measuring errors."""


@dataclass(frozen=True)
class VisionSettings:
    """How corners are found and depth is computed, and the limits that tell a facet from something else."""

    corner_detector: CornerDetector = "line_fit"
    """`line_fit` intersects lines fitted to the gradient; `mic`, `median` and `slope` are the thesis's detectors
    (D'Souza, sections 4.5.1, 4.2.2, 4.5.3)."""
    stereo_formula: StereoFormula = "exact"
    """`exact` intersects viewing rays; `thesis` is D'Souza (2.3); `thesis_compensated` adds its piecewise linear error
    compensation (section 4.2.4)."""
    depth_readings_mm: tuple[DepthReading, ...] = ()
    """For `thesis_compensated`: measured depths, each `[depth by the formula, its error]` in mm, as `facetctl calibrate
    quick` prints them. Without any, the formula's error is worked out from the calibration."""
    shrinks: Annotated[tuple[Annotated[int, Meta(ge=1, le=16)], ...], Meta(min_length=1)] = (1, 2, 4)
    """Pixel sizes, in camera pixels, at which closed regions are sought. A look that has taught parts uses the coarse
    effort instead."""
    levels: Annotated[tuple[Sigmas, ...], Meta(min_length=1)] = (4.5, 6.0, 8.0, 12.0, 18.0)
    """Gradient thresholds for that, in sigmas of the gradient's noise. A look that has taught parts uses the coarse
    effort instead."""
    faintest: Sigmas = 5.0
    """What counts as an edge at all, in sigmas of the gradient's noise."""
    min_area_px: Annotated[float, Meta(gt=0, le=1e6)] = 40.0
    """Smallest region, px²."""
    max_area_fraction: Share = 0.3
    """Largest region, as a share of the image."""
    max_corners: Annotated[int, Meta(ge=3, le=100)] = 14
    """Most corners of a polygon."""
    max_regions: Annotated[int, Meta(ge=1, le=1000)] = 40
    """How many regions are followed up at each scale, largest first. A look that has taught parts uses the coarse
    effort instead."""
    alike: Few = 3
    """How many of those may lie in much the same place. A look that has taught parts uses the coarse effort instead."""
    min_side_px: Pixels = 5.0
    """Shortest side of a polygon, px."""
    min_evidence: Sigmas = 4.0
    """Least mean slope across a side, in sigmas of the gradient's noise."""
    min_support: Share = 0.75
    """Least share of the outline that shows an edge."""
    min_seen: Share = 0.6
    """Least share of a side that shows an edge."""
    search_epipolar_px: Pixels = 6.0
    """How far from the epipolar line a match is sought, px."""
    max_epipolar_px: Pixels = 2.5
    """How far matched corners may lie off each other's epipolar line, px."""
    depth_range_mm: tuple[Depth, Depth] = (80.0, 2500.0)
    """Nearest and farthest distance at which parts may be, mm."""
    planarity_sigmas: Sigmas = 6.0
    """How many predicted errors a corner may lie off its facet's plane."""
    budget_s: Seconds = 1.0
    """Processor time that a look may take, s. What it then leaves out is in its notes. The costliest looks take a third
    of it on a desktop's core, so that a computer three times as slow sees the same."""

    def coarse(self) -> VisionSettings:
        """The same for a look that knows parts, at little cost: half-size pixels, few levels, the largest regions only;
        what that leaves unnamed is looked for by straight edges.
        """
        return replace(self, shrinks=(2,), levels=(4.5, 8.0, 18.0), max_regions=12, alike=2)

    def fine(self) -> VisionSettings:
        """The brief effort at full-size pixels: for small parts, where few edges are followed up."""
        return replace(self.coarse(), shrinks=(1,))

    def without_time_limit(self) -> VisionSettings:
        """The same without a time budget, so that results do not depend on the computer's speed."""
        return replace(self, budget_s=inf)
