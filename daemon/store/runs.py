"""Reading run folders: find them, read their lines past a torn end, check the ledger, keep the disk within its quota.

Nothing here writes into a run; `enforce_quota` removes whole runs.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from daemon.errors import FacetdError

Record = dict[str, Any]
FAILURE_MARKS = (b'"kind":"fault"', b'"kind":"refusal"', b'"outcome":"missed"', b'"outcome":"failed"')
PICKED_MARK = b'"outcome":"picked"'


class RunError(FacetdError):
    """A run folder that cannot be read: the message says which and why."""


@dataclass(frozen=True)
class RunRecords:
    """A run as read: its records in order, and one line for each thing that was skipped (a torn end, a bad line)."""

    folder: Path
    records: tuple[Record, ...]
    skipped: tuple[str, ...]


@dataclass(frozen=True)
class Interrupted:
    """How a run was left: state and cycle, what the gripper was last told, which part it was; in_doubt: what an earlier
    run left was never resolved, or it ended with a part perhaps in the gripper; auto: count and every_s of what an
    `auto on` had still to bring."""

    run: str
    cycle: int | None
    state: str | None
    hand_closed: bool
    label: str | None
    in_doubt: bool = False
    auto: Record | None = None


def new_folder(runs: Path, now: datetime) -> Path:
    """A name for a run that starts now (UTC), free in `runs`; names sort by time."""
    stem = now.strftime("%Y%m%dT%H%M%SZ")
    number = 0
    while (folder := runs / (f"{stem}-{number}" if number else stem)).exists():
        number += 1
    return folder


def list_runs(runs: Path) -> list[Path]:
    """Every run folder in `runs`, oldest first."""
    if not runs.is_dir():
        return []
    return sorted((f for f in runs.iterdir() if (f / "run.jsonl").is_file()), key=_age_key)


def find_run(runs: Path, name: str) -> Path:
    """`latest`, a folder's name in `runs`, or a path -> the run folder. Raises RunError."""
    known = list_runs(runs)
    if name == "latest":
        if not known:
            raise RunError(f"{runs}: no run in it yet")
        return known[-1]
    for folder in (runs / name, Path(name)):
        if (folder / "run.jsonl").is_file():
            return folder
    raise RunError(f"{name}: no such run (neither a folder with run.jsonl nor a name in {runs})")


def read_run(folder: Path) -> RunRecords:
    """All records of a run; what cannot be read is skipped and named. Raises RunError where there is no run."""
    try:
        content = (folder / "run.jsonl").read_bytes()
    except OSError as error:
        raise RunError(f"{folder}/run.jsonl: {error.strerror}") from None
    records: list[Record] = []
    skipped: list[str] = []
    lines = content.split(b"\n")
    for number, line in enumerate(lines, 1):
        if not line:
            continue
        try:
            record = json.loads(line)
            if not isinstance(record, dict) or "kind" not in record:
                raise ValueError("not a record")
            records.append(record)
        except ValueError:
            what = "torn last line" if number == len(lines) else "unreadable line"
            skipped.append(f"{folder}/run.jsonl:{number}: {what}, {len(line)} bytes skipped")
    return RunRecords(folder, tuple(records), tuple(skipped))


def interrupted(folder: Path) -> Interrupted | None:
    """How the run was left in doubt: without an end (power cut, kill -9), or with a part perhaps in the gripper; else
    None. A doubt that was there when it began (`left`) stands until an operator's `resume`."""
    records = read_run(folder).records
    cycle = state = label = auto = None
    in_doubt = hand_closed = False
    for record in records:
        kind = record["kind"]
        if kind == "left":
            cycle, state, label = record.get("cycle"), record.get("state"), record.get("label")
            in_doubt, hand_closed, auto = True, bool(record.get("hand_closed")), record.get("auto")
        elif kind in ("cycle_start", "cycle_end"):
            cycle, label = (record.get("cycle"), record.get("target")) if kind == "cycle_start" else (None, None)
        elif kind == "estimate":
            label = record.get("label")
        elif kind == "state":
            if record.get("from") == "fault" and record.get("event") == "resume":
                cycle, in_doubt = None, False
            state = record.get("to")
            if record.get("event") == "placed":
                auto = _one_less(auto)
        elif kind == "auto":
            auto = {"count": record.get("count"), "every_s": record.get("every_s")} if record.get("on") else None
        elif kind == "hand":
            hand_closed = bool(record.get("closed"))
        elif kind == "holding":
            hand_closed = record.get("held") is not False
        elif kind == "run_end" and "holding" in record:
            in_doubt, hand_closed = in_doubt or record["holding"] is not False, record["holding"] is not False
    ended = any(r["kind"] == "run_end" for r in records)
    if not records or (ended and not in_doubt):
        return None
    return Interrupted(folder.name, cycle, state, hand_closed, label, in_doubt, auto)


