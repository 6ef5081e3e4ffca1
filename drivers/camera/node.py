"""Video device nodes of the operating system: list, open, map, wait. The only module here that touches /dev. Tests
replace `LINUX`.
"""

import ctypes
import fcntl
import mmap
import os
import select
from collections.abc import Sequence
from pathlib import Path


class FileNode:
    """An open, non-blocking /dev/videoN. Its methods raise OSError."""

    def __init__(self, path: str) -> None:
        self._fd = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def fileno(self) -> int:
        return self._fd

    def ioctl(self, request: int, argument: ctypes.Structure | ctypes.c_int32) -> None:
        """One request, repeated when a signal interrupted it."""
        while True:
            try:
                fcntl.ioctl(self._fd, request, argument)
                return
            except InterruptedError:
                continue

    def map(self, offset: int, length: int) -> mmap.mmap:
        """Map one driver buffer."""
        return mmap.mmap(self._fd, length, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE, offset=offset)

    def close(self) -> None:
        """Close; safe to call twice."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


class Linux:
    """The video nodes of the machine that facetd runs on."""

    def nodes(self) -> list[str]:
        numbers = (p.name.removeprefix("video") for p in Path("/sys/class/video4linux").glob("video*"))
        return [f"/dev/video{n}" for n in sorted(int(n) for n in numbers if n.isdigit())]

    def resolve(self, name: str) -> str | None:
        """The node of an absolute path or link; None where there is none."""
        return os.path.realpath(name) if name.startswith("/") and os.path.exists(name) else None

    def links(self, path: str) -> list[str]:
        """Stable names of this node: by-id before by-path."""
        return [str(link) for link in sorted(Path("/dev/v4l").glob("by-*/*")) if os.path.realpath(link) == path]

    def holders(self, path: str) -> list[str]:
        """Programs that have the node open, as `name (pid)`; those of other users only for root."""
        found = []
        for process in Path("/proc").glob("[0-9]*"):
            try:
                if any(os.path.realpath(fd) == path for fd in (process / "fd").iterdir()):
                    found.append(f"{(process / 'comm').read_text().strip()} ({process.name})")
            except OSError:
                continue
        return found

    def open(self, path: str) -> FileNode:
        """Open for capture."""
        return FileNode(path)

    def wait(self, nodes: Sequence[FileNode], timeout_s: float) -> bool:
        """Wait until one of the nodes has a frame or an error; False on timeout."""
        poll = select.poll()
        for node in nodes:
            poll.register(node.fileno(), select.POLLIN | select.POLLPRI)
        return bool(poll.poll(max(0.0, timeout_s) * 1000.0))


LINUX = Linux()
