"""Arcs in a facet's outline: corners that run round a circle in short, equal turns, and the sector angle they span.

In: corners. Out: arcs, and the name a facet gets from one. Straight-sided typing lives in facet_types.py.
Source: D'Souza, section 5.7 (the sector angle of an arc as a property of the element).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daemon.arrays import Array
from daemon.vision.geometry import fit_circle, newell_normal

MIN_CORNERS = 7  # fewer than this on a circle is a regular polygon as well as an arc
ROUND_MM, ROUND_SIGMAS = 0.2, 2.0  # how far a corner may lie off the circle, and in predicted errors on top
LONGEST_RAD, UNEVEN = np.pi / 2, 4.0  # a longer turn is a straight side, and so is one of so many usual ones
NAME_STEP_DEG, UNSURE = 15, 0.25  # sector angles are named to this step, and are so unsure, in steps


@dataclass(frozen=True)
class Arc:
    """Corners first, first + 1, ... (count of them, round the facet) on one circle; sector_rad is 2 pi for a disc."""

    first: int
    count: int
    sector_rad: float
    radius_mm: float


def find_arc(corners_mm: Array, covariance_mm2: Array) -> Arc | None:
    """The longest run of at least seven corners on one circle, or None. (N, 3) mm, (N, 3, 3) mm^2."""
    n = len(corners_mm)
    if n < MIN_CORNERS:
        return None
    flat = _in_plane(corners_mm)
    most_mm = ROUND_MM + ROUND_SIGMAS * float(np.sqrt(np.trace(covariance_mm2, axis1=1, axis2=2).mean() / 3))
    runs = [(n, 0, True), *((count, first, False) for count in range(n, MIN_CORNERS - 1, -1) for first in range(n))]
    for count, first, closed in runs:  # all corners of a D lie on its circle, and its straight side does not
        points = flat[(first + np.arange(count)) % n]
        centre, radius, worst = fit_circle(points)
        round_once = np.vstack([points, points[:1]]) if closed else points
        if worst < most_mm and _turns_evenly(round_once, centre):
            return Arc(first, count, 2 * np.pi if closed else _sector(points, centre), radius)
    return None


def arc_name(corners_mm: Array, covariance_mm2: Array) -> str | None:
    """`arc360` for a disc, `arc180` for a facet with a half circle in its outline, and so on; None without an arc."""
    arc = find_arc(corners_mm, covariance_mm2)
    if arc is None:
        return None
    return f"arc{NAME_STEP_DEG * round(np.rad2deg(arc.sector_rad) / NAME_STEP_DEG)}"


def arc_names(arcs: Sequence[Array]) -> tuple[str, ...]:
    """Return the names, as `arc_name` does, of a facet whose arcs are known, points (K, 3) mm along each from end to
    end: of the longest, the likeliest first; two where its sector is near to the limit of a step."""
    degrees = max(np.rad2deg(_sector_of(_in_plane(points))) for points in arcs) / NAME_STEP_DEG
    steps = dict.fromkeys(int(np.clip(round(degrees + off), 1, 360 / NAME_STEP_DEG)) for off in (0, -UNSURE, UNSURE))
    return tuple(f"arc{NAME_STEP_DEG * step}" for step in steps)


def _sector_of(points: Array) -> float:
    return abs(_sector(points, fit_circle(points)[0]))


def _in_plane(corners: Array) -> Array:
    normal = newell_normal(corners)
    centred = corners - corners.mean(0)
    one = centred[0] - normal * (centred[0] @ normal)
    one = one / max(float(np.linalg.norm(one)), 1e-9)
    flat: Array = np.column_stack([centred @ one, centred @ np.cross(normal, one)])
    return flat


def _turns_evenly(points: Array, centre: Array) -> bool:
    """Whether the steps round the circle all go one way and none is longer than a straight side would be."""
    steps = _steps(points, centre)
    return bool((steps > 0).all() and steps.max() < LONGEST_RAD and steps.max() < UNEVEN * np.median(steps))


def _sector(points: Array, centre: Array) -> float:
    return float(_steps(points, centre).sum())


def _steps(points: Array, centre: Array) -> Array:
    angle = np.arctan2(points[:, 1] - centre[1], points[:, 0] - centre[0])
    steps: Array = (np.diff(angle) + np.pi) % (2 * np.pi) - np.pi
    return steps
