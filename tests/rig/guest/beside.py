"""In the guest: the ends of the two virtio ports that lead to the cell around it (tests/rig/otherside.py).

Run as a program this is the feeder: it keeps the loopback cameras (LEFT RIGHT, or LEFT) supplied with what the eyes see
now.
"""

from __future__ import annotations

import json
import os
import sys
import time
from typing import Any

import numpy as np

WIDTH, HEIGHT = 640, 480
FPS = 1.25
"""Slow, because all is emulated: light must reach the devices within the period that a frame is taken to last."""


class Port:
    """One port, opened by its name."""

    def __init__(self, name: str) -> None:
        self._fd = os.open(f"/dev/virtio-ports/rig.{name}", os.O_RDWR)

    def ask(self, line: bytes) -> None:
        """Send one line."""
        os.write(self._fd, line + b"\n")

    def read(self, size: int) -> bytes:
        """That many bytes."""
        pieces = []
        while size:
            piece = os.read(self._fd, size)
            if not piece:
                raise ConnectionError("the cell beside the guest has gone")
            pieces.append(piece)
            size -= len(piece)
        return b"".join(pieces)

    def line(self) -> bytes:
        """Up to the end of the line."""
        text = b""
        while not text.endswith(b"\n"):
            text += self.read(1)
        return text


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
        light.ask(b"")
        both = np.frombuffer(light.read(2 * WIDTH * HEIGHT), np.uint8).reshape(2, HEIGHT, WIDTH)
        return both[0], both[1]

    feeder = loopback.Feeder(picture, fps=FPS, most_s=0.9 / FPS, paths=paths)
    while True:
        began_s = time.monotonic()
        feeder.write()
        time.sleep(max(0.0, began_s + 1 / FPS - time.monotonic()))


if __name__ == "__main__":
    feed(*sys.argv[1:])
