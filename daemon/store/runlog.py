"""Write the log of a run so that a crash loses nothing: one folder a run, one JSON object a line.

`record` returns once the kernel has its line (kill -9 then loses at most a line being written). It waits once, for
`patience_s`, for a stalled disk, and not again until the disk has caught up: the log may not delay moves.
daemon/store/runs.py reads runs and removes old ones.

Lines are {"v": 2, "seq": n, "t": ISO UTC ms, "mono_s": ..., "kind": ..., more by kind}; daemon/events/records.py has
kinds and fields. wire.jsonl is the serial line's ledger: each of its lines has the hash of the line before.
"""

from __future__ import annotations

import hashlib
import logging
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from daemon.errors import spelt_throughout
from daemon.events.upgrade import VERSION
from daemon.store.files import NO_ROOM, LineFile, OpenFile, Syncer, write_atomically
from daemon.store.outside import read_file
from daemon.store.recovery_state import RecoveryFile, RecoveryState, after

PATIENCE_S = 0.1
LINES_WAITING = 20_000
LARGEST_KEPT = 256_000_000
PICTURES_WAITING = 64

URGENT = frozenset({"run_start", "left", "holding", "fault", "hand", "cycle_start", "cycle_end", "gap", "run_end"})


class RunLog:
    """The log of the current run. Safe to call from any thread.

    trouble: why the disk does not take it, in one line, or None; on_trouble(trouble) is called, from the writer's
    thread, when that changes.
    """

    def __init__(
        self,
        folder: Path,
        *,
        clock: Callable[[], float] = time.monotonic,
        wall: Callable[[], datetime] = lambda: datetime.now(UTC),
        fsync_every_s: float = 1.0,
        patience_s: float = PATIENCE_S,
        on_trouble: Callable[[str | None], object] = lambda _: None,
        recovery: RecoveryFile | None = None,
    ) -> None:
        """Start a run in `folder`, which is made if absent. recovery: the recovery file to keep up to date; the log
        closes it. Raises OSError; FileExistsError where the folder has a run."""
        self.trouble: str | None = None
        self._troubles: dict[str, str] = {}
        """Trouble by what the disk does not take."""
        self._refused: deque[Callable[[], None]] = deque()
        """Pictures that a full disk refused: written once the disk takes lines again."""
        self._clock, self._wall, self._patience_s, self._on_trouble = clock, wall, patience_s, on_trouble
        self._run = _Run(folder)
        self._recovery, self._state = recovery, RecoveryState(folder.name)
        self._lock, self._telling = threading.RLock(), threading.Lock()  # a writer without a thread counts a gap in it
        self._lost = 0
        self._behind = False
        self._closed = False
        self._lines, self._pictures = _Worker("runlog-lines"), _Worker("runlog-pictures")
        self._syncer = Syncer(fsync_every_s, self._synced)

    @property
    def folder(self) -> Path:
        return self._run.folder

    @property
    def removed(self) -> bool:
        """Whether somebody removed the run's folder: what is written since is lost."""
        return not self._run.lines.in_place

    def record(self, kind: str, /, **fields: Any) -> None:
        """Append one line of JSON. images: {name: (H, W) uint8}, written as images/<seq>-<name>.png."""
        written = threading.Event()
        with self._lock:
            run, seq = self._run, self._run.take_number()
            pictures = {name: f"images/{seq:06d}-{name}.png" for name in fields.get("images") or {}}
            for name, file in pictures.items():
                self._put_picture(run.folder / file, fields["images"][name])
            line = {**self._head(seq, kind), **fields, **({"images": pictures} if pictures else {})}
            before, self._state = self._state, after(self._state, kind, fields)
            if self._recovery is not None and self._state != before:
                self._lines.do(partial(self._write_recovery, self._recovery, self._state))
            self._put(run.lines, encode(line), written)
        if "lines" not in self._troubles and not self._behind:
            self._behind = not written.wait(self._patience_s)
        if kind in URGENT:
            self._syncer.hurry()

    def wire(self, entry: Mapping[str, Any]) -> None:
        """Append one entry to the serial line's ledger; never waits."""
        with self._lock:
            content = encode({**entry, "chain": self._run.chain})
            self._run.chain = hashlib.sha256(content).hexdigest()
            self._put(self._run.wire, content, threading.Event())

    def keep(self, path: Path) -> str:
        """Copy a file into kept/; returns kept/<sha256><suffix>. Raises FileError, OSError."""
        content = read_file(path, LARGEST_KEPT)
        name = f"kept/{hashlib.sha256(content).hexdigest()}{path.suffix}"
        target = self.folder / name
        if not target.exists():
            write_atomically(target, content, synced=False)
        return name

    def roll(self, folder: Path) -> None:
        """Continue in a new folder; the caller records its run_start. Raises OSError, with nothing changed."""
        fresh = _Run(folder)
        self.record("run_end", why=f"continues in {folder.name}")
        with self._lock:
            before, self._run = self._run, fresh
            self._state = msgspec.structs.replace(self._state, run=folder.name)
            self._lines.do(partial(self._close_finished, before))

    def settle(self, timeout_s: float = 5.0) -> bool:
        """Wait until all records and pictures so far are on the disk; False on timeout."""
        through = (threading.Event(), threading.Event())
        self._lines.do(through[0].set)
        self._pictures.do(through[1].set)
        deadline = time.monotonic() + timeout_s
        done = all(event.wait(max(0.0, deadline - time.monotonic())) for event in through)
        self._syncer.hurry()
        return done and self._syncer.wait_until_written(max(0.0, deadline - time.monotonic()))

    def close(self, why: str = "stopped", **fields: Any) -> None:
        """Write run_end and close the files, within seconds even where the disk hangs; safe to call twice."""
        if self._closed:
            return
        pictures_written = self._pictures.end(1.5)
        self._lost += len(self._refused)
        self.record("run_end", why=why, **fields)
        self._closed = True
        lines_written = self._lines.end(1.5)
        self._syncer.stop()
        if pictures_written and lines_written:
            self._run.close()
            if self._recovery is not None:
                self._recovery.close()

    def _head(self, seq: int, kind: str) -> dict[str, Any]:
        now = self._wall().strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"
        return {"v": VERSION, "seq": seq, "t": now, "mono_s": round(self._clock(), 6), "kind": kind}

    def _put(self, file: LineFile, content: bytes, written: threading.Event) -> None:
        if self._closed or self._lines.waiting > LINES_WAITING:
            self._lost += 1
            written.set()
        else:
            self._lines.do(partial(self._write_line, file, content, written))

    def _put_picture(self, path: Path, pixels: NDArray[np.uint8]) -> None:
        if self._pictures.waiting > PICTURES_WAITING:
            self._lost += 1
        else:
            self._pictures.do(partial(self._write_picture, path, pixels))

    def _write_line(self, file: LineFile, content: bytes, written: threading.Event) -> None:
        try:
            if self._lost:
                self._write_gap()
            file.append(content)
            self._tell("lines", None)
            self._catch_up()
        except OSError as error:
            self._lost += 1
            self._tell("lines", f"{file.path.parent}: {error.strerror}")
        written.set()
        self._behind = self._behind and self._lines.waiting > 0
        self._syncer.take(file)

    def _catch_up(self) -> None:
        """Retry what the disk refused before, now that it takes lines."""
        if self._recovery is not None and {"recovery", str(self._recovery.path)} & self._troubles.keys():
            self._write_recovery(self._recovery, self._state)
        if self._refused:
            self._pictures.do(self._refused.popleft())

    def _write_recovery(self, file: RecoveryFile, state: RecoveryState) -> None:
        try:
            file.write(state)
            self._tell("recovery", None)
        except OSError as error:
            self._tell("recovery", f"{file.path}: {error.strerror}")
        self._syncer.take(file)

    def _synced(self, file: OpenFile, error: OSError | None) -> None:
        self._tell(str(file.path), None if error is None else f"{file.path}: not kept: {error.strerror}")

    def _close_finished(self, run: _Run) -> None:
        """Close a finished run; its troubles end with it, as nothing can mend them now."""
        run.close()
        for file in (run.lines, run.wire):
            self._tell(str(file.path), None)

    def _write_gap(self) -> None:
        with self._lock:
            run, lost = self._run, self._lost
            why = self.trouble or "the disk did not keep up"
            gap = {**self._head(run.take_number(), "gap"), "lost": lost, "why": why}
        run.lines.append(encode(gap))
        with self._lock:
            self._lost -= lost

    def _write_picture(self, path: Path, pixels: NDArray[np.uint8]) -> None:
        try:
            _, png = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
            write_atomically(path, png.tobytes(), synced=False)
            if self._refused:
                self._pictures.do(self._refused.popleft())
            else:
                self._tell("pictures", None)
        except OSError as error:
            if error.errno in NO_ROOM and len(self._refused) < PICTURES_WAITING:
                self._refused.append(partial(self._write_picture, path, pixels))
            else:
                self._lost += 1
            self._tell("pictures", f"{path}: {error.strerror}")

    def _tell(self, of: str, trouble: str | None) -> None:
        with self._telling:
            if trouble is None:
                self._troubles.pop(of, None)
            else:
                self._troubles[of] = trouble
            first = next(iter(self._troubles.values()), None)
            if first != self.trouble:
                self.trouble = first
                self._on_trouble(first)


