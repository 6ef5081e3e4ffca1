"""Write docs/DATA.md from the schema and the queries: `python -m daemon.fleet.document > docs/DATA.md`."""

from __future__ import annotations

from daemon.fleet.layout import FILE
from daemon.fleet.questions import QUESTIONS, SQL_KINDS, VIEW
from daemon.fleet.schema import TABLES, VERSION, Column

HEAD = """# The data of many cells

`facetctl runs collect CELL=RUNS... --into STORE` takes the finished runs of many cells into one store, a folder or a
bucket, and adds their rows to {count} tables of Parquet files, which DuckDB, Spark and pandas can read. This page is
made from the code that writes them (daemon/fleet/schema.py, daemon/fleet/questions.py): `make docs` writes it, and a
test checks it.

```
STORE/runs/<cell>/<run>/                               each run, as its cell wrote it (deploy/RUNS.md)
STORE/collected/<id>,<cell>,<run>.json                 the runs collected, with size and hash of each file
STORE/apart/<cell>/<run>/, .../<run>.txt               damaged runs, and what is wrong with them
STORE/tables/<table>/cell=<cell>/month=<YYYY-MM>/{file}
```

A file holds a cell's month, sorted by day, so that a reader of one day skips the rest by the file's own statistics.
We also tried a file a day, with forty cells and a year: the question to `looks` that takes longest, and one to a
cell's day (`python -m tests.bench.hall --by-day`; processor time of two cores, the files' opening included):

| layout | files | question to all | question to a day | disk |
| --- | --- | --- | --- | --- |
| a file a cell and month | 960 | 1.1 s | 0.08 s | 132 MB |
| that, with a row group a day | 960 | 3.7 s | 0.32 s | 241 MB |
| a file a cell and day | 29 194 | 10.3 s | 4.6 s | 289 MB |

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
    example = VIEW.format(table="cycles", files=f"'STORE/tables/cycles/*/*/{FILE}'")
    parts = [HEAD.format(count=len(TABLES), file=FILE, version=VERSION, view=example)]
    for name, table in TABLES.items():
        parts.append(f"### {name}: a row is {table.row}\n")
        parts.append("| column | type | unit | meaning | since |\n| --- | --- | --- | --- | --- |")
        parts.append("| `cell` | VARCHAR | | the cell's name, from the folder | 1 |")
        parts.append("| `month` | VARCHAR | | such as 2026-11, from the folder | 2 |")
        parts.append("\n".join(map(_line, table.columns)) + "\n")
    parts.append("## Ten questions\n\nEach is answered by DuckDB; `python -m tests.bench.hall` measures how soon.\n")
    for number, question in enumerate(QUESTIONS, 1):
        parts.append(f"**{number}. {question.text}**\n\n```sql\n{question.sql.strip()}\n```\n")
    return "\n".join(parts)


def _line(column: Column) -> str:
    return f"| `{column.name}` | {SQL_KINDS[column.kind]} | {column.unit} | {column.meaning} | {column.since} |"


if __name__ == "__main__":
    print(document(), end="")
