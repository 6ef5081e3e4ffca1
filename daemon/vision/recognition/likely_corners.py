"""Where a recognised part's corners most likely are: what was measured and what was taught, weighed by their errors.

In: seen corners, a taught solid and a fitted pose. Out: corners in the cyclopean frame. Fitting is rigid_fit.py's.
"""

from __future__ import annotations

import numpy as np

from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron
from daemon.vision.recognition.fits import Hypothesis


def most_likely_corners(seen: Polyhedron, taught: Polyhedron, fit: Hypothesis, tolerance_mm: float) -> Array:
    """(K, 3) mm: each measured corner drawn towards where the fitted model has it.

    A corner without a counterpart stays where it was measured.
    """
    matched = np.nonzero(fit.corners >= 0)[0]
    turn, shift = fit.pose[:3, :3], fit.pose[:3, 3]
    there = fit.corners[matched]
    expected = taught.corners_mm[there] @ turn.T + shift
    doubt = turn @ taught.covariance_mm2[there] @ turn.T + tolerance_mm**2 * np.eye(3)
    gain = doubt @ np.linalg.inv(doubt + seen.covariance_mm2[matched])
    corners = seen.corners_mm.copy()
    corners[matched] = expected + (gain @ (seen.corners_mm[matched] - expected)[..., None])[..., 0]
    return corners
