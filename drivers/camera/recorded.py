"""Recorded stereo pairs as a camera: for replay, for trying settings, for a computer without cameras.

Two layouts: folders with left.png and right.png each (as `facetctl snap` writes), or one folder of NAME-left.png and
NAME-right.png (a run's images). Pairs are in the order of their names.
"""

import re
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from drivers.camera.pair import CameraError, CameraName, Frame, StereoPair
from drivers.camera.pixels import Image


def _order(path: Path) -> list[tuple[int, str]]:
    """Sort key that puts pair 9 before pair 10."""
    return [(int(piece), "") if piece.isdigit() else (-1, piece) for piece in re.split(r"(\d+)", str(path)) if piece]


def recorded_pairs(folder: Path) -> list[tuple[Path, Path]]:
    """The (left, right) files of a folder, in order. Raises CameraError where there is none, or half of one."""
    if not folder.is_dir():
        raise CameraError(f"recorded pairs: {folder} is not a folder")
    lefts = [p for pattern in ("left.png", "*-left.png", "*/left.png") for p in folder.glob(pattern)]
    pairs = [(p, p.with_name(p.name.removesuffix("left.png") + "right.png")) for p in sorted(set(lefts), key=_order)]
    if not pairs:
        raise CameraError(f"recorded pairs: {folder} contains neither PAIR/left.png nor PAIR-left.png")
    missing = next((right for _, right in pairs if not right.is_file()), None)
    if missing:
        raise CameraError(f"recorded pairs: {missing} is missing")
    return pairs


def read_image(path: Path) -> Image:
    """An image file as grey (H, W). Raises CameraError."""
    try:
        data = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError as error:
        raise CameraError(f"recorded pairs: {path}: {error.strerror}") from error
    image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size else None
    if image is None:
        raise CameraError(f"recorded pairs: {path} is not an image")
    return np.asarray(image, np.uint8)


class RecordedCamera:
    """A StereoCamera (pair.py) whose grabs return the next recorded pair, stamped with the present time.

    After the last pair it begins again where `again` is set, else it raises CameraError.
    """

    def __init__(self, folder: Path, again: bool = False, clock: Callable[[], float] = time.monotonic) -> None:
        self._folder, self._again, self._clock = folder, again, clock
        self._pairs: list[tuple[Path, Path]] = []
        self._next = 0

    def open(self) -> None:
        """List the folder and begin with its first pair. Raises CameraError."""
        self._pairs = recorded_pairs(self._folder)
        self._next = 0

    def grab(self, not_before_s: float, timeout_s: float) -> StereoPair:
        """The next pair. Raises CameraError after the last one."""
        if not self._pairs:
            self.open()
        if self._next == len(self._pairs) and not self._again:
            raise CameraError(f"recorded pairs: {self._folder} has no more than {self._next}")
        left, right = self._pairs[self._next % len(self._pairs)]
        taken_s = max(self._clock(), not_before_s)
        pair = StereoPair(*(Frame(read_image(path), taken_s, self._next) for path in (left, right)))
        self._next += 1
        return pair

    def use(self, alone: CameraName | None) -> None:
        """Both cameras only: raises CameraError for one."""
        if alone is not None:
            raise CameraError("recorded pairs are of both cameras")

    def expose(self, left: float, right: float) -> None:
        """Recorded pictures have no exposure to change."""

    def close(self) -> None:
        """Forget the folder; safe to call twice."""
        self._pairs = []

    def describe(self) -> str:
        return f"recorded pairs from {self._folder}: {self._next} of {len(self._pairs)} shown"
