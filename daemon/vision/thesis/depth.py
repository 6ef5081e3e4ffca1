"""Depth as D'Souza computes it: his formula (2.3) for converging cameras, and his compensation of its error.

Kept beside the exact rays of daemon/vision/geometry/rig.py so that the two can be compared on the same corners.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daemon.arrays import Array
from daemon.vision.geometry import StereoRig

_READINGS = np.linspace(0.5, 2.0, 9)


@dataclass(frozen=True, eq=False)
class Converging:
    """The three constants of D'Souza, section 4.2.1: baseline mm, focal length px, fixation distance mm.

    at_mm, error_mm: depths as the formula gives them on the cyclopean axis, and what is wrong with each there.
    """

    baseline_mm: float
    focal_px: float
    fixation_mm: float
    at_mm: Array
    error_mm: Array

    def with_readings(self, at_mm: Array, error_mm: Array) -> Converging:
        """Return the same constants with these readings (K,), in any order."""
        order = np.argsort(at_mm)
        return replace(self, at_mm=at_mm[order], error_mm=error_mm[order])


def converging(rig: StereoRig, readings_mm: Sequence[tuple[float, float]] = ()) -> Converging:
    """The thesis's constants of a calibrated rig, with readings (depth by the formula, its error) mm on the axis.

    Without measured readings, nine about the fixation point are worked out from the rig.
    """
    focal = float(np.mean([c.matrix[k, k] for c in (rig.left, rig.right) for k in (0, 1)]))
    turns = [c.cyclopean_from_camera[:3, 2] for c in (rig.left, rig.right)]
    vergence = turns[0][0] / turns[0][2] - turns[1][0] / turns[1][2]
    fixation = rig.baseline_mm / vergence if vergence > 1e-6 else 1e9
    bare = Converging(rig.baseline_mm, focal, fixation, np.zeros(1), np.zeros(1))
    if readings_mm:
        return bare.with_readings(*np.array(readings_mm).T)
    truth = _READINGS * min(fixation, 1000.0)
    points = np.stack([np.zeros_like(truth), np.zeros_like(truth), truth], 1)
    seen = by_formula(rig.left.project(points), rig.right.project(points), rig, bare)[:, 2]
    return bare.with_readings(seen, seen - truth)


def by_formula(
    left_px: Array, right_px: Array, rig: StereoRig, constants: Converging, compensated: bool = False
) -> Array:
    """Points (N, 3) mm, cyclopean, from matched distorted px (N, 2) by equation (2.3).

    compensated: depth less the error interpolated, piecewise linearly, between the readings (section 4.2.4).
    """
    left, right = rig.left.normalised(left_px) * constants.focal_px, rig.right.normalised(right_px) * constants.focal_px
    p = left[:, 0] - right[:, 0] + constants.focal_px * constants.baseline_mm / constants.fixation_mm
    p = np.where(np.abs(p) < 1e-6, 1e-6, p)
    z = constants.baseline_mm * constants.focal_px / p
    if compensated:
        z = z - np.interp(z, constants.at_mm, constants.error_mm)
    x = z * (left[:, 0] + right[:, 0]) / (2 * constants.focal_px)
    y = z * (left[:, 1] + right[:, 1]) / (2 * constants.focal_px)
    return np.stack([x, y, z], 1)
