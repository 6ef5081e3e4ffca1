"""What a person may choose about seeing facets. Values and their meaning only; no behaviour.

Thresholds are in units of the measured noise, of pixels, or of predicted errors, so that none of them knows a scene.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import Annotated, Literal

from msgspec import Meta

from daemon.quantities import Few, Pixels, Seconds, Share

CornerDetector = Literal["line_fit", "mic", "median"]
Sigmas = Annotated[float, Meta(gt=0, le=1000)]
Depth = Annotated[float, Meta(gt=0, le=100_000)]
StereoFormula = Literal["exact", "thesis", "thesis_compensated"]


TOLERANCE_MM = 0.25
"""How far a real part may deviate from the taught one, a standard deviation per axis; what a model says goes before."""


@dataclass(frozen=True)
class MemorySettings:
    """How the memory learns and recalls; a model keeps those that it was trained with.

    rho: baseline vigilance of learning; 1: views that differ by more than they may be measured wrongly are nodes of
    their own. alpha: choice parameter, beta: learning rate, 1 being fast learning. vigilance: the least match at which
    a node is recalled (tests/bench/vigilance.py: from 1 to .98 as much is named rightly, and the lower it is the more
    is measured, most of that below .995; alpha and beta change nothing there). tolerance_mm: how far a real part may
    deviate from the taught one, a standard deviation per axis, on top of all predicted measuring errors.
    """

    rho: Share = 1.0
    alpha: Annotated[float, Meta(ge=0, le=1000)] = 0.01
    beta: Share = 1.0
    vigilance: Share = 0.999
    tolerance_mm: Annotated[float, Meta(gt=0, le=10)] = TOLERANCE_MM


@dataclass(frozen=True)
class VisionSettings:
    """How corners are found and how depth is computed, and the limits that tell a facet from something else.

    corner_detector: `line_fit` intersects lines fitted to the gradient; `mic` and `median` are D'Souza's (section
    4.5.1, 4.2.2). stereo_formula: `exact` meets rays; `thesis` is D'Souza (2.3); `thesis_compensated` adds its
    piecewise linear error compensation (section 4.2.4).
    shrinks: sizes of pixel, in camera pixels, at which closed regions are sought. levels: gradient thresholds for that,
    in sigmas of the gradient's noise; faintest: what counts as an edge at all. min_area_px, max_area_fraction (of the
    image): smallest and largest region. max_corners: of a polygon. max_regions: how many are followed up a scale,
    largest first; alike: how many of those in much the same place. Of these shrinks, levels, max_regions and alike
    matter in teaching alone: a look that knows parts makes the brief effort in their stead. min_side_px: shortest side.
    min_evidence: mean slope across a side, in sigmas; min_seen: least fraction of a side that shows an edge.
    min_support: least fraction of the outline that shows an edge. max_epipolar_px: how far matched corners may lie off
    each other's epipolar line. depth_range_mm: where parts may be. planarity_sigmas: how many predicted errors a corner
    may leave its plane by. budget_s: processor time a look may take; what it then leaves out its notes say. The
    costliest looks take a third of it on a desktop's core, so that a computer three times as slow sees the same.
    """

    corner_detector: CornerDetector = "line_fit"
    stereo_formula: StereoFormula = "exact"
    shrinks: Annotated[tuple[Annotated[int, Meta(ge=1, le=16)], ...], Meta(min_length=1)] = (1, 2, 4)
    levels: Annotated[tuple[Sigmas, ...], Meta(min_length=1)] = (4.5, 6.0, 8.0, 12.0, 18.0)
    faintest: Sigmas = 5.0
    min_area_px: Annotated[float, Meta(gt=0, le=1e6)] = 40.0
    max_area_fraction: Share = 0.3
    max_corners: Annotated[int, Meta(ge=3, le=100)] = 14
    max_regions: Annotated[int, Meta(ge=1, le=1000)] = 40
    alike: Few = 3
    min_side_px: Pixels = 5.0
    min_evidence: Sigmas = 4.0
    min_support: Share = 0.75
    min_seen: Share = 0.6
    search_epipolar_px: Pixels = 6.0
    max_epipolar_px: Pixels = 2.5
    depth_range_mm: tuple[Depth, Depth] = (80.0, 2500.0)
    planarity_sigmas: Sigmas = 6.0
    budget_s: Seconds = 1.0

    def brief(self) -> VisionSettings:
        """The same for a look that knows parts, at little cost: half-size pixels, few levels, the largest regions only;
        what that leaves unnamed is looked for by straight edges.
        """
        return replace(self, shrinks=(2,), levels=(4.5, 8.0, 18.0), max_regions=12, alike=2)

    def closer(self) -> VisionSettings:
        """The brief effort at full-size pixels: for small parts, where few edges are followed up."""
        return replace(self.brief(), shrinks=(1,))

    def unhurried(self) -> VisionSettings:
        """The same for a look that nobody waits for: what it names must not hang on how fast the computer is."""
        return replace(self, budget_s=inf)
