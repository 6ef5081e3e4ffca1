"""Data of the report page as JSON values, from a digest. No HTML, no file.

Keys are short because a run of a thousand cycles has tens of thousands of them.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from daemon.events.codes import CauseCode, cause_code
from daemon.events.outcomes import DEFINITION, GOING_ON, is_success
from daemon.events.records import Json, Record
from daemon.pick.transitions import SHOWN
from daemon.review.digest import Cycle, Digest, LookStep, duration_s, repeated_faults, stops_of
from daemon.review.failure_causes import RunContext, causes, in_plain_words, run_context
from daemon.review.measures import strips
from daemon.review.not_counted import not_counted_text, picks_not_counted
from daemon.review.production import production, remedies
from daemon.review.record_words import ended_in_words, record_words
from daemon.review.set_downs import places_json
from daemon.store.place_status import PlaceStatus

MAX_CYCLES = MAX_EVENTS = 1000
"""Largest number of cycles and events shown, the newest ones; figures and measures cover all."""


def page_data(digest: Digest) -> Json:
    """All data of the page except images."""
    start, done, happened = digest.start or {}, production([digest]), events(digest)
    context = run_context(digest.cycles)
    return {
        "run": digest.name,
        "started": digest.records[0].get("t") if digest.records else None,
        "seconds": duration_s(digest.records),
        "utc_offset_s": start.get("utc_offset_s"),
        "cell": {
            **{"name": start.get("name"), "kind": start.get("cell"), "version": start.get("version")},
            "times_life": start.get("times_life"),
        },
        "models": digest.models_used(),
        "kept": {name: digest.kept(name) for name in ("config", "calibration")},
        "going": digest.going,
        "end": ended_in_words(digest.end),
        "production": done,
        "definition": DEFINITION,
        "remedies": remedies(done),
        "skipped": list(digest.skipped),
        "timeline": timeline(shown_of(digest)),
        "strips": strips(digest),
        "cycles": [cycle_json(c, context, digest.going) for c in shown_of(digest).cycles],
        "cycles_left_out": max(0, len(digest.cycles) - MAX_CYCLES),
        "outside": [stop_json(s) for s in stops_of([r for r in digest.outside if r["kind"] == "look"])],
        "places": places_json(digest, shown_of(digest)),
        "events": happened[-MAX_EVENTS:],
        "events_left_out": max(0, len(happened) - MAX_EVENTS),
        "states": {SHOWN.get(name, name): s for name, s in median_state_seconds(digest.cycles).items()},
    }


def shown_of(digest: Digest) -> Digest:
    """The run with its newest cycles only: a page of 10,000 cycles had 102 MB, and no browser opened it."""
    return replace(digest, cycles=digest.cycles[-MAX_CYCLES:])


def cycle_json(cycle: Cycle, run: RunContext, going: bool) -> Json:
    """Return one row of the table of cycles, with its details."""
    found = causes(cycle, run, going)
    return {
        "n": cycle.number,
        "t": cycle.records[0].get("t"),
        "label": cycle.label,
        "outcome": GOING_ON if going and cycle.end is None else cycle.outcome,
        "looks": cycle.looks,
        "cameras": cycle.cameras,
        "s": round(cycle.seconds, 2),
        "mm": _short(cycle.predicted_mm),
        "deg": _short(cycle.predicted_deg),
        "true_mm": _short(cycle.true_mm),
        "true_deg": _short(cycle.true_deg),
        "why": None if cycle.why is None else in_plain_words(cycle.why),
        "causes": [
            {"name": c.code.summary, "stage": c.code.stage, "r": c.code.remedy}
            | {"w": round(c.weight, 2), "e": c.evidence, "at": c.at}
            for c in found
        ],
        "mms": [_short(s.estimate.get("predicted_mm")) for s in cycle.stops if s.estimate],
        "decisions": [_decided(r) for r in cycle.of("decision", "laid_down")],
        "stops": [stop_json(s) for s in cycle.stops],
    }


SET_DOWN_TEXTS: dict[str, str] = {
    PlaceStatus.SET: "let go",
    PlaceStatus.OFF: "seen off",
    PlaceStatus.MISSING: "not seen",
}
"""Text for a part placed on the table, by its status; other statuses are their own text."""


def _decided(record: Record) -> Json:
    """A decision, or a part put on the table between two grasps, with the reason or what was seen of it."""
    if record["kind"] == "decision":
        return {"text": record.get("text"), "why": record.get("why")}
    off_mm, off_deg = record.get("off_mm"), record.get("off_deg")
    off = f"{off_mm:.1f} mm, {off_deg or 0.0:.1f} degrees off" if off_mm is not None else ""
    words = SET_DOWN_TEXTS.get(status := str(record.get("status")), status)
    return {"text": f"laid on the table: {words}", "why": ", ".join(filter(None, (off, record.get("why"))))}


def stop_json(stop: LookStep) -> Json:
    """Return one look as JSON values: parts and refusals in pixels of both images, the estimate, the moves after it."""
    look, estimate, scene = stop.look, stop.estimate, stop.scene
    return {
        "n": stop.number,
        "seq": look.get("seq"),
        "t": look.get("t"),
        "purpose": stop.purpose,
        "ms": scene.get("ms"),
        "pictures_only": look.get("scene") is None,
        "seconds": {k: _short(v, 4) for k, v in (look.get("seconds") or {}).items()},
        "health": look.get("health") or {},
        "parts": [_part(p) for p in stop.parts],
        "rejected": [
            {"camera": r.get("eye"), "why": r.get("reason"), "px": _points(r.get("corners_px"))}
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
    """A hypothesis. l, r: per image the ends of every edge that should be visible, and whether it is."""
    sides = {
        key: [
            {"px": _points([edge[:2], edge[2:]]), "shows": shows}
            for edge, shows in zip(guess.get(f"{camera}_px") or [], guess.get(f"{camera}_shows") or [], strict=False)
        ]
        for key, camera in (("l", "left"), ("r", "right"))
    }
    return {"label": guess.get("label"), "share": _short(guess.get("share")), **sides}


def _move(record: Json) -> Json:
    kind = record["kind"]
    if kind == "moved":
        text = f"there in {_short(record.get('seconds'))} s, {_short(record.get('error_mm'))} mm off"
    else:
        text = f"{MOVE_PREFIXES.get(kind, '')}{record_words(record)}"
    return {"kind": kind, "text": text}


MOVE_PREFIXES = {"hand": "gripper ", "refusal": "refused: "}
"""Beginning of the text of what followed a look, by kind."""


def state_seconds(cycle: Cycle) -> dict[str, float]:
    """Seconds of one cycle in each state."""
    states = cycle.of("state")
    total: dict[str, float] = {}
    for here, following in pairwise([*states, cycle.records[-1]] if states else []):
        spent = max(float(following["mono_s"]) - float(here["mono_s"]), 0.0)
        name = str(here.get("to"))
        total[name] = round(total.get(name, 0.0) + spent, 3)
    return total


def median_state_seconds(cycles: Sequence[Cycle]) -> dict[str, float]:
    """Median seconds in each state over successful picks, in the order of a pick."""
    spent = [state_seconds(c) for c in cycles if is_success(c.outcome)]
    names = dict.fromkeys(name for one in spent for name in one)
    return {name: float(np.median([one.get(name, 0.0) for one in spent])) for name in names}


def timeline(digest: Digest) -> list[Json]:
    """Return one bar a cycle, in seconds from the run's start."""
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
    """Events besides the picks, each once, with the record before it, and who cleared a fault after how long."""
    found: list[Json] = []
    before, cycle, last = None, None, None
    zero = float(digest.records[0]["mono_s"]) if digest.records else 0.0
    again = repeated_faults(digest.records)
    uncounted = {
        miss["seq"]: {**miss, "kind": "uncounted", "text": not_counted_text(miss)}
        for c in digest.cycles
        for miss in picks_not_counted(c)
    }
    for line in digest.records:
        record = uncounted.get(line["seq"], line)
        kind = record["kind"]
        if kind == "cycle_start":
            cycle = record.get("cycle")
        if kind in EVENT_KINDS:
            event = {
                "t": record.get("t"),
                "s": round(float(record["mono_s"]) - zero, 2),
                "kind": kind,
                "what": EVENT_KINDS[kind],
                "cycle": cycle,
                "text": _event_text(record),
                "cleared": None,
                "after": None if before is None else _event_text(before),
            }
            same = kind != "fault" and found and all(found[-1][k] == event[k] for k in ("kind", "cycle", "text"))
            if not same and record["seq"] not in again:
                found.append(event)
        elif kind in ("move", "hand", "held_back", "decision", "command", "state"):
            before = record
            last = record if kind == "command" else last
            if kind == "state" and record.get("from") == "fault" and record.get("to") != "fault":
                now = float(record["mono_s"]) - zero
                for one in (e for e in found if e["kind"] == "fault" and e["cleared"] is None):
                    one["cleared"] = {"by": (last or {}).get("who"), "s": round(now - one["s"], 1)}
        if kind == "cycle_end":
            cycle = None
    return found


