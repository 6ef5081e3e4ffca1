"""Write the page of one cycle: the arm and the parts in 3-D, and its motion over time. One file; no network needed.

Needs the extra `plots`. The arm is drawn as the capsules that the sweep checks, from the joints that the controller
reported; parts as their measured facets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.cell.recorded_arm import RecordedArm, recorded_arm
from daemon.config import ConfigError
from daemon.events.records import Record
from daemon.review.digest import Cycle, Digest, parts_of
from daemon.review.page import read_digest, render
from daemon.store.files import write_atomically
from daemon.store.folders import how_to_add
from daemon.store.outside import FileError
from daemon.store.runs import RunError, kept_file

Json = dict[str, Any]

WAY_SAMPLES = 12
"""Points that draw the way of a joint-interpolated move."""


def write_cycle_page(folder: Path, number: int, out: Path) -> Path:
    """Write the page of cycle `number` of the run in `folder` to `out`; returns out.

    Raises RunError without that cycle or without the extra, OSError where the page cannot be written.
    """
    if find_spec("plotly") is None:
        raise RunError(f"the page of a cycle needs the library plotly: {how_to_add('plots')}")
    from plotly.offline import get_plotlyjs

    run = read_digest(folder)
    cycle = next((c for c in run.cycles if c.number == number), None)
    if cycle is None:
        known = f"cycles {run.cycles[0].number} to {run.cycles[-1].number}" if run.cycles else "no cycle"
        raise RunError(f"{folder}: no cycle {number}; the run has {known}")
    page = render("cycle", cycle_data(folder, run, cycle), {}, library=get_plotlyjs())
    write_atomically(out, page.encode())
    return out


def cycle_data(folder: Path, run: Digest, cycle: Cycle) -> Json:
    """The page's data: lengths in mm in the world, angles in degrees, times in seconds from the cycle's start."""
    arm, trouble = _arm_of(folder, run, cycle)
    zero = float(cycle.records[0]["mono_s"])
    moments = _moments(cycle, zero)
    arrivals = _arrivals(run, cycle)
    joints = _joints_over(arrivals, moments)
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
        "way": _way(arrivals, cycle, arm),
        "arm": _drawn(arm, joints),
        "table_z": None if arm is None else arm.table_z_mm,
        "keep_out": [] if arm is None else [[box.name, box.low_mm, box.high_mm] for box in arm.keep_out],
        "trouble": trouble,
    }


def _arm_of(folder: Path, run: Digest, cycle: Cycle) -> tuple[RecordedArm | None, str | None]:
    """The arm as it was configured, or why it cannot be drawn."""
    start: Record = {}
    for record in run.records:
        start = record if record["kind"] == "run_start" else start
        if record is cycle.records[0]:
            break
    if not start.get("config"):
        return None, "The run kept no configuration: the arm is not drawn."
    try:
        arm_file = kept_file(folder, start["arm"]) if start.get("arm") else None
        return recorded_arm(kept_file(folder, start["config"]), arm_file), None
    except (RunError, FileError, ConfigError) as error:
        return None, f"The arm is not drawn: {error}"


def _moments(cycle: Cycle, zero: float) -> list[Json]:
    """What can be chosen on the page: arrivals, looks, the gripper, refusals; each with the parts to draw: those of the
    last look, from the grasp on the held one with the tool."""
    found: list[Json] = []
    purpose, parts, held = None, list[Json](), None
    world_from_tool = np.eye(4)
    for record in cycle.records:
        kind, name = record["kind"], record["kind"]
        if kind == "move":
            purpose = record.get("purpose")
            continue
        if kind == "moved":
            off = record.get("error_mm")
            name = str(purpose)
            text = f"arrived: {name}" + ("" if off is None else f", {off:.2f} mm from the target")
            world_from_tool = np.array(record.get("where") or world_from_tool, float)
            parts = parts if held is None else held.at(world_from_tool)
        elif kind == "look":
            parts, held = _seen(record), None
            name = f"look: {record.get('purpose') or 'unnamed'}"
            text = f"{name}: {', '.join(part['label'] for part in parts) or 'nothing'}"
        elif kind == "hand":
            name = text = "gripper closes" if record.get("closed") else "gripper opens"
            held = _grasped(parts, world_from_tool) if record.get("closed") else None
        elif kind in ("refusal", "fault"):
            text = f"{kind}: {record.get('text')}"
        else:
            continue
        found.append(
            {"s": _seconds(record, zero), "seq": record["seq"], "kind": kind, "name": name, "text": text,
             "parts": [part | {"facets": [np.round(f, 1).tolist() for f in part["facets"]]} for part in parts]}
        )  # fmt: skip
    return found


def _seen(look: Record) -> list[Json]:
    """The parts of a look, their facets (N, 3) mm in the world."""
    pose = look.get("world_from_cyclopean")
    if pose is None:
        return []
    world_from_cyclopean = np.array(pose, float)
    return [
        {
            "label": part["label"],
            "facets": [
                frames.apply(world_from_cyclopean, np.array(facet["corners_mm"], float))
                for facet in part.get("facets") or []
            ],
        }
        for part in parts_of(look)
    ]


@dataclass(frozen=True, eq=False)
class _Held:
    """The parts of the last look as the gripper closed, the held one first."""

    parts: list[Json]
    world_from_tool: Array

    def at(self, world_from_tool: Array) -> list[Json]:
        """The parts when the tool is at a pose (4, 4): the held one has gone with it."""
        moved = world_from_tool @ frames.inverse(self.world_from_tool)
        first, *rest = self.parts
        return [first | {"facets": [frames.apply(moved, facet) for facet in first["facets"]]}, *rest]


def _grasped(parts: list[Json], world_from_tool: Array) -> _Held | None:
    """The part nearest to the tool centre point is held; None where no part was seen."""
    by_distance = sorted(
        (part for part in parts if part["facets"]),
        key=lambda part: np.linalg.norm(np.vstack(part["facets"]).mean(axis=0) - world_from_tool[:3, 3]),
    )
    return _Held(by_distance, world_from_tool) if by_distance else None


def _arrivals(run: Digest, cycle: Cycle) -> list[Record]:
    """The last arrival before the cycle, and those in it."""
    before = None
    for record in run.records:
        if record is cycle.records[0]:
            break
        before = record if record["kind"] == "moved" and _at(record) else before
    return [*([before] if before else []), *filter(_at, cycle.of("moved"))]


def _at(arrival: Record) -> bool:
    """Whether the arrival says where the arm was."""
    return bool(arrival.get("joints") and arrival.get("where"))


def _joints_over(arrivals: Sequence[Record], moments: list[Json]) -> Array:
    """(N, 6) rad: the joints at each of the moments; (0, 6) where the run recorded none."""
    if not arrivals:
        return np.empty((0, 6))
    at = np.searchsorted([r["seq"] for r in arrivals], [m["seq"] for m in moments], side="right") - 1
    return np.array([r["joints"] for r in arrivals])[np.maximum(at, 0)]


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
    drawn = [(_seconds(record, zero), at, speed) for record, at, speed in points if at is not None]
    return {
        "s": [s for s, _, _ in drawn],
        "joints": [np.round(np.degrees(at["joints"]), 2).tolist() for _, at, _ in drawn],
        "tool": [[round(row[3], 1) for row in at["where"][:3]] for _, at, _ in drawn],
        "speed": [speed for _, _, speed in drawn],
    }


def _way(arrivals: Sequence[Record], cycle: Cycle, arm: RecordedArm | None) -> list[list[float]]:
    """The way of the tool centre point, mm in the world: straight moves by their ends, joint moves sampled."""
    how = {after["seq"]: move.get("how") for move, after in pairwise(cycle.of("move", "moved"))}
    points: list[Array] = []
    for before, after in zip([None, *arrivals], arrivals, strict=False):
        if before is not None and arm is not None and how.get(after["seq"]) == "joint":
            ends = np.array(before["joints"]), np.array(after["joints"])
            shares = np.linspace(0, 1, WAY_SAMPLES + 1)[1:-1]
            points += [arm.kinematics.between(*ends, float(share))[:3, 3] for share in shares]
        points.append(np.array(after["where"], float)[:3, 3])
    return np.round(points, 1).tolist() if points else []


def _drawn(arm: RecordedArm | None, joints: Array) -> Json | None:
    """The arm's capsules at each moment: radius_mm (C,), ends (N, C, 2, 3)."""
    if arm is None or not len(joints):
        return None
    radius, ends = arm.capsules(joints)
    return {"radius": radius, "ends": np.round(ends, 1).tolist()}


def _seconds(record: Record, zero: float) -> float:
    return round(float(record["mono_s"]) - zero, 3)
