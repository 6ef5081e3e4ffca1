"""One offline HTML page for all cells: which are well, which drift, which miss what. DuckDB counts, this module
decides.

A cell is reported only where chance does not explain the difference: its success rate is more than SIGMAS standard
errors below that of the other cells, or drift, light or faults exceed the limits of its own daemon.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from daemon.calibration.drift import DriftSettings
from daemon.events.codes import BY_SUMMARY, CauseCode, cause_code
from daemon.events.outcomes import DEFINITION
from daemon.events.upgrade import read_prose
from daemon.fleet.store import Store, StoreError
from daemon.fleet.views import opened
from daemon.review.measures import AXES, NEAR
from daemon.review.page import render
from daemon.review.production import NONE_CHOSEN, shares_apart
from daemon.store.files import write_atomically
from daemon.store.place_status import PlaceStatus
from daemon.vision.health import MEASURES

Json = dict[str, Any]
BEFORE = timedelta(days=28)
"""Period before the days shown that gives a cell's earlier success rate."""
USUAL = timedelta(days=6)
"""Period after a calibration that gives the usual camera angles, so that slow drift shows too."""
SIGMAS = 4.0
"""With forty cells of five parts each, one page in a hundred reports a difference that is chance."""
LOOKED_AT = (PlaceStatus.RIGHT, PlaceStatus.OFF, PlaceStatus.MISSING)
"""What the look after a set-down finds, in the order of the page."""
LEAST_SHARE = 0.01
"""Smallest difference of success rates worth a report."""
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
    last = opened(store, months[-1:]).execute("SELECT max(day) FROM runs").fetchone()[0]
    first = last - timedelta(days=days - 1)
    since = first - BEFORE
    calibrated = _calibrated(store, months)
    needed = {f"{day:%Y-%m}" for day in (*(c[0] for c in calibrated.values()), *(c[1] for c in calibrated.values()))}
    views = opened(store, [m for m in months if f"{since:%Y-%m}" <= m <= f"{last:%Y-%m}" or m in needed])
    between = f"day BETWEEN '{first}' AND '{last}'"
    of: Callable[[str], list[tuple[Any, ...]]] = lambda sql: views.execute(sql).fetchall()  # noqa: E731
    shown = [first + timedelta(days=k) for k in range(days)]
    cells = _cells(of, between, since, first, shown, calibrated)
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
            "drift": DriftSettings().stop_deg,
            "epipolar": MEASURES["epipolar"].limit,
            "near": NEAR,
        },
        "simulated": any(kind == "simulated" for (kind,) in of(f"SELECT DISTINCT kind FROM runs WHERE {between}")),
    }


def _calibrated(store: Store, months: Sequence[str]) -> dict[str, tuple[date, date]]:
    """Cell -> first and last day of the period after its present calibration that gives its usual camera angles."""
    rows = opened(store, months).execute(
        """SELECT cell, min(day) FROM runs JOIN (SELECT cell, arg_max(calibration, t) AS now FROM runs GROUP BY cell)
        USING (cell) WHERE calibration IS NOT DISTINCT FROM now GROUP BY cell"""
    )
    return {cell: (day, day + USUAL) for cell, day in rows.fetchall()}


