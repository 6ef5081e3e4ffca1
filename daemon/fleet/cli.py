"""Commands `facetctl runs`, `replay` and `fleet`: the runs of one cell or of many. They need no daemon."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from daemon.errors import DONE, NOT_UNDERSTOOD, FacetdError
from daemon.quantities import whole, within
from daemon.review.cli import command
from daemon.store import folders
from daemon.store.runs import find_run, list_runs

REGRESSED = NOT_ALL = 1
COLLECTED = "collected"
MOST = 9999
"""Largest number of runs, days or workers that a person may request."""

RUN_COLUMNS: dict[str, Callable[[dict[str, Any]], Any]] = {
    "run": lambda row: row["run"],
    "picked": lambda row: f"{row['picked']} of {row['tried']}",
    "miss": lambda row: row["missed"],
    "abort": lambda row: row["aborted"],
    "refuse": lambda row: row["refusals"],
    "fault": lambda row: row["faults"],
    "mm": lambda row: None if row["predicted_mm"] is None else f"{row['predicted_mm']:.2f}",
    "true": lambda row: None if row["true_mm"] is None else f"{row['true_mm']:.2f}",
    "model": lambda row: row["model_version"] or row["model"],
    "end": lambda row: "running" if row["going"] else row["ended"],
}
"""Columns of the table for people, within 80 characters. mm: mean predicted error at the grasp."""


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the commands to facetctl."""
    runs = command(subparsers, "runs", _runs, "a table of all runs; `runs collect`: many cells' runs into one store")
    runs.add_argument("--last", type=within(whole, 1, MOST), default=30, metavar="N", help="how many, newest last (30)")
    runs.add_argument("--json", action="store_true", help="one JSON line a run")
    collect = runs.add_subparsers(metavar="[collect ...]").add_parser(
        "collect", help="take finished runs into a store (extra `fleet`)"
    )
    collect.set_defaults(job=_collect)
    collect.add_argument(
        "cells", nargs="+", metavar="CELL=RUNS", help="a cell's name and its folder of runs, or HOST:FOLDER over ssh"
    )
    collect.add_argument("--into", metavar="STORE", required=True, help="folder or bucket, such as s3://plant/facetd")
    collect.add_argument("--free", action="store_true", help="then remove the runs that the store has from the cells")
    collect.add_argument("--json", action="store_true", help="one JSON line")
    replay = command(subparsers, "replay", _replay, "every look through today's recogniser; 1 on a regression")
    replay.add_argument("folders", metavar="RUN", nargs="*", help="runs by folder or name, `latest`, or a store")
    replay.add_argument(
        "--with", action="append", default=[], dest="chosen", metavar="FILE",
        help="instead of the runs' own: a model (a file, 3, latest), a calibration, a facetd.yaml; may be repeated",
    )  # fmt: skip
    replay.add_argument("--workers", type=within(whole, 1, MOST), metavar="N", help="processes here (extra `fleet`)")
    replay.add_argument("--cluster", metavar="ADDRESS", help="by the workers of this dask scheduler")
    replay.add_argument("--out", metavar="DIR", help="results and report.html; called again, it goes on there")
    replay.add_argument("--json", action="store_true", help="one JSON line")
    fleet = command(subparsers, "fleet", _fleet, "one HTML page for all cells of a store (extra `fleet`)")
    fleet.add_argument("store", metavar="STORE", help="what `facetctl runs collect` made")
    fleet.add_argument("--days", type=within(whole, 1, MOST), default=7, metavar="N", help="up to the last run (7)")
    fleet.add_argument("--out", type=Path, default=Path("fleet.html"), metavar="PAGE.html", help="(fleet.html)")


def _runs(args: argparse.Namespace) -> int:
    if "job" in args:
        return int(args.job(args))
    from daemon.review.brief import read_brief

    rows = []
    for folder in list_runs(args.runs or folders.runs_last_used())[-args.last :]:
        try:
            rows.append(read_brief(folder).statistics())
        except FacetdError as error:  # one bad run must not hide the others
            print(f"facetctl runs: {error}", file=sys.stderr)
    if args.json:
        for row in rows:
            print(json.dumps(row))
        return DONE
    if not rows:
        print("no runs yet")
        return DONE
    _print_table([list(RUN_COLUMNS), *([_cell(column(row)) for column in RUN_COLUMNS.values()] for row in rows)])
    return DONE


