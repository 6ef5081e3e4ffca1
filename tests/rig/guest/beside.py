"""In the guest: the ends of the two virtio ports that lead to the cell around it (tests/rig/otherside.py).

Run as a program this is the feeder: it keeps the loopback cameras (LEFT RIGHT, or LEFT) supplied with what the cameras
see now.
"""

from __future__ import annotations

import json
import os
import secrets
import sys
import time
from typing import Any

import numpy as np

WIDTH, HEIGHT = 640, 480
FPS = 1.25
"""Slow, because all is emulated: light must reach the devices within the period that a frame is taken to last."""


class Port:
    """One port, opened by its name. Every question has a number that its answer begins with: what an asker who was
    killed had still to read comes before that, and is nobody's."""

    def __init__(self, name: str) -> None:
        self._fd = os.open(f"/dev/virtio-ports/rig.{name}", os.O_RDWR)
        self._kept = bytearray()

    def ask(self, line: bytes = b"") -> None:
        """Send one line; what is read next is its answer."""
        number = secrets.token_hex(16).encode()
        os.write(self._fd, number + b" " + line + b"\n")
        self._up_to(number + b" ")

    def read(self, size: int) -> bytes:
        """That many bytes."""
        while len(self._kept) < size:
            self._more()
        return self._take(size)

    def line(self) -> bytes:
        """Up to the end of the line."""
        return self._up_to(b"\n")

    def _up_to(self, mark: bytes) -> bytes:
        while mark not in self._kept:
            self._more()
        return self._take(self._kept.index(mark) + len(mark))

    def _take(self, size: int) -> bytes:
        taken = bytes(self._kept[:size])
        del self._kept[:size]
        return taken

    def _more(self) -> None:
        piece = os.read(self._fd, 1 << 20)
        if not piece:
            raise ConnectionError("the cell beside the guest has gone")
        self._kept += piece


class Person:
    """Someone who stands at the cell."""

    def __init__(self) -> None:
        self._port = Port("person")

    def do(self, what: str, **more: Any) -> dict[str, Any]:
        """One of otherside.py's do_*."""
        self._port.ask(json.dumps({"do": what} | more).encode())
        answer: dict[str, Any] = json.loads(self._port.line())
        assert "error" not in answer, answer
        return answer


def feed(*paths: str) -> None:
    """Feed two devices, or the left one, for ever. A pair whose light took longer than a period is not shown: it would
    be stale."""
    import loopback

    light = Port("light")

    def picture(_: int) -> tuple[np.ndarray, np.ndarray]:
        light.ask()
        both = np.frombuffer(light.read(2 * WIDTH * HEIGHT), np.uint8).reshape(2, HEIGHT, WIDTH)
        return both[0], both[1]

    feeder = loopback.Feeder(picture, fps=FPS, most_s=0.9 / FPS, paths=paths)
    while True:
        began_s = time.monotonic()
        feeder.write()
        time.sleep(max(0.0, began_s + 1 / FPS - time.monotonic()))


if __name__ == "__main__":
    feed(*sys.argv[1:])