def _one_less(auto: Record | None) -> Record | None:
    """What `auto` has still to bring after a part was put into the bin; None: nothing."""
    if auto is None or auto["count"] is None:
        return auto
    return {**auto, "count": auto["count"] - 1} if auto["count"] > 1 else None


def left_behind(runs: Path) -> Interrupted | None:
    """What the last daemon left that somebody must look at: a pick or an auto cut off, a part perhaps in the gripper;
    else None.

    Runs that never started (a device was not there) are looked past: they know nothing of the gripper.
    """
    for folder in reversed(list_runs(runs)):
        if not _started(folder):
            continue
        left = interrupted(folder)
        told = left is not None and (left.in_doubt or left.cycle is not None or left.hand_closed or left.auto)
        return left if told else None
    return None


def drop_unstarted(runs: Path) -> None:
    """Remove the runs at the end of the list that never started: a device missing over a week-end makes thousands."""
    for folder in reversed(list_runs(runs)):
        if _started(folder):
            return
        shutil.rmtree(folder, ignore_errors=True)


def _started(folder: Path) -> bool:
    return any(b'"kind":"run_start"' in line for _, line in _lines(folder / "run.jsonl"))


def check_wire(folder: Path) -> list[str]:
    """Walk the ledger's chain of hashes; one line for each place where it does not hold, none when it is whole."""
    problems: list[str] = []
    chain, before = "", None
    for number, line in _lines(folder / "wire.jsonl"):
        try:
            entry = json.loads(line)
        except ValueError:
            problems.append(f"wire.jsonl:{number}: torn or unreadable line")
            continue
        missing = entry.get("seq", 0) - before - 1 if before is not None else 0
        if entry.get("chain") != chain and missing > 0:
            problems.append(f"wire.jsonl:{number}: {missing} entries are missing before it")
        elif entry.get("chain") != chain:
            problems.append(f"wire.jsonl:{number}: does not follow from the line before it")
        chain, before = hashlib.sha256(line).hexdigest(), entry.get("seq")
    return problems


def enforce_quota(runs: Path, limit_bytes: int, current: Path, min_free_bytes: int = 0) -> list[Path]:
    """Remove runs until the rest fits: oldest first, runs in which something failed last, never the current one.

    Also when the disk has less than min_free_bytes left. Returns what was removed; an OSError on one run skips it.
    """
    sizes = {folder: folder_bytes(folder) for folder in list_runs(runs)}
    total = sum(sizes.values())
    removed: list[Path] = []
    if total <= limit_bytes and shutil.disk_usage(runs).free >= min_free_bytes:
        return removed
    candidates = [folder for folder in sizes if folder != current]
    for folder in sorted(candidates, key=lambda f: (has_failure(f), _age_key(f))):
        if total <= limit_bytes and shutil.disk_usage(runs).free >= min_free_bytes:
            break
        try:
            shutil.rmtree(folder)
        except OSError:
            continue
        total -= sizes[folder]
        removed.append(folder)
    return removed


def folder_bytes(folder: Path) -> int:
    """Bytes on disk of a folder and all below; a file that goes away meanwhile counts nothing."""
    total = 0
    for path in folder.rglob("*"):
        try:
            total += path.lstat().st_blocks * 512
        except OSError:
            continue
    return total


def has_failure(folder: Path) -> bool:
    """Whether a run holds a fault, a refusal or a cycle that picked nothing, or has no run_end."""
    ended = False
    for _, line in _lines(folder / "run.jsonl"):
        if any(mark in line for mark in FAILURE_MARKS):
            return True
        if b'"kind":"cycle_end"' in line and PICKED_MARK not in line:
            return True
        ended = ended or b'"kind":"run_end"' in line
    return not ended


def _lines(path: Path) -> Iterator[tuple[int, bytes]]:
    try:
        with path.open("rb") as file:
            for number, line in enumerate(file, 1):
                yield number, line.rstrip(b"\n")
    except OSError:
        return


def _age_key(folder: Path) -> tuple[str, int]:
    stem, _, number = folder.name.partition("-")
    return stem, int(number) if number.isdigit() else 0
