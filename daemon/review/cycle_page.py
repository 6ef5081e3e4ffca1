"""Write the page of one cycle: arm and parts in 3-D, and the motion over time. Needs the extra `plots`."""

from collections.abc import Sequence
from importlib import resources
from pathlib import Path

import numpy as np

from daemon.events.records import Json, Record
from daemon.review.digest import Cycle, Digest
from daemon.review.page import read_digest, render
from daemon.review.space import arm_of, is_arrival, joints_over, moments_of, seconds_after, space_of, way_of
from daemon.store.files import write_atomically
from daemon.store.folders import needing
from daemon.store.runs import RunError


def write_cycle_page(folder: Path, number: int, out: Path) -> Path:
    """Write the page of cycle `number` of the run in `folder`; returns out. Raises RunError, OSError."""
    with needing("plots", "the page of a cycle", RunError):
        from plotly.offline import get_plotlyjs
    run = read_digest(folder)
    cycle = next((c for c in run.cycles if c.number == number), None)
    if cycle is None:
        known = f"cycles {run.cycles[0].number} to {run.cycles[-1].number}" if run.cycles else "no cycle"
        raise RunError(f"{folder}: no cycle {number}; the run has {known}")
    scene = (resources.files("daemon.review") / "assets" / "space.js").read_text()
    page = render("cycle", cycle_data(folder, run, cycle), {}, library=get_plotlyjs(), shared=scene)
    write_atomically(out, page.encode())
    return out


def cycle_data(folder: Path, run: Digest, cycle: Cycle) -> Json:
    """The page's data: lengths in mm in the world, angles in degrees, times in seconds from the cycle's start."""
    arm, trouble = arm_of(folder, _start_of(run, cycle))
    zero = float(cycle.records[0]["mono_s"])
    moments = moments_of(cycle.records, zero)
    arrivals = _arrivals(run, cycle)
    space = space_of(arm, joints_over(arrivals, moments), way_of(arrivals, cycle.records, arm))
    return {
        "run": run.name,
        "utc_offset_s": (run.start or {}).get("utc_offset_s"),
        "n": cycle.number,
        "t": cycle.started,
        "label": cycle.label,
        "outcome": cycle.outcome,
        "why": cycle.why,
        "seconds": round(cycle.seconds, 2),
        "moments": moments,
        "motion": _motion(arrivals, cycle, zero),
        **space,
        "trouble": trouble,
    }


def _start_of(run: Digest, cycle: Cycle) -> Record:
    """The record with which the daemon began that wrote the cycle."""
    start: Record = {}
    for record in run.records:
        start = record if record["kind"] == "run_start" else start
        if record is cycle.records[0]:
            break
    return start


def _arrivals(run: Digest, cycle: Cycle) -> list[Record]:
    """The last arrival before the cycle, and those in it."""
    before = None
    for record in run.records:
        if record is cycle.records[0]:
            break
        before = record if is_arrival(record) else before
    return [*([before] if before else []), *filter(is_arrival, cycle.records)]


def _motion(arrivals: Sequence[Record], cycle: Cycle, zero: float) -> Json:
    """Joints, tool and speed over time: each move from where the last one ended, both ends with their times."""
    by_seq = {r["seq"]: r for r in arrivals}
    here, pct = next(iter(arrivals), None), 0.0
    points = [(cycle.records[0], here, 0.0)]
    for record in cycle.of("move", "moved"):
        if record["kind"] == "move":
            pct = float(record.get("speed_pct") or 0.0)
            points += [(record, here, 0.0), (record, here, pct)]
        else:
            here = by_seq.get(record["seq"], here)
            points += [(record, here, pct), (record, here, 0.0)]
    points.append((cycle.records[-1], here, 0.0))
    drawn = [(seconds_after(record, zero), at, speed) for record, at, speed in points if at is not None]
    return {
        "s": [s for s, _, _ in drawn],
        "joints": [np.round(np.degrees(at["joints"]), 2).tolist() for _, at, _ in drawn],
        "tool": [[round(row[3], 1) for row in at["where"][:3]] for _, at, _ in drawn],
        "speed": [speed for _, _, speed in drawn],
    }
