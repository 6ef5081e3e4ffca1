"""Collect finished runs of many cells into one store: each run once, checked, removed from the cell only when safe.

The collector may be interrupted anywhere and started again: a run counts as collected once its manifest exists, which
is written last; files already copied are compared, not copied again. Cells do not depend on the store.
"""

import re
import shlex
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from daemon.errors import FacetdError
from daemon.fleet.layout import Rows, add_rows, rows_of
from daemon.fleet.soundness import damages, files_of, finished
from daemon.fleet.store import Collected, Store, StoreError, hashed_below, manifest_name
from daemon.review.digest import digest
from daemon.store.outside import FileError
from daemon.store.runs import RUN, RUN_NAME, RunRecords, list_runs, read_run

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
AT_ONCE = 20
"""Runs of a cell whose rows are added to the tables together."""
QUIET_S = 60.0
"""How long a run must be unchanged before it is collected: its last pictures are written after its last line."""
FILTER = (*(f"--include=/{name}" for name in (RUN, "wire.jsonl", "images/***", "kept/***")), "--exclude=*")


@dataclass(frozen=True)
class RunSource:
    """A cell's folder of runs: local, or `[user@]host:folder` by rsync over ssh."""

    cell: str
    where: str

    @property
    def remote(self) -> bool:
        return ":" in self.where.split("/")[0]


@dataclass
class CollectionSummary:
    """Counts of one collection. lines: problems that a person should read; say: receives every message as it occurs."""

    collected: int = 0
    known: int = 0
    apart: int = 0
    waiting: int = 0
    freed: int = 0
    bytes: int = 0
    lines: list[str] = field(default_factory=list)
    say: Callable[[str], object] = lambda _: None

    def warn(self, line: str) -> None:
        """Report a problem that a person should read."""
        self.lines.append(line)
        self.say(line)


def source_of(text: str) -> RunSource:
    """Parse `CELL=FOLDER` or `CELL=HOST:FOLDER`. Raises StoreError."""
    cell, equals, where = text.partition("=")
    if not equals or not where or not NAME.fullmatch(cell):
        raise StoreError(f"{text}: expected CELL=FOLDER or CELL=[USER@]HOST:FOLDER, CELL of letters and digits")
    return RunSource(cell, where)


def collect(
    store: Store, sources: Sequence[RunSource], free: bool = False, say: Callable[[str], object] = lambda _: None
) -> CollectionSummary:
    """Copy every finished run that the store does not have; free: then remove collected runs from the cells. A cell
    that cannot be reached is reported and skipped. Raises StoreError, OSError where the store fails."""
    summary = CollectionSummary(say=say)
    for source in sources:
        try:
            names = _names(source)
            _collect_cell(store, source, names, summary)
            if free:
                _free_cell(store, source, names, summary)
        except (FileError, _UnreachableError) as error:
            summary.warn(f"{source.cell}: {error}")
    return summary


def _collect_cell(store: Store, source: RunSource, names: list[str], summary: CollectionSummary) -> None:
    collected = store.collected()
    ids = {short: f"{cell}/{run}" for (cell, run), short in collected.items()}
    fresh = [name for name in names if (source.cell, name) not in collected]
    summary.known += len(names) - len(fresh)
    for begin in range(0, len(fresh), AT_ONCE):
        taken = [
            one
            for name in fresh[begin : begin + AT_ONCE]
            if (one := _collect_run(store, source, name, name != names[-1], ids, summary)) is not None
        ]
        add_rows(store, source.cell, [rows for _, rows in taken])
        for safe, _ in taken:
            store.write(msgspec.json.encode(safe), "collected", manifest_name(safe.id[:16], safe.cell, safe.run))
            summary.collected += 1
            summary.bytes += sum(size for size, _ in safe.files.values())


def _collect_run(
    store: Store, source: RunSource, name: str, later: bool, ids: dict[str, str], summary: CollectionSummary
) -> tuple[Collected, Rows] | None:
    """Copy a sound run; returns its manifest and rows. None: not finished, damaged, or a copy of one of `ids` (id ->
    cell/run). later: whether the cell has begun another run since."""
    try:
        with _local_copy(source, name) as folder:
            run = read_run(folder)
            if not finished(folder, run, later) or not _unchanged(folder):
                summary.waiting += 1
                return None
            if problems := damages(folder, run):
                _quarantine(store, source.cell, folder, problems)
                summary.apart += 1
                summary.warn(f"{source.cell}/{name}: damaged, set apart: {'; '.join(problems[:3])}")
                return None
            short = hashed_below(folder, RUN)[1][:16]
            if short in ids:
                summary.warn(f"{source.cell}/{name}: is the same run as {ids[short]}; not collected twice")
                return None
            safe = _put(store, source.cell, folder, run)
            ids[short] = f"{source.cell}/{name}"
            summary.say(f"{source.cell}/{name}: {len(safe.files)} files")
            return safe, rows_of(digest(name, run.records))
    except FileError as error:  # an unreadable file must not keep the cell's other runs out
        summary.apart += 1
        summary.warn(f"{source.cell}/{name}: damaged, stays on its cell: {error}")
        return None


