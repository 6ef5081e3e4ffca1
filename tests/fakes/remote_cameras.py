"""facetd with the cameras of another process: a launcher for benches on a computer without video devices.

The rest is the daemon as on a real cell. The owner of the cameras serves them with `lend` and starts the daemon by
`python -m tests.fakes.remote_cameras`, with the path of the socket in FACETD_LENT_CAMERAS.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from multiprocessing.connection import Client, Connection, Listener
from pathlib import Path
from typing import Any
from unittest.mock import patch

from daemon import main
from daemon.cell import own_cells
from drivers.camera.pair import CameraError, StereoCamera, StereoPair

PLACE = "FACETD_LENT_CAMERAS"


def lend(camera: StereoCamera, place: Path) -> Listener:
    """Serve the camera at a socket, to one borrower after the other, until the listener is closed."""
    listener = Listener(str(place), family="AF_UNIX")

    def serve() -> None:
        while True:
            try:
                borrower = listener.accept()
            except OSError:
                return
            threading.Thread(target=_answer, args=(borrower, camera), daemon=True).start()

    threading.Thread(target=serve, name="lent cameras", daemon=True).start()
    return listener


def _answer(borrower: Connection, camera: StereoCamera) -> None:
    with borrower:
        while True:
            try:
                not_before_s, timeout_s = borrower.recv()
                try:
                    answer: StereoPair | CameraError = camera.grab(not_before_s, timeout_s)
                except CameraError as error:
                    answer = error
                borrower.send(answer)
            except (EOFError, OSError):
                return


class BorrowedCameras:
    """drivers/camera/pair.py's StereoCamera, by way of a socket."""

    def __init__(self, settings: Any, clock: Callable[[], float]) -> None:
        self._line: Connection | None = None

    def open(self) -> None:
        """See StereoCamera."""
        self._line = Client(os.environ[PLACE], family="AF_UNIX")

    def grab(self, not_before_s: float, timeout_s: float) -> StereoPair:
        """See StereoCamera."""
        assert self._line is not None
        self._line.send((not_before_s, timeout_s))
        answer: StereoPair | CameraError = self._line.recv()
        if isinstance(answer, CameraError):
            raise answer
        return answer

    def expose(self, left: float, right: float) -> None:
        """Theirs, not ours, to set."""

    def close(self) -> None:
        """See StereoCamera."""
        if self._line is not None:
            self._line.close()

    def describe(self) -> str:
        """See StereoCamera."""
        return "lent cameras"


if __name__ == "__main__":
    with patch.object(own_cells, "V4L2StereoCamera", BorrowedCameras):
        sys.exit(main.main())
