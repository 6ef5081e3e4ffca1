"""Convert a run's records to rows, and write the tables' Parquet files into the store, with pyarrow (extra `fleet`).

One file a cell and month, sorted by day so that a reader skips the other days: a file a cell and day would be 14 600
files a year for forty cells, and a query over all of them would spend its time on opening files.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from daemon.events.records import Record
from daemon.fleet.schema import TABLES, VERSION, Column
from daemon.fleet.store import Store, StoreError
from daemon.review.digest import Cycle, Digest, cameras_of, duration_s, in_use, parts_of, place_mm, short_hash
from daemon.review.failure_causes import RunContext, causes, causes_of_record, run_context
from daemon.review.production import interventions
from daemon.review.replay import NEAR_MM
from daemon.review.set_downs import PartSetDown, set_downs_of
from daemon.store.folders import needing

if TYPE_CHECKING:
    import pyarrow as pa

Row = dict[str, Any]
Rows = dict[str, Any]
"""Rows of one or several runs: table name -> pyarrow table."""
FILE = "rows.parquet"
VERSION_KEY = b"facetd.schema"
ROWS_A_GROUP = 16_384
"""Some days of a cell's parts: a reader of one day reads little more."""
PROVEN = "picked"


def arrow() -> tuple[Any, Any]:
    """pyarrow and pyarrow.parquet. Raises StoreError without the extra."""
    with needing("fleet", "tables of many cells", StoreError):
        import pyarrow as pa
        import pyarrow.compute
        import pyarrow.parquet as pq
    return pa, pq


def schema_of(table: str) -> pa.Schema:
    """The pyarrow schema of a table, with its version."""
    pa, _ = arrow()
    kinds = {
        "text": pa.string(), "integer": pa.int64(), "real": pa.float32(), "flag": pa.bool_(),
        "time": pa.timestamp("ms", tz="UTC"), "day": pa.date32(),
    }  # fmt: skip
    fields = [pa.field(c.name, kinds[c.kind]) for c in TABLES[table].columns]
    return pa.schema(fields, metadata={VERSION_KEY: str(VERSION).encode()})


def rows_of(run: Digest) -> Rows:
    """Convert one run to rows, by table."""
    pa, _ = arrow()
    context = run_context(run.cycles)
    made = {
        "runs": [_run(run)] if run.records else [],
        "cycles": [_cycle(c, context) for c in run.cycles],
        "looks": _looks(run),
        "parts": _parts(run),
        "moves": _moves(run),
        "faults": [_fault(r) for r in run.of("fault", "refusal", "gap", "clock")],
        "health": [_health(r) for r in run.of("look")],
    }
    return {name: _table(pa, name, run.name, rows) for name, rows in made.items()}


def _table(pa: Any, name: str, run: str, rows: Sequence[Row]) -> pa.Table:
    """Build a pyarrow table; absent values, and values of another kind than their column, become null."""
    columns = TABLES[name].columns
    times = np.array([utc_time(str(row["t"])) for row in rows], "datetime64[ms]")
    given = {"t": times, "day": times.astype("datetime64[D]"), "run": [run] * len(rows)}
    schema = schema_of(name)
    arrays = [
        pa.array(given.get(c.name) if c.name in given else [_valued(row.get(c.name), c) for row in rows], kind.type)
        for c, kind in zip(columns, schema, strict=True)
    ]
    return pa.Table.from_arrays(arrays, schema=schema)


def utc_time(t: str) -> datetime:
    """Parse a time as UTC without zone. A small z is valid (RFC 3339)."""
    at = datetime.fromisoformat(t.upper())
    return at if at.tzinfo is None else at.astimezone(UTC).replace(tzinfo=None)


def _valued(value: Any, column: Column) -> Any:
    match column.kind:
        case "text":
            return None if value is None else str(value)
        case "flag":
            return value if isinstance(value, bool) else None
        case "integer":
            return int(value) if isinstance(value, (int, float)) else None
        case _:
            return float(value) if isinstance(value, (int, float)) else None


