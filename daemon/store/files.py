"""Bytes onto a disk that may be full, slow or pulled: whole lines or none, synced in a thread of their own.

Nothing here knows what the lines mean.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

from daemon.errors import FacetdError

NO_ROOM = (errno.ENOSPC, errno.EDQUOT)
"""What a disk says that is full."""


class OpenFile:
    """A file that is written for as long as it is open, and synced from another thread."""

    def __init__(self, path: Path, handle: int) -> None:
        self.path, self._handle = path, handle
        self._closing = threading.Lock()

    def sync(self) -> None:
        """Bring it to the disk. Raises OSError; a closed file is on the disk already."""
        with self._closing:
            if self._handle >= 0:
                os.fsync(self._handle)

    def close(self) -> None:
        """Bring it to the disk and let go; safe to call twice."""
        with contextlib.suppress(OSError):
            self.sync()
        with self._closing:
            if self._handle >= 0:
                os.close(self._handle)
            self._handle = -1


class LineFile(OpenFile):
    """An append-only file that never keeps half a line: a short write is cut off again."""

    def __init__(self, path: Path) -> None:
        """Create it, and hold it while it is written (`being_written`). Raises OSError, FileExistsError where there is
        one already."""
        super().__init__(path, os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC, 0o640))
        with contextlib.suppress(OSError):  # a file system without locks: readers will take it for ended
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._length = 0
        self._torn = False
        """Whether half a line may stand at its end: a full disk may have no room to cut it off either."""

    @property
    def in_place(self) -> bool:
        """Whether it is still what its name leads to."""
        try:
            return self._handle < 0 or os.path.samestat(os.fstat(self._handle), os.stat(self.path))
        except OSError:
            return False

    def append(self, content: bytes) -> None:
        """Add one line. Raises OSError, and then nothing of it is in the file, or will be once it is written again."""
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
    """Whether a process still has this LineFile open; however it ends, the kernel lets go of it."""
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
    """Brings lines from the kernel to the disk: at once for urgent kinds, else at most every so often."""

    def __init__(self, every_s: float, done: Callable[[OpenFile, OSError | None], object] = lambda *_: None) -> None:
        """done: told of each try, in this thread, and why the disk cannot keep what it took, if so. It has forgotten it
        then, and says of the next try that all is well."""
        self._every_s, self._done, self._stop = every_s, done, False
        self._dirty: set[OpenFile] = set()
        self._wake, self._urgent, self._clean = threading.Event(), threading.Event(), threading.Event()
        self._lock = threading.Lock()
        self._clean.set()
        self._thread = threading.Thread(target=self._run, name="runlog-sync", daemon=True)
        self._thread.start()

    def take(self, file: OpenFile) -> None:
        """Sync this file some time soon."""
        with self._lock:
            self._clean.clear()
            self._dirty.add(file)
        self._wake.set()

    def hurry(self) -> None:
        """Sync what was taken now."""
        self._urgent.set()

    def settled(self, timeout_s: float) -> bool:
        """Wait until all that was taken is on the disk; False when that took longer."""
        return self._clean.wait(timeout_s)

    def stop(self) -> None:
        """Sync what was taken and end."""
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
    """Replace a file so that a power cut leaves the old or the new one, never a half: temporary, fsync, rename. Raises
    OSError, and then the old one is there, also where it is the rename that a disk cannot keep.

    Not synced it costs no wait: a reader still meets the whole file or none, but a power cut may leave it empty.
    """
    with naming(path):
        _write_atomically(path, content, synced)


def _write_atomically(path: Path, content: bytes, synced: bool) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    before = _content(path) if synced else None
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


def _content(path: Path) -> bytes | None:
    return path.read_bytes() if path.is_file() else None


def _put_back(path: Path, before: bytes | None) -> None:
    """What was there before a write of which the caller is told that it was none. Raises OSError, which says that it
    stands."""
    try:
        if before is None:
            path.unlink()
        else:
            _write_atomically(path, before, synced=False)
    except OSError as error:
        why = f"written, and it is not sure that it stays: {error.strerror}"
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
    """What the operating system says of a full or failing disk names no file: this one it was."""
    try:
        yield
    except OSError as error:
        if error.filename is None:
            error.filename = str(path)
        raise


LAST_NUMBER = 999_999_999
"""Of anything that is numbered here. Nobody counted that far: what says so counts as not numbered, as nothing could
come behind it."""


def number_of(name: str) -> int | None:
    """The number that something is named by; None where its name is none of ours."""
    ours = name.isascii() and name.isdecimal() and len(name) < 10
    return int(name) if ours and int(name) < LAST_NUMBER else None


class InUseError(FacetdError):
    """A folder belongs to another process at present: which folder, which process."""


def hold(folder: Path) -> int:
    """Claim a folder for this process until it ends, however it ends; gives the lock's handle, to be kept open.

    Raises InUseError, OSError.
    """
    lock = folder / "lock"
    folder.mkdir(parents=True, exist_ok=True)
    handle = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o640)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        holder = os.read(handle, 20).decode("ascii", "replace").strip() or "unknown"
        os.close(handle)
        raise InUseError(f"{folder}: another facetd (process {holder}) works in it; stop that one first") from None
    with contextlib.suppress(OSError):  # on a full disk it is held all the same
        os.ftruncate(handle, 0)
        os.pwrite(handle, f"{os.getpid()}\n".encode(), 0)
    return handle


def plain(error: BaseException) -> str:
    """An error for people, on one line; those of the operating system as `file: what is wrong`, and what to do where
    the disk is full."""
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        remedy = "; free some space there" if error.errno in NO_ROOM else ""
        return f"{error.filename}: {error.strerror}{remedy}"
    return " ".join(str(error).split()) or type(error).__name__
