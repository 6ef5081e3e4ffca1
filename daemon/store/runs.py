"""Find and read run folders, check the wire ledger, and remove old runs to stay within the disk quota."""

import contextlib
import hashlib
import os
import re
import shutil
import time
from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import BinaryIO

import msgspec

from daemon.events.records import LONGEST_LINE, Record, record_of
from daemon.store.files import LAST_NUMBER
from daemon.store.outside import JSON_ERRORS, PIECE, FileError, open_below, read_below
from daemon.store.runlog import LARGEST_KEPT

RUN = "run.jsonl"
LARGEST_RUN = 256_000_000
"""Bytes read of one run.jsonl. The daemon starts a new run folder long before (log.roll_mb)."""
MAX_RUNS = 5_000
"""Largest number of runs kept, however small: each one is scanned at every start and every minute."""
RUN_NAME = re.compile(r"\d{8}T\d{6}Z(-\d{1,9})?", re.ASCII)
FAILURE_MARKS = (b'"kind":"fault"', b'"kind":"refusal"', b'"outcome":"missed"', b'"outcome":"failed"')
PICKED_MARK = b'"outcome":"picked"'


class RunError(FileError):
    """A run folder cannot be read: which, and why."""


@dataclass(frozen=True)
class RunRecords:
    """A run as read: its records in order, and one line of text for each line that was skipped (torn, unreadable)."""

    folder: Path
    records: tuple[Record, ...]
    skipped: tuple[str, ...]


def new_folder(runs: Path, now: datetime) -> Path:
    """Path for a run that starts at `now` (UTC). Names sort in the order of creation: where the clock was set back, the
    name is that of the last run with a number added."""
    began = now.strftime("%Y%m%dT%H%M%SZ"), 0
    made = (age_key(f) for f in runs.glob("*") if RUN_NAME.fullmatch(f.name))
    last, number = max((key for key in made if key[1] < LAST_NUMBER), default=("", 0))
    stem, number = max(began, (last, number + 1))
    return runs / (f"{stem}-{number}" if number else stem)


def list_runs(runs: Path) -> list[Path]:
    """All run folders in `runs`, oldest first, without those that cannot be opened."""
    if not runs.is_dir():
        return []
    return sorted((f for f in runs.iterdir() if os.path.isfile(f / RUN)), key=age_key)


def find_run(runs: Path, name: str) -> Path:
    """Find a run by `latest`, by its name in `runs`, or by a path. Raises RunError."""
    if name == "latest":
        found = list_runs(runs)
        if not found:
            raise RunError(f"{runs}: no run in it yet")
        return max(found, key=lambda f: (RUN_NAME.fullmatch(f.name) is not None, age_key(f)))
    for folder in (runs / name, Path(name)):
        if os.path.isfile(folder / RUN):
            return folder if folder.name not in ("", "..") else folder.resolve()
    raise RunError(f"{name}: no such run (neither a folder with run.jsonl nor a name in {runs})")


def read_run(folder: Path, scenes_of: Container[int] | None = None) -> RunRecords:
    """Read all records of a run; unreadable lines are skipped and reported. scenes_of: the looks, by seq, that keep
    their scene, nine tenths of a record (None: all). Raises FileError."""
    records: list[Record] = []
    skipped: list[str] = []
    with open_below(folder, RUN) as file:
        for number, line, complete in lines_of(file):
            try:
                record = record_of(line)
                if scenes_of is not None and record["kind"] == "look" and record["seq"] not in scenes_of:
                    record.pop("scene", None)
                records.append(record)
            except ValueError as error:
                long = len(line) > LONGEST_LINE
                what = f"unreadable line ({error})" if complete or long else "torn last line"
                count = f"more than {LONGEST_LINE}" if long else len(line)
                skipped.append(f"{folder}/{RUN}:{number}: {what}, {count} bytes skipped")
        if file.tell() >= LARGEST_RUN:
            skipped.append(f"{folder}/{RUN}: too large: only its first {LARGEST_RUN // 1_000_000} MB are read")
    return RunRecords(folder, tuple(records), tuple(skipped))


def follow(folder: Path, going_on: Callable[[], bool]) -> Iterator[Record]:
    """Yield the records of a run as they are written, until run_end, or until its writer has ended (going_on)."""
    with open_below(folder, RUN) as file:
        rest = b""
        while True:
            more_may_come = going_on()
            content = file.read(PIECE)
            *lines, rest = (rest + content).split(b"\n")
            for line in lines:
                try:
                    record = record_of(line)
                except ValueError:
                    continue
                yield record
                if record["kind"] == "run_end":
                    return
            rest = rest[: LONGEST_LINE + 1]
            if not content:
                if not more_may_come:
                    return
                time.sleep(0.1)


def kept_file(folder: Path, name: object) -> Path:
    """The path of a file in kept/, checked against the hash in its name. Raises FileError, RunError."""
    content = read_below(folder, name, LARGEST_KEPT)
    path = folder / str(name)
    if hashlib.sha256(content).hexdigest() != path.name.split(".")[0]:
        raise RunError(f"{path}: changed: its content does not have the hash in its name")
    return path


class _WireEntry(msgspec.Struct):
    seq: int | None = None
    chain: str | None = None


