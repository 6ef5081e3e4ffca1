"""Queries over the runs of all cells, as SQL for DuckDB, and the views that they use. docs/DATA.md shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from daemon.fleet.layout import FILE
from daemon.fleet.schema import TABLES
from daemon.fleet.store import Store, StoreError
from daemon.store.folders import how_to_add

SQL_KINDS = {
    "text": "VARCHAR", "integer": "BIGINT", "real": "FLOAT", "flag": "BOOLEAN", "time": "TIMESTAMPTZ", "day": "DATE",
}  # fmt: skip
READ = (
    "FROM read_parquet({files}, union_by_name = true, hive_partitioning = true, "
    "hive_types = {{'cell': VARCHAR, 'month': VARCHAR}})"
)
VIEW = "CREATE VIEW {table} AS " + READ
STOPPED = "outcome = 'fault' AND cause = 'operator''s stop'"
UPGRADED = {
    "cycles": f""" REPLACE (CASE WHEN {STOPPED} THEN 'aborted' ELSE outcome END AS outcome,
    tried AND outcome NOT IN ('aborted', 'unfinished') AND ({STOPPED}) IS NOT TRUE AS tried)"""
}
"""Converts rows of earlier versions: a person's stop was a fault, and picks ended by a person or by the end of the run
counted as tried."""


@dataclass(frozen=True)
class Question:
    """text: the question in words; sql: its answer from the views."""

    text: str
    sql: str


QUESTIONS: Sequence[Question] = (
    Question("Which cell picks less than it used to?", """
WITH week AS (SELECT max(day) - 6 AS first FROM runs)
SELECT cell,
       round(100 * avg((outcome = 'picked')::INT) FILTER (day >= first), 2) AS this_week_pct,
       round(100 * avg((outcome = 'picked')::INT) FILTER (day < first), 2) AS before_pct
FROM cycles, week WHERE tried GROUP BY cell ORDER BY this_week_pct - before_pct"""),
    Question("Which part fails where?", """
SELECT cell, label, count(*) AS picks, count(*) FILTER (outcome <> 'picked') AS not_picked,
       round(100 * not_picked / picks, 2) AS not_picked_pct
FROM cycles WHERE tried AND label IS NOT NULL GROUP BY cell, label ORDER BY not_picked_pct DESC LIMIT 20"""),
    Question("Which place is missed, where?", """
SELECT cell, label, place, count(*) AS looked_at, count(*) FILTER (place_status = 'seen right') AS seen_right,
       round(quantile_cont(place_off_mm::DOUBLE, 0.95), 2) AS p95_mm,
       round(quantile_cont(place_off_deg::DOUBLE, 0.95), 2) AS p95_deg
FROM cycles WHERE place_status IN ('seen right', 'off', 'missing') GROUP BY cell, label, place
ORDER BY seen_right / looked_at, looked_at DESC, place LIMIT 20"""),
    Question("What stops the cells most, and which of them?", """
SELECT cause, count(*) AS times, count(DISTINCT cell) AS cells, mode(cell) AS most_at
FROM cycles WHERE cause IS NOT NULL GROUP BY cause ORDER BY times DESC"""),
    Question("Is the new model better than the last, on the same cells?", """
SELECT model, min(day) AS since, count(*) AS tried, count(DISTINCT cell) AS cells,
       round(100 * avg((outcome = 'picked')::INT), 2) AS picked_pct, round(avg(looks), 2) AS looks,
       round(median(predicted_mm::DOUBLE), 3) AS predicted_mm
FROM cycles WHERE tried GROUP BY model ORDER BY since"""),
    Question("Which cell's cameras drift?", """
WITH weekly AS (
    SELECT cell, date_trunc('week', day) AS week,
           sum(pitch_deg / pitch_sigma_deg ** 2) / sum(1 / pitch_sigma_deg ** 2) AS pitch,
           sum(roll_deg / roll_sigma_deg ** 2) / sum(1 / roll_sigma_deg ** 2) AS roll,
           sum(vergence_deg / vergence_sigma_deg ** 2) / sum(1 / vergence_sigma_deg ** 2) AS vergence
    FROM health WHERE pitch_sigma_deg > 0 GROUP BY cell, week)
