"""Commands `facetctl review`, `export` and `tail`, which read runs. They need no daemon."""

from __future__ import annotations

import argparse
import os
import socket
import sys
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

from daemon.errors import DONE, printable
from daemon.events.records import Record
from daemon.quantities import whole
from daemon.review.record_words import record_words
from daemon.store import folders
from daemon.store.files import being_written
from daemon.store.runs import RUN, find_run, follow


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the commands to facetctl."""
    review = with_run(command(subparsers, "review", _review, "one HTML page of a run"))
    where = "where to write it (default: into the run folder, or the current one where you may not write there)"
    review.add_argument("--out", type=Path, metavar="PAGE.html", help=where)
    review.add_argument("--against", metavar="RUN", help="compare it with another run")
    review.add_argument("--cycle", type=whole, metavar="N", help="one cycle in 3-D and over time (extra `plots`)")
    review.add_argument("--week", action="store_true", help="one page for the week that ended with it, in runs/")
    export = with_run(command(subparsers, "export", _export, "a run for other tools"))
    kind = export.add_mutually_exclusive_group(required=True)
    kind.add_argument("--csv", action="store_true", help="cycles.csv and looks.csv")
    kind.add_argument("--mcap", action="store_true", help="for Foxglove: images, transforms, log (extra `export`)")
    export.add_argument("--out", type=Path, help="folder, or file for --mcap (default: as review)")
    export.add_argument("--cell", default=socket.gethostname(), help="this cell's name in the tables")
    tail = with_run(command(subparsers, "tail", _tail, "follow a run live, a line a step"))
    tail.add_argument("--once", action="store_true", help="print what is there and end")


def command(
    subparsers: argparse._SubParsersAction[argparse.ArgumentParser],
    name: str,
    job: Callable[[argparse.Namespace], int],
    text: str,
) -> argparse.ArgumentParser:
    """Add a command that reads runs, with the option --runs."""
    parser = subparsers.add_parser(name, help=text)
    parser.add_argument("--runs", type=Path, default=None, metavar="DIR", help="where the run folders are")
    parser.set_defaults(run=job)
    return parser


def with_run(parser: argparse.ArgumentParser) -> argparse.ArgumentParser:
    """Add the argument RUN to a command."""
    parser.add_argument("folder", metavar="RUN", nargs="?", default="latest", help="a run folder, its name or `latest`")
    return parser


def folder_of(args: argparse.Namespace, name: str | None = None) -> Path:
    """The folder of the named run. Raises RunError."""
    return find_run(args.runs or folders.runs_last_used(), name or args.folder)


def _home(folder: Path) -> Path:
    """Folder of a page without --out: the given one, or the current one where only the daemon may write there."""
    return folder if os.access(folder, os.W_OK) else Path()


def _review(args: argparse.Namespace) -> int:
    from daemon.review.page import write_page

    folder = folder_of(args)
    if args.week:
        from daemon.review.week import write_week

        print(write_week(folder.parent, folder, args.out or _home(folder.parent) / "week.html"))
        return DONE
    if args.cycle is not None:
        from daemon.review.cycle_page import write_cycle_page

        print(write_cycle_page(folder, args.cycle, args.out or _home(folder) / f"cycle-{args.cycle}.html"))
        return DONE
    against = folder_of(args, args.against) if args.against else None
    print(write_page(folder, args.out or _home(folder) / "report.html", against))
    return DONE


def _export(args: argparse.Namespace) -> int:
    from daemon.review import export
    from daemon.review.page import read_digest

    folder = folder_of(args)
    run = read_digest(folder)
    if args.mcap:
        written = [export.to_mcap(folder, run, args.out or _home(folder) / f"{folder.name}.mcap")]
    else:
        written = export.to_csv(run, args.out or _home(folder), args.cell)
    for path in written:
        print(path)
    return DONE


def _tail(args: argparse.Namespace) -> int:
    folder = folder_of(args)
    colour = sys.stdout.isatty()
    print(f"{folder}")
    try:
        for record in follow(folder, lambda: not args.once and being_written(folder / RUN)):
            line = record_line(record)
            if line is not None:
                print(_coloured(record["kind"], line) if colour else line, flush=True)
    except KeyboardInterrupt:
        print()
    return DONE


def record_line(record: Record, utc_offset_s: float = 0.0) -> str | None:
    """Format a record as one line for people, in their local time; None for a record of no interest to them."""
    words = record_words(record)
    if words is None:
        return None
    text = printable(words)
    try:
        at = datetime.fromisoformat(str(record.get("t"))) + timedelta(seconds=utc_offset_s)
    except ValueError:
        return f"--:--:--  {record['kind']:<11} {text}"
    return f"{at:%H:%M:%S}  {record['kind']:<11} {text}"


def _coloured(kind: str, line: str) -> str:
    code = {"fault": 31, "refusal": 33, "cycle_end": 32, "decision": 36}.get(kind)
    return line if code is None else f"\x1b[{code}m{line}\x1b[0m"