def _run(run: Digest) -> Row:
    start = run.start or {}
    return {
        "t": run.records[0]["t"],
        "release": start.get("version"),
        "kind": start.get("cell"),
        "computer": start.get("name"),
        "utc_offset_s": start.get("utc_offset_s"),
        "seconds": duration_s(run.records),
        "records": len(run.records),
        "cycles": len(run.cycles),
        "interventions": interventions(run),
        "ended": run.end is not None,
        "model": run.model,
        "calibration": run.kept("calibration"),
        "config": run.kept("config"),
        "times_life": run.times_life,
    }


def _cycle(cycle: Cycle, run: RunContext) -> Row:
    found = causes(cycle, run)[:1]
    set_down = next(reversed(list(set_downs_of(cycle))), None)
    plain = ("seconds", "label", "outcome", "why", "looks", "predicted_mm", "predicted_deg", "true_mm", "true_deg")
    return {
        **{name: getattr(cycle, name) for name in (*plain, "model", "calibration")},
        "eyes": cycle.cameras,
        "t": cycle.started,
        "cycle": cycle.number,
        "target": cycle.records[0].get("target"),
        "tried": cycle.tried,
        "cause": next((c.code.summary for c in found), None),
        **({} if set_down is None else _placed(set_down)),
    }


def _placed(made: PartSetDown) -> Row:
    off = {"place_off_mm": made.off_mm, "place_off_deg": made.off_deg}
    return {"place": made.place, "place_status": made.status, **off}


def _looks(run: Digest) -> list[Row]:
    estimates = {id(s.look): s.estimate or {} for s in run.stops}
    rows = []
    for record, kept in in_use(run.records):
        if record["kind"] != "look":
            continue
        scene, estimate = record.get("scene") or {}, estimates.get(id(record), {})
        images, parts = record.get("images") or {}, parts_of(record)
        rows.append(
            {
                **{name: record.get(name) for name in ("seq", "cycle", "t", "stop", "purpose")},
                "whole": record.get("whole", True),
                "ms": scene.get("ms"),
                "parts": len(parts),
                "named": sum(p["label"] != "unknown" for p in parts),
                "predicted_mm": estimate.get("predicted_mm"),
                "chi2": estimate.get("chi2"),
                "noise": (record.get("health") or {}).get("noise"),
                "left": images.get("left"),
                "right": images.get("right"),
                "model": short_hash(kept.get("model")),
                "eyes": cameras_of(record),
            }
        )
    return rows


def _parts(run: Digest) -> list[Row]:
    proofs = proofs_of(run)
    return [
        _part(look, number, part, proven_label(part, look, proofs.get(id(look))))
        for look in run.of("look")
        for number, part in enumerate(parts_of(look))
    ]


def _part(look: Record, number: int, part: Record, picked_as: str | None) -> Row:
    same = ("label", "confidence", "match_ratio", "activation", "runner_up", "ambiguous", "cause", "residual_mm")
    pose, covariance = part.get("cyclopean_from_part"), part.get("covariance")
    place = None if pose is None else np.array(pose, float)[:3, 3]
    world = place_mm(part, look)
    return {
        **{name: look.get(name) for name in ("seq", "cycle", "t")},
        **{name: part.get(name) for name in same},
        "part": number,
        "picked_as": picked_as,
        "facets": len(part.get("facets") or []),
        "sigma_mm": None if covariance is None else float(np.sqrt(max(np.trace(np.array(covariance)[:3, :3]), 0.0))),
        "depth_mm": None if place is None else float(np.linalg.norm(place)),
        **({} if world is None else dict(zip(("x_mm", "y_mm", "z_mm"), world, strict=True))),
    }


Proof = tuple[str, np.ndarray[Any, Any]]


def proofs_of(run: Digest) -> dict[int, Proof]:
    """id of a look's record -> (label, (3,) world mm) of the part that the pick then held. Only looks before the
    gripper closed: afterwards the part is somewhere else."""
    found: dict[int, Proof] = {}
    for cycle in run.cycles:
        last = next((s.estimate for s in reversed(cycle.stops) if s.estimate), None)
        if cycle.outcome != PROVEN or last is None or not last.get("world_from_part") or cycle.label is None:
            continue
        place = np.array(last["world_from_part"], float)[:3, 3]
        found |= {id(s.look): (cycle.label, place) for s in cycle.stops if s.look["seq"] < last["seq"]}
    return found


