"""Rows of looks and of cycles, the same for CSV and for Parquet: what a fleet of cells is compared by.

The columns and their units are the documented schema (deploy/RUNS.md, "Many cells"); a new one goes at the end.
"""

from __future__ import annotations

from typing import Any

from daemon.review.digest import Cycle, Digest, short_hash

Row = dict[str, Any]

CYCLE_COLUMNS: dict[str, str] = {
    "cell": "string", "day": "string", "run": "string", "cycle": "int64", "started": "string", "seconds": "float64",
    "label": "string", "outcome": "string", "looks": "int64", "predicted_mm": "float64", "predicted_deg": "float64",
    "true_mm": "float64", "true_deg": "float64", "why": "string", "model": "string", "calibration": "string",
}  # fmt: skip
LOOK_COLUMNS: dict[str, str] = {
    "cell": "string", "day": "string", "run": "string", "seq": "int64", "cycle": "int64", "stop": "int64",
    "purpose": "string", "taken": "string", "ms": "float64", "parts": "int64", "named": "int64", "labels": "string",
    "best_confidence": "float64", "residual_mm": "float64", "epipolar_px": "float64", "noise": "float64",
    "predicted_mm": "float64", "chi2": "float64",
}  # fmt: skip


def cycle_rows(run: Digest, cell: str) -> list[Row]:
    """One row a cycle, with CYCLE_COLUMNS."""
    return [_cycle_row(run, c, cell) for c in run.cycles]


def _cycle_row(run: Digest, cycle: Cycle, cell: str) -> Row:
    end, truth = cycle.end or {}, cycle.truth or {}
    predicted = end.get("predicted") or {}
    started = str(cycle.records[0].get("t") or "")
    return {
        "cell": cell,
        "day": started[:10],
        "run": run.name,
        "cycle": cycle.number,
        "started": started,
        "seconds": round(cycle.seconds, 3),
        "label": cycle.label,
        "outcome": cycle.outcome,
        "looks": cycle.looks,
        "predicted_mm": predicted.get("mm"),
        "predicted_deg": predicted.get("deg"),
        "true_mm": truth.get("error_mm"),
        "true_deg": truth.get("error_deg"),
        "why": end.get("why"),
        "model": short_hash(run.models()[-1]) if run.models() else None,
        "calibration": short_hash((run.start or {}).get("calibration")),
    }


def look_rows(run: Digest, cell: str) -> list[Row]:
    """One row a look, with LOOK_COLUMNS."""
    estimates = {id(s.look): s.estimate or {} for s in run.stops}
    rows = []
    for record in run.of("look"):
        scene, health = record.get("scene") or {}, record.get("health") or {}
        parts = scene.get("parts") or []
        named = [p for p in parts if p["label"] != "unknown"]
        taken = str(record.get("t") or "")
        estimate = estimates.get(id(record), {})
        rows.append(
            {
                "cell": cell,
                "day": taken[:10],
                "run": run.name,
                "seq": record.get("seq"),
                "cycle": record.get("cycle"),
                "stop": record.get("stop"),
                "purpose": record.get("purpose"),
                "taken": taken,
                "ms": scene.get("ms"),
                "parts": len(parts),
                "named": len(named),
                "labels": " ".join(sorted(p["label"] for p in named)),
                "best_confidence": max((p["confidence"] for p in named), default=None),
                "residual_mm": max((p["residual_mm"] for p in named if p.get("residual_mm") is not None), default=None),
                "epipolar_px": health.get("epipolar_px"),
                "noise": health.get("noise"),
                "predicted_mm": estimate.get("predicted_mm"),
                "chi2": estimate.get("chi2"),
            }
        )
    return rows