def check_wire(folder: Path) -> list[str]:
    """Check the hash chain of the wire ledger; returns one line of text for each break."""
    problems: list[str] = []
    chain, before = "", None
    try:
        with open_below(folder, "wire.jsonl") as file:
            for number, line, _ in lines_of(file):
                try:
                    entry = msgspec.json.decode(line, type=_WireEntry)
                except JSON_ERRORS:
                    problems.append(f"wire.jsonl:{number}: torn or unreadable line")
                    continue
                missing = 0 if before is None or entry.seq is None else entry.seq - before - 1
                if entry.chain != chain and missing > 0:
                    problems.append(f"wire.jsonl:{number}: {missing} entries are missing before it")
                elif entry.chain != chain:
                    problems.append(f"wire.jsonl:{number}: does not follow from the line before it")
                chain, before = hashlib.sha256(line).hexdigest(), entry.seq
    except FileError as error:
        problems += [str(error)] if os.path.lexists(folder / "wire.jsonl") else []
    return problems


def enforce_quota(
    runs: Path,
    limit_bytes: int,
    current: Path | None,
    min_free_bytes: int = 0,
    stuck: Callable[[Path, str], object] = lambda _, __: None,
) -> list[Path]:
    """Remove runs until the rest fits: oldest first, runs with a failure last, never the current one.

    It also removes runs while the disk has less than min_free_bytes free, or there are more than MAX_RUNS. Returns the
    removed folders. A run that cannot be removed goes to `stuck` with the reason and counts no longer: otherwise all
    others would be removed for it. Links do not count: they lead to runs elsewhere.
    """
    if not runs.is_dir():
        return []
    sizes = {folder: run_bytes(folder) for folder in list_runs(runs) if not folder.is_symlink()}
    total = sum(sizes.values())
    removed: list[Path] = []

    def fits() -> bool:
        few = total <= limit_bytes and len(sizes) <= MAX_RUNS
        return few and shutil.disk_usage(runs).free >= min_free_bytes

    if fits():
        return removed
    candidates = [folder for folder in sizes if folder != current]
    for folder in sorted(candidates, key=lambda f: (has_failure(f), age_key(f))):
        if fits():
            break
        try:
            shutil.rmtree(folder)
            removed.append(folder)
        except (OSError, RecursionError) as error:
            stuck(folder, getattr(error, "strerror", None) or str(error))
        total -= sizes.pop(folder)
        for below in [below for below in _SCANNED if below.startswith(f"{folder}{os.sep}")]:
            del _SCANNED[below]
    return removed


def run_bytes(folder: Path) -> int:
    """Bytes on disk of a run. Its folders of pictures are scanned again only when one has changed: the current run may
    have thousands of pictures, and its size is read every minute."""
    size, folders = bytes_in(str(folder))
    return size + sum(_bytes_below(below, changed_ns) for below, changed_ns in folders)


_SCANNED: dict[str, tuple[int, int]] = {}
"""Folder -> its time of change when it was scanned, and the bytes below it."""


def _bytes_below(folder: str, changed_ns: int) -> int:
    scanned = _SCANNED.get(folder)
    if scanned is not None and scanned[0] == changed_ns:
        return scanned[1]
    if len(_SCANNED) >= 2 * MAX_RUNS:
        _SCANNED.clear()
    size, left = 0, [folder]
    while left:
        more, folders = bytes_in(left.pop())
        size += more
        left += [below for below, _ in folders]
    _SCANNED[folder] = changed_ns, size
    return size


def bytes_in(folder: str) -> tuple[int, list[tuple[str, int]]]:
    """Bytes on disk of the entries of a folder, and its subfolders, each with its time of change."""
    size, folders = 0, []
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            with contextlib.suppress(OSError):
                status = entry.stat(follow_symlinks=False)
                size += status.st_blocks * 512
                if entry.is_dir(follow_symlinks=False):
                    folders.append((entry.path, status.st_mtime_ns))
    return size, folders


def has_failure(folder: Path) -> bool:
    """Whether a run has a fault, a refusal or a cycle without success, or has no run_end."""
    ended = False
    with contextlib.suppress(FileError, OSError), open_below(folder, RUN) as file:
        for _, line, _ in lines_of(file):
            if any(mark in line for mark in FAILURE_MARKS):
                return True
            if b'"kind":"cycle_end"' in line and PICKED_MARK not in line:
                return True
            ended = ended or b'"kind":"run_end"' in line
    return not ended


def lines_of(file: BinaryIO) -> Iterator[tuple[int, bytes, bool]]:
    """Yield (number, line, complete) up to LARGEST_RUN bytes; of a line that is too long only the beginning."""
    number, goes_on = 0, False
    while file.tell() < LARGEST_RUN and (line := file.readline(LONGEST_LINE + 2)):
        begins, goes_on = not goes_on, not line.endswith(b"\n")
        number += begins
        if begins and line != b"\n":
            yield number, line.rstrip(b"\n"), not goes_on


def age_key(folder: Path) -> tuple[str, int]:
    """Sort key of a run's folder: runs of one second by their number, as one."""
    stem, _, number = folder.name.partition("-")
    return stem, int(number) if number.isdecimal() and len(number) < 10 else 0
