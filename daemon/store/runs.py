"""Reading run folders: find them, read their lines past a torn end, check the ledger, keep the disk within its quota.

Nothing here writes into a run; `enforce_quota` removes whole runs.
"""

from __future__ import annotations

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
from daemon.store.outside import PIECE, FileError, open_below, read_below
from daemon.store.runlog import LARGEST_KEPT

RUN = "run.jsonl"
LARGEST_RUN = 256_000_000
"""Of the lines in one run: a run goes on in a new folder long before (log.roll_mb counts its pictures, too)."""
MOST_RUNS = 5_000
"""However small they are: each is looked through at every start and every minute."""
RUN_NAME = re.compile(r"\d{8}T\d{6}Z(-\d{1,9})?", re.ASCII)
FAILURE_MARKS = (b'"kind":"fault"', b'"kind":"refusal"', b'"outcome":"missed"', b'"outcome":"failed"')
PICKED_MARK = b'"outcome":"picked"'


class RunError(FileError):
    """A run folder that cannot be read: the message says which and why."""


@dataclass(frozen=True)
class RunRecords:
    """A run as read: its records in order, and one line for each thing that was skipped (a torn end, a bad line)."""

    folder: Path
    records: tuple[Record, ...]
    skipped: tuple[str, ...]


def new_folder(runs: Path, now: datetime) -> Path:
    """A name for a run that starts now (UTC), behind all that are in `runs`: names sort by which run was made first.
    Where the clock was set back, a run is numbered after the last one."""
    began = now.strftime("%Y%m%dT%H%M%SZ"), 0
    made = (_age_key(f) for f in runs.glob("*") if RUN_NAME.fullmatch(f.name))
    last, number = max((key for key in made if key[1] < LAST_NUMBER), default=("", 0))
    stem, number = max(began, (last, number + 1))
    return runs / (f"{stem}-{number}" if number else stem)


def list_runs(runs: Path) -> list[Path]:
    """Every run folder in `runs`, oldest first; one that cannot be looked into is none."""
    if not runs.is_dir():
        return []
    return sorted((f for f in runs.iterdir() if os.path.isfile(f / RUN)), key=_age_key)


def find_run(runs: Path, name: str) -> Path:
    """`latest`, a folder's name in `runs`, or a path (`.`, too) -> the run folder. Of those that somebody named
    otherwise none is the latest as long as there are others. Raises RunError."""
    known = list_runs(runs)
    if name == "latest":
        if not known:
            raise RunError(f"{runs}: no run in it yet")
        return max(known, key=lambda f: (RUN_NAME.fullmatch(f.name) is not None, _age_key(f)))
    for folder in (runs / name, Path(name)):
        if os.path.isfile(folder / RUN):
            return folder if folder.name not in ("", "..") else folder.resolve()
    raise RunError(f"{name}: no such run (neither a folder with run.jsonl nor a name in {runs})")


def read_run(folder: Path, scenes_of: Container[int] | None = None) -> RunRecords:
    """All records of a run; what cannot be read is skipped and named. scenes_of: the looks, by seq, that keep their
    scene, which is nine tenths of a record (None: all). Raises RunError where there is no run."""
    records: list[Record] = []
    skipped: list[str] = []
    with open_below(folder, RUN) as file:
        for number, line, whole in lines_of(file):
            try:
                record = record_of(line)
                if scenes_of is not None and record["kind"] == "look" and record["seq"] not in scenes_of:
                    record.pop("scene", None)
                records.append(record)
            except ValueError as error:
                long = len(line) > LONGEST_LINE
                what = f"unreadable line ({error})" if whole or long else "torn last line"
                count = f"more than {LONGEST_LINE}" if long else len(line)
                skipped.append(f"{folder}/{RUN}:{number}: {what}, {count} bytes skipped")
        if file.tell() >= LARGEST_RUN:
            skipped.append(f"{folder}/{RUN}: too large: only {LARGEST_RUN // 1_000_000} MB of it are read")
    return RunRecords(folder, tuple(records), tuple(skipped))


