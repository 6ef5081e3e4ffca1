"""How fast the arm may go, near a part and far from it. Pure."""

from __future__ import annotations

import numpy as np

NEAR_MM, FAR_MM = 100.0, 400.0


def speed_pct(distance_mm: float, travel_pct: float, near_pct: float) -> float:
    """Speed by distance to the part: near_pct within NEAR_MM, travel_pct beyond FAR_MM, a ramp between."""
    share = float(np.clip((distance_mm - NEAR_MM) / (FAR_MM - NEAR_MM), 0.0, 1.0))
    return near_pct + share * (travel_pct - near_pct)
