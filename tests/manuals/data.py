"""docs/DATA.md, the reference of the tables of many cells, made from their schema and ten queries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from daemon.fleet.layout import FILE
from daemon.fleet.schema import TABLES, VERSION, Column
from daemon.fleet.views import READ, SQL_KINDS


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

HEAD = """# The data of many cells

`facetctl runs collect CELL=RUNS... --into STORE` takes the finished runs of many cells into one store, a folder or a
bucket, and adds their rows to {count} tables of Parquet files, which DuckDB, Spark and pandas can read. This page is
made from the code that writes them (daemon/fleet/schema.py, tests/manuals/data.py): `make docs` writes it, and a test
checks it.

```
STORE/runs/<cell>/<run>/                               each run, as its cell wrote it (deploy/RUNS.md)
STORE/collected/<id>,<cell>,<run>.json                 the runs collected, with size and hash of each file
STORE/apart/<cell>/<run>/, .../<run>.txt               damaged runs, and what is wrong with them
STORE/tables/<table>/cell=<cell>/month=<YYYY-MM>/{file}
```

A file holds a cell's month, sorted by day, so that a reader of one day skips the rest by the file's own statistics.
With one file for each day the slowest question about all of `looks` took 10.3 s in place of 1.1 s, with the data of
forty cells and one year (`python -m tests.bench.hall --by-day`; processor time of two cores).

For an engine that needs a folder a day, one line of DuckDB makes it:
`COPY (FROM looks) TO 'days' (FORMAT parquet, PARTITION_BY (cell, day))`.

Lengths are mm, angles degrees, times UTC. The schema is version {version}; every file says its own in its metadata
(`facetd.schema`). A later version adds columns at the end of a table and changes none; a file of an earlier release
lacks columns, and readers fill them with null (`union_by_name` below; Spark's `mergeSchema`). Collecting into a month
that an earlier release began rewrites it in today's schema; facetd does not change one that a newer release began.

## Reading it

With DuckDB, make a view for each table, here `cycles`. The questions below need no more than these views:

```sql
{view};
```

With Spark, `spark.read.option("mergeSchema", "true").parquet("STORE/tables/cycles")`; with pandas,
`pandas.read_parquet("STORE/tables/cycles")`. Both have `cell` and `month` from the folders' names.

## The tables
"""


def document() -> str:
    """The page as text."""
    example = "CREATE VIEW cycles AS " + READ.format(files=f"'STORE/tables/cycles/*/*/{FILE}'")
    parts = [HEAD.format(count=len(TABLES), file=FILE, version=VERSION, view=example)]
    for name, table in TABLES.items():
        parts.append(f"### {name}: a row is {table.row}\n")
        parts.append("| column | type | unit | meaning | since |\n| --- | --- | --- | --- | --- |")
        parts.append("| `cell` | VARCHAR | | the cell's name, from the folder | 1 |")
        parts.append("| `month` | VARCHAR | | such as 2026-11, from the folder | 2 |")
        parts.append("\n".join(map(_line, table.columns)) + "\n")
    parts.append("## Example questions\n\nDuckDB answers each; `python -m tests.bench.hall` measures how fast.\n")
    for number, question in enumerate(QUESTIONS, 1):
        parts.append(f"**{number}. {question.text}**\n\n```sql\n{question.sql.strip()}\n```\n")
    return "\n".join(parts)


def _line(column: Column) -> str:
    return f"| `{column.name}` | {SQL_KINDS[column.kind]} | {column.unit} | {column.meaning} | {column.since} |"
