"""What a person may choose about seeing facets. Values and their meaning only; no behaviour.

Thresholds are in units of the measured noise, of pixels, or of predicted errors, so that none of them knows a scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

CornerDetector = Literal["line_fit", "mic", "median"]
StereoFormula = Literal["exact", "thesis", "thesis_compensated"]


@dataclass(frozen=True)
class VisionSettings:
    """How corners are found and how depth is computed, and the limits that tell a facet from something else.

    corner_detector: `line_fit` intersects lines fitted to the gradient; `mic` and `median` are D'Souza's (section
    4.5.1, 4.2.2). stereo_formula: `exact` meets rays; `thesis` is D'Souza (2.3); `thesis_compensated` adds its
    piecewise linear error compensation (section 4.2.4).
    smoothing_px: sigma of the Gaussian before the gradient. edge_levels: gradient thresholds, in sigmas of its
    noise, at which closed regions are sought. min_area_px: smallest region. max_area_fraction: largest, of the image.
    min_side_px: shortest side. min_evidence: weakest side, in sigmas of its own predicted noise. max_epipolar_px:
    how far matched corners may lie off each other's epipolar line. depth_range_mm: where parts may be.
    planarity_sigmas, table_sigmas: how many predicted errors a corner may leave its plane by.
    """

    corner_detector: CornerDetector = "line_fit"
    stereo_formula: StereoFormula = "exact"
    scales: tuple[tuple[float, tuple[float, ...]], ...] = ((1.0, (5.5, 7.0, 10.0, 14.0, 20.0)), (2.0, (5.0, 9.0)))
    min_area_px: float = 40.0
    max_area_fraction: float = 0.3
    min_side_px: float = 5.0
    max_corners: int = 14
    max_regions: int = 60
    min_evidence: float = 5.0
    min_support: float = 0.75
    max_epipolar_px: float = 2.5
    depth_range_mm: tuple[float, float] = (80.0, 2500.0)
    planarity_sigmas: float = 6.0
    table_sigmas: float = 4.0
