"""Feed two v4l2loopback devices in the guest: what a camera would deliver, from frames that the test chooses.

A loopback device captures only while somebody has its format set on the other side. Nothing here waits for a certain
time or counts on one: the guest is emulated, and how slowly depends on what else its machine does.
"""

from __future__ import annotations

import os
import subprocess
import threading
import time
from collections.abc import Callable
from ctypes import c_int32

import cv2
import numpy as np

from drivers.camera import v4l2
from drivers.camera.node import FileNode

Image = np.ndarray
Span = tuple[float, float]
FOURCC = {"GREY": "GREY", "Y16": "Y16", "YUYV": "YUYV", "NV12": "NV12", "MJPEG": "MJPG"}


def modprobe(*words: str) -> None:
    """Load or (-r) unload a kernel module."""
    subprocess.run(["modprobe", *words], check=True, timeout=60)
    subprocess.run(["udevadm", "settle", "--timeout=20"], check=True)


def load(numbers: str = "0,1") -> None:
    """The v4l2loopback module with a device called left and one called right, under these numbers; of one number, the
    left alone."""
    count = len(numbers.split(","))
    names, caps = (",".join(words[:count]) for words in (["left", "right"], ["1", "1"]))
    modprobe("v4l2loopback", f"devices={count}", f"video_nr={numbers}", f"card_label={names}", f"exclusive_caps={caps}")


def pack(code: str, grey: Image) -> bytes:
    """A grey image as the bytes of one frame; the low byte of Y16 and all chroma hold what no reader should show."""
    if code == "MJPEG":
        return cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
    if code == "Y16":
        return np.stack([np.full_like(grey, 0x5A), grey], axis=-1).tobytes()
    if code == "YUYV":
        return np.stack([grey, np.full_like(grey, 0x33)], axis=-1).tobytes()
    return grey.tobytes() + (b"\x33" * (grey.size // 2) if code == "NV12" else b"")


class Feeder:
    """Writes frames into a pair of devices, or the left ones into one, at most `fps` a second, until it is stopped.

    picture: frame number -> (left, right) grey images; delay_s: how much later (at least) the right one is written;
    cut: how many bytes at the end of each left frame are kept back. written_s holds, on the monotonic clock, when
    each pair's writing began and ended: (left, right). A pair that took longer than most_s to make is not written.
    """

    def __init__(
        self, picture: Callable[[int], tuple[Image, Image]], code: str = "GREY", fps: float = 15.0,
        delay_s: float = 0.0, most_s: float = 1e9, paths: tuple[str, ...] = ("/dev/video0", "/dev/video1"),
        cut: int = 0,
    ) -> None:  # fmt: skip
        self.picture, self.code, self.fps, self.delay_s, self.most_s = picture, code, fps, delay_s, most_s
        self.cut = cut
        self.nodes = [FileNode(path) for path in paths]
        height, width = picture(0)[0].shape
        for node in self.nodes:
            v4l2.query_capability(node)  # where v4l2loopback looks up what it can do at present
            granted = v4l2.set_format(node, v4l2.fourcc(FOURCC[code]), width, height, v4l2.OUTPUT)
            assert v4l2.code_of(granted.pixelformat) == FOURCC[code], v4l2.code_of(granted.pixelformat)
            # Makes us the writer, so that the device can be written to again after we close it; write() alone does not.
            node.ioctl(v4l2.STREAMON, c_int32(v4l2.OUTPUT))
        self.number = 0
        self.written_s: list[tuple[Span, Span]] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Feeder:
        """Begin to feed."""
        self.write()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop and let the devices go."""
        self._stop.set()
        self._thread.join()
        for node in self.nodes:
            node.close()

    def write(self) -> None:
        """One pair."""
        asked_s = time.monotonic()
        left, right = (pack(self.code, image) for image in self.picture(self.number))
        if time.monotonic() - asked_s > self.most_s:
            return
        early = self._write(0, left[: len(left) - self.cut])
        if self.delay_s:
            time.sleep(self.delay_s)
        late = self._write(1, right) if len(self.nodes) > 1 else early
        self.written_s.append((early, late))
        self.number += 1

    def _write(self, camera: int, data: bytes) -> Span:
        began_s = time.monotonic()
        os.write(self.nodes[camera].fileno(), data)
        return began_s, time.monotonic()

    def _run(self) -> None:
        """Never one pair close behind another, even after a hold-up: its left frame would suit the one before."""
        due_s = time.monotonic()
        while not self._stop.wait(max(0.0, due_s - time.monotonic())):
            self.write()
            due_s = max(due_s + 1 / self.fps, time.monotonic() + 0.5 / self.fps)
