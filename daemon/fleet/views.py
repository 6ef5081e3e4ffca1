"""Views of the tables of all cells, for queries by DuckDB. docs/DATA.md shows some."""

from collections.abc import Sequence
from typing import Any

from daemon.events.codes import EARLIER_SUMMARIES
from daemon.fleet.layout import FILE
from daemon.fleet.schema import TABLES
from daemon.fleet.store import Store, StoreError
from daemon.store.folders import needing

SQL_KINDS = {
    "text": "VARCHAR", "integer": "BIGINT", "real": "FLOAT", "flag": "BOOLEAN", "time": "TIMESTAMPTZ", "day": "DATE",
}  # fmt: skip


def quoted(text: str) -> str:
    """A text as a literal of SQL."""
    return "'" + text.replace("'", "''") + "'"


READ = (
    "FROM read_parquet({files}, union_by_name = true, hive_partitioning = true, "
    "hive_types = {{'cell': VARCHAR, 'month': VARCHAR}})"
)
RENAMED = " ".join(f"WHEN {quoted(old)} THEN {quoted(code.summary)}" for old, code in EARLIER_SUMMARIES.items())
STOPPED = "outcome = 'fault' AND cause = 'operator''s stop'"
UPGRADED = {
    "cycles": f""" REPLACE (CASE WHEN {STOPPED} THEN 'aborted' ELSE outcome END AS outcome,
    tried AND outcome NOT IN ('aborted', 'unfinished') AND ({STOPPED}) IS NOT TRUE AS tried,
    CASE cause {RENAMED} ELSE cause END AS cause)"""
}
"""Converts rows of earlier versions: a person's stop was a fault, picks ended by a person or by the end of the run
counted as tried, and some causes had other names."""


def open_views(store: Store, months: Sequence[str] | None = None) -> Any:
    """Open DuckDB with a view for each table. months: only these (`2026-11`). Raises StoreError."""
    with needing("fleet", "questions to many cells", StoreError):
        import duckdb
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
