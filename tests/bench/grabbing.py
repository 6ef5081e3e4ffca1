"""What grabbing costs and how old a look is: the V4L2 driver and take_look on made-up cameras that run in real time.

The kernel's side is made up here (no machine that runs this needs a camera): two cameras deliver a scene of tests/data,
stamped as a UVC camera stamps, at their own steady pace. All above the ioctls is the daemon's own. Figures on real
devices, emulated, are the rig's.
"""

from __future__ import annotations

import asyncio
import errno
import mmap
import os
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arm.belief import Reading
from daemon.arm.settling import Settling
from daemon.arm.workcell import Workcell
from daemon.cell.cameras import ThreadedCameras
from daemon.pick.looks import capture_pair, take_look
from daemon.pick.recogniser import ModelRecogniser
from daemon.store.library import load_facets
from daemon.vision.model.model import empty_model
from daemon.vision.settings import VisionSettings
from drivers.camera import v4l2
from drivers.camera.pixels import FORMATS
from drivers.camera.settings import CameraSettings
from drivers.camera.v4l2_stereo import V4L2StereoCamera
from tests.fakes import rendered

SCENE = "clean-B-003"
SECONDS = 8.0
LATE_S = 0.003
"""How much later the right camera's frames come."""
CAPABLE = v4l2.CAP_DEVICE_CAPS | v4l2.CAP_CAPTURE | v4l2.CAP_STREAMING
Image = NDArray[np.uint8]


def packed(code: str, grey: Image) -> bytes:
    """A grey image as one frame of that format."""
    if code == "MJPEG":
        return cv2.imencode(".jpg", grey)[1].tobytes()
    if code in ("Y16", "YUYV"):
        return np.stack([grey, grey][:: 1 if code == "YUYV" else -1], axis=-1).tobytes()
    return grey.tobytes() + (b"\x80" * (grey.size // 2) if code == "NV12" else b"")


class LiveCamera:
    """One device node: frame k comes at first_s + k / fps into the next free buffer, or into nothing."""

    def __init__(self, card: str, code: str, frames: Sequence[bytes], first_s: float, fps: float) -> None:
        self.card, self.code, self.frames, self.first_s, self.fps = card, code, frames, first_s, fps
        self.number = 0
        self.free: deque[int] = deque()
        self.filled: deque[tuple[int, float, int]] = deque()

    def next_s(self) -> float:
        """When the next frame comes."""
        return self.first_s + self.number / self.fps

    def advance(self) -> None:
        """Let come what is due."""
        while self.next_s() <= time.monotonic():
            if self.free:
                self.filled.append((self.free.popleft(), self.next_s(), self.number))
            self.number += 1

    def ioctl(self, request: int, a: Any) -> None:
        """As the driver of a plain USB camera would answer."""
        if request == v4l2.DQBUF:
            self.advance()
            if not self.filled:
                raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
            a.index, stamp_s, a.sequence = self.filled.popleft()
            a.bytesused, a.flags = len(self.frames[a.index]), v4l2.BUFFER_CLOCK_MONOTONIC
            a.seconds, a.microseconds = divmod(round(stamp_s * 1e6), 1_000_000)
        elif request == v4l2.QBUF:
            self.free.append(a.index)
        elif request == v4l2.QUERYCAP:
            a.card, a.capabilities, a.device_caps = self.card.encode(), CAPABLE, CAPABLE
        elif request == v4l2.ENUM_FMT and a.index == 0:
            a.pixelformat = v4l2.fourcc(FORMATS[self.code].code)
        elif request == v4l2.QUERYBUF:
            a.length, a.m.offset = 1 << 20, a.index << 20
        elif request not in (v4l2.S_FMT, v4l2.REQBUFS, v4l2.STREAMON, v4l2.STREAMOFF):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))

    def map(self, offset: int, length: int) -> mmap.mmap:
        """A buffer; what it shows is in it already."""
        memory = mmap.mmap(-1, length)
        frame = self.frames[offset >> 20]
        memory[: len(frame)] = frame
        return memory

    def close(self) -> None:
        """Nothing is held."""


@dataclass(frozen=True)
class LiveSystem:
    """A machine with a left and a right camera."""

    cameras: dict[str, LiveCamera]

    def nodes(self) -> list[str]:
        """Their paths."""
        return list(self.cameras)

    def resolve(self, name: str) -> str | None:
        """A path as it is."""
        return name if name in self.cameras else None

    def links(self, path: str) -> list[str]:
        """No stable names."""
        return []

    def holders(self, path: str) -> list[str]:
        """Nobody else."""
        return []

    def open(self, path: str) -> Any:
        """The node."""
        return self.cameras[path]

    def wait(self, nodes: Sequence[Any], timeout_s: float) -> bool:
        """Until the next frame of one of them."""
        now_s = time.monotonic()
        due_s = min((node.next_s() for node in nodes), default=now_s + timeout_s)
        time.sleep(max(0.0, min(due_s - now_s, timeout_s)))
        return bool(nodes) and due_s - now_s <= timeout_s