def follow(folder: Path, going_on: Callable[[], bool]) -> Iterator[Record]:
    """Records of a run as they are written, until run_end; where nothing goes on any more, those that are there."""
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
    """A file that was kept with the run, which must still be what its name says. Raises FileError, RunError."""
    content = read_below(folder, name, LARGEST_KEPT)
    path = folder / str(name)
    if hashlib.sha256(content).hexdigest() != path.name.split(".")[0]:
        raise RunError(f"{path}: changed since it was kept: its content does not have the hash in its name")
    return path


class _WireEntry(msgspec.Struct):
    seq: int | None = None
    chain: str | None = None


def check_wire(folder: Path) -> list[str]:
    """Walk the ledger's chain of hashes; one line for each place where it does not hold, none when it is whole."""
    problems: list[str] = []
    chain, before = "", None
    try:
        with open_below(folder, "wire.jsonl") as file:
            for number, line, _ in lines_of(file):
                try:
                    entry = msgspec.json.decode(line, type=_WireEntry)
                except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError):
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
    """Remove runs until the rest fits: oldest first, runs in which something failed last, never the current one.

    Also when the disk has less than min_free_bytes left, or there are more than MOST_RUNS. Returns what was removed.
    One that cannot be removed is given to `stuck` with the reason and counts no more: the others would all go for it.
    Nor does a link count, which is somebody's way to a run elsewhere.
    """
    if not runs.is_dir():
        return []
    sizes = {folder: run_bytes(folder) for folder in list_runs(runs) if not folder.is_symlink()}
    total = sum(sizes.values())
    removed: list[Path] = []

    def fits() -> bool:
        few = total <= limit_bytes and len(sizes) <= MOST_RUNS
        return few and shutil.disk_usage(runs).free >= min_free_bytes

    if fits():
        return removed
    candidates = [folder for folder in sizes if folder != current]
    for folder in sorted(candidates, key=lambda f: (has_failure(f), _age_key(f))):
        if fits():
            break
        try:
            shutil.rmtree(folder)
            removed.append(folder)
        except (OSError, RecursionError) as error:
            stuck(folder, getattr(error, "strerror", None) or str(error))
        total -= sizes.pop(folder)
        _forget_below(folder)
    return removed


def run_bytes(folder: Path) -> int:
    """Bytes on disk of a run; a file that goes away meanwhile counts nothing. Its pictures are looked through only
    once one was put in or taken away: the run that is written may have thousands, and is asked every minute."""
    size, folders = _bytes_in(str(folder))
    return size + sum(_bytes_then(below, changed_ns) for below, changed_ns in folders)


_KNOWN: dict[str, tuple[int, int]] = {}
"""Of folders of pictures: when they were changed, and the bytes below them then."""


def _bytes_then(folder: str, changed_ns: int) -> int:
    known = _KNOWN.get(folder)
    if known is not None and known[0] == changed_ns:
        return known[1]
    if len(_KNOWN) >= 2 * MOST_RUNS:
        _KNOWN.clear()
    size, left = 0, [folder]
    while left:
        more, folders = _bytes_in(left.pop())
        size += more
        left += [below for below, _ in folders]
    _KNOWN[folder] = changed_ns, size
    return size


def _forget_below(folder: Path) -> None:
    for below in [below for below in _KNOWN if below.startswith(f"{folder}{os.sep}")]:
        del _KNOWN[below]


def _bytes_in(folder: str) -> tuple[int, list[tuple[str, int]]]:
    """Bytes on disk of what lies in a folder, and the folders among it, each with when it was changed."""
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
    """Whether a run holds a fault, a refusal or a cycle that picked nothing, or has no run_end."""
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
    """Number, line, and whether its end is there; of one that is too long the beginning. No more than LARGEST_RUN."""
    number, goes_on = 0, False
    while file.tell() < LARGEST_RUN and (line := file.readline(LONGEST_LINE + 2)):
        begins, goes_on = not goes_on, not line.endswith(b"\n")
        number += begins
        if begins and line != b"\n":
            yield number, line.rstrip(b"\n"), not goes_on


def _age_key(folder: Path) -> tuple[str, int]:
    stem, _, number = folder.name.partition("-")
    return stem, int(number) if number.isdecimal() and len(number) < 10 else 0
