"""Tables of looks and of cycles for a spreadsheet. Add a new column at the end."""

from typing import Any

from daemon.events.records import Record
from daemon.review.digest import Digest, parts_of, residual_mm

Row = dict[str, Any]

CYCLE_COLUMNS = (
    "cell", "day", "run", "cycle", "started", "seconds", "label", "outcome", "looks", "predicted_mm", "predicted_deg",
    "true_mm", "true_deg", "why", "model", "calibration",
)  # fmt: skip
LOOK_COLUMNS = (
    "cell", "day", "run", "seq", "cycle", "stop", "purpose", "taken", "ms", "parts", "named", "labels",
    "best_confidence", "residual_mm", "epipolar_px", "noise", "predicted_mm", "chi2",
)  # fmt: skip


def tables(run: Digest, cell: str) -> dict[str, tuple[tuple[str, ...], list[Row]]]:
    """Each table's name -> its columns and its rows."""
    return {"cycles": (CYCLE_COLUMNS, cycle_rows(run, cell)), "looks": (LOOK_COLUMNS, look_rows(run, cell))}


def cycle_rows(run: Digest, cell: str) -> list[Row]:
    """One row a cycle, with CYCLE_COLUMNS."""
    plain = (
        *("started", "label", "outcome", "looks", "predicted_mm", "predicted_deg", "true_mm", "true_deg", "why"),
        *("model", "calibration"),
    )
    return [
        {"cell": cell, "run": run.name}
        | {name: getattr(cycle, name) for name in plain}
        | {"day": cycle.started[:10], "cycle": cycle.number, "seconds": round(cycle.seconds, 3)}
        for cycle in run.cycles
    ]


def look_rows(run: Digest, cell: str) -> list[Row]:
    """One row a look, with LOOK_COLUMNS."""
    estimates = {id(s.look): s.estimate or {} for s in run.stops}
    return [_look_row(look, estimates.get(id(look), {}), cell, run.name) for look in run.of("look")]


def _look_row(look: Record, estimate: Record, cell: str, run: str) -> Row:
    health, parts, taken = look.get("health") or {}, parts_of(look), str(look.get("t") or "")
    named = [part for part in parts if part["label"] != "unknown"]
    return {
        **{name: look.get(name) for name in ("seq", "cycle", "stop", "purpose")},
        **{name: health.get(name) for name in ("epipolar_px", "noise")},
        **{name: estimate.get(name) for name in ("predicted_mm", "chi2")},
        "cell": cell,
        "day": taken[:10],
        "run": run,
        "taken": taken,
        "ms": (look.get("scene") or {}).get("ms"),
        "parts": len(parts),
        "named": len(named),
        "labels": " ".join(sorted(part["label"] for part in named)),
        "best_confidence": max((part["confidence"] for part in named), default=None),
        "residual_mm": residual_mm(named),
    }
