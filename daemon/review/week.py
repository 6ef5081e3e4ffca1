"""Write the page of a week of runs: trends from day to day, each point a link to its run's page."""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from daemon.arm import CAMERA_NAMES
from daemon.calibration.drift import STOP_DEG
from daemon.events.outcomes import DEFINITION
from daemon.events.records import Json
from daemon.review.brief import read_runs_with_picks
from daemon.review.digest import Digest
from daemon.review.measures import AXES, number
from daemon.review.page import WEEK, render, run_time, write_page
from daemon.review.production import median_of, production, remedies
from daemon.review.set_downs import placing_figures, set_downs
from daemon.store.files import write_atomically
from daemon.store.runs import RunError, list_runs

REPORT = "report.html"


def write_week(runs: Path, last: Path, out: Path) -> Path:
    """Write the page of the week that ends with `last`, and the pages of its runs. Raises RunError, OSError."""
    end = run_time(last.name)
    if end is None:
        raise RunError(f"{last}: the name of the run is not a time; --week needs one such as 20260101T120000Z")
    folders = [f for f in list_runs(runs) if (t := run_time(f.name)) is not None and end - WEEK < t <= end]
    picked = read_runs_with_picks(folders)
    for folder in picked:
        if not _is_fresh(folder):
            write_page(folder, folder / REPORT)
    links = [Path(os.path.relpath(folder / REPORT, out.parent)).as_posix() for folder in picked]
    data = week_data([*picked.values()], links)
    write_atomically(out, render("week", data, {}).encode())
    return out


def _is_fresh(folder: Path) -> bool:
    try:
        return (folder / REPORT).stat().st_mtime >= (folder / "run.jsonl").stat().st_mtime
    except OSError:
        return False


def week_data(runs: Sequence[Digest], links: Sequence[str]) -> Json:
    """The page's data: figures of the week, and one row a run."""
    start, done = runs[-1].start or {} if runs else {}, production(runs)
    return {
        "title": "the week",
        "cell": {"name": start.get("name"), "kind": start.get("cell"), "version": start.get("version")},
        "utc_offset_s": start.get("utc_offset_s"),
        "production": done,
        "definition": DEFINITION,
        "remedies": remedies(done),
        "placing": placing_figures([made for run in runs for made in set_downs(run)]),
        "stop_deg": STOP_DEG,
        "runs": [run_json(run) | {"link": link} for run, link in zip(runs, links, strict=True)],
    }


def run_json(run: Digest) -> Json:
    """Return one run as a point of each trend; None without data."""
    looks = [r.get("health") or {} for r in run.of("look")]
    return {
        "run": run.name,
        "t": run.records[0].get("t") if run.records else None,
        "production": production([run]),
        "models": run.models_used(),
        "calibration": run.kept("calibration"),
        "drift": {axis: _weighted_mean(looks, axis) for axis in AXES},
        "epipolar_px": median_of([h.get("epipolar_pair") for h in looks]),
        "light": {camera: median_of([h.get(f"darkness_{camera}") for h in looks]) for camera in CAMERA_NAMES},
        "focus_px": {camera: median_of([h.get(f"focus_{camera}") for h in looks]) for camera in CAMERA_NAMES},
    }


def _weighted_mean(looks: Sequence[Json], axis: str) -> float | None:
    """Mean angle over the looks, weighted by the inverse variance of each."""
    measured = [(number(h.get(f"{axis}_deg")), number(h.get(f"{axis}_sigma_deg"))) for h in looks]
    weighted = [(value, sigma**-2) for value, sigma in measured if value is not None and sigma]
    if not weighted:
        return None
    values, weights = np.array(weighted).T
    return float(np.sum(values * weights) / np.sum(weights))
