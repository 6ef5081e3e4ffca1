"""Export a run for other tools: CSV tables (columns: below), or MCAP for Foxglove (extra `export`)."""

import base64
import csv
import json
from collections.abc import Sequence
from datetime import datetime
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.events.records import Record
from daemon.review.digest import Digest, parts_of, residual_mm
from daemon.store.folders import needing
from daemon.store.outside import FileError, read_below
from daemon.store.pictures import LARGEST_BYTES


def to_csv(run: Digest, out: Path, cell: str) -> list[Path]:
    """Write cycles.csv and looks.csv into the folder `out`. Raises OSError."""
    out.mkdir(parents=True, exist_ok=True)
    written = []
    for name, (columns, rows) in tables(run, cell).items():
        written.append(out / f"{name}.csv")
        with written[-1].open("w", newline="") as file:
            writer = csv.DictWriter(file, columns)
            writer.writeheader()
            writer.writerows(rows)
    return written


def to_mcap(folder: Path, run: Digest, out: Path) -> Path:
    """Write one MCAP file: images, poses of arm and parts, estimates, and the log. Raises FacetdError, OSError."""
    with needing("export", "MCAP"):
        from mcap.writer import Writer
    with out.open("wb") as file:
        writer: Any = Writer(file)
        writer.start(profile="", library="facetd")
        schemas = json.loads((resources.files("daemon.review") / "assets" / "mcap-schemas.json").read_text())
        channels: dict[str, int] = {}
        for record in run.records:
            stamp = nanoseconds_of(record)
            for topic, schema, message in messages_of(folder, record, stamp):
                if topic not in channels:
                    number = writer.register_schema(schema, "jsonschema", json.dumps(schemas[schema]).encode())
                    channels[topic] = writer.register_channel(topic, "json", number)
                writer.add_message(channels[topic], stamp, json.dumps(message).encode(), stamp)
        writer.finish()
    return out


INFO, WARNING, ERROR = 2, 3, 4


def messages_of(folder: Path, record: dict[str, Any], stamp: int) -> list[tuple[str, str, dict[str, Any]]]:
    """The messages of one record: (topic, schema, message)."""
    kind, when = record["kind"], {"sec": stamp // 10**9, "nsec": stamp % 10**9}
    found: list[tuple[str, str, dict[str, Any]]] = []
    if kind == "look":
        for camera, name in (record.get("images") or {}).items():
            try:
                content = read_below(folder, name, LARGEST_BYTES)
            except FileError:
                continue
            data = base64.b64encode(content).decode()
            message = {"timestamp": when, "frame_id": f"{camera}_eye", "format": "png", "data": data}
            found.append((f"/{camera}/image", "foxglove.CompressedImage", message))
        found += frame_transform(when, "world", "cyclopean", record.get("world_from_cyclopean"))
    elif kind == "moved":
        found += frame_transform(when, "world", "tool", record.get("where"))
    elif kind == "estimate":
        found += frame_transform(when, "world", f"part:{record.get('label')}", record.get("world_from_part"))
        keys = ("cycle", "stop", "label", "predicted_mm", "predicted_deg", "chi2")
        found.append(("/estimate", "facetd.Estimate", {k: record.get(k) for k in keys}))
    level = {"fault": ERROR, "refusal": WARNING, "gap": WARNING}.get(kind, INFO)
    text = {k: v for k, v in record.items() if k not in _BULKY}
    log = {"timestamp": when, "level": level, "name": kind, "message": json.dumps(text)}
    return [*found, ("/log", "foxglove.Log", log)]


_BULKY = ("v", "seq", "t", "mono_s", "scene", "where", "world_from_cyclopean", "world_from_part", "covariance",
          "target", "grasp", "joints", "images")  # fmt: skip


def frame_transform(
    when: dict[str, int], parent: str, child: str, rows: Sequence[Sequence[float]] | None
) -> list[tuple[str, str, dict[str, Any]]]:
    """A Foxglove message of one frame in another, or nothing where it is not recorded. rows: (4, 4), mm."""
    if not rows:
        return []
    parent_from_child = np.array(rows, float)
    x, y, z = parent_from_child[:3, 3] / 1000.0
    quaternion = _quaternion(parent_from_child[:3, :3])
    message = {
        "timestamp": when,
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": {"x": x, "y": y, "z": z},
        "rotation": dict(zip("xyzw", quaternion, strict=True)),
    }
    return [("/tf", "foxglove.FrameTransform", message)]


def _quaternion(rotation: Array) -> tuple[float, float, float, float]:
    vector = frames.vector_from_rotation(rotation)
    angle = float(np.linalg.norm(vector))
    axis = vector / angle if angle > 0 else vector
    x, y, z = (float(v) for v in axis * np.sin(angle / 2))
    return x, y, z, float(np.cos(angle / 2))


def nanoseconds_of(record: dict[str, Any]) -> int:
    """A record's time in nanoseconds since 1970, to the millisecond."""
    moment = datetime.fromisoformat(str(record.get("t") or "1970-01-01T00:00:00+00:00").replace("Z", "+00:00"))
    return int(moment.timestamp() * 1000) * 10**6


Row = dict[str, Any]

OF_CYCLE = (
    "started", "seconds", "label", "outcome", "looks", "predicted_mm", "predicted_deg", "true_mm", "true_deg", "why",
    "model", "calibration",
)  # fmt: skip
CYCLE_COLUMNS = ("cell", "day", "run", "cycle", *OF_CYCLE)
LOOK_COLUMNS = (
    "cell", "day", "run", "seq", "cycle", "stop", "purpose", "taken", "ms", "parts", "named", "labels",
    "best_confidence", "residual_mm", "epipolar_px", "noise", "predicted_mm", "chi2",
)  # fmt: skip


def tables(run: Digest, cell: str) -> dict[str, tuple[tuple[str, ...], list[Row]]]:
    """Each table's name -> its columns and its rows."""
    return {"cycles": (CYCLE_COLUMNS, cycle_rows(run, cell)), "looks": (LOOK_COLUMNS, look_rows(run, cell))}


def cycle_rows(run: Digest, cell: str) -> list[Row]:
    """Return one row a cycle, with CYCLE_COLUMNS."""
    return [
        {name: getattr(cycle, name) for name in OF_CYCLE}
        | {"cell": cell, "run": run.name, "day": cycle.started[:10]}
        | {"cycle": cycle.number, "seconds": round(cycle.seconds, 3)}
        for cycle in run.cycles
    ]


def look_rows(run: Digest, cell: str) -> list[Row]:
    """Return one row a look, with LOOK_COLUMNS."""
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
