"""Device nodes as the operating system hands them out: list, open, map, wait. The only module here that touches /dev.

`LINUX` is the real thing; tests put a made-up machine in its place (the `System` protocol).
"""

from __future__ import annotations

import ctypes
import fcntl
import mmap
import os
import select
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from drivers.camera import v4l2


class OpenNode(v4l2.Node, Protocol):
    """A device node held open."""

    def map(self, offset: int, length: int) -> mmap.mmap:
        """Map one driver buffer. Raises OSError."""

    def close(self) -> None:
        """Let go; safe to call twice."""


class System(Protocol):
    """What the camera driver needs of a machine."""

    def nodes(self) -> list[str]:
        """Paths of all video nodes, by number."""

    def resolve(self, name: str) -> str | None:
        """The node that an absolute path, link or not, leads to now; None where it leads nowhere or is no path."""

    def links(self, path: str) -> list[str]:
        """Stable names (paths under /dev/v4l) that lead to this node now."""

    def holders(self, path: str) -> list[str]:
        """Programs that hold the node open, as far as this process may see."""

    def open(self, path: str) -> OpenNode:
        """Open for capture. Raises OSError."""

    def wait(self, nodes: Sequence[OpenNode], timeout_s: float) -> bool:
        """Sleep until one of the nodes has a frame or trouble; False when the time ran out."""


class FileNode:
    """A /dev/videoN held open without blocking."""

    def __init__(self, path: str) -> None:
        self._fd = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def fileno(self) -> int:
        """The descriptor, for select."""
        return self._fd

    def ioctl(self, request: int, argument: ctypes.Structure | ctypes.c_int32) -> None:
        """One request, again when a signal broke it off."""
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
        """Let go; safe to call twice."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


class Linux:
    """The video nodes of the machine that facetd runs on."""

    def nodes(self) -> list[str]:
        """Paths of all video nodes, by number."""
        numbers = (p.name.removeprefix("video") for p in Path("/sys/class/video4linux").glob("video*"))
        return [f"/dev/video{n}" for n in sorted(int(n) for n in numbers if n.isdigit())]

    def resolve(self, name: str) -> str | None:
        """Where an absolute path leads now: a node itself, or a link of udev's."""
        return os.path.realpath(name) if name.startswith("/") and os.path.exists(name) else None

    def links(self, path: str) -> list[str]:
        """Stable names that lead to this node now: by-id before by-path."""
        return [str(link) for link in sorted(Path("/dev/v4l").glob("by-*/*")) if os.path.realpath(link) == path]

    def holders(self, path: str) -> list[str]:
        """Programs that hold the node open, as `name (pid)`; those of other users stay unseen without root."""
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

    def wait(self, nodes: Sequence[OpenNode], timeout_s: float) -> bool:
        """Sleep until one of the nodes has a frame or trouble."""
        poll = select.poll()
        for node in nodes:
            if isinstance(node, FileNode):
                poll.register(node.fileno(), select.POLLIN | select.POLLPRI)
        return bool(poll.poll(max(0.0, timeout_s) * 1000.0))


LINUX = Linux()
