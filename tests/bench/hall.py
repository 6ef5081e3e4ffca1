"""A hall of cells: how fast a year of forty is written, and how soon each question is answered. Prints a table.

usage: python -m tests.bench.hall RUN... [--cells 40] [--days 365] [--picks 103] [--store FOLDER]
RUN: folders of recorded runs (such as `facetctl demo` leaves) whose picks the year is made of.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from datetime import date
from pathlib import Path

import numpy as np

from daemon.hall.layout import rows_of
from daemon.hall.page import write_hall
from daemon.hall.questions import QUESTIONS, opened
from daemon.hall.store import open_store
from daemon.review.page import read_digest
from tests.bench.runs import opened_ms
from tests.worlds.made_year import picks_of, write_year

TIMES = 3


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("runs", type=Path, nargs="+")
    parser.add_argument("--cells", type=int, default=40)
    parser.add_argument("--days", type=int, default=365)
    parser.add_argument("--picks", type=int, default=103, help="a cell and day")
    parser.add_argument("--store", type=Path)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as spare:
        folder = args.store or Path(spare)
        store = open_store(str(folder))
        if not store.names("tables"):
            write(args, store)
        size = sum(f.stat().st_size for f in folder.rglob("*.parquet"))
        print(f"on disk: {size / 1e6:.0f} MB in {sum(1 for _ in folder.rglob('*.parquet'))} files")
        print(f"{'wall s':>8} {'processor s':>12}  question (the better of {TIMES}, each in a fresh connection)")
        for question in QUESTIONS:
            spent = []
            for _ in range(TIMES):
                connection = opened(store)
                wall, cpu = time.perf_counter(), time.process_time()
                rows = connection.execute(question.sql).fetchall()
                spent.append((time.perf_counter() - wall, time.process_time() - cpu))
            best = min(spent)
            print(f"{best[0]:8.2f} {best[1]:12.2f}  {question.text} ({len(rows)} rows, first {rows[:1]})")
        wall, cpu = time.perf_counter(), time.process_time()
        page = write_hall(store, 7, Path(spare) / "hall.html")
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        found = opened_ms(page)
        print(f"a week: {page.stat().st_size / 1e3:.0f} kB, made in {wall:.1f} s ({cpu:.1f} s of processor), "
              f"opened in Chromium in {'none here' if found is None else np.round(found)} ms")  # fmt: skip


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