def _print_table(cells: list[list[str]]) -> None:
    widths = [max(len(line[k]) for line in cells) for k in range(len(cells[0]))]
    for line in cells:
        print("  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip())


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "-" if value is None else str(value)


def _collect(args: argparse.Namespace) -> int:
    from daemon.fleet.collect import collect, source_of
    from daemon.fleet.store import open_store

    sources = [source_of(text) for text in args.cells]
    say = (lambda _: None) if args.json else (lambda line: print(line, flush=True))
    summary = collect(open_store(args.into), sources, args.free, say)
    if args.json:
        print(json.dumps({name: value for name, value in vars(summary).items() if name != "say"}))
    else:
        print(
            f"{summary.collected} runs collected ({summary.bytes / 1e6:.1f} MB), {summary.known} already in the store, "
            f"{summary.waiting} not finished for a minute, {summary.apart} damaged and set apart, "
            f"{summary.freed} removed from the cells"
        )
    return NOT_ALL if summary.lines else DONE


def _replay(args: argparse.Namespace) -> int:
    from daemon.fleet.replay_many import replay_here, replay_with
    from daemon.fleet.replay_results import differences, summed

    chosen = replay_with(args.chosen)
    failed: list[str] = []
    out: str | None = args.out
    if out is None and args.workers is None and args.cluster is None and not any(map(_is_store, args.folders)):
        results = replay_here(map(Path, _folders_of(args)), chosen)
    else:
        results, failed, out = _replay_many(args, chosen)
    total, found = summed(results), differences(results)
    if out is not None:
        from daemon.fleet.replay_page import write_replay_page
        from daemon.fleet.store import open_store

        page = write_replay_page(open_store(out), total, found, _folders_of(args), args.chosen)
    if args.json:
        changes = [{"run": one["run"], **change} for one in found for change in one["changes"]]
        print(json.dumps({**total, "regressions": total["worse"], "changes": changes, "failed": failed}))
    else:
        for one in found if out is None else found[:20]:
            for change in one["changes"]:
                mark = "worse " if change["regression"] else "other "
                where = f"look {one['seq']:>5}  cycle {_cell(one['cycle']):>3}"
                print(f"{mark} {one['cell']}/{one['run']}  {where}  {change['part']}: {change['what']}")
        for line in (*total["skipped"], *failed):
            print(f"skipped {line}")
        print(_in_words(total))
        if out is not None:
            print(page)
    return NOT_UNDERSTOOD if failed else REGRESSED if total["worse"] else DONE


def _in_words(total: dict[str, Any]) -> str:
    counts, (then_ms, now_ms) = total["all"], total["all"]["ms"]
    words = [
        f"{total['looks']} looks of {total['runs']} run{'s' * (total['runs'] != 1)}: "
        f"{total['identical']} identical, {total['worse']} worse",
        f"named {counts['named'][0]} then, {counts['named'][1]} now of {counts['parts']}",
    ]
    if counts["proved"]:
        words.append(
            f"right {counts['right'][0]} then, {counts['right'][1]} now of {counts['proved']} that a pick proved"
        )
    if then_ms and now_ms:
        words.append(f"{then_ms:.1f} ms a look then, {now_ms:.1f} ms now")
    return "; ".join(words)


def _is_store(name: str) -> bool:
    return "://" in name or (Path(name) / COLLECTED).is_dir()


def _folders_of(args: argparse.Namespace) -> list[str]:
    runs = args.runs or folders.runs_last_used()
    return [name if _is_store(name) else str(find_run(runs, name)) for name in args.folders or ["latest"]]


def _replay_many(args: argparse.Namespace, chosen: Any) -> tuple[list[tuple[str, Any]], list[str], str]:
    from daemon.fleet.replay_many import jobs_of, replay_many, run_in_folder, runs_in_store
    from daemon.fleet.store import open_store

    runs = []
    for name in _folders_of(args):
        runs += runs_in_store(open_store(name)) if _is_store(name) else [run_in_folder(Path(name))]
    out = args.out or f"replay-{chosen.digest()[:8]}"
    out = out if "://" in out else str(Path(out).resolve())
    jobs = jobs_of(runs, chosen, out)

    def say(done: int, of: int) -> None:
        if not args.json and sys.stderr.isatty():
            print(f"\r{done} of {of} pieces done", end="\n" if done == of else "", file=sys.stderr, flush=True)

    results, failed = replay_many(jobs, args.workers or 1, args.cluster, say)
    return results, failed, out


def _fleet(args: argparse.Namespace) -> int:
    from daemon.fleet.page import write_fleet_page
    from daemon.fleet.store import open_store

    print(write_fleet_page(open_store(args.store), args.days, args.out))
    return DONE