def _put(store: Store, cell: str, folder: Path, run: RunRecords) -> Collected:
    """Copy every file of a sound run and read it back from the store; returns the manifest."""
    files = {name: store.put(folder, name, "runs", cell, folder.name, *name.split("/")) for name in files_of(folder)}
    start = next((r for r in run.records if r["kind"] == "run_start"), {})
    return Collected(cell, folder.name, files[RUN][1], start.get("version"), files)


def _quarantine(store: Store, cell: str, folder: Path, problems: list[str]) -> None:
    for name in files_of(folder):
        store.put(folder, name, "apart", cell, folder.name, *name.split("/"))
    store.write("".join(f"{line}\n" for line in problems).encode(), "apart", cell, f"{folder.name}.txt")


def _unchanged(folder: Path) -> bool:
    newest = max((folder / name).stat().st_mtime for name in files_of(folder))
    return time.time() - newest >= QUIET_S


def _free_cell(store: Store, source: RunSource, names: list[str], summary: CollectionSummary) -> None:
    """Remove from the cell the runs that equal the store's copy byte for byte; the newest run stays."""
    store.settle()
    collected = store.collected()
    for name in names[:-1]:
        if (source.cell, name) not in collected:
            continue
        safe = store.manifest(source.cell, name)
        with _local_copy(source, name) as folder:
            lost = store.damaged(safe)
            if not lost and _same(folder, safe):
                _remove(source, name)
                summary.freed += 1
                continue
            what = f"{lost[0]} is damaged in the store" if lost else "differs from what was collected"
            summary.warn(f"{source.cell}/{name}: {what}; it stays on the cell")


def _same(folder: Path, safe: Collected) -> bool:
    """Whether the folder has exactly the files of the manifest."""
    return set(files_of(folder)) == set(safe.files) and all(
        hashed_below(folder, name) == recorded for name, recorded in safe.files.items()
    )


class _UnreachableError(FacetdError):
    """A cell does not answer, or refuses access."""


def _names(source: RunSource) -> list[str]:
    """The runs of a cell, oldest first."""
    if not source.remote:
        if not Path(source.where).is_dir():
            raise _UnreachableError(f"{source.where}: no such folder of runs")
        return [folder.name for folder in list_runs(Path(source.where)) if NAME.fullmatch(folder.name)]
    listed = _rsync("--list-only", f"{source.where.rstrip('/')}/")
    names = [line.split()[-1] for line in listed.splitlines() if line.startswith("d")]
    return sorted((n for n in names if RUN_NAME.fullmatch(n)), key=lambda n: (n[:16], int(n[17:] or 0)))


@contextmanager
def _local_copy(source: RunSource, name: str) -> Iterator[Path]:
    """A run as a local folder: the cell's own, or a temporary copy by rsync."""
    if not source.remote:
        yield Path(source.where) / name
        return
    with tempfile.TemporaryDirectory(prefix="facetd-collect-") as folder:
        ends = f"{source.where.rstrip('/')}/{name}/", f"{folder}/{name}/"
        _rsync("--recursive", "--times", "--checksum", *FILTER, *ends)
        yield Path(folder) / name


def _remove(source: RunSource, name: str) -> None:
    if not source.remote:
        shutil.rmtree(Path(source.where) / name)
        return
    host, _, path = source.where.partition(":")
    _done("ssh", "-o", "BatchMode=yes", host, f"rm -r -- {shlex.quote(path.rstrip('/') + '/' + name)}")


def _rsync(*words: str) -> str:
    return _done("rsync", "--rsh=ssh -o BatchMode=yes", *words)


def _done(*words: str) -> str:
    try:
        done = subprocess.run(words, capture_output=True, text=True, check=False)
    except OSError as error:
        raise _UnreachableError(f"{words[0]}: {error.strerror}: install {words[0]}") from None
    if done.returncode:
        raise _UnreachableError(f"{words[0]}: {(done.stderr.strip().splitlines() or ['failed'])[0]}")
    return done.stdout
