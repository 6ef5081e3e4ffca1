"""Write the page of all cells: which are well, which drift, which miss what. DuckDB counts, this module decides.

A cell is reported only where chance does not explain the difference: its success rate is more than SIGMAS standard
errors below that of the other cells, or drift, light or faults exceed the limits of its own daemon.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from datetime import date, timedelta
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from daemon.calibration.drift import STOP_DEG
from daemon.events.codes import BY_SUMMARY, CauseCode, cause_code
from daemon.events.outcomes import DEFINITION
from daemon.events.records import Json
from daemon.events.upgrade import read_prose
from daemon.fleet.store import Store, StoreError
from daemon.fleet.views import open_views
from daemon.review.measures import AXES, NEAR
from daemon.review.page import render
from daemon.review.production import NONE_CHOSEN, shares_apart
from daemon.store.files import write_atomically
from daemon.store.place_status import PlaceStatus
from daemon.vision.health import MEASURES

BEFORE = timedelta(days=28)
"""Period before the days shown that gives a cell's earlier success rate."""
USUAL = timedelta(days=6)
"""Period after a calibration that gives the usual camera angles, so that slow drift shows too."""
SIGMAS = 4.0
"""With forty cells of five parts each, one page in a hundred reports a difference that is chance."""
LOOKED_AT = [str(status) for status in (PlaceStatus.RIGHT, PlaceStatus.OFF, PlaceStatus.MISSING)]
"""What the look after a set-down finds, in the order of the page."""
LEAST_SHARE = 0.01
"""Smallest difference of success rates worth a report."""
ANGLE = """CREATE MACRO angle(deg, sigma_deg) AS
    sum(deg / sigma_deg ** 2) FILTER (sigma_deg > 0) / sum(1 / sigma_deg ** 2) FILTER (sigma_deg > 0)"""
"""Mean weighted by the inverse variance of each look."""
STATES = ("faults", "misses", "one camera", "drifts", "dark", "silent", "well")
"""A cell has the first state that applies."""


def write_fleet_page(store: Store, days: int, out: Path) -> Path:
    """Write the page of the store's last `days` days to `out`; returns out. Raises StoreError, OSError."""
    write_atomically(out, render("fleet", fleet_data(store, days), {}, "daemon.fleet").encode())
    return out


def fleet_data(store: Store, days: int) -> Json:
    """The page's data. Raises StoreError for a store without runs."""
    months = sorted({f.split("month=")[1].split("/")[0] for f in store.fs.glob(store.path("tables/runs/*/*/*"))})
    if not months:
        raise StoreError(f"{store.url}: no runs in it yet: `facetctl runs collect CELL=RUNS --into {store.url}`")
    last = open_views(store, months[-1:]).execute("SELECT max(day) FROM runs").fetchone()[0]
    first = last - timedelta(days=days - 1)
    since = first - BEFORE
    calibrated = _calibrated(store, months)
    needed = {f"{day:%Y-%m}" for day in (*(c[0] for c in calibrated.values()), *(c[1] for c in calibrated.values()))}
    views = open_views(store, [m for m in months if f"{since:%Y-%m}" <= m <= f"{last:%Y-%m}" or m in needed])
    between = f"day BETWEEN '{first}' AND '{last}'"
    of: Callable[[str], list[tuple[Any, ...]]] = lambda sql: views.execute(sql).fetchall()  # noqa: E731
    shown = [first + timedelta(days=k) for k in range(days)]
    cells = _cells(views, first, last, calibrated)
    _set_states(cells, last)
    parts = _summed(c["parts"] for c in cells)
    causes = dict(sum((Counter(c["causes"]) for c in cells), Counter[str]()).most_common())
    return {
        "title": "the fleet",
        "days": [str(day) for day in shown],
        "cells": sorted(cells, key=lambda c: (STATES.index(c["state"]), c["name"])),
        "parts": parts,
        "causes": causes,
        "remedies": {name: BY_SUMMARY[name].remedy for name in causes if name in BY_SUMMARY},
        "models": _models(of, between),
        "definition": DEFINITION,
        "limits": {
            "light": MEASURES["darkness"].limit,
            "drift": STOP_DEG,
            "epipolar": MEASURES["epipolar"].limit,
            "near": NEAR,
        },
        "simulated": any(kind == "simulated" for (kind,) in of(f"SELECT DISTINCT kind FROM runs WHERE {between}")),
    }


def _calibrated(store: Store, months: Sequence[str]) -> dict[str, tuple[date, date]]:
    """Cell -> first and last day of the period after its present calibration that gives its usual camera angles."""
    rows = open_views(store, months).execute(
        """SELECT cell, min(day) FROM runs JOIN (SELECT cell, arg_max(calibration, t) AS now FROM runs GROUP BY cell)
        USING (cell) WHERE calibration IS NOT DISTINCT FROM now GROUP BY cell"""
    )
    return {cell: (day, day + USUAL) for cell, day in rows.fetchall()}


def _cells(views: Any, first: date, last: date, calibrated: Mapping[str, tuple[date, date]]) -> list[Json]:
    views.execute("CREATE TABLE calibrated (cell VARCHAR, first_day DATE, last_day DATE)")
    for cell, (begin, end) in calibrated.items():
        views.execute("INSERT INTO calibrated VALUES (?, ?, ?)", [cell, begin, end])
    views.execute(ANGLE)
    query = (resources.files("daemon.fleet") / "assets" / "cells.sql").read_text()
    found = views.execute(
        query,
        {"first": first, "last": last, "since": first - BEFORE, "none_chosen": NONE_CHOSEN, "looked_at": LOOKED_AT},
    )
    names = [column[0] for column in found.description]
    cells = [_short(dict(zip(names, row, strict=True))) for row in found.fetchall()]
    for cell in cells:
        cell["cameras_used"] = [cell.pop("cameras"), cell.pop("one_camera")]
        cell["last"], cell["faults"] = cell["last"].isoformat(), faults_by_cause(cell["faults"])
    return cells


