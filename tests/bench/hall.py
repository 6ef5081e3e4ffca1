"""A hall of cells: how fast a year of forty is written, and how soon each question is answered. Prints a table.

usage: python -m tests.bench.hall RUN... [--cells 40] [--days 365] [--picks 103] [--store FOLDER] [--by-day]
RUN: folders of recorded runs (such as `facetctl demo` leaves) whose picks the year is made of. --by-day: of three
layouts (as it is, a row group a day, a folder a day) what a question to all cells and days costs, and one to a cell's
day.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from datetime import date
from itertools import pairwise
from pathlib import Path

import duckdb
import numpy as np
import pyarrow.parquet as pq

from daemon.fleet.layout import rows_of
from daemon.fleet.page import write_fleet_page
from daemon.fleet.store import open_store
from daemon.fleet.views import open_views
from daemon.review.page import read_digest
from tests.bench.runs import opened_ms
from tests.fakes.made_year import picks_of, write_year
from tests.manuals.data import QUESTIONS

TIMES = 3
ASKED = {"all": QUESTIONS[8].sql, "a cell's day": "SELECT count(*), avg(ms) FROM looks WHERE cell = 'cell07' AND day = "
         "(SELECT max(day) - 40 FROM runs WHERE cell = 'cell07')"}  # fmt: skip
"""The question that takes longest, of looks and runs; and one that reads a single day."""


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("runs", type=Path, nargs="+")
    parser.add_argument("--cells", type=int, default=40)
    parser.add_argument("--days", type=int, default=365)
    parser.add_argument("--picks", type=int, default=103, help="a cell and day")
    parser.add_argument("--store", type=Path)
    parser.add_argument("--by-day", action="store_true")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as spare:
        folder = args.store or Path(spare)
        store = open_store(str(folder))
        if not store.names("tables"):
            write(args, store)
        if args.by_day:
            by_day(folder, Path(spare))
            return
        size = sum(f.stat().st_size for f in folder.rglob("*.parquet"))
        print(f"on disk: {size / 1e6:.0f} MB in {sum(1 for _ in folder.rglob('*.parquet'))} files")
        print(f"{'wall s':>8} {'processor s':>12}  question (the better of {TIMES}, each in a fresh connection)")
        for question in QUESTIONS:
            spent = []
            for _ in range(TIMES):
                connection = open_views(store)
                wall, cpu = time.perf_counter(), time.process_time()
                rows = connection.execute(question.sql).fetchall()
                spent.append((time.perf_counter() - wall, time.process_time() - cpu))
            best = min(spent)
            print(f"{best[0]:8.2f} {best[1]:12.2f}  {question.text} ({len(rows)} rows, first {rows[:1]})")
        wall, cpu = time.perf_counter(), time.process_time()
        page = write_fleet_page(store, 7, Path(spare) / "fleet.html")
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        found = opened_ms(page)
        print(f"a week: {page.stat().st_size / 1e3:.0f} kB, made in {wall:.1f} s ({cpu:.1f} s of processor), "
              f"opened in Chromium in {'none here' if found is None else np.round(found)} ms")  # fmt: skip


def by_day(year: Path, spare: Path) -> None:
    """What a day of its own costs, in one file a month and in a file each."""
    print(f"{'files':>6} {'MB':>6} {'written s':>10} {'all: s':>7} {'processor':>10} {'one day: s':>11}   layout")
    for layout in ("as it is", "a row group a day", "a folder a day"):
        folder, spent = year, 0.0
        if layout != "as it is":
            folder, began = spare / layout.replace(" ", "-"), time.process_time()
            for file in year.glob("tables/*/*/*/*.parquet"):
                if file.parts[-4] in ("looks", "runs"):
                    split(file, folder / file.relative_to(year), layout == "a folder a day")
            spent = time.process_time() - began
        files = [f for table in ("looks", "runs") for f in folder.glob(f"tables/{table}/*/*/*.parquet")]
        took = {name: min(asked(folder, sql) for _ in range(TIMES)) for name, sql in ASKED.items()}
        print(f"{len(files):6} {sum(f.stat().st_size for f in files) / 1e6:6.0f} {spent:10.1f} {took['all'][0]:7.2f} "
              f"{took['all'][1]:10.2f} {took[list(ASKED)[1]][0]:11.3f}   {layout}", flush=True)  # fmt: skip


def split(month: Path, to: Path, folders: bool) -> None:
    """A month's file again, each day by itself."""
    rows = pq.ParquetFile(month).read()
    days = rows["day"].to_numpy()
    cut = [0, *(np.flatnonzero(days[1:] != days[:-1]) + 1), len(rows)]
    pieces = [rows.slice(start, end - start) for start, end in pairwise(cut)]
    if not folders:
        to.parent.mkdir(parents=True)
        with pq.ParquetWriter(to, rows.schema, compression="zstd") as writer:
            for piece in pieces:
                writer.write_table(piece)
        return
    for piece in pieces:
        folder = to.parent.parent / f"day={piece['day'][0].as_py()}"
        folder.mkdir(parents=True)
        pq.write_table(piece, folder / to.name, compression="zstd")


def asked(folder: Path, sql: str) -> tuple[float, float]:
    """Wall and processor time, opening the files included."""
    wall, cpu = time.perf_counter(), time.process_time()
    connection = duckdb.connect()
    for table in ("looks", "runs"):
        files = f"read_parquet('{folder}/tables/{table}/*/*/*.parquet', hive_partitioning = true)"
        connection.execute(f"CREATE VIEW {table} AS FROM {files}")
    connection.execute(sql).fetchall()
    return time.perf_counter() - wall, time.process_time() - cpu


def write(args: argparse.Namespace, store: object) -> None:
    picks = picks_of([rows_of(read_digest(folder)) for folder in args.runs])
    wall, cpu = time.perf_counter(), time.process_time()
    rows = sum(write_year(store, picks, args.cells, date(2026, 1, 1), args.days, args.picks))  # type: ignore[arg-type]
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    print(
        f"{args.cells * args.days * args.picks:,} picks, {rows:,} records written in {wall:.1f} s ({cpu:.1f} s of "
        f"processor): {rows / wall:,.0f} a second, {rows / cpu:,.0f} a second of processor"
    )


if __name__ == "__main__":
    main()