SELECT cell, round(arg_max(pitch, week) - arg_min(pitch, week), 3) AS pitch_deg,
       round(arg_max(roll, week) - arg_min(roll, week), 3) AS roll_deg,
       round(arg_max(vergence, week) - arg_min(vergence, week), 3) AS vergence_deg
FROM weekly GROUP BY cell ORDER BY greatest(abs(pitch_deg), abs(roll_deg), abs(vergence_deg)) DESC"""),
    Question("Which cell gets darker, and how near is it to the limit?", """
SELECT cell, month, round(avg(least(darkness_left, darkness_right)), 1) AS brightness_p99
FROM health GROUP BY cell, month ORDER BY brightness_p99 LIMIT 20"""),
    Question("Which part was given a name that the pick then disproved?", """
SELECT label, picked_as, count(*) AS times, round(avg(confidence), 3) AS confidence, mode(cell) AS most_at
FROM parts WHERE picked_as IS NOT NULL AND label NOT IN ('unknown', picked_as)
GROUP BY label, picked_as ORDER BY times DESC"""),
    Question("Are names as certain as their confidence?", """
SELECT round(confidence::DOUBLE, 1) AS confidence_class, round(avg((label = picked_as)::INT), 3) AS was_right, count(*)
AS parts FROM parts WHERE picked_as IS NOT NULL AND label <> 'unknown' GROUP BY confidence_class
ORDER BY confidence_class"""),
    Question("How long does a look take, and has a release changed that?", """
SELECT release, cell, round(avg(ms), 1) AS mean_ms, round(approx_quantile(ms, 0.95)::DOUBLE, 1) AS p95_ms
FROM looks JOIN (SELECT cell, run, release FROM runs) USING (cell, run)
WHERE ms IS NOT NULL GROUP BY release, cell ORDER BY p95_ms DESC LIMIT 20"""),
    Question("Which arm arrives less and less accurately?", """
SELECT cell, month, round(avg(error_mm), 4) AS error_mm, round(avg(seconds), 2) AS seconds, count(*) AS moves
FROM moves WHERE sent GROUP BY cell, month ORDER BY error_mm DESC LIMIT 20"""),
)  # fmt: skip


def opened(store: Store, months: Sequence[str] | None = None) -> Any:
    """Open DuckDB with a view for each table. months: only these (`2026-11`). Raises StoreError."""
    try:
        import duckdb
    except ImportError:
        raise StoreError(f"questions to many cells need duckdb: {how_to_add('fleet')}") from None
    connection = duckdb.connect()
    connection.execute("SET TimeZone = 'UTC'")
    if not store.local:
        connection.register_filesystem(store.fs)
    for table, spec in TABLES.items():
        files = _files(store, table, months)
        columns = ", ".join(f"NULL::{SQL_KINDS[c.kind]} AS {c.name}" for c in spec.columns)
        none = f"SELECT {columns}, NULL::VARCHAR AS cell, NULL::VARCHAR AS month WHERE false"
        if files:
            rows = f"{READ.format(files=files)} UNION ALL BY NAME {none}"
            connection.execute(f"CREATE VIEW {table} AS SELECT *{UPGRADED.get(table, '')} FROM ({rows})")
        else:
            connection.execute(f"CREATE VIEW {table} AS {none}")
    return connection


def _files(store: Store, table: str, months: Sequence[str] | None) -> list[str]:
    found = store.fs.glob(store.path("tables", table, "cell=*", "month=*", FILE))
    chosen = [f for f in found if months is None or any(f"/month={month}/" in f for month in months)]
    return sorted(chosen) if store.local else sorted(store.fs.unstrip_protocol(f) for f in chosen)
