"""What the report page shows, as plain JSON values: a digest in, one dict out. No HTML, no drawing, no file.

Names are short because a run of a thousand cycles has tens of thousands of them.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from daemon.review.digest import Cycle, Digest, Stop, parts_of, residual_mm, stops_of
from daemon.review.why import causes

Json = dict[str, Any]


def page_data(digest: Digest) -> Json:
    """Everything but the pictures."""
    return {
        "stats": digest.statistics(),
        "skipped": list(digest.skipped),
        "kept": {name: digest.kept(name) for name in ("config", "calibration", "model")},
        "timeline": timeline(digest),
        "cycles": [cycle_json(c) for c in digest.cycles],
        "outside": [stop_json(s) for s in stops_of([r for r in digest.outside if r["kind"] == "look"])],
        "events": events(digest),
        "looks": looks(digest),
        "end": (digest.end or {}).get("why"),
    }


def cycle_json(cycle: Cycle) -> Json:
    """One row of the table, and what opens below it."""
    return {
        "n": cycle.number,
        "t": cycle.records[0].get("t"),
        "label": cycle.label,
        "outcome": cycle.outcome,
        "looks": cycle.looks,
        "s": round(cycle.seconds, 2),
        "mm": _short(cycle.predicted_mm),
        "deg": _short(cycle.predicted_deg),
        "true_mm": _short(cycle.true_mm),
        "true_deg": _short(cycle.true_deg),
        "why": cycle.why,
        "causes": [{"stage": c.stage, "w": round(c.weight, 2), "e": c.evidence, "r": c.remedy} for c in causes(cycle)],
        "decisions": [{"text": r.get("text"), "why": r.get("why")} for r in cycle.of("decision")],
        "states": state_seconds(cycle),
        "stops": [stop_json(s) for s in cycle.stops],
    }


def stop_json(stop: Stop) -> Json:
    """One look: parts and refusals in pixels of both eyes, the estimate, the moves after it."""
    look, estimate = stop.look, stop.estimate
    scene = look.get("scene") or {}
    return {
        "n": stop.number,
        "seq": look.get("seq"),
        "t": look.get("t"),
        "purpose": stop.purpose,
        "ms": scene.get("ms"),
        "seconds": {k: _short(v, 4) for k, v in (look.get("seconds") or {}).items()},
        "health": look.get("health") or {},
        "parts": [_part(p) for p in stop.parts],
        "rejected": [
            {"eye": r.get("eye"), "why": r.get("reason"), "px": _points(r.get("corners_px"))}
            for r in (scene.get("rejected") or [])[:40]
        ],
        "guesses": [_guess(g) for g in scene.get("guesses") or []],
        "notes": scene.get("notes") or [],
        "estimate": None
        if estimate is None
        else {
            "label": estimate.get("label"),
            "mm": _short(estimate.get("predicted_mm")),
            "deg": _short(estimate.get("predicted_deg")),
            "chi2": _short(estimate.get("chi2"), 1),
            "at": [_short(row[3], 1) for row in (estimate.get("world_from_part") or [])[:3]],
        },
        "moves": [_move(r) for r in stop.moves],
    }


def _part(part: Json) -> Json:
    return {
        "label": part.get("label"),
        "conf": _short(part.get("confidence")),
        "ratio": _short(part.get("match_ratio")),
        "act": _short(part.get("activation")),
        "runner": part.get("runner_up"),
        "why": part.get("reason"),
        "res": _short(part.get("residual_mm")),
        "facets": [
            {"type": f.get("type"), "l": _points(f.get("left_px")), "r": _points(f.get("right_px"))}
            for f in part.get("facets") or []
        ],
    }


def _guess(guess: Json) -> Json:
    """l, r: for each eye the ends of every edge that should show, and whether it does."""
    sides = {
        key: [
            {"px": _points([edge[:2], edge[2:]]), "shows": shows}
            for edge, shows in zip(guess.get(f"{eye}_px") or [], guess.get(f"{eye}_shows") or [], strict=False)
        ]
        for key, eye in (("l", "left"), ("r", "right"))
    }
    return {"label": guess.get("label"), "share": _short(guess.get("share")), **sides}


def _move(record: Json) -> Json:
    kind = record["kind"]
    if kind == "move":
        place = [_short(row[3], 1) for row in (record.get("target") or [])[:3]]
        sent = "" if record.get("sent", True) else ", not sent (dry)"
        text = f"{record.get('how')} to {record.get('purpose')} {place} at {_short(record.get('speed_pct'), 0)} %{sent}"
    elif kind == "moved":
        text = f"there in {_short(record.get('seconds'))} s, {_short(record.get('error_mm'), 3)} mm off"
    elif kind == "hand":
        text = "hand closes" if record.get("closed") else "hand opens"
    else:
        text = f"refused: {record.get('rule')}: {record.get('text')}"
    return {"kind": kind, "text": text}


def state_seconds(cycle: Cycle) -> dict[str, float]:
    """Seconds spent in each state of the pick cycle."""
    states = cycle.of("state")
    total: dict[str, float] = {}
    for here, following in pairwise([*states, cycle.records[-1]] if states else []):
        spent = max(float(following["mono_s"]) - float(here["mono_s"]), 0.0)
        name = str(here.get("to"))
        total[name] = round(total.get(name, 0.0) + spent, 3)
    return total


def timeline(digest: Digest) -> list[Json]:
    """One bar a cycle on the run's own clock, seconds from its start."""
    if not digest.records:
        return []
    zero = float(digest.records[0]["mono_s"])
    return [
        {
            "n": c.number,
            "from": round(float(c.records[0]["mono_s"]) - zero, 2),
            "to": round(float(c.records[-1]["mono_s"]) - zero, 2),
            "outcome": c.outcome,
            "label": c.label,
        }
        for c in digest.cycles
    ]