def faults_by_cause(faults: Sequence[Json]) -> dict[str, int]:
    """Number of faults by cause, most frequent first, from code, text and count of each kind. A person's stop does not
    count. Rows of earlier versions have no code of the catalogue: their text gives the cause."""
    counts = Counter[str]()
    for code, text, count in ((str(one["code"]), str(one["text"]), one["count"]) for one in faults):
        known = CauseCode(code) if code in CauseCode.__members__.values() else cause_code(read_prose(text)["code"])
        if known.stage != "operator":
            counts[code if known is CauseCode.INTERNAL else known.summary] += count
    return dict(counts.most_common())


def _models(of: Any, between: str) -> list[Json]:
    rows = of(f"""SELECT model, min(day), count(DISTINCT cell), count(*) FILTER (outcome = 'picked'), count(*),
        median(predicted_mm::DOUBLE) FILTER (outcome = 'picked') FROM cycles WHERE tried AND {between}
        GROUP BY model ORDER BY 2""")
    return [
        {"model": model, "since": str(day), "cells": cells, "picked": [picked, tried], "mm": _short(mm)}
        for model, day, cells, picked, tried, mm in rows
    ]


def _short(value: Any) -> Any:
    """Numbers, in whatever lists and mappings, with four digits; None for one that is not finite."""
    if isinstance(value, dict):
        return {name: _short(one) for name, one in value.items()}
    if isinstance(value, list):
        return [_short(one) for one in value]
    if isinstance(value, float):
        return float(f"{value:.4g}") if np.isfinite(value) else None
    return value


def _summed(shares: Any) -> dict[str, list[int]]:
    found: dict[str, list[int]] = {}
    for one in shares:
        for name, (part, of) in one.items():
            total = found.setdefault(name, [0, 0])
            total[0], total[1] = total[0] + part, total[1] + of
    return dict(sorted(found.items()))


def _set_states(cells: Sequence[Json], last: date) -> None:
    """Set each cell's state, and a sentence for each finding."""
    all_parts = _summed(c["parts"] for c in cells)
    total = [sum(c["picked"] for c in cells), sum(c["tried"] for c in cells)]
    for cell in cells:
        findings: list[tuple[str, str]] = []
        if date.fromisoformat(cell["last"][:10]) < last - timedelta(days=1):
            findings.append(("silent", f"no run since {cell['last'][:10]}"))
        if sum(cell["faults"].values()):
            most = [f"{count} × {name}" for name, count in cell["faults"].items()]
            findings.append(("faults", ", ".join([*most[:3], *([f"{len(most) - 3} more"] if len(most) > 3 else [])])))
        cell["weak"] = sorted(name for name, of in cell["parts"].items() if is_worse(of, _without(all_parts[name], of)))
        findings += [*_misses(cell, total, all_parts), *_one_camera(cell), *_drifts(cell), *_too_dark(cell)]
        cell["findings"] = [list(one) for one in findings]
        cell["state"] = next((state for state in STATES if any(state == kind for kind, _ in findings)), "well")


def _misses(cell: Json, total: Sequence[int], all_parts: Mapping[str, list[int]]) -> list[tuple[str, str]]:
    own, found = [cell["picked"], cell["tried"]], []
    for name in cell["weak"]:
        of, others = cell["parts"][name], _without(all_parts[name], cell["parts"][name])
        found.append(("misses", f"{name}: {_percent(of)} picked, {_percent(others)} in other cells"))
    if is_worse(own, _without(total, own)) and not 0 < len(cell["weak"]) <= len(cell["parts"]) / 2:
        found = [("misses", f"{_percent(own)} picked, {_percent(_without(total, own))} in other cells")]
    if is_worse(own, cell["before"]):
        found.append(("misses", f"{_percent(own)} picked, {_percent(cell['before'])} in the four weeks before"))
    return found


def _one_camera(cell: Json) -> list[tuple[str, str]]:
    cameras, count = cell["cameras_used"]
    if not count:
        return []
    now = "both are in use again" if cameras == "both" else f"the {cameras} camera is in use alone"
    return [("one camera", f"{count} looks with one camera; {now}")]


def _drifts(cell: Json) -> list[tuple[str, str]]:
    found = []
    for axis in AXES:
        measured = [turn for turn in cell["turn"][axis] if turn is not None]
        usual = cell["usual"][axis]
        turned = measured[-1] - usual if measured and usual is not None else 0.0
        if abs(turned) > NEAR * STOP_DEG:
            found.append(("drifts", f"{axis} of the right camera {turned:+.2f} degrees since calibration"))
    return found


def _too_dark(cell: Json) -> list[tuple[str, str]]:
    measured = [light for light in cell["light"] if light is not None]
    limit = MEASURES["darkness"].limit
    if measured and measured[-1] < limit / NEAR:
        return [("dark", f"99th-percentile brightness {measured[-1]:.0f} grey levels, limit {limit:.0f}")]
    return []


def _without(all_of: Sequence[int], own: Sequence[int]) -> list[int]:
    return [all_of[0] - own[0], all_of[1] - own[1]]


def _percent(of: Sequence[int]) -> str:
    return f"{100 * of[0] / of[1]:.1f} %" if of[1] else "none"


def is_worse(own: Sequence[int], others: Sequence[int]) -> bool:
    """Whether a share [part, of] is below another by more than chance explains, and by enough to matter."""
    if not own[1] or not others[1]:
        return False
    gap, sigma = shares_apart(own, others)
    return gap > LEAST_SHARE and gap > SIGMAS * sigma
