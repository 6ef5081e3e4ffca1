"""One or two V4L2 cameras as one stereo camera: pairs of one moment, never stale, and its own recovery from trouble.

Belongs here: the pair's life. A look drains what the drivers queued since the last one and waits for light that fell
after `not_before`; no thread runs between looks. Whatever goes wrong closes both streams and is said as a CameraError;
the next grab looks the devices up again by name and starts afresh.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from drivers.camera import stream
from drivers.camera.node import LINUX, System
from drivers.camera.pair import CameraError, EyeName, Frame, StereoPair
from drivers.camera.pairing import newest_pair, why_no_pair
from drivers.camera.pixels import DamagedFrameError
from drivers.camera.settings import CameraSettings
from drivers.camera.stream import CameraStream, RawFrame, StreamTally

KEEP = 4
"""Frames remembered of each eye while looking for a pair."""
SILENT_PERIODS = 10
"""A camera without a frame for as many frame periods has fallen silent."""


@dataclass(frozen=True)
class CameraReport:
    """One eye for people and metrics: its line, what it took of the wished controls, names of controls that are others
    here, what it delivered."""

    line: str
    controls: dict[str, int]
    renamed: dict[str, str]
    tally: StreamTally


class V4L2StereoCamera:
    """Honours drivers/camera/pair.py StereoCamera. One caller at a time."""

    def __init__(
        self, settings: CameraSettings, clock: Callable[[], float] = time.monotonic, system: System = LINUX
    ) -> None:
        self._settings, self._clock, self._system = settings, clock, system
        self._eyes: tuple[CameraStream, ...] = ()
        self._used = settings.devices

    def use(self, alone: EyeName | None) -> None:
        """See StereoCamera."""
        devices = self._settings.devices
        used = devices if alone is None else {name: device for name, device in devices.items() if name == alone}
        if len(used) < (2 if alone is None else 1):
            raise CameraError(f"there is no such camera: the configuration names {' and '.join(devices)} only")
        if used != self._used:
            self.close()
        self._used = used

    def open(self) -> None:
        """Claim the devices that are looked with. Raises CameraError; then none is held."""
        if self._eyes:
            return
        started: list[CameraStream] = []
        try:
            for name, device in self._used.items():
                started.append(stream.start(name, device, self._settings, self._system, self._clock))
        except CameraError:
            for eye in started:
                eye.stop()
            raise
        self._eyes = tuple(started)

    def close(self) -> None:
        """Release the devices; safe to call twice."""
        started, self._eyes = self._eyes, ()
        for eye in started:
            eye.stop()

    def grab(self, not_before_s: float, timeout_s: float) -> StereoPair:
        """The newest pair exposed wholly after not_before_s, skew within max_skew_ms.

        Opens the devices where they are not (any more). Raises CameraError when they cannot be had, are lost meanwhile,
        or give no such pair within timeout_s; the devices are let go then.
        """
        deadline_s = self._clock() + timeout_s
        try:
            self.open()
            for eye in self._eyes:
                eye.hold(self._settings)
            pair = self._await_pair(self._eyes, not_before_s, deadline_s, timeout_s)
            for eye in self._eyes:
                eye.release(self._settings)
            return pair
        except CameraError:
            self.close()
            raise

    def expose(self, left: float, right: float) -> tuple[float, float] | None:
        """See StereoCamera. Where the settings name exposure or gain, those are the operator's."""
        if not self._eyes or {"exposure_us", "gain"} & set(self._settings.controls):
            return None
        took = [eye.brighten(factor) for eye, factor in zip(self._eyes, (left, right), strict=False)]
        return None if None in took else (took[0] or 1.0, took[-1] or 1.0)

    def _await_pair(
        self, both: tuple[CameraStream, ...], not_before_s: float, deadline_s: float, timeout_s: float
    ) -> StereoPair:
        seen = [eye.waiting() for eye in both]
        woken = False
        while True:
            came = [eye.take() for eye in both]
            for frames, new in zip(seen, came, strict=True):
                frames += new
                del frames[:-KEEP]
            pair = self._choose(both, seen, not_before_s)
            if pair:
                return pair
            remaining_s = deadline_s - self._clock()
            if woken and not any(came):  # a driver that reports trouble it does not deliver must not spin us
                self._system.wait([], min(remaining_s, 0.005))
            woken = remaining_s > 0 and self._system.wait([eye.node for eye in both], remaining_s)
            if not woken:
                raise CameraError(self._why(both, seen, not_before_s, timeout_s))

    def _choose(
        self, both: tuple[CameraStream, ...], seen: list[list[RawFrame]], not_before_s: float
    ) -> StereoPair | None:
        """The best pair among the frames seen, of one eye its frame twice; one that cannot be decoded is counted,
        forgotten, and looked past."""
        while True:
            left, right = ([f.exposure for f in frames] for frames in (seen[0], seen[-1]))
            chosen = newest_pair(left, right, not_before_s, self._settings.max_skew_ms / 1000.0)
            if chosen is None:
                return None
            frames = []
            for eye, raws, k in zip(both, seen, chosen, strict=False):
                try:
                    frames.append(Frame(raws[k].image(), raws[k].exposure.middle_s, raws[k].sequence))
                except DamagedFrameError as damage:
                    eye.tally.damaged += 1
                    eye.tally.frames -= 1
                    eye.tally.last_damage = str(damage)
                    del raws[k]
                    break
            if len(frames) == len(both):
                return StereoPair(frames[0], frames[-1])

    def _why(
        self, both: tuple[CameraStream, ...], seen: list[list[RawFrame]], not_before_s: float, timeout_s: float
    ) -> str:
        left, right = ([f.exposure for f in frames] for frames in (seen[0], seen[-1]))
        silent_since_s = self._clock() - SILENT_PERIODS * max(eye.period_s for eye in both)
        names = both[0].name, both[-1].name
        why = why_no_pair(left, right, not_before_s, self._settings.max_skew_ms / 1000.0, silent_since_s, names)
        damage = [
            f"{e.name}: {e.tally.damaged} damaged frames, the last {e.tally.last_damage} (cable, USB bandwidth?)"
            for e in both
            if e.tally.damaged
        ]
        where = " and ".join(f"{eye.path} `{eye.card}`" for eye in both)
        what = "stereo pair" if len(both) > 1 else "picture"
        return f"no {what} within {timeout_s:g} s from {where}: {'; '.join([why, *damage])}; streams restarted"

    def reports(self) -> tuple[CameraReport, ...]:
        """What each open eye is doing."""
        return tuple(CameraReport(e.describe(), e.settings_taken, e.renamed, e.tally) for e in self._eyes)

    def describe(self) -> str:
        """One line for people."""
        if self._eyes:
            return "; ".join(eye.describe() for eye in self._eyes)
        return f"closed: {', '.join(f'{name} `{device}`' for name, device in self._used.items())}"