def events(digest: Digest) -> list[Json]:
    """Faults, refusals, gaps, clock jumps and model changes, each with the record that led to it."""
    found, before, cycle = [], None, None
    for record in digest.records:
        kind = record["kind"]
        if kind == "cycle_start":
            cycle = record.get("cycle")
        if kind in ("fault", "refusal", "gap", "clock", "model", "run_end"):
            found.append(
                {
                    "t": record.get("t"),
                    "kind": kind,
                    "cycle": cycle,
                    "text": _event_text(record),
                    "after": None if before is None else _event_text(before),
                }
            )
        elif kind in ("move", "hand", "decision", "command", "state"):
            before = record
        if kind == "cycle_end":
            cycle = None
    return found


def _event_text(record: Json) -> str:
    kind = record["kind"]
    parts = [record.get(k) for k in ("code", "rule", "action", "purpose", "text", "why", "while", "to")]
    text = ": ".join(str(p) for p in parts if p is not None)
    if kind == "clock":
        text = f"the machine's clock jumped by {record.get('jump_s')} s"
    return f"{kind} {text}".strip()


def looks(digest: Digest) -> Json:
    """Columns over all looks, for plots: when, how long, corner residuals, camera health."""
    rows = digest.of("look")
    zero = float(digest.records[0]["mono_s"]) if digest.records else 0.0
    health = [r.get("health") or {} for r in rows]
    names = sorted({k for h in health for k, v in h.items() if isinstance(v, (int, float))})
    return {
        "s": [round(float(r["mono_s"]) - zero, 2) for r in rows],
        "cycle": [r.get("cycle") for r in rows],
        "ms": [(r.get("scene") or {}).get("ms") for r in rows],
        "residual_mm": [residual_mm(parts_of(r)) for r in rows],
        "health": {name: [_short(h.get(name), 3) for h in health] for name in names},
    }


def _points(points: Any) -> list[list[float]]:
    return [[round(x, 1), round(y, 1)] for x, y in points or []]


def _short(value: Any, digits: int = 2) -> float | None:
    return round(float(value), digits) if isinstance(value, (int, float)) else None
