"""The cameras as asynchronous calls, in a thread of their own; recorded pairs that repeat until the next is
requested."""

import asyncio
import contextlib
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from daemon.arm import CameraName
from drivers.camera.find import device_rows as device_rows
from drivers.camera.pair import CameraError, Frame
from drivers.camera.pair import StereoCamera as StereoCamera
from drivers.camera.pair import StereoPair as StereoPair
from drivers.camera.recorded import RecordedCamera
from drivers.camera.v4l2_stereo import camera_rows as camera_rows

T = TypeVar("T")


class ThreadedCameras:
    """A StereoCamera (drivers/camera/pair.py) whose blocking calls run in a thread, one after the other."""

    def __init__(
        self, camera: StereoCamera, clock: Callable[[], float] = time.monotonic, alone: CameraName | None = None
    ) -> None:
        self.camera = camera
        self.heard_s: float | None = None
        """Time of the last pair, on the cell's clock."""
        self.alone = alone
        """The only camera in use, or None for both."""
        self._clock = clock
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="cameras")

    async def open(self) -> None:
        await self._call(self.camera.open)

    async def grab(self, not_before_s: float, timeout_s: float) -> StereoPair:
        pair = await self._call(lambda: self.camera.grab(not_before_s, timeout_s))
        self.heard_s = self._clock()
        return pair

    async def expose(self, left: float, right: float) -> tuple[float, float] | None:
        return await self._call(lambda: self.camera.expose(left, right))

    async def use(self, alone: CameraName | None) -> None:
        """Use one camera, or both (None). Raises CameraError, with nothing changed."""
        await self._call(lambda: self.camera.use(alone))
        self.alone = alone

    def step(self) -> bool:
        """Recorded pairs: show the next one. False where the cameras are not recorded."""
        if isinstance(self.camera, RepeatedPairs):
            self.camera.step()
            return True
        return False

    async def close(self) -> None:
        """Close the cameras; safe to call twice."""
        with contextlib.suppress(RuntimeError, TimeoutError, CameraError):
            async with asyncio.timeout(1.0):
                await self._call(self.camera.close)
        self._thread.shutdown(wait=False, cancel_futures=True)

    def describe(self) -> str:
        return self.camera.describe()

    async def _call(self, job: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._thread, job)


class RepeatedPairs(RecordedCamera):
    """Recorded pairs; each is repeated, as if taken now, until `step`."""

    _shown: StereoPair | None = None
    _shown_count = 0

    def grab(self, not_before_s: float, timeout_s: float) -> StereoPair:
        """The present pair. Raises CameraError."""
        pair = self._shown = self._shown or super().grab(not_before_s, timeout_s)
        now_s = max(time.monotonic(), not_before_s)
        return StereoPair(self._restamped(pair.left, now_s), self._restamped(pair.right, now_s))

    def _restamped(self, frame: Frame, now_s: float) -> Frame:
        """The frame stamped now. One corner pixel changes by two grey levels: identical images count as a frozen
        camera."""
        self._shown_count += 1
        pixels = frame.pixels.copy()
        pixels[0, 0] ^= self._shown_count & 2
        return Frame(pixels, now_s, frame.sequence + self._shown_count)

    def step(self) -> None:
        """Go to the next pair; after the last one to the first."""
        self._shown = None
