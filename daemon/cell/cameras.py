"""The cameras as the daemon calls them: asynchronous, and, where they are recorded pairs, holding still."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from daemon.arm import EyeName
from drivers.camera.find import device_rows as device_rows
from drivers.camera.pair import CameraError, Frame, StereoPair
from drivers.camera.pair import StereoCamera as StereoCamera
from drivers.camera.recorded import RecordedCamera
from drivers.camera.stereo import camera_rows as camera_rows


class ThreadedEyes:
    """A stereo camera whose blocking calls run in a thread of their own; one caller after the other."""

    def __init__(
        self, camera: StereoCamera, clock: Callable[[], float] = time.monotonic, alone: EyeName | None = None
    ) -> None:
        self.camera = camera
        self.heard_s: float | None = None
        """When the last pair was delivered, on the cell's clock."""
        self.alone = alone
        """The one eye that is looked with, where the other is not there."""
        self._clock = clock
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="cameras")

    async def open(self) -> None:
        """Claim the cameras. Raises CameraError."""
        await self._call(self.camera.open)

    async def grab(self, not_before_s: float, timeout_s: float) -> StereoPair:
        """The newest pair exposed wholly after not_before_s. Raises CameraError."""
        pair: StereoPair = await self._call(lambda: self.camera.grab(not_before_s, timeout_s))
        self.heard_s = self._clock()
        return pair

    async def expose(self, left: float, right: float) -> tuple[float, float] | None:
        """See StereoCamera. Raises CameraError."""
        took: tuple[float, float] | None = await self._call(lambda: self.camera.expose(left, right))
        return took

    async def use(self, alone: EyeName | None) -> None:
        """Look with one eye from now on, or with both (None). Raises CameraError; then nothing has changed."""
        await self._call(lambda: self.camera.use(alone))
        self.alone = alone

    def step(self) -> bool:
        """Recorded pairs: show the next one. False where the cameras are not recorded."""
        if isinstance(self.camera, HeldPairs):
            self.camera.step()
            return True
        return False

    async def close(self) -> None:
        """Release the cameras; safe to call twice."""
        with contextlib.suppress(RuntimeError, TimeoutError, CameraError):
            async with asyncio.timeout(1.0):
                await self._call(self.camera.close)
        self._thread.shutdown(wait=False, cancel_futures=True)

    def describe(self) -> str:
        """One line for people."""
        return self.camera.describe()

    async def _call(self, job: Callable[[], Any]) -> Any:
        return await asyncio.get_running_loop().run_in_executor(self._thread, job)


class HeldPairs(RecordedCamera):
    """Recorded pairs that hold still: each pair is shown, as if taken now, until the next one is asked for."""

    _shown: StereoPair | None = None
    _shows = 0

    def grab(self, not_before_s: float, timeout_s: float) -> StereoPair:
        """The pair that is shown. Raises CameraError."""
        pair = self._shown = self._shown or super().grab(not_before_s, timeout_s)
        now_s = max(time.monotonic(), not_before_s)
        return StereoPair(self._live(pair.left, now_s), self._live(pair.right, now_s))

    def _live(self, frame: Frame, now_s: float) -> Frame:
        """The frame as of now. A corner pixel flickers by two grey levels, as otherwise the camera looks frozen."""
        self._shows += 1
        pixels = frame.pixels.copy()
        pixels[0, 0] ^= self._shows & 2
        return Frame(pixels, now_s, frame.sequence + self._shows)

    def step(self) -> None:
        """Go on to the next pair; after the last one the first comes again."""
        self._shown = None
