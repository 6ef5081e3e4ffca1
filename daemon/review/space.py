"""The cell in space, from a run's records: where the arm was, its path, the parts as measured. mm in the world.

The arm is drawn as the capsules that the sweep checks, from the joints that the controller reported.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.cell.recorded_arm import RecordedArm, recorded_arm
from daemon.events.records import Json, Record
from daemon.review.digest import parts_of
from daemon.store.outside import FileError
from daemon.store.runs import RunError, kept_file
from daemon.store.yamlfile import ConfigError

WAY_SAMPLES = 12
"""Points that draw the way of a joint-interpolated move."""


def arm_of(folder: Path, start: Record) -> tuple[RecordedArm | None, str | None]:
    """The arm as configured when the run in `folder` began with this record, or why it cannot be drawn."""
    if not start.get("config"):
        return None, "The run kept no configuration: the arm is not drawn."
    try:
        arm_file = kept_file(folder, start["arm"]) if start.get("arm") else None
        return recorded_arm(kept_file(folder, start["config"]), arm_file, start.get("gripper")), None
    except (RunError, FileError, ConfigError) as error:
        return None, f"The arm is not drawn: {error}"


def moments_of(records: Iterable[Record], zero: float) -> list[Json]:
    """Arrivals, looks, gripper commands, refusals, each with the parts to draw: those of the last look, after the grasp
    the held one with the tool. zero: mono_s at second 0."""
    found: list[Json] = []
    purpose, parts, held = None, list[Json](), None
    world_from_tool = np.eye(4)
    for record in records:
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
        elif kind == "laid_down":
            name, text = "laid on the table", f"laid on the table: {record.get('status')}"
        else:
            continue
        found.append(
            {"s": seconds_after(record, zero), "seq": record["seq"], "kind": kind, "name": name, "text": text,
             "parts": [part | {"facets": [np.round(f, 1).tolist() for f in part["facets"]]} for part in parts]}
        )  # fmt: skip
    return found


def _seen(look: Record) -> list[Json]:
    """The parts of a look, their facets (N, 3) mm in the world."""
    pose = look.get("world_from_cyclopean")
    if pose is None:
        return []
    world_from_cyclopean = np.array(pose, float)

    def in_world(facet: Json) -> Array:
        return frames.apply(world_from_cyclopean, np.array(facet["corners_mm"], float))

    return [
        {"label": part["label"], "facets": [in_world(facet) for facet in part.get("facets") or []]}
        for part in parts_of(look)
    ]


@dataclass(frozen=True, eq=False)
class _Held:
    """The parts of the last look when the gripper closed, the held one first."""

    parts: list[Json]
    world_from_tool: Array

    def at(self, world_from_tool: Array) -> list[Json]:
        """The parts with the tool at a pose (4, 4): the held one moves with it."""
        moved = world_from_tool @ frames.inverse(self.world_from_tool)
        first, *rest = self.parts
        return [first | {"facets": [frames.apply(moved, facet) for facet in first["facets"]]}, *rest]


def _grasped(parts: list[Json], world_from_tool: Array) -> _Held | None:
    """The held part: the one nearest to the tool centre point; None where no part was seen."""
    by_distance = sorted(
        (part for part in parts if part["facets"]),
        key=lambda part: np.linalg.norm(np.vstack(part["facets"]).mean(axis=0) - world_from_tool[:3, 3]),
    )
    return _Held(by_distance, world_from_tool) if by_distance else None


def is_arrival(record: Record) -> bool:
    """Whether a move ended here with a known pose."""
    return bool(record["kind"] == "moved" and record.get("joints") and record.get("where"))


def joints_over(arrivals: Sequence[Record], moments: list[Json]) -> Array:
    """(N, 6) rad: the joints at each moment; (0, 6) where the run has none."""
    if not arrivals:
        return np.empty((0, 6))
    at = np.searchsorted([r["seq"] for r in arrivals], [m["seq"] for m in moments], side="right") - 1
    return np.array([r["joints"] for r in arrivals])[np.maximum(at, 0)]


def way_of(arrivals: Sequence[Record], records: Iterable[Record], arm: RecordedArm | None) -> list[list[float]]:
    """The path of the tool centre point, mm in the world: straight moves by their ends, joint moves sampled."""
    moves = pairwise(record for record in records if record["kind"] in ("move", "moved"))
    how = {after["seq"]: move.get("how") for move, after in moves}
    points: list[Array] = []
    for before, after in zip([None, *arrivals], arrivals, strict=False):
        if before is not None and arm is not None and how.get(after["seq"]) == "joint":
            ends = np.array(before["joints"]), np.array(after["joints"])
            shares = np.linspace(0, 1, WAY_SAMPLES + 1)[1:-1]
            points += [arm.kinematics.between(*ends, float(share))[:3, 3] for share in shares]
        points.append(np.array(after["where"], float)[:3, 3])
    return np.round(points, 1).tolist() if points else []


def space_of(arm: RecordedArm | None, joints: Array, way: list[list[float]]) -> Json:
    """What is the same at every moment, and the arm's capsules at joints (N, 6) rad: radius (C,), ends (N, C, 2, 3)."""
    if arm is None:
        return {"way": way, "arm": None, "table_z": None, "keep_out": []}
    limits, bodies = arm.settings.limits, None
    if len(joints):
        radius, ends = arm.capsules(joints)
        bodies = {"radius": radius, "ends": np.round(ends, 1).tolist()}
    keep_out = [[box.name, box.low_mm, box.high_mm] for box in limits.keep_out]
    return {"way": way, "arm": bodies, "table_z": limits.table_z_mm, "keep_out": keep_out}


def seconds_after(record: Record, zero: float) -> float:
    """Seconds of a record after mono_s zero, to the millisecond."""
    return round(float(record["mono_s"]) - zero, 3)