class _Worker:
    """A thread that runs its jobs in order."""

    def __init__(self, name: str) -> None:
        self._jobs: queue.SimpleQueue[Callable[[], object] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Number of jobs not begun."""
        return self._jobs.qsize()

    def do(self, job: Callable[[], object]) -> None:
        self._jobs.put(job)

    def end(self, timeout_s: float) -> bool:
        """Finish the queued jobs and end the thread; False on timeout."""
        self._jobs.put(None)
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                job()
            except Exception:  # one failed job must not stop the next
                logging.getLogger(__name__).exception("run log: a job failed")


class _Run:
    """One run folder, open for writing, with its counters."""

    def __init__(self, folder: Path) -> None:
        for name in ("images", "kept"):
            (folder / name).mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self.lines = LineFile(folder / "run.jsonl")
        self.wire = LineFile(folder / "wire.jsonl")
        self.chain = ""
        self._next = 0

    def take_number(self) -> int:
        self._next += 1
        return self._next - 1

    def close(self) -> None:
        self.lines.close()
        self.wire.close()


def encode(content: Mapping[str, Any]) -> bytes:
    """Encode one JSON object on one line."""
    try:
        return msgspec.json.encode(content, enc_hook=_plain)
    except UnicodeEncodeError:  # it has a file name that is not UTF-8
        return msgspec.json.encode(spelt_throughout(content), enc_hook=lambda value: spelt_throughout(_plain(value)))


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    return str(value)
