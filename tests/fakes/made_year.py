"""A year of many cells, resampled from recorded picks, each cell with its own weaknesses.

The rows are from real runs; order, dates and weaknesses are invented.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, timedelta
from typing import Any

import numpy as np
import pyarrow as pa

from daemon.fleet.layout import add_month, schema_of
from daemon.fleet.schema import TABLES
from daemon.fleet.store import Store

DAY_MS = 86_400_000
OF_PICKS = tuple(name for name in TABLES if name != "runs")
SILENT, FAULTY, WORSE = 29, 17, 11
"""Numbers of cells: one without data for the last days; one with faults from summer on; one with fewer picks lately."""
STOPS = ("part slipped", "looks like another", "out of the arm's reach", "camera knocked", "estimate too uncertain")


@dataclass(frozen=True, eq=False)
class Picks:
    """Recorded picks: each table's rows in the order of the picks, and where each pick's rows begin (picks + 1,)."""

    rows: Mapping[str, pa.Table]
    begin: Mapping[str, Any]
    began_ms: Any


def picks_of(runs: Sequence[Mapping[str, pa.Table]]) -> Picks:
    """The picks of recorded runs, as daemon.fleet.layout.rows_of gives them."""
    rows: dict[str, list[pa.Table]] = {name: [] for name in OF_PICKS}
    lengths: dict[str, list[int]] = {name: [] for name in OF_PICKS}
    began: list[int] = []
    for run in runs:
        for number, at in zip(run["cycles"]["cycle"].to_pylist(), _ms(run["cycles"]["t"]), strict=True):
            began.append(int(at))
            for name in OF_PICKS:
                of = run[name].filter(pa.compute.equal(run[name]["cycle"], number))
                rows[name].append(of)
                lengths[name].append(len(of))
    return Picks(
        {name: pa.concat_tables(of).combine_chunks() for name, of in rows.items()},
        {name: np.concatenate([[0], np.cumsum(of)]) for name, of in lengths.items()},
        np.array(began),
    )


def write_year(
    store: Store, picks: Picks, cells: int, first: date, days: int, a_day: int, only: Sequence[int] | None = None
) -> Iterator[int]:
    """Write `cells` cells, `a_day` picks on each of `days` days (only: on those, by number); gives how many rows each
    cell and month has."""
    months: dict[str, list[date]] = {}
    for day in (first + timedelta(k) for k in (range(days) if only is None else only)):
        months.setdefault(f"{day:%Y-%m}", []).append(day)
    for cell in range(cells):
        for month, of in months.items():
            of = of[:-3] if cell == SILENT and of[-1] == first + timedelta(days=days - 1) else of
            rng = np.random.default_rng((cell, of[0].toordinal()))
            tables = _month(picks, cell, (of[0] - first).days / 365, of, a_day, rng)
            for name, rows in tables.items():
                add_month(store, name, f"cell{cell + 1:02d}", month, rows)
            yield sum(map(len, tables.values()))


def _month(picks: Picks, cell: int, year: float, days: Sequence[date], a_day: int, rng: Any) -> dict[str, pa.Table]:
    count, span = a_day * len(days), DAY_MS // a_day
    drawn = rng.integers(len(picks.began_ms), size=count)
    epoch = (days[0] - date(1970, 1, 1)).days
    day = epoch + np.arange(count) // a_day
    number = np.arange(count) % a_day + 1
    began = day * DAY_MS + (number - 1) * span
    names = pa.array([f"{d:%Y%m%d}T000000Z" for d in days])
    ill = _illness(picks, cell, year, drawn, rng)
    found = {}
    for name in OF_PICKS:
        begin = picks.begin[name]
        lengths = (begin[1:] - begin[:-1])[drawn]
        of_pick = np.repeat(np.arange(count), lengths)
        within = np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        rows = picks.rows[name].take(pa.array(begin[:-1][drawn][of_pick] + within))
        values = {c: rows[c] for c in rows.column_names}
        values["t"] = pa.array(_ms(rows["t"]) - picks.began_ms[drawn][of_pick] + began[of_pick])
        values["day"] = pa.array(day[of_pick].astype("int32"))
        values["run"] = names.take(pa.array(day[of_pick] - epoch))
        values["cycle"] = pa.array(number[of_pick])
        _suffer(name, values, of_pick, ill, rng)
        found[name] = pa.table({f.name: _as(values[f.name], f.type) for f in schema_of(name)}, schema=schema_of(name))
    if cell == FAULTY and year > 0.6:
        found["faults"] = _faults(found["cycles"].filter(pa.array(ill["failed"])))
    found["runs"] = _runs(cell, days, a_day, names, found)
    return found


def _illness(picks: Picks, cell: int, year: float, drawn: Any, rng: Any) -> dict[str, Any]:
    """The weakness of a cell: parts that slip, a fading lamp, cameras that drift, a model that changed in summer."""
    labels = picks.rows["cycles"]["label"].to_numpy(zero_copy_only=False)[drawn]
    known = sorted({str(label) for label in labels})
    rate = np.full(len(drawn), 0.004 + 0.002 * (cell % 5)) * (0.6 if year > 0.5 else 1.0)
    rate[labels == known[cell % len(known)]] += 0.02 if cell % 7 == 3 else 0.0
    return {
        "failed": rng.random(len(drawn)) < rate + (0.08 if cell == WORSE and year > 0.9 else 0.0),
        "cause": pa.array(STOPS).take(pa.array(rng.integers(len(STOPS), size=len(drawn)))),
        "light": 1.0 - (0.86 * year if cell % 9 == 4 else 0.05 * year),
        "pitch": 0.4 * year if cell % 13 == 6 else 0.01 * year,
        "model": "1f2e3d4c" if year < 0.5 else "9a8b7c6d",
        "slack": 1.0 + (2.0 * year if cell % 11 == 8 else 0.0),
    }


def _suffer(name: str, values: dict[str, Any], of_pick: Any, ill: Mapping[str, Any], rng: Any) -> None:
    for column, given in values.items():
        if isinstance(given.type, pa.DataType) and pa.types.is_floating(given.type):
            noise = 1 + 0.02 * rng.standard_normal(len(given), dtype=np.float32)
            if name == "health" and column.startswith("darkness"):
                noise *= ill["light"]
            if name == "moves" and column == "error_mm":
                noise *= ill["slack"]
            values[column] = pa.compute.multiply(given, pa.array(noise))
    if name == "health":
        values["pitch_deg"] = pa.compute.add(values["pitch_deg"], pa.scalar(ill["pitch"], pa.float32()))
    if "model" in values:
        values["model"] = pa.repeat(ill["model"], len(of_pick))
    if name == "cycles":
        failed = pa.array(ill["failed"])
        values["outcome"] = pa.compute.if_else(failed, "missed", values["outcome"])
        values["cause"] = pa.compute.if_else(failed, ill["cause"], values["cause"])
    if name == "parts":
        failed = pa.array(ill["failed"][of_pick])
        values["picked_as"] = pa.compute.if_else(failed, pa.scalar(None, pa.string()), values["picked_as"])
        confused = pa.array(ill["failed"][of_pick] & (rng.random(len(of_pick)) < 0.1))
        values["label"] = pa.compute.if_else(confused, values["runner_up"], values["label"])


def _faults(cycles: pa.Table) -> pa.Table:
    same = {"seq": 0, "kind": "fault", "code": "arm_lost", "text": "arm_lost: the controller does not answer"}
    given = {name: cycles[name] for name in ("day", "run", "cycle", "t")}
    columns = given | {name: pa.repeat(value, len(cycles)) for name, value in same.items()}
    schema = schema_of("faults")
    return pa.table({f.name: _as(columns[f.name], f.type) for f in schema}, schema=schema)


def _runs(cell: int, days: Sequence[date], a_day: int, names: pa.Array, found: Mapping[str, pa.Table]) -> pa.Table:
    same = {
        "release": "0.1.0", "kind": "simulated", "computer": f"cell{cell + 1:02d}", "utc_offset_s": 0,
        "seconds": 86_400.0, "records": sum(map(len, found.values())) // len(days), "cycles": a_day,
        "interventions": cell % 3, "ended": True, "model": found["cycles"]["model"][0].as_py(), "calibration": "0c",
        "config": "0d", "times_life": 1.0,
    }  # fmt: skip
    at = [(day - date(1970, 1, 1)).days for day in days]
    given = {"day": pa.array(at, pa.int32()), "run": names, "t": pa.array([d * DAY_MS for d in at])}
    columns = given | {name: pa.repeat(value, len(days)) for name, value in same.items()}
    schema = schema_of("runs")
    return pa.table({f.name: _as(columns[f.name], f.type) for f in schema}, schema=schema)


def _ms(times: Any) -> Any:
    return times.cast(pa.int64()).to_numpy()


def _as(values: Any, kind: Any) -> Any:
    return values if values.type == kind else values.cast(kind)