def live(code: str, fps: float, scene: str = SCENE) -> V4L2StereoCamera:
    """The driver on two such cameras; every buffer has noise of its own."""
    random, cameras, first_s = np.random.default_rng(1), {}, time.monotonic() + 0.3
    for k, (camera, grey) in enumerate(zip(("left", "right"), rendered.pair(rendered.HERE / scene), strict=True)):
        noisy = [np.clip(grey + random.normal(0, 1, grey.shape), 0, 255).astype(np.uint8) for _ in range(4)]
        frames = [packed(code, image) for image in noisy]
        cameras[f"/dev/video{k}"] = LiveCamera(camera, code, frames, first_s + k * LATE_S, fps)
    settings = CameraSettings("/dev/video0", "/dev/video1", fps=fps, formats=(code,))
    system: Any = LiveSystem(cameras)
    return V4L2StereoCamera(settings, time.monotonic, system)


def grab_all(code: str, fps: float) -> str:
    """Take every pair for a while, as `facetctl stream` would: rate, skew, age, processor."""
    camera = live(code, fps)
    last = camera.grab(0.0, 5.0)
    began_s, cpu_s, skews, ages = time.monotonic(), time.process_time(), [], []
    while time.monotonic() - began_s < SECONDS:
        last = camera.grab(last.right.taken_s - 0.5 / fps, 5.0)
        skews.append(last.skew_ms)
        ages.append((time.monotonic() - last.right.taken_s - 0.5 / fps) * 1000.0)
    took_s = time.monotonic() - began_s
    share = (time.process_time() - cpu_s) / took_s
    dropped = sum(row["dropped"] for row in camera.rows())
    camera.close()
    return (
        f"{code:6} {len(skews) / took_s:5.1f} pairs/s  skew {np.median(skews):.2f} ms (true {1000 * LATE_S:g})  "
        f"given {np.median(ages):.2f} ms (worst {max(ages):.1f}) after the second frame is in  {dropped} dropped  "
        f"{share:.2%} of a processor"
    )


class StillRobot:
    """Stands still."""

    async def where(self) -> Reading:
        """Here."""
        return Reading(np.eye(4), np.zeros(6))


async def looks(scene: str, fps: float, count: int) -> str:
    """take_look, whole: two pairs that agree, the images' health, facets, recognition without a model."""
    rig = rendered.rig(rendered.HERE, "B")
    cameras = ThreadedCameras(live("YUYV", fps, scene))
    cell = Workcell(StillRobot(), cameras, None, time.monotonic, rig, np.eye(4), asyncio.to_thread)  # type: ignore[arg-type]
    sight = ModelRecogniser(empty_model(load_facets()), rig, VisionSettings())
    await cameras.open()
    await cameras.grab(time.monotonic(), 5.0)
    seen, cpu_s = [], time.process_time()
    for _ in range(count):
        reading = await cell.robot.where()
        rest_s = time.monotonic()
        taken = await capture_pair(cell, reading, rest_s, Settling())
        seen.append(await take_look(cell, sight, taken, rest_s, None))
    cpu_ms = 1000.0 * (time.process_time() - cpu_s) / count
    await cameras.close()
    light, rest, vision = (
        np.array([1000.0 * get(look) for look in seen])
        for get in (lambda s: s.from_light_s, lambda s: s.seconds, lambda s: sum(s.scene.seconds.values()))
    )
    return (
        f"{scene} at {fps:g} fps: from mid-exposure to the answer median {np.median(light):.0f} ms "
        f"(worst {light.max():.0f}), {np.median(vision):.0f} of them finding facets; from the arm's rest, two pairs "
        f"agreeing, {np.median(rest):.0f} ms (worst {rest.max():.0f}); {cpu_ms:.0f} ms of processor a look"
    )


def main() -> None:
    """Print both tables."""
    cv2.setNumThreads(1)
    print(f"grabbing every pair at 15 fps, 640x480, {SECONDS:g} s each:")
    for code in FORMATS:
        print(f"  {grab_all(code, 15.0)}")
    print("looks, YUYV:")
    for scene, fps in ((SCENE, 15.0), (SCENE, 30.0), ("multi-B-004", 15.0)):
        print(f"  {asyncio.run(looks(scene, fps, 25))}")


if __name__ == "__main__":
    main()
