"""Stream of one V4L2 camera: negotiate the format, set controls, map buffers, take frames."""

import contextlib
import mmap
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass

from drivers.camera import controls, find, v4l2
from drivers.camera.node import FileNode, Linux
from drivers.camera.pair import CameraError
from drivers.camera.pairing import FrameExposure, exposure_of
from drivers.camera.pixels import FORMATS, Image, Layout, read_grey, stride, whole_frame_bytes
from drivers.camera.settings import CameraSettings

BUFFERS = 4
STAMPED_TO_S = 1e-6


@dataclass(frozen=True, eq=False)
class RawFrame:
    """One undecoded frame: bytes, layout, exposure, the driver's number."""

    data: bytes
    layout: Layout
    exposure: FrameExposure
    sequence: int

    def image(self) -> Image:
        """Grey image (height, width). Raises DamagedFrameError."""
        return read_grey(self.data, self.layout)


@dataclass
class StreamTally:
    """Frame counts of one camera since it was opened: complete, dropped by the driver, damaged."""

    frames: int = 0
    dropped: int = 0
    damaged: int = 0
    last_damage: str = ""


class CameraStream:
    """An open, streaming camera, made by `start`. Any method may raise CameraError; then call stop()."""

    def __init__(self, name: str, path: str, node: FileNode, system: Linux, clock: Callable[[], float]) -> None:
        self.name, self.path, self.node = name, path, node
        self.card = ""
        self.tally = StreamTally()
        self.settings_taken: dict[str, int] = {}
        self.renamed: dict[str, str] = {}
        """Controls with another name on this device: name in the settings -> name here."""
        self.layout = Layout("GREY", 0, 0, 0)
        self.period_s = 0.0
        self.stamps_are_monotonic = False  # until a frame shows it
        self._system, self._clock = system, clock
        self._maps: list[mmap.mmap] = []
        self._last_sequence: int | None = None
        self._all_stamped = True
        """Whether every frame taken since the last `waiting` had a usable stamp."""
        self._exposure_s = 0.0
        self._streaming_since_s = 0.0

    def begin(self, settings: CameraSettings) -> None:
        """Negotiate format, rate and controls with the driver and start the stream."""
        with self._kernel_errors():
            capability = v4l2.query_capability(self.node)
            self.card = capability.card.decode("utf-8", "replace")
            if not v4l2.can_capture(capability):
                raise CameraError(f"{self.name} camera {self.path} `{self.card}` does not capture video")
            self.layout = self._agree_on_format(settings)
            self.period_s = self._agree_on_rate(settings.fps)
            self.settings_taken = controls.apply(self.node, self.name, settings.controls)
            self.renamed = controls.renamed(settings.controls, self.settings_taken)
            self._exposure_s = controls.exposure_s(self.node)
            for index in range(v4l2.request_buffers(self.node, BUFFERS)):
                buffer = v4l2.query_buffer(self.node, index)
                self._maps.append(self.node.map(buffer.m.offset, buffer.length))
                v4l2.queue_buffer(self.node, index)
            self._streaming_since_s = self._clock()
            v4l2.stream_on(self.node)

    def _agree_on_format(self, settings: CameraSettings) -> Layout:
        """The first format in order of preference that the driver grants at the wished size."""
        offered = {v4l2.code_of(f.pixelformat): f.pixelformat for f in v4l2.enumerate_formats(self.node)}
        for code in (c for c in settings.formats if FORMATS[c].code in offered):
            number = offered[FORMATS[code].code]
            granted = v4l2.set_format(self.node, number, settings.width, settings.height)
            if (granted.pixelformat, granted.width, granted.height) == (number, settings.width, settings.height):
                return Layout(code, granted.width, granted.height, stride(code, granted.width, granted.bytesperline))
        offer = "; ".join(map(str, find.offers(self.node))) or "nothing"
        wish = f"{settings.width}x{settings.height} in {', '.join(settings.formats)}"
        raise CameraError(f"{self.name} camera {self.path} cannot give {wish}; it offers: {offer}")

    def _agree_on_rate(self, fps: float) -> float:
        """The frame period granted by the driver, s; the wished one where it grants none."""
        try:
            granted = v4l2.set_interval(self.node, v4l2.Fraction(1000, round(fps * 1000)))
        except OSError:
            return 1.0 / fps
        return granted.numerator / granted.denominator if granted.numerator and granted.denominator else 1.0 / fps

    def take(self) -> list[RawFrame]:
        """All complete queued frames, oldest first; damaged ones are counted and left out."""
        frames: list[RawFrame] = []
        with self._kernel_errors():
            while True:
                try:
                    buffer = v4l2.dequeue_buffer(self.node)
                except BlockingIOError:
                    return frames
                data = self._maps[buffer.index][: buffer.bytesused]
                v4l2.queue_buffer(self.node, buffer.index)
                if self._is_whole(buffer):
                    frames.append(RawFrame(data, self.layout, self._exposure(buffer), buffer.sequence))
                    self.tally.frames += 1

    def _is_whole(self, buffer: v4l2.Buffer) -> bool:
        """Whether the buffer contains a complete frame; counts it otherwise."""
        if self._last_sequence is not None:
            self.tally.dropped += max(0, buffer.sequence - self._last_sequence - 1)
        self._last_sequence = buffer.sequence
        expected = whole_frame_bytes(self.layout)
        if buffer.flags & v4l2.BUFFER_ERROR or buffer.bytesused < max(expected, 1):
            self.tally.damaged += 1
            marked = " and marked damaged" if buffer.flags & v4l2.BUFFER_ERROR else ""
            self.tally.last_damage = f"{buffer.bytesused} of {expected or 'some'} bytes{marked}"
            return False
        return True

    def _exposure(self, buffer: v4l2.Buffer) -> FrameExposure:
        """When the frame was exposed. Where the stamp is of another clock, or in the future, the time of taking
        replaces it."""
        at_start = buffer.flags & v4l2.BUFFER_STAMP_MASK == v4l2.BUFFER_STAMP_START_OF_EXPOSURE
        stamp_s, now_s = buffer.seconds + buffer.microseconds * 1e-6, self._clock()
        clock = buffer.flags & v4l2.BUFFER_CLOCK_MASK
        if clock == v4l2.BUFFER_CLOCK_UNKNOWN:  # v4l2loopback: a stamp within this stream's time shows the clock
            self.stamps_are_monotonic |= self._streaming_since_s <= stamp_s <= now_s
        else:
            self.stamps_are_monotonic = clock == v4l2.BUFFER_CLOCK_MONOTONIC
        if not self.stamps_are_monotonic or stamp_s > now_s + STAMPED_TO_S:
            self._all_stamped = False
            return exposure_of(now_s, False, self.period_s, self._exposure_s)
        return exposure_of(stamp_s, at_start, self.period_s, self._exposure_s)

    def waiting(self) -> list[RawFrame]:
        """Frames queued since the last grab, where they are the newest.

        Empty where all buffers were full (the driver had to drop newer frames), or stamps are not usable (the age of a
        queued frame is then unknown).
        """
        stamps_were_usable, self._all_stamped = self.stamps_are_monotonic, True
        frames = self.take()
        return frames if stamps_were_usable and self._all_stamped and len(frames) < BUFFERS else []

    def brighten(self, factor: float) -> float | None:
        """See controls.brighten; the longest exposure is the frame period."""
        with self._kernel_errors():
            took = controls.brighten(self.node, self.name, factor, self.period_s)
            self._exposure_s = controls.exposure_s(self.node)
            return took

    def hold(self, settings: CameraSettings) -> None:
        """Freeze automatic exposure, gain, focus for a look."""
        with self._kernel_errors():
            controls.hold(self.node, settings.controls)
            self._exposure_s = controls.exposure_s(self.node) if settings.controls else self._exposure_s

    def release(self, settings: CameraSettings) -> None:
        """Turn automatic exposure, gain, focus on again after a look."""
        with self._kernel_errors():
            controls.release(self.node, settings.controls)

    def describe(self) -> str:
        """Such as `left /dev/video0 "C920" GREY 640x480 15 fps`."""
        form = f"{self.layout.code} {self.layout.width}x{self.layout.height} {1 / self.period_s:.4g} fps"
        return f"{self.name} {self.path} `{self.card}` {form}"

    def stop(self) -> None:
        """Stop the stream and close the device, also one that was unplugged."""
        for mapped in self._maps:
            mapped.close()
        self._maps.clear()
        with contextlib.suppress(OSError):
            v4l2.stream_off(self.node)
            v4l2.request_buffers(self.node, 0)
        self.node.close()

    def _kernel_errors(self) -> AbstractContextManager[None]:
        return find.kernel_errors(self.name, self.path, self._system)


def start(name: str, device: str, settings: CameraSettings, system: Linux, clock: Callable[[], float]) -> CameraStream:
    """Find, open and start one camera. Raises CameraError, with nothing left open."""
    path = find.find(device, name, system)
    with find.kernel_errors(name, path, system):
        node = system.open(path)
    camera = CameraStream(name, path, node, system, clock)
    try:
        camera.begin(settings)
    except CameraError:
        camera.stop()
        raise
    return camera