def _cells(
    of: Any, between: str, since: date, first: date, shown: Sequence[date], calibrated: Mapping[str, tuple[date, date]]
) -> list[Json]:
    begun = " OR ".join(f"cell = '{c}' AND day BETWEEN '{a}' AND '{b}'" for c, (a, b) in calibrated.items())
    before = f"day >= '{since}' AND day < '{first}'"
    picked = "count(*) FILTER (outcome = 'picked')"
    totals = _by(
        of(f"""SELECT cell, count(*), sum(interventions), arg_max(release, t) FROM runs
        WHERE {between} GROUP BY cell""")
    )
    latest = _by(
        of("""SELECT cell, max(t + to_milliseconds((1000 * coalesce(seconds, 0))::BIGINT))::TIMESTAMP FROM runs
        GROUP BY cell""")
    )  # end of the last run, which lasts for days on an idle cell
    usual = _by(of(f"SELECT cell, {picked}, count(*) FROM cycles WHERE tried AND {before} GROUP BY cell"))
    ever = [cell for (cell,) in of("SELECT DISTINCT cell FROM runs ORDER BY cell")]
    daily = _days(
        of(f"""SELECT cell, day, {picked}, count(*),
        median(seconds) FILTER (outcome = 'picked' AND coalesce(times_life, 1) = 1),
        median(predicted_mm::DOUBLE) FILTER (outcome = 'picked')
        FROM cycles LEFT JOIN (SELECT cell, run, times_life FROM runs) USING (cell, run) WHERE tried AND {between}
        GROUP BY cell, day""")
    )
    health = _days(
        of(f"""SELECT cell, day, {_turns()}, median(least(darkness_left, darkness_right)::DOUBLE),
        median(epipolar_pair::DOUBLE) FROM health
        WHERE {between} GROUP BY cell, day""")
    )
    rest = _by(of(f"SELECT cell, {_turns()} FROM health WHERE {begun} GROUP BY cell"))
    looks = _by(
        of(
            f"SELECT cell, median(ms::DOUBLE), arg_max(eyes, (t, seq)), count(*) FILTER (eyes <> 'both') FROM looks "
            f"WHERE {between} GROUP BY cell"
        )
    )
    parts = _nested(
        of(f"""SELECT cell, coalesce(label, '{NONE_CHOSEN}') AS part, [{picked}, count(*)] FROM cycles
        WHERE tried AND {between} GROUP BY cell, part ORDER BY part""")
    )
    placed = _by(
        of(f"""SELECT cell, {", ".join(f"count(*) FILTER (place_status = '{each}')" for each in LOOKED_AT)} FROM cycles
        WHERE {between} GROUP BY cell""")
    )
    causes = _nested(
        of(f"""SELECT cell, cause, count(*) AS n FROM cycles
        WHERE cause IS NOT NULL AND {between} GROUP BY cell, cause ORDER BY n DESC""")
    )
    faults: dict[str, dict[tuple[str, str], int]] = defaultdict(dict)
    for cell, code, text, count in of(f"""SELECT cell, code, text, count(*) FROM faults
        WHERE kind = 'fault' AND {between} GROUP BY cell, code, text"""):
        faults[cell][str(code), str(text)] = count
    found = []
    for cell in ever:
        of_day = [daily.get((cell, day), (0, 0, None, None)) for day in shown]
        measured = [health.get((cell, day), (None,) * 5) for day in shown]
        count, interventions, version = totals.get(cell, (0, 0, None))
        (at,) = latest[cell]
        ms, cameras, one_camera = looks.get(cell, (None, None, 0))
        found.append(
            {
                "name": cell,
                "last": at.isoformat(),
                "runs": count,
                "interventions": interventions,
                "release": version,
                "picked": sum(d[0] for d in of_day),
                "tried": sum(d[1] for d in of_day),
                "before": list(usual.get(cell, (0, 0))),
                "success": [[d[0], d[1]] for d in of_day],
                "seconds": [_short(d[2]) for d in of_day],
                "mm": [_short(d[3]) for d in of_day],
                "parts": parts.get(cell, {}),
                "placed": list(placed.get(cell, (0,) * len(LOOKED_AT))),
                "causes": causes.get(cell, {}),
                "faults": _by_cause(faults.get(cell, {})),
                "ms": _short(ms),
                "eyes": [cameras, one_camera],
                "turn": {axis: [_short(m[k]) for m in measured] for k, axis in enumerate(AXES)},
                "usual": {axis: _short(rest.get(cell, (None,) * 3)[k]) for k, axis in enumerate(AXES)},
                "light": [_short(m[3]) for m in measured],
                "epipolar": [_short(m[4]) for m in measured],
            }
        )
    return found


def _by_cause(faults: Mapping[tuple[str, str], int]) -> dict[str, int]:
    """Number of faults by cause, most frequent first, from counts of (code, text). A person's stop does not count. Rows
    of earlier versions have no code of the catalogue: their text gives the cause."""
    counts = Counter[str]()
    for (code, text), count in faults.items():
        known = CauseCode(code) if code in CauseCode.__members__.values() else cause_code(read_prose(text)["code"])
        if known.stage != "operator":
            counts[code if known is CauseCode.INTERNAL else known.summary] += count
    return dict(counts.most_common())


def _turns() -> str:
    """SQL for the mean of each axis, weighted by the inverse variance of each look."""
    measured = "FILTER ({0}_sigma_deg > 0)"
    mean = f"sum({{0}}_deg / {{0}}_sigma_deg ** 2) {measured} / sum(1 / {{0}}_sigma_deg ** 2) {measured}"
    return ", ".join(mean.format(axis) for axis in AXES)


