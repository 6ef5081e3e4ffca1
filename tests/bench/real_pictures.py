"""Photographs in which nothing taught is shown: nothing may be named in them, and no look may take long.

The chessboard pairs and the aloe of Debian's opencv-doc, the motorcycle of scikit-image; none of it is kept. Taught:
the six train-B views.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.calibration.board import Board
from daemon.calibration.board_detection import find_board
from daemon.calibration.stereo import Pair, calibrate_stereo
from daemon.store.pictures import read_grey
from daemon.vision.geometry.rig import Camera, StereoRig
from daemon.vision.look import look
from daemon.vision.values import UNKNOWN
from tests.bench.data.packages import debian_package, python_package
from tests.bench.recognise import trained
from tests.fakes import rendered

SAMPLES = "usr/share/doc/opencv-doc/examples/data"
BOARD = Board(9, 6, 25.0)
Image = NDArray[np.uint8]
Pictures = tuple[str, Image, Image, StereoRig]


def main() -> None:
    if not rendered.ALL.is_dir():
        print("real pictures: no scenes to teach (set FACETD_SHARED)")
        return
    cv2.setNumThreads(1)
    model = trained(rendered.rig(rendered.ALL, "B"))
    print(f"{'picture':<16}{'size':>11}{'parts':>7}{'named':>7}{'ms':>7}")
    count = named = 0
    worst_ms = 0.0
    for name, left, right, rig in _pictures():
        scene = look(left, right, rig, model, clock=time.process_time)
        labels = [p.recognition.label for p in scene.parts if p.recognition.label != UNKNOWN]
        ms = 1000 * sum(scene.seconds.values())
        print(f"{name:<16}{f'{left.shape[1]}x{left.shape[0]}':>11}{len(scene.parts):>7}{len(labels):>7}{ms:>7.0f}  "
              + " ".join(labels))  # fmt: skip
        count, named, worst_ms = count + 1, named + len(labels), max(worst_ms, ms)
    print(f"{count} pairs, {named} parts named in them; the longest look {worst_ms:.0f} ms of processor")


def _pictures() -> Iterator[Pictures]:
    with tempfile.TemporaryDirectory() as samples, tempfile.TemporaryDirectory() as wheel:
        root = debian_package("opencv-doc", f"{SAMPLES}/aloeL.jpg", Path(samples))
        if isinstance(root, str):
            print(f"chessboards, aloe: {root}")
        else:
            yield from _chessboards(root / SAMPLES)
            left, right = (read_grey(root / SAMPLES / f"aloe{camera}.jpg") for camera in "LR")
            # Middlebury 2006: f, baseline and how far the right picture was cropped; its centre is taken for the middle
            yield "aloe", left, right, _rectified(left, 3740.0, (640.5, 554.5), 270.0, 160.0)
        root = python_package("scikit-image", Path(wheel))
        if isinstance(root, str):
            print(f"motorcycle: {root}")
        else:
            left, right = (read_grey(root / f"skimage/data/motorcycle_{camera}.png") for camera in ("left", "right"))
            # Middlebury 2014 at a quarter of its size, from the documentation of skimage.data.stereo_motorcycle
            yield "motorcycle", left, right, _rectified(left, 994.978, (311.193, 254.877), 31.086, 193.001)


def _chessboards(folder: Path) -> Iterator[Pictures]:
    """With the rig calibrated on themselves."""
    both = {
        f"chessboard {path.stem[4:]}": (read_grey(path), read_grey(path.with_name(f"right{path.stem[4:]}.jpg")))
        for path in sorted(folder.glob("left[0-9][0-9].jpg"))
    }
    boards = [Pair(name, find_board(left, BOARD), find_board(right, BOARD)) for name, (left, right) in both.items()]
    rig = calibrate_stereo(boards, BOARD, (640, 480)).rig
    for name, (left, right) in both.items():
        yield name, left, right, rig


def _rectified(
    image: Image, focal_px: float, centre_px: tuple[float, float], apart_px: float, baseline_mm: float
) -> StereoRig:
    """Cameras side by side that look straight ahead; apart_px: how much further right the right one's centre lies."""
    cameras = []
    for side, shift in ((-0.5, 0.0), (0.5, apart_px)):
        matrix = np.array([[focal_px, 0, centre_px[0] + shift], [0, focal_px, centre_px[1]], [0, 0, 1]])
        sits = np.eye(4)
        sits[0, 3] = side * baseline_mm
        cameras.append(Camera(matrix, np.zeros(5), sits))
    return StereoRig(cameras[0], cameras[1], (image.shape[1], image.shape[0]))


if __name__ == "__main__":
    main()
