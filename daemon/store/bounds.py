"""Bounds of the configuration's numbers that decide where the arm goes, as one table; what lies outside names its line.

Not a number and infinity are refused everywhere: a limit that is nan compares with nothing, and so would never refuse.
What the values mean is said where they are typed (daemon/pick/plan.py, guard.py, grasp.py, drivers/val2/dialect.py).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from daemon.store.yamlfile import Document, Key

Bound = tuple[float, float]
ABOVE_0 = math.ulp(0.0)
LENGTH_MM: Bound = (ABOVE_0, 5000.0)
PERCENT: Bound = (0.1, 100.0)
SECONDS: Bound = (ABOVE_0, 3600.0)

BOUNDS: dict[str, Bound] = {
    "pick.tries": (1, 100),
    "pick.views_of_doubtful": (0, 100),
    "pick.travel_pct": PERCENT,
    "pick.near_pct": PERCENT,
    "pick.pregrasp_mm": LENGTH_MM,
    "pick.lift_mm": LENGTH_MM,
    "pick.verify_mm": LENGTH_MM,
    "pick.gone_mm": LENGTH_MM,
    "pick.epipolar_limit_px": (ABOVE_0, 100.0),
    "pick.hand_s": (0.0, 60.0),
    "pick.limits.max_step_mm": LENGTH_MM,
    "pick.limits.max_turn_deg": (ABOVE_0, 360.0),
    "pick.limits.max_speed_pct": PERCENT,
    "pick.limits.max_look_age_s": SECONDS,
    "pick.limits.clearance_mm": LENGTH_MM,
    "pick.arrival.within_mm": LENGTH_MM,
    "pick.arrival.within_deg": (ABOVE_0, 180.0),
    "pick.arrival.slack_s": SECONDS,
    "pick.arrival.slowest_mm_s": LENGTH_MM,
    "pick.arrival.slowest_deg_s": (ABOVE_0, 360.0),
    "pick.arrival.timeout_s": SECONDS,
    "pick.stops.enough_mm": LENGTH_MM,
    "pick.stops.enough_deg": (ABOVE_0, 180.0),
    "pick.stops.least_looks": (1, 100),
    "pick.stops.most_looks": (1, 100),
    "pick.gripper.opening_mm": LENGTH_MM,
    "pick.gripper.finger_width_mm": LENGTH_MM,
    "pick.gripper.finger_thick_mm": LENGTH_MM,
    "pick.gripper.friction": (ABOVE_0, 5.0),
    "pick.settling.timeout_s": SECONDS,
}
"""Key -> least and greatest value, both allowed."""
DIALECT_BOUNDS: dict[str, Bound] = {
    "baud": (50, 4_000_000),
    "line_limit": (20, 1000),
    "typing_attempts": (1, 100),
    **dict.fromkeys(
        ("typing_s", "answer_s", "motion_s", "calibrate_s", "resync_s", "poll_s", "stall_s", "prompt_silence_s"),
        SECONDS,
    ),
    **dict.fromkeys(("character_pause_s", "echo_settle_s"), (0.0, 10.0)),
    **dict.fromkeys(("same_place_mm", "arrived_mm", "same_place_deg", "arrived_deg"), (ABOVE_0, 10.0)),
}


def check_finite(document: Document) -> None:
    """Raise ConfigError for the first number that is none, or infinite."""
    for keys, value in _numbers(document.data, ()):
        if not math.isfinite(value):
            raise document.error(keys, f"expected a finite number, found {value}")


def check_bounds(document: Document, said: Any) -> None:
    """Raise ConfigError for the first value outside its bounds. said: the typed file."""
    for name, bound in BOUNDS.items():
        keys = tuple(name.split("."))
        value = said
        for key in keys:
            value = getattr(value, key)
        _hold(document, keys, value, bound)
    stops = said.pick.stops
    far_to_near = sorted(stops.stand_offs_mm, reverse=True)
    if not far_to_near or far_to_near != list(stops.stand_offs_mm):
        problem = f"expected distances, far to near, found {list(stops.stand_offs_mm)}"
        raise document.error(("pick", "stops", "stand_offs_mm"), problem)
    for place, value in enumerate(stops.stand_offs_mm):
        _hold(document, ("pick", "stops", "stand_offs_mm", place), value, LENGTH_MM)
    if stops.most_looks < stops.least_looks:
        found = f"{stops.most_looks}, less than least_looks' {stops.least_looks}"
        raise document.error(("pick", "stops", "most_looks"), f"expected at least as many looks, found {found}")
    if not said.pick.surveys:
        raise document.error(("pick", "surveys"), "expected at least one place to look at the table from")


def check_dialect(document: Document, dialect: Any) -> None:
    """The same for the section arm.dialect as typed."""
    for name, bound in DIALECT_BOUNDS.items():
        _hold(document, ("arm", "dialect", name), getattr(dialect, name), bound)


def _hold(document: Document, keys: tuple[Key, ...], value: float, bound: Bound) -> None:
    low, high = bound
    if not low <= value <= high:
        least = "above 0" if low == ABOVE_0 else f"from {low:g}"
        raise document.error(keys, f"expected {least} to {high:.10g}, found {value:g}")


def _numbers(data: Any, keys: tuple[Key, ...]) -> Iterator[tuple[tuple[Key, ...], float]]:
    if isinstance(data, float):
        yield keys, data
    elif isinstance(data, dict):
        for key, value in data.items():
            yield from _numbers(value, (*keys, key))
    elif isinstance(data, list):
        for place, value in enumerate(data):
            yield from _numbers(value, (*keys, place))
