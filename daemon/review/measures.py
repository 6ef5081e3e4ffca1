"""Measures of a run over time, each with its limit and whether a value came near it. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from daemon.calibration.drift import STOP_DEG, initial_state, observe
from daemon.events.outcomes import is_success
from daemon.events.records import Json, Record
from daemon.review.digest import Digest, cameras_of
from daemon.vision.health import MEASURES, Clue

NEAR = 0.7
"""A value beyond this share of its limit counts as near it."""
TITLES = {
    "darkness": "brightness, 99th percentile",
    "saturation": "overexposed pixels",
    "covered": "image contrast",
    "focus": "edge width (focus)",
    "motion": "motion blur",
    "half": "repeated rows (half a frame)",
    "torn": "torn frame",
    "frozen": "repeated frames",
    "doubled": "both cameras the same image",
    "swapped": "cameras swapped",
    "knocked": "vertical disparity",
    "epipolar": "epipolar error",
}
AXES = ("pitch", "roll", "vergence")
MAX_POINTS = 2000
"""Largest number of points of a line in the page: of more looks, each point is the worst of several."""


@dataclass(frozen=True)
class Strip:
    """One measure: lines by name, each with its values (None: not measured) at the times s; limit None: no limit."""

    name: str
    unit: str
    limit: float | None
    above: bool
    s: list[float]
    lines: dict[str, list[float | None]]

    def worst(self) -> float | None:
        """The value nearest to, or farthest beyond, the limit; without a limit the largest."""
        values = [v for line in self.lines.values() for v in line if v is not None]
        return (max(values) if self.above else min(values)) if values else None

    def json(self) -> Json:
        """The page's data. near: 0 no, 1 near the limit, 2 beyond it."""
        worst, near = self.worst(), 0
        if worst is not None and self.limit is not None:
            ends = (self.limit * NEAR, self.limit) if self.above else (-self.limit / NEAR, -self.limit)
            value = worst if self.above else -worst
            near = 2 if value > ends[1] else int(value > ends[0] and self.limit > 0)
        each = -(-len(self.s) // MAX_POINTS) or 1
        plain = {k: [None if v is None else float(f"{v:.4g}") for v in line] for k, line in self._fewer(each).items()}
        return {"name": self.name, "unit": self.unit, "limit": self.limit, "above": self.above, "s": self.s[::each],
                "each": each, "lines": plain, "worst": worst, "near": near}  # fmt: skip

    def _fewer(self, each: int) -> dict[str, list[float | None]]:
        """The worst of each so many values of every line."""
        worst = max if self.above else min
        return {
            name: [
                worst((v for v in line[begin : begin + each] if v is not None), default=None)
                for begin in range(0, len(line), each)
            ]
            for name, line in self.lines.items()
        }


def strips(run: Digest) -> list[Json]:
    """Every measure with values in the run, those of the pick first."""
    zero = float(run.records[0]["mono_s"]) if run.records else 0.0
    limits = (run.start or {}).get("limits") or {}
    made = [*_of_pick(run, zero, limits), *_of_pictures(run.of("look"), zero), _drift(run, zero)]
    return [strip.json() for strip in made if strip.worst() is not None]


def _s(records: Sequence[Record], zero: float) -> list[float]:
    return [round(float(r["mono_s"]) - zero, 2) for r in records]


def _of_pick(run: Digest, zero: float, limits: Json) -> list[Strip]:
    ended = [c for c in run.cycles if c.grasped and c.predicted_mm is not None]
    picked = [c for c in run.cycles if is_success(c.outcome)]
    moved = run.of("moved")
    predicted: dict[str, list[float | None]] = {"predicted": [c.predicted_mm for c in ended]}
    if any(c.true_mm is not None for c in ended):
        predicted["true (simulated)"] = [c.true_mm for c in ended]
    ended_s, picked_s = (_s([c.records[-1] for c in of], zero) for of in (ended, picked))
    off: list[float | None] = [r.get("error_mm") for r in moved]
    return [
        Strip("error at the grasp", "mm", limits.get("grasp_mm"), True, ended_s, predicted),
        Strip("cycle time", "s", None, True, picked_s, {"": [c.seconds for c in picked]}),
        Strip("arrival error of the arm", "mm", limits.get("arrival_mm"), True, _s(moved, zero), {"": off}),
    ]


def _of_pictures(looks: Sequence[Record], zero: float) -> list[Strip]:
    found = []
    for name, measure in MEASURES.items():
        by_camera = {
            camera: [number((r.get("health") or {}).get(f"{name}_{camera}")) for r in looks]
            for camera in ("left", "right", "pair")
        }
        lines = {
            camera.replace("pair", ""): line for camera, line in by_camera.items() if any(v is not None for v in line)
        }
        flag = measure.limit == 0.0 or name == "swapped"
        if flag and not any(v for line in lines.values() for v in line):
            continue  # frozen, doubled, swapped: of interest only where one occurred
        found.append(Strip(TITLES[name], measure.unit, measure.limit, measure.above, _s(looks, zero), lines))
    return found


def _drift(run: Digest, zero: float) -> Strip:
    """Angle of the right camera against its calibration, as the drift watch estimated it from the looks. Like the
    daemon's, the watch restarts after a calibration (run_start) and with other cameras."""
    watch, cameras, line = initial_state(), "both", list[float | None]()
    for record in run.of("run_start", "look"):
        if record["kind"] == "run_start" or cameras_of(record) != cameras:
            watch, cameras = initial_state(), cameras_of(record)
        if record["kind"] == "run_start":
            continue
        health = record.get("health") or {}
        turn = [np.radians(number(health.get(f"{axis}_deg")) or 0.0) for axis in AXES]
        sigma = [number(health.get(f"{axis}_sigma_deg")) for axis in AXES]
        sigma_rad = np.array([np.inf if s is None or s <= 0 else np.radians(s) for s in sigma])
        watch, drift = observe(watch, Clue(np.array(turn), sigma_rad, ""))
        line.append(0.0 if drift is None else abs(drift.degrees))
    return Strip("stereo rotation drift", "°", STOP_DEG, True, _s(run.of("look"), zero), {"": line})


def number(value: Any) -> float | None:
    """A value of a record as a finite number, else None."""
    return float(value) if isinstance(value, (int, float)) and np.isfinite(value) else None