EVENT_KINDS = {
    "fault": "fault", "refusal": "refusal", "note": "note", "operator": "operator", "model": "model",
    "eyes": "cameras", "gained": "second look", "uncounted": "not counted", "gap": "records missing",
    "clock": "clock", "run_end": "end",
}  # fmt: skip
"""Kinds of records in the table of events, and their names for people."""
PREFIXES = {
    "refusal": "the guard refused: ", "gap": "records are missing: ", "run_end": "the run ended: ",
    **dict.fromkeys(("note", "operator", "model", "eyes", "gained", "uncounted", "clock"), ""),
}  # fmt: skip
"""Beginning of the text of an event, by kind; others have their kind before it."""


def _event_text(record: Json) -> str:
    kind = record["kind"]
    if kind == "state":
        return f"state {SHOWN.get(str(record.get('to')), record.get('to'))}"
    if kind == "fault":
        known, words = cause_code(record.get("code")), in_plain_words(str(record.get("text")))
        cause = "" if known is CauseCode.INTERNAL else f"{known.summary}: "
        return words if known.stage == "operator" else f"fault: {cause}{words}"
    return f"{PREFIXES.get(kind, f'{kind} ')}{record_words(record)}"


def _points(points: Any) -> list[list[float]]:
    return [[round(x, 1), round(y, 1)] for x, y in points or []]


def _short(value: Any, digits: int = 2) -> float | None:
    return round(float(value), digits) if isinstance(value, (int, float)) else None