def _by(rows: Sequence[tuple[Any, ...]]) -> dict[str, tuple[Any, ...]]:
    return {row[0]: row[1:] for row in rows}


def _days(rows: Sequence[tuple[Any, ...]]) -> dict[tuple[str, date], tuple[Any, ...]]:
    return {(row[0], row[1]): row[2:] for row in rows}


def _nested(rows: Sequence[tuple[Any, ...]]) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = defaultdict(dict)
    for cell, name, value in rows:
        found[cell][name] = value
    return found


def _models(of: Any, between: str) -> list[Json]:
    rows = of(f"""SELECT model, min(day), count(DISTINCT cell), count(*) FILTER (outcome = 'picked'), count(*),
        median(predicted_mm::DOUBLE) FILTER (outcome = 'picked') FROM cycles WHERE tried AND {between}
        GROUP BY model ORDER BY 2""")
    return [
        {"model": model, "since": str(day), "cells": cells, "picked": [picked, tried], "mm": _short(mm)}
        for model, day, cells, picked, tried, mm in rows
    ]


def _short(value: Any) -> float | None:
    return None if value is None or not np.isfinite(value) else float(f"{value:.4g}")


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
        findings += [*_misses(cell, total, all_parts), *_one_camera(cell), *_drifts(cell), *_dark(cell)]
        cell["told"] = [list(one) for one in findings]
        cell["weak"] = sorted(name for name, of in cell["parts"].items() if _worse(of, _without(all_parts[name], of)))
        cell["state"] = next((state for state in STATES if any(state == kind for kind, _ in findings)), "well")


def _misses(cell: Json, total: Sequence[int], all_parts: Mapping[str, list[int]]) -> list[tuple[str, str]]:
    own = [cell["picked"], cell["tried"]]
    weak = [name for name, of in cell["parts"].items() if _worse(of, _without(all_parts[name], of))]
    of_part = [(name, cell["parts"][name], _without(all_parts[name], cell["parts"][name])) for name in weak]
    found = [
        ("misses", f"{name}: {_percent(of)} picked, {_percent(others)} in other cells") for name, of, others in of_part
    ]
    if _worse(own, _without(total, own)) and not 0 < len(weak) <= len(cell["parts"]) / 2:
        found = [("misses", f"{_percent(own)} picked, {_percent(_without(total, own))} in other cells")]
    if _worse(own, cell["before"]):
        found.append(("misses", f"{_percent(own)} picked, {_percent(cell['before'])} in the four weeks before"))
    return found


def _one_camera(cell: Json) -> list[tuple[str, str]]:
    cameras, count = cell["eyes"]
    if not count:
        return []
    now = "both are in use again" if cameras == "both" else f"the {cameras} camera is in use alone"
    return [("one camera", f"{count} looks with one camera; {now}")]


def _drifts(cell: Json) -> list[tuple[str, str]]:
    found = []
    for axis in AXES:
        measured = [turn for turn in cell["turn"][axis] if turn is not None]
        usual = cell["usual"][axis]
        if measured and usual is not None and abs(measured[-1] - usual) > NEAR * DriftSettings().stop_deg:
            found.append(
                ("drifts", f"{axis} of the right camera {measured[-1] - usual:+.2f} degrees since calibration")
            )
    return found


def _dark(cell: Json) -> list[tuple[str, str]]:
    measured = [light for light in cell["light"] if light is not None]
    limit = MEASURES["darkness"].limit
    if measured and measured[-1] < limit / NEAR:
        return [("dark", f"99th-percentile brightness {measured[-1]:.0f} grey levels, limit {limit:.0f}")]
    return []


def _without(all_of: Sequence[int], own: Sequence[int]) -> list[int]:
    return [all_of[0] - own[0], all_of[1] - own[1]]


def _percent(of: Sequence[int]) -> str:
    return f"{100 * of[0] / of[1]:.1f} %" if of[1] else "none"


def _worse(own: Sequence[int], others: Sequence[int]) -> bool:
    """Whether a share [part, of] is below another by more than chance explains, and by enough to matter."""
    if not own[1] or not others[1]:
        return False
    gap, sigma = shares_apart(own, others)
    return gap > LEAST_SHARE and gap > SIGMAS * sigma
