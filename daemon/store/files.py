"""Write files so that a full, slow or removed disk never leaves half a line: appending, syncing, atomic replacement."""

import contextlib
import errno
import fcntl
import os
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

from daemon.errors import FacetdError, one_line

NO_ROOM = (errno.ENOSPC, errno.EDQUOT)
"""Errors of a full disk."""


class OpenFile:
    """A file that one thread writes and another syncs."""

    def __init__(self, path: Path, handle: int) -> None:
        self.path, self._handle = path, handle
        self._closing = threading.Lock()

    def sync(self) -> None:
        """Flush it to the disk. Raises OSError; a closed file is on the disk already."""
        with self._closing:
            if self._handle >= 0:
                os.fsync(self._handle)

    def close(self) -> None:
        """Flush it to the disk and close it; safe to call twice."""
        with contextlib.suppress(OSError):
            self.sync()
        with self._closing:
            if self._handle >= 0:
                os.close(self._handle)
            self._handle = -1


class LineFile(OpenFile):
    """An append-only file of whole lines: a line of which only a part was written is removed again."""

    def __init__(self, path: Path) -> None:
        """Create the file and lock it until it is closed. Raises OSError; FileExistsError where it exists."""
        super().__init__(path, os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC, 0o640))
        with contextlib.suppress(OSError):  # a file system without locks: readers take the file for complete
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._length = 0
        self._torn = False
        """Whether the file may end in half a line: on a full disk even the truncation may fail."""

    @property
    def in_place(self) -> bool:
        """Whether its path still leads to this file."""
        try:
            return self._handle < 0 or os.path.samestat(os.fstat(self._handle), os.stat(self.path))
        except OSError:
            return False

    def append(self, content: bytes) -> None:
        """Add one line. Raises OSError: then the file has no part of it, or loses that part before the next line."""
        line = content + b"\n"
        self._cut_off()
        self._torn = True
        try:
            if os.write(self._handle, line) != len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError:
            self._cut_off()
            raise
        self._torn = False
        self._length += len(line)

    def _cut_off(self) -> None:
        if self._torn:
            os.ftruncate(self._handle, self._length)
            self._torn = False


def being_written(path: Path) -> bool:
    """Whether a process still has this LineFile open. The kernel frees the lock however that process ends."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # a file system without locks
        pass
    finally:
        os.close(handle)
    return False


class Syncer:
    """Syncs files to the disk in its own thread: at once on request, else at most every `every_s`."""

    def __init__(self, every_s: float, done: Callable[[OpenFile, OSError | None], object] = lambda *_: None) -> None:
        """done: called after each sync, in the syncer's thread, with the error if it failed. The kernel reports such an
        error once: the next sync succeeds although the data are lost."""
        self._every_s, self._done, self._stop = every_s, done, False
        self._dirty: set[OpenFile] = set()
        self._wake, self._urgent, self._clean = threading.Event(), threading.Event(), threading.Event()
        self._lock = threading.Lock()
        self._clean.set()
        self._thread = threading.Thread(target=self._run, name="runlog-sync", daemon=True)
        self._thread.start()

    def take(self, file: OpenFile) -> None:
        """Queue a file for the next sync."""
        with self._lock:
            self._clean.clear()
            self._dirty.add(file)
        self._wake.set()

    def hurry(self) -> None:
        """Sync the queued files now."""
        self._urgent.set()

    def wait_until_written(self, timeout_s: float) -> bool:
        """Wait until all queued files are on the disk; False on timeout."""
        return self._clean.wait(timeout_s)

    def stop(self) -> None:
        """Sync the queued files and end the thread."""
        self._stop = True
        self._urgent.set()
        self._wake.set()
        self._thread.join(timeout=1.5)

    def _run(self) -> None:
        while not self._stop or self._dirty:
            self._wake.wait()
            self._urgent.wait(self._every_s)
            self._wake.clear()
            self._urgent.clear()
            with self._lock:
                files, self._dirty = self._dirty, set()
            for file in files:
                try:
                    file.sync()
                except OSError as error:
                    self._done(file, error)
                else:
                    self._done(file, None)
            with self._lock:
                if not self._dirty:
                    self._clean.set()


def write_atomically(path: Path, content: bytes, synced: bool = True) -> None:
    """Replace a file so that a power cut leaves the old or the new one, never a half: temporary file, fsync, rename.

    synced False: no wait for the disk; readers still find a whole file or none, but a power cut may leave it empty.
    Raises OSError: then the old file is in place, even where syncing the rename failed.
    """
    with naming(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        before = path.read_bytes() if synced and path.is_file() else None
        mode = path.stat().st_mode & 0o777 if path.exists() else 0o644
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
                file.flush()
                os.fchmod(file.fileno(), mode)
                if synced:
                    os.fsync(file.fileno())
            os.replace(temporary, path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
        if not synced:
            return
        try:
            _sync_folder(path.parent)
        except OSError:
            _put_back(path, before)
            raise


def _put_back(path: Path, before: bytes | None) -> None:
    """Restore the file from before a failed write. Raises OSError where that fails too: the new content may remain."""
    try:
        if before is None:
            path.unlink()
        else:
            write_atomically(path, before, synced=False)
    except OSError as error:
        why = f"written, but a power cut may undo it: {error.strerror}"
        raise OSError(error.errno, why, str(path)) from error
    with contextlib.suppress(OSError):
        _sync_folder(path.parent)


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Add the file's name to an OSError that has none, as that of a full or failing disk."""
    try:
        yield
    except OSError as error:
        if error.filename is None:
            error.filename = str(path)
        raise


@contextlib.contextmanager
def failing_as(kind: type[FacetdError], what: str) -> Iterator[None]:
    """Turn an OSError into an error for people: `what: reason`."""
    try:
        yield
    except OSError as error:
        raise kind(f"{what}: {error.strerror or error}") from error


LAST_NUMBER = 999_999_999
"""Largest number of a version, view or calibration; a file with it counts as not numbered: none could follow."""


def number_of(name: str) -> int | None:
    """The number that a file is named by; None for a name that facetd does not give."""
    ours = name.isascii() and name.isdecimal() and len(name) < 10
    return int(name) if ours and int(name) < LAST_NUMBER else None


class InUseError(FacetdError):
    """Another process uses a folder: which folder, which process."""


def hold(folder: Path) -> int:
    """Lock a folder for this process; returns the handle, to be left open. Raises InUseError, OSError."""
    lock = folder / "lock"
    folder.mkdir(parents=True, exist_ok=True)
    handle = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o640)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        holder = os.read(handle, 20).decode("ascii", "replace").strip() or "unknown"
        os.close(handle)
        raise InUseError(f"{folder}: another facetd (process {holder}) uses it; stop that one first") from None
    with contextlib.suppress(OSError):  # on a full disk the lock holds all the same
        os.ftruncate(handle, 0)
        os.pwrite(handle, f"{os.getpid()}\n".encode(), 0)
    return handle


def plain(error: BaseException) -> str:
    """Text of an error for people, on one line: of an OSError `file: what is wrong`, and the remedy for a full disk."""
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        remedy = "; free some space there" if error.errno in NO_ROOM else ""
        return f"{error.filename}: {error.strerror}{remedy}"
    return one_line(error)
