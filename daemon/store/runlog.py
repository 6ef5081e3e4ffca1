"""What happened, written so that a crash loses nothing: one folder a run, one JSON object a line. Writing only.

`record` returns once its line is in the kernel's hands (kill -9 then loses at most a line being written). It waits once
`patience_s` for a stalled disk, and no more until the disk has caught up: a log may not delay moves. Reading and
quotas are in daemon/store/runs.py.

Lines are {"v": 2, "seq": n, "t": ISO UTC ms, "mono_s": ..., "kind": ..., more by kind}; daemon/events/records.py has
kinds and fields. wire.jsonl beside it holds the serial line's ledger: there each line carries its forerunner's hash.
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
    """The log of the present run. Safe to call from any thread.

    `trouble` says in one line why the disk does not take it, or None; on_trouble(trouble) is called (from the writer's
    thread) when that changes.
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
        standing: RecoveryFile | None = None,
    ) -> None:
        """Start a run in `folder` (made if need be). standing: where it is kept what the next start must know; it is
        closed with the log. Raises OSError; FileExistsError where a run is in it already."""
        self.trouble: str | None = None
        self._troubles: dict[str, str] = {}
        """By what the disk does not take."""
        self._refused: deque[Callable[[], None]] = deque()
        """The pictures that there is no room for: written once the disk takes lines again."""
        self._clock, self._wall, self._patience_s, self._on_trouble = clock, wall, patience_s, on_trouble
        self._run = _Run(folder)
        self._standing, self._stands = standing, RecoveryState(folder.name)
        self._lock, self._telling = threading.Lock(), threading.Lock()
        self._lost = 0
        self._behind = False
        self._closed = False
        self._lines, self._pictures = _Worker("runlog-lines"), _Worker("runlog-pictures")
        self._syncer = Syncer(fsync_every_s, self._synced)

    @property
    def folder(self) -> Path:
        """The folder of the present run."""
        return self._run.folder

    @property
    def removed(self) -> bool:
        """Whether somebody took the run's folder away: what is written then is nowhere to be found."""
        return not self._run.lines.in_place

    def record(self, kind: str, /, **fields: Any) -> None:
        """Append one line. Arrays, numpy scalars and paths become plain JSON, nan becomes null.

        Under the name `images`, a dict of name -> (H, W) uint8 array is kept as images/<seq>-<name>.png.
        """
        written = threading.Event()
        with self._lock:
            run, seq = self._run, self._run.take_number()
            pictures = {name: f"images/{seq:06d}-{name}.png" for name in fields.get("images") or {}}
            for name, file in pictures.items():
                self._put_picture(run.folder / file, fields["images"][name])
            line = {**self._head(seq, kind), **fields, **({"images": pictures} if pictures else {})}
            before, self._stands = self._stands, after(self._stands, kind, fields)
            if self._standing is not None and self._stands != before:
                self._lines.do(partial(self._write_standing, self._standing, self._stands))
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
        """Copy a file into kept/ by the hash of its content; gives kept/<sha256><suffix>. Raises FileError, OSError."""
        content = read_file(path, LARGEST_KEPT)
        name = f"kept/{hashlib.sha256(content).hexdigest()}{path.suffix}"
        target = self.folder / name
        if not target.exists():
            write_atomically(target, content, synced=False)
        return name

    def roll(self, folder: Path) -> None:
        """End this run and go on in a new folder; the caller records its run_start. OSError: nothing changed."""
        fresh = _Run(folder)
        self.record("run_end", why=f"continues in {folder.name}")
        with self._lock:
            before, self._run = self._run, fresh
            self._stands = msgspec.structs.replace(self._stands, run=folder.name)
            self._lines.do(partial(self._let_go, before))

    def settle(self, timeout_s: float = 5.0) -> bool:
        """Wait until all recorded so far, pictures too, is on the disk; False when that took longer."""
        through = (threading.Event(), threading.Event())
        self._lines.do(through[0].set)
        self._pictures.do(through[1].set)
        deadline = time.monotonic() + timeout_s
        done = all(event.wait(max(0.0, deadline - time.monotonic())) for event in through)
        self._syncer.hurry()
        return done and self._syncer.settled(max(0.0, deadline - time.monotonic()))

    def close(self, why: str = "stopped", **fields: Any) -> None:
        """Write run_end and let go of the files, within some seconds even when the disk hangs; safe to call twice."""
        if self._closed:
            return
        shown = self._pictures.end(1.5)
        self._lost += len(self._refused)
        self.record("run_end", why=why, **fields)
        self._closed = True
        told = self._lines.end(1.5)
        self._syncer.stop()
        if shown and told:
            self._run.close()
            if self._standing is not None:
                self._standing.close()

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
        """The disk takes lines: perhaps it takes by now what else it refused."""
        if self._standing is not None and {"standing", str(self._standing.path)} & self._troubles.keys():
            self._write_standing(self._standing, self._stands)
        if self._refused:
            self._pictures.do(self._refused.popleft())

    def _write_standing(self, file: RecoveryFile, standing: RecoveryState) -> None:
        try:
            file.write(standing)
            self._tell("standing", None)
        except OSError as error:
            self._tell("standing", f"{file.path}: {error.strerror}")
        self._syncer.take(file)

    def _synced(self, file: OpenFile, error: OSError | None) -> None:
        self._tell(str(file.path), None if error is None else f"{file.path}: not kept: {error.strerror}")

    def _let_go(self, run: _Run) -> None:
        """What of it is not on the disk by now is not to be mended."""
        run.close()
        for file in (run.lines, run.wire):
            self._tell(str(file.path), None)

    def _write_gap(self) -> None:
        with self._lock:
            run, lost = self._run, self._lost
            gap = {
                **self._head(run.take_number(), "gap"),
                "lost": lost,
                "why": self.trouble or "the disk did not keep up",
            }
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
            told = next(iter(self._troubles.values()), None)
            if told != self.trouble:
                self.trouble = told
                self._on_trouble(told)


class _Worker:
    """A thread that does what it is given, one after the other."""

    def __init__(self, name: str) -> None:
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """How many jobs are not begun yet."""
        return self._jobs.qsize()

    def do(self, job: Callable[[], None]) -> None:
        """Do it once all before it is done."""
        self._jobs.put(job)

    def end(self, timeout_s: float) -> bool:
        """Do what was given and end; False when that takes longer."""
        self._jobs.put(None)
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                job()
            except Exception:  # whatever one cannot be written for, the next one is
                logging.getLogger(__name__).exception("the run log")


class _Run:
    """One run folder, open for writing, and the counters that belong to it."""

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
    """One JSON object without newlines."""
    try:
        return msgspec.json.encode(content, enc_hook=_plain)
    except UnicodeEncodeError:  # a file's name that is no UTF-8 is in it
        return msgspec.json.encode(spelt_throughout(content), enc_hook=lambda value: spelt_throughout(_plain(value)))


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    return str(value)
