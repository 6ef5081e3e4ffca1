"""`facetctl runs | review | replay | export | tail`: arguments in, files and tables out. Works without a daemon."""

from __future__ import annotations

import argparse
import json
import socket
import sys
from collections.abc import Callable
from dataclasses import asdict
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from daemon.errors import FacetdError
from daemon.store import places
from daemon.store.records import Record
from daemon.store.runs import find_run, follow, list_runs

DONE, REGRESSED, UNUSABLE = 0, 1, 2


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the commands to facetctl."""
    runs = _command(subparsers, "runs", _runs, "a table of all runs")
    runs.add_argument("--last", type=int, default=30, metavar="N", help="how many, newest last (30)")
    runs.add_argument("--json", action="store_true", help="a line for machines each")
    review = _with_run(_command(subparsers, "review", _review, "one HTML page of a run"))
    review.add_argument(
        "--out", type=Path, metavar="PAGE.html", help="where to write it (default: into the run folder)"
    )
    review.add_argument("--against", metavar="RUN", help="lay another run beside it")
    review.add_argument("--week", action="store_true", help="one page for the week that ended with it, in runs/")
    replay = _with_run(
        _command(subparsers, "replay", _replay, "every look through today's recogniser; 1 on a regression")
    )
    replay.add_argument("--model", type=Path, help="this model (a file, 3, or latest) instead of the run's own")
    replay.add_argument("--json", action="store_true", help="one line for machines")
    export = _with_run(_command(subparsers, "export", _export, "a run for other tools"))
    kind = export.add_mutually_exclusive_group(required=True)
    kind.add_argument("--csv", action="store_true", help="cycles.csv and looks.csv")
    kind.add_argument("--mcap", action="store_true", help="for Foxglove: images, transforms, log (extra `export`)")
    kind.add_argument("--parquet", action="store_true", help="into a fleet's store by cell and day (extra `export`)")
    export.add_argument("--out", type=Path, help="folder, or file for --mcap (default: in the run folder)")
    export.add_argument("--cell", default=socket.gethostname(), help="this cell's name in the tables")
    tail = _with_run(_command(subparsers, "tail", _tail, "follow a run live, a line a step"))
    tail.add_argument("--once", action="store_true", help="print what is there and end")


def _command(
    subparsers: argparse._SubParsersAction[argparse.ArgumentParser],
    name: str,
    job: Callable[[argparse.Namespace], int],
    text: str,
) -> argparse.ArgumentParser:
    def run(args: argparse.Namespace) -> int:
        try:
            return job(args)
        except (FacetdError, OSError) as error:
            print(f"facetctl {name}: {error}", file=sys.stderr)
            return UNUSABLE

    parser = subparsers.add_parser(name, help=text)
    parser.add_argument("--runs", type=Path, default=None, metavar="DIR", help="where the run folders are")
    parser.set_defaults(run=run)
    return parser


def _with_run(parser: argparse.ArgumentParser) -> argparse.ArgumentParser:
    parser.add_argument(
        "folder", metavar="RUN", nargs="?", default="latest", help="a run folder, its name, or `latest`"
    )
    return parser


def _folder(args: argparse.Namespace, name: str | None = None) -> Path:
    return find_run(args.runs or places.runs_folder(), name or args.folder)


def _runs(args: argparse.Namespace) -> int:
    from daemon.review.page import read_digest

    rows = []
    for folder in list_runs(args.runs or places.runs_folder())[-args.last :]:
        try:
            rows.append(read_digest(folder).statistics())
        except FacetdError as error:  # one bad run keeps nobody from seeing the others
            print(f"facetctl runs: {error}", file=sys.stderr)
    if args.json:
        for row in rows:
            print(json.dumps(row))
        return DONE
    if not rows:
        print("no runs yet")
        return DONE
    columns = ("run", "cycles", "picked", "missed", "refusals", "faults", "mean_looks", "predicted_mm", "true_mm",
               "model", "calibration", "ended")  # fmt: skip
    cells: list[list[str]] = [
        [name.replace("_", " ") for name in columns],
        *([_cell(row[c]) for c in columns] for row in rows),
    ]
    widths = [max(len(line[k]) for line in cells) for k in range(len(columns))]
    for line in cells:
        print("  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip())
    return DONE


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "-" if value is None else str(value)


def _review(args: argparse.Namespace) -> int:
    from daemon.review.page import write_page

    folder = _folder(args)
    if args.week:
        from daemon.review.week import write_week

        print(write_week(folder.parent, folder, args.out or folder.parent / "week.html"))
        return DONE
    against = _folder(args, args.against) if args.against else None
    print(write_page(folder, args.out or folder / "report.html", against))
    return DONE


def _replay(args: argparse.Namespace) -> int:
    from daemon.review.page import read_digest
    from daemon.review.replay import replay
    from daemon.store.library import FACETS, load_facets
    from daemon.store.model import load
    from daemon.store.model_store import model_file

    folder = _folder(args)
    model = load(model_file(args.model)) if args.model else None
    result = replay(folder, read_digest(folder), load_facets(FACETS), model=model)
    if args.json:
        changes = [asdict(c) for c in result.changes]
        print(json.dumps({"run": folder.name, "looks": result.looks, "identical": result.identical,
                          "regressions": result.regressions, "changes": changes, "then_ms": result.then_ms,
                          "now_ms": result.now_ms, "skipped": list(result.skipped)}))  # fmt: skip
    else:
        for change in result.changes:
            mark = "worse " if change.regression else "other "
            print(f"{mark} look {change.seq:>5}  cycle {_cell(change.cycle):>3}  {change.part}: {change.what}")
        for line in result.skipped:
            print(f"skipped {line}")
        times = (
            ""
            if None in (result.then_ms, result.now_ms)
            else f", {result.then_ms:.1f} ms then, {result.now_ms:.1f} ms now"
        )
        print(f"{result.looks} looks: {result.identical} identical, {result.regressions} worse{times}")
    return REGRESSED if result.regressions else DONE


def _export(args: argparse.Namespace) -> int:
    from daemon.review import export
    from daemon.review.page import read_digest

    folder = _folder(args)
    run = read_digest(folder)
    if args.mcap:
        written = [export.to_mcap(folder, run, args.out or folder / f"{folder.name}.mcap")]
    elif args.csv:
        written = export.to_csv(run, args.out or folder, args.cell)
    else:
        written = export.to_parquet(run, args.out or folder.parent.parent / "fleet", args.cell)
    for path in written:
        print(path)
    return DONE


def _tail(args: argparse.Namespace) -> int:
    folder = _folder(args)
    colour = sys.stdout.isatty()
    print(f"{folder}")
    try:
        for record in follow(folder, lambda: not args.once):
            line = told(record)
            if line is not None:
                print(_coloured(record["kind"], line) if colour else line, flush=True)
    except KeyboardInterrupt:
        print()
    return DONE


def told(record: Record, utc_offset_s: float = 0.0) -> str | None:
    """One line of a step for people, at the time of their clocks, or None for what would only fill the screen."""
    text = _words(record)
    if text is None:
        return None
    try:
        at = datetime.fromisoformat(str(record.get("t"))) + timedelta(seconds=utc_offset_s)
    except ValueError:
        return f"--:--:--  {record['kind']:<11} {text}"
    return f"{at:%H:%M:%S}  {record['kind']:<11} {text}"


def _words(record: Record) -> str | None:
    match record["kind"]:
        case "look":
            scene = record.get("scene") or {}
            parts = ", ".join(map(_seen, scene.get("parts") or [])) or "nothing"
            return f"{record.get('purpose')}: {parts}"
        case "estimate":
            mm, deg = (record.get(name) or float("nan") for name in ("predicted_mm", "predicted_deg"))
            return f"{record.get('label')} to {mm:.2f} mm {deg:.2f} degrees"
        case "move":
            sent = "" if record.get("sent") else ", not sent"
            return f"{record.get('purpose')}: {record.get('how')}{_place(record.get('target'))}{sent}"
        case "decision" | "cycle_end":
            return f"{record.get('text') or record.get('outcome')}: {record.get('why')}"
        case "cycle_start":
            return f"{record.get('cycle')}"
        case "hand":
            return "closes" if record.get("closed") else "opens"
        case "fault" | "refusal":
            return f"{record.get('code') or record.get('rule')}: {record.get('text')}"
        case "command":
            return f"{record.get('who')} at {record.get('door')}: {record.get('text')}"
        case "left":
            hand = ", a part perhaps in the gripper" if record.get("hand_closed") else ""
            return f"run {record.get('run')} was cut off in state {record.get('state')}{hand}"
        case "holding":
            return {True: "a part in the gripper", False: "the gripper is empty", None: "not known"}[record.get("held")]
        case "auto" if record.get("on"):
            return f"{record.get('count') or 'all'} parts to pick"
        case "run_end":
            return str(record.get("why"))
        case _:
            return None


def _place(world_from_tool: Any) -> str:
    """Where a move goes."""
    match world_from_tool:
        case [[*_, x], [*_, y], [*_, z], *_]:
            return f" to x {x:.0f} y {y:.0f} z {z:.0f} mm"
    return ""


def _seen(part: dict[str, Any]) -> str:
    """A part and how sure that is; of one without a name there is nothing to be sure of."""
    return "unknown" if part["label"] == "unknown" else f"{part['label']} {100 * part['confidence']:.0f} %"


def _coloured(kind: str, line: str) -> str:
    code = {"fault": 31, "refusal": 33, "cycle_end": 32, "decision": 36}.get(kind)
    return line if code is None else f"\x1b[{code}m{line}\x1b[0m"
