"""One page for a week of runs: what changes from day to day, each point a link to its run's own page."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from daemon.calibration.drift import DriftSettings
from daemon.events.outcomes import DEFINITION
from daemon.review.brief import that_picked
from daemon.review.digest import Digest
from daemon.review.measures import number
from daemon.review.page import WEEK, render, run_time, write_page
from daemon.review.production import median_of, production, remedies
from daemon.store.files import write_atomically
from daemon.store.runs import RunError, list_runs

REPORT = "report.html"
DRIFTS = ("pitch_deg", "roll_deg", "vergence_deg")
LIGHTS = ("darkness_left", "darkness_right")

Json = dict[str, Any]


def write_week(runs: Path, last: Path, out: Path) -> Path:
    """Write the page of the week that ended with the run `last` of the folder `runs`, and the page of each of its runs
    that has none yet, or one that is older than the run. Returns out. Raises RunError, OSError."""
    end = run_time(last.name)
    if end is None:
        raise RunError(f"{last}: its name is no time, so that it is not known which week it ended")
    folders = [f for f in list_runs(runs) if (t := run_time(f.name)) is not None and end - WEEK < t <= end]
    picked = that_picked(folders)
    for folder in picked:
        if not _is_fresh(folder):
            write_page(folder, folder / REPORT)
    data = week_data([*picked.values()], [_link(folder, out) for folder in picked])
    write_atomically(out, render("week", data, {}).encode())
    return out


def _is_fresh(folder: Path) -> bool:
    try:
        return (folder / REPORT).stat().st_mtime >= (folder / "run.jsonl").stat().st_mtime
    except OSError:
        return False


def _link(folder: Path, out: Path) -> str:
    return Path(os.path.relpath(folder / REPORT, out.parent)).as_posix()


def week_data(runs: Sequence[Digest], links: Sequence[str]) -> Json:
    """What the page shows: the week as a whole, a row a run."""
    start, done = runs[-1].start or {} if runs else {}, production(runs)
    return {
        "title": "the week",
        "cell": {"name": start.get("name"), "kind": start.get("cell"), "version": start.get("version")},
        "utc_offset_s": start.get("utc_offset_s"),
        "production": done,
        "definition": DEFINITION,
        "remedies": remedies(done),
        "stop_deg": DriftSettings().stop_deg,
        "runs": [run_json(run) | {"link": link} for run, link in zip(runs, links, strict=True)],
    }


def run_json(run: Digest) -> Json:
    """One run as points of every trend; None where it says nothing."""
    looks = [r.get("health") or {} for r in run.of("look")]
    return {
        "run": run.name,
        "t": run.records[0].get("t") if run.records else None,
        "production": production([run]),
        "models": run.models_used(),
        "calibration": run.kept("calibration"),
        "drift": {name.removesuffix("_deg"): _trusted(looks, name) for name in DRIFTS},
        "epipolar_px": median_of([h.get("epipolar_pair") for h in looks]),
        "light": {name.removeprefix("darkness_"): median_of([h.get(name) for h in looks]) for name in LIGHTS},
        "focus_px": {eye: median_of([h.get(f"focus_{eye}") for h in looks]) for eye in ("left", "right")},
    }


def _trusted(looks: Sequence[Json], name: str) -> float | None:
    """The mean over the looks, each by what it is worth."""
    known = [(number(h.get(name)), number(h.get(name.replace("_deg", "_sigma_deg")))) for h in looks]
    told = [(value, sigma**-2) for value, sigma in known if value is not None and sigma]
    if not told:
        return None
    values, weights = np.array(told).T
    return float(np.sum(values * weights) / np.sum(weights))
