"""One or two V4L2 cameras as a stereo camera: synchronous pairs, never stale, with recovery from errors.

A grab drains the frames queued since the last one and waits for exposures after `not_before`; no thread runs between
grabs. Any error closes both streams and raises CameraError; the next grab finds the devices by name and starts again.
"""

import time
from collections.abc import Callable
from typing import Any

from drivers.camera import stream
from drivers.camera.node import LINUX, Linux
from drivers.camera.pair import CameraError, CameraName, Frame, StereoCamera, StereoPair
from drivers.camera.pairing import newest_pair, why_no_pair
from drivers.camera.pixels import DamagedFrameError
from drivers.camera.settings import CameraSettings
from drivers.camera.stream import CameraStream, RawFrame

KEEP = 4
"""Frames kept of each camera while waiting for a pair."""
SILENT_PERIODS = 10
"""A camera without a frame for so many periods counts as silent."""


class V4L2StereoCamera:
    """A StereoCamera (pair.py) of V4L2 devices. One caller at a time."""

    def __init__(
        self, settings: CameraSettings, clock: Callable[[], float] = time.monotonic, system: Linux = LINUX
    ) -> None:
        self._settings, self._clock, self._system = settings, clock, system
        self._streams: tuple[CameraStream, ...] = ()
        self._used = settings.devices

    def use(self, alone: CameraName | None) -> None:
        devices = self._settings.devices
        used = devices if alone is None else {name: device for name, device in devices.items() if name == alone}
        if len(used) < (2 if alone is None else 1):
            raise CameraError(f"no such camera: the configuration names only {' and '.join(devices)}")
        if used != self._used:
            self.close()
        self._used = used

    def open(self) -> None:
        """Open the devices in use. Raises CameraError, with none left open."""
        if self._streams:
            return
        started: list[CameraStream] = []
        try:
            for name, device in self._used.items():
                started.append(stream.start(name, device, self._settings, self._system, self._clock))
        except CameraError:
            for camera in started:
                camera.stop()
            raise
        self._streams = tuple(started)

    def close(self) -> None:
        started, self._streams = self._streams, ()
        for camera in started:
            camera.stop()

    def grab(self, not_before_s: float, timeout_s: float) -> StereoPair:
        """See StereoCamera; skew within max_skew_ms. Opens the devices where they are closed. They are closed after any
        CameraError."""
        deadline_s = self._clock() + timeout_s
        try:
            self.open()
            for camera in self._streams:
                camera.hold(self._settings)
            pair = self._await_pair(not_before_s, deadline_s, timeout_s)
            for camera in self._streams:
                camera.release(self._settings)
            return pair
        except CameraError:
            self.close()
            raise

    def expose(self, left: float, right: float) -> tuple[float, float] | None:
        """See StereoCamera. None where the settings name exposure or gain."""
        if not self._streams or {"exposure_us", "gain"} & set(self._settings.controls):
            return None
        took = [camera.brighten(factor) for camera, factor in zip(self._streams, (left, right), strict=False)]
        return None if None in took else (took[0] or 1.0, took[-1] or 1.0)

    def _await_pair(self, not_before_s: float, deadline_s: float, timeout_s: float) -> StereoPair:
        seen = [camera.waiting() for camera in self._streams]
        woken = False
        while True:
            came = [camera.take() for camera in self._streams]
            for frames, new in zip(seen, came, strict=True):
                frames += new
                del frames[:-KEEP]
            pair = self._choose(seen, not_before_s)
            if pair:
                return pair
            remaining_s = deadline_s - self._clock()
            if woken and not any(came):  # do not spin where a driver reports readiness without a frame
                self._system.wait([], min(remaining_s, 0.005))
            woken = remaining_s > 0 and self._system.wait([camera.node for camera in self._streams], remaining_s)
            if not woken:
                raise CameraError(self._why(seen, not_before_s, timeout_s))

    def _choose(self, seen: list[list[RawFrame]], not_before_s: float) -> StereoPair | None:
        """The best pair of the frames; with one camera its frame twice. Frames that cannot be decoded are counted and
        dropped."""
        while True:
            left, right = ([f.exposure for f in frames] for frames in (seen[0], seen[-1]))
            chosen = newest_pair(left, right, not_before_s, self._settings.max_skew_ms / 1000.0)
            if chosen is None:
                return None
            frames = []
            for camera, raws, k in zip(self._streams, seen, chosen, strict=False):
                try:
                    frames.append(Frame(raws[k].image(), raws[k].exposure.middle_s, raws[k].sequence))
                except DamagedFrameError as damage:
                    camera.tally.damaged += 1
                    camera.tally.frames -= 1
                    camera.tally.last_damage = str(damage)
                    del raws[k]
                    break
            if len(frames) == len(self._streams):
                return StereoPair(frames[0], frames[-1])

    def _why(self, seen: list[list[RawFrame]], not_before_s: float, timeout_s: float) -> str:
        streams = self._streams
        left, right = ([f.exposure for f in frames] for frames in (seen[0], seen[-1]))
        silent_since_s = self._clock() - SILENT_PERIODS * max(camera.period_s for camera in streams)
        names = streams[0].name, streams[-1].name
        why = why_no_pair(left, right, not_before_s, self._settings.max_skew_ms / 1000.0, silent_since_s, names)
        damage = [
            f"{e.name}: {e.tally.damaged} damaged frames, the last {e.tally.last_damage} (cable, USB bandwidth?)"
            for e in streams
            if e.tally.damaged
        ]
        where = " and ".join(f"{camera.path} `{camera.card}`" for camera in streams)
        what = "stereo pair" if len(streams) > 1 else "picture"
        return f"no {what} within {timeout_s:g} s from {where}: {'; '.join([why, *damage])}; streams restarted"

    def rows(self) -> list[dict[str, Any]]:
        """State of each open camera, for people and metrics: its line, the controls set, those with another name here,
        frame counts."""
        return [
            {
                "line": e.describe(), "controls": e.settings_taken, "renamed": e.renamed, "frames": e.tally.frames,
                "dropped": e.tally.dropped, "damaged": e.tally.damaged,
            }
            for e in self._streams
        ]  # fmt: skip

    def describe(self) -> str:
        if self._streams:
            return "; ".join(camera.describe() for camera in self._streams)
        return f"closed: {', '.join(f'{name} `{device}`' for name, device in self._used.items())}"


def camera_rows(camera: StereoCamera) -> list[dict[str, Any]]:
    """V4L2StereoCamera.rows; empty for other kinds of cameras."""
    return camera.rows() if isinstance(camera, V4L2StereoCamera) else []
