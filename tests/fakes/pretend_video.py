"""A made-up machine with made-up video devices that answer ioctls as a V4L2 driver does, on a clock of their own.

Belongs here: the kernel's side of the conversation. A device fills queued buffers at the times its schedule says,
skips a number when no buffer is free, and fails with the errno it is told to.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from drivers.camera import v4l2


def fail(number: int) -> OSError:
    return OSError(number, os.strerror(number))


@dataclass
class PretendControl:
    name: str
    minimum: int
    maximum: int
    value: int
    step: int = 1
    menu: dict[int, str] = field(default_factory=dict)
    stuck_at: int | None = None


@dataclass
class Arrival:
    """A frame that arrives at `at_s`: its bytes, its time stamp, its flags."""

    at_s: float
    data: bytes
    sequence: int
    flags: int = v4l2.BUFFER_CLOCK_MONOTONIC
    stamp_s: float | None = None


class PretendMap:
    def __init__(self, memory: bytearray) -> None:
        self.memory = memory

    def __getitem__(self, which: slice) -> bytes:
        return bytes(self.memory[which])

    def close(self) -> None:
        self.memory = bytearray()


@dataclass
class PretendDevice:
    """One device: its names and formats, the frames that arrive, and its faults."""

    card: str
    formats: dict[str, list[tuple[int, int]]] = field(default_factory=lambda: {"GREY": [(8, 4)]})
    controls: dict[int, PretendControl] = field(default_factory=dict)
    schedule: list[Arrival] = field(default_factory=list)
    fails: dict[int, int] = field(default_factory=dict)  # request -> errno
    captures: bool = True
    padding: int = 0
    stream_is_on: bool = False
    opened: int = 0
    size: tuple[int, int] = (8, 4)
    code: str = "GREY"
    _free: list[int] = field(default_factory=list)
    _filled: list[v4l2.Buffer] = field(default_factory=list)
    _memory: list[bytearray] = field(default_factory=list)

    def advance(self, now_s: float) -> None:
        """Deliver every frame that is due into a free buffer; without one it is lost."""
        while self.schedule and self.schedule[0].at_s <= now_s:
            frame = self.schedule.pop(0)
            if not (self.stream_is_on and self._free):
                continue
            index = self._free.pop(0)
            stamp_s = frame.at_s if frame.stamp_s is None else frame.stamp_s
            self._memory[index][: len(frame.data)] = frame.data
            seconds, micros = divmod(round(stamp_s * 1e6), 1_000_000)
            self._filled.append(
                v4l2.Buffer(
                    index=index,
                    bytesused=len(frame.data),
                    flags=frame.flags,
                    seconds=seconds,
                    microseconds=micros,
                    sequence=frame.sequence,
                )
            )

    def ioctl(self, request: int, argument: object) -> None:
        if request in self.fails:
            raise fail(self.fails[request])
        handlers: dict[int, Callable[[Any], None]] = {
            v4l2.QUERYCAP: self._query, v4l2.ENUM_FMT: self._enum_format, v4l2.ENUM_FRAMESIZES: self._enum_size,
            v4l2.S_FMT: self._set_format, v4l2.REQBUFS: self._request, v4l2.QUERYBUF: self._where,
            v4l2.QBUF: self._queue, v4l2.DQBUF: self._dequeue, v4l2.STREAMON: self._on, v4l2.STREAMOFF: self._off,
            v4l2.QUERYCTRL: self._query_control, v4l2.QUERYMENU: self._query_menu, v4l2.G_CTRL: self._get,
            v4l2.S_CTRL: self._set,
        }  # fmt: skip
        if request not in handlers:
            raise fail(errno.EINVAL if request == v4l2.ENUM_FRAMEINTERVALS else errno.ENOTTY)
        handlers[request](argument)

    def _query(self, a: v4l2.Capability) -> None:
        a.card, a.driver, a.bus_info = self.card.encode(), b"pretend", b"platform:pretend"
        a.capabilities = v4l2.CAP_DEVICE_CAPS | v4l2.CAP_CAPTURE | v4l2.CAP_STREAMING
        a.device_caps = v4l2.CAP_STREAMING | (v4l2.CAP_CAPTURE if self.captures else 0)

    def _enum_format(self, a: v4l2.FormatDescription) -> None:
        if a.index >= len(self.formats):
            raise fail(errno.EINVAL)
        a.pixelformat = v4l2.fourcc(list(self.formats)[a.index])

    def _enum_size(self, a: v4l2.FrameSize) -> None:
        sizes = self.formats[v4l2.code_of(a.pixel_format)]
        if a.index >= len(sizes):
            raise fail(errno.EINVAL)
        a.type = v4l2.SIZE_DISCRETE
        a.values[0], a.values[1] = sizes[a.index]

    def _set_format(self, a: v4l2.StreamFormat) -> None:
        pix = a.fmt.pix
        self.code = v4l2.code_of(pix.pixelformat)
        sizes = self.formats[self.code]
        self.size = (pix.width, pix.height) if (pix.width, pix.height) in sizes else sizes[0]
        pix.width, pix.height = self.size
        per_pixel = {"GREY": 1, "Y16": 2, "YUYV": 2, "NV12": 1}.get(self.code, 0)
        pix.bytesperline = per_pixel * pix.width + self.padding if per_pixel else 0
        pix.sizeimage = 4096

    def _request(self, a: v4l2.RequestBuffers) -> None:
        self._memory = [bytearray(65536) for _ in range(a.count)]
        self._free, self._filled = [], []

    def _where(self, a: v4l2.Buffer) -> None:
        a.length, a.m.offset = 65536, a.index * 65536

    def map(self, offset: int, length: int) -> PretendMap:
        return PretendMap(self._memory[offset // length])

    def _queue(self, a: v4l2.Buffer) -> None:
        self._free.append(a.index)

    def _dequeue(self, a: v4l2.Buffer) -> None:
        if not self._filled:
            raise fail(errno.EAGAIN)
        filled = self._filled.pop(0)
        for name in ("index", "bytesused", "flags", "seconds", "microseconds", "sequence"):
            setattr(a, name, getattr(filled, name))

    def _on(self, _a: object) -> None:
        self.stream_is_on = True

    def _off(self, _a: object) -> None:
        self.stream_is_on = False
        self._free, self._filled = [], []

    def _query_control(self, a: v4l2.QueryControl) -> None:
        after = [i for i in sorted(self.controls) if i > a.id & ~v4l2.NEXT_CONTROL]
        if not after:
            raise fail(errno.EINVAL)
        control = self.controls[after[0]]
        a.id, a.name, a.type = after[0], control.name.encode(), v4l2.MENU if control.menu else v4l2.INTEGER
        a.minimum, a.maximum, a.step = control.minimum, control.maximum, control.step

    def _query_menu(self, a: v4l2.QueryMenu) -> None:
        menu = self.controls[a.id].menu
        if a.index not in menu:
            raise fail(errno.EINVAL)
        a.item.name = menu[a.index].encode()

    def _get(self, a: v4l2.ControlValue) -> None:
        if a.id not in self.controls:
            raise fail(errno.EINVAL)
        control = self.controls[a.id]
        a.value = control.value if control.stuck_at is None else control.stuck_at

    def _set(self, a: v4l2.ControlValue) -> None:
        control = self.controls[a.id]
        control.value = a.value // control.step * control.step
        a.value = control.value


class PretendNode:
    """One opening of a device."""

    def __init__(self, device: PretendDevice, system: PretendSystem) -> None:
        self.device, self.system, self.is_open = device, system, True
        device.opened += 1

    def ioctl(self, request: int, argument: object) -> None:
        if not any(self.device is there for there in self.system.devices.values()):
            raise fail(errno.ENODEV)
        self.device.advance(self.system.now_s)
        self.device.ioctl(request, argument)

    def map(self, offset: int, length: int) -> PretendMap:
        return self.device.map(offset, length)

    def close(self) -> None:
        self.device.opened -= self.is_open
        self.is_open = False


@dataclass
class PretendSystem:
    """A machine: devices by path, stable names, and a clock that only moves while somebody waits."""

    devices: dict[str, PretendDevice]
    names: dict[str, str] = field(default_factory=dict)  # link -> path
    open_fails: dict[str, int] = field(default_factory=dict)
    now_s: float = 100.0
    waits: int = 0

    def clock(self) -> float:
        return self.now_s

    def nodes(self) -> list[str]:
        return sorted(self.devices)

    def resolve(self, name: str) -> str | None:
        path = self.names.get(name, name)
        return path if path in self.devices or path in self.open_fails else None

    def links(self, path: str) -> list[str]:
        return [link for link, leads_to in self.names.items() if leads_to == path]

    def holders(self, path: str) -> list[str]:
        return ["ffmpeg (4711)"]

    def open(self, path: str) -> PretendNode:
        if path in self.open_fails:
            raise fail(self.open_fails[path])
        if path not in self.devices:
            raise fail(errno.ENOENT)
        return PretendNode(self.devices[path], self)

    def wait(self, nodes: Sequence[PretendNode], timeout_s: float) -> bool:
        """Advance the clock to the next arrival on these nodes, or to the time limit if that comes first."""
        self.waits += 1
        due = [a.at_s for node in nodes for a in node.device.schedule]
        until_s = self.now_s + timeout_s
        self.now_s = min([until_s, *(max(at_s, self.now_s) for at_s in due)])
        for device in self.devices.values():
            device.advance(self.now_s)
        return bool(due) and min(due) <= until_s


def whole_frames(system: PretendSystem, count: int, period_s: float = 0.1) -> None:
    """Deliver a number of complete frames from every device, from now on."""
    for device in system.devices.values():
        size = device.size[0] * device.size[1]
        device.schedule[:] = [Arrival(system.now_s + 0.02 + k * period_s, bytes(size), k) for k in range(count)]