def proven_label(part: Record, look: Record, proof: Proof | None) -> str | None:
    """The name under which the pick held this part; None where the pick did not prove it."""
    place = place_mm(part, look)
    if proof is None or place is None or np.linalg.norm(place - proof[1]) > NEAR_MM:
        return None
    return proof[0]


def _moves(run: Digest) -> list[Row]:
    rows: list[Row] = []
    for record in run.of("move", "moved", "held_back"):
        if record["kind"] == "move":
            place = [row[3] for row in (record.get("target") or [])[:3]] or [None] * 3
            same = ("seq", "cycle", "t", "how", "purpose", "speed_pct")
            rows.append(
                {name: record.get(name) for name in same}
                | {"sent": record.get("sent", True)}
                | dict(zip(("x_mm", "y_mm", "z_mm"), place, strict=True))
            )
        elif rows and record["kind"] == "moved":
            rows[-1] |= {name: record.get(name) for name in ("seconds", "error_mm", "error_deg")}
        elif rows and record.get("what") == "move":
            rows[-1]["sent"] = False
    return rows


def _fault(record: Record) -> Row:
    text = record.get("text") or record.get("why") or record.get("jump_s")
    return {**{name: record.get(name) for name in ("seq", "cycle", "t", "kind")}, "code": _code(record), "text": text}


def _code(record: Record) -> str | None:
    """The code of a fault; of one that names measures of images, the cause that the first one indicates."""
    if record.get("findings"):
        return str(next(causes_of_record(record)).code)
    return record.get("code") or record.get("rule")


def _health(look: Record) -> Row:
    return (look.get("health") or {}) | {name: look.get(name) for name in ("seq", "cycle", "t")}


def add_rows(store: Store, cell: str, runs: Iterable[Rows]) -> None:
    """Add runs to the tables, replacing rows of the same run. Raises StoreError, OSError."""
    pa, _ = arrow()
    given = list(runs)
    for name in TABLES if given else ():
        added = pa.concat_tables([run[name] for run in given])
        names = pa.concat_tables([run["runs"] for run in given])["run"]
        months = added["day"].to_numpy().astype("datetime64[M]")
        for month in np.unique(months):
            add_month(store, name, cell, str(month), added.filter(months == month), names)


def add_month(store: Store, name: str, cell: str, month: str, rows: pa.Table, instead_of: Any = ()) -> None:
    """Add rows to the file of one table, cell and month in place of those of the runs `instead_of`. Raises StoreError
    where a newer release wrote the file: its additional columns would be lost."""
    pa, pq = arrow()
    parts = ("tables", name, f"cell={cell}", f"month={month}", FILE)
    path = store.path(*parts)
    if store.fs.exists(path):
        with store.fs.open(path, "rb") as file:
            before = pq.ParquetFile(file).read()
        version = int((before.schema.metadata or {}).get(VERSION_KEY, b"1"))
        if version > VERSION:
            raise StoreError(f"{path}: is of schema {version}, this release knows {VERSION}: collect with a newer one")
        kept = before.filter(pa.compute.invert(pa.compute.is_in(before["run"], pa.array(instead_of, pa.string()))))
        together = pa.concat_tables([_in_present_schema(kept, name), rows])
        rows = together.sort_by([("day", "ascending"), ("t", "ascending")])
    with store.replacing(*parts) as file:
        pq.write_table(rows, file, compression="zstd", row_group_size=ROWS_A_GROUP, store_schema=True)


def _in_present_schema(rows: pa.Table, name: str) -> pa.Table:
    """Convert rows of an earlier version to today's schema; absent columns become null."""
    pa, _ = arrow()
    schema = schema_of(name)
    present = set(rows.column_names)
    arrays = [rows[f.name].cast(f.type) if f.name in present else pa.nulls(len(rows), f.type) for f in schema]
    return pa.Table.from_arrays(arrays, schema=schema)
