"""The structures and request numbers against what a C compiler says of <linux/videodev2.h> on a 64-bit machine."""

from __future__ import annotations

import ctypes
import fcntl
import os

import pytest

from drivers.camera import v4l2

pytestmark = pytest.mark.skipif(ctypes.sizeof(ctypes.c_void_p) != 8, reason="figures are those of 64-bit machines")

REQUESTS = {
    "QUERYCAP": 0x80685600, "ENUM_FMT": 0xC0405602, "G_FMT": 0xC0D05604, "S_FMT": 0xC0D05605, "REQBUFS": 0xC0145608,
    "QUERYBUF": 0xC0585609, "QBUF": 0xC058560F, "DQBUF": 0xC0585611, "STREAMON": 0x40045612, "STREAMOFF": 0x40045613,
    "G_PARM": 0xC0CC5615, "S_PARM": 0xC0CC5616, "G_CTRL": 0xC008561B, "S_CTRL": 0xC008561C, "QUERYCTRL": 0xC0445624,
    "QUERYMENU": 0xC02C5625, "ENUM_FRAMESIZES": 0xC02C564A, "ENUM_FRAMEINTERVALS": 0xC034564B,
}  # fmt: skip

OFFSETS = {
    (v4l2.Buffer, "seconds"): 24, (v4l2.Buffer, "timecode"): 40, (v4l2.Buffer, "sequence"): 56, (v4l2.Buffer, "m"): 64,
    (v4l2.Buffer, "length"): 72, (v4l2.StreamFormat, "fmt"): 8, (v4l2.QueryMenu, "reserved"): 40,
    (v4l2.QueryControl, "flags"): 56, (v4l2.FrameSize, "values"): 12, (v4l2.FrameInterval, "values"): 20,
}  # fmt: skip


@pytest.mark.parametrize("name", REQUESTS)
def test_a_request_number_is_the_one_the_kernel_knows(name: str) -> None:
    assert getattr(v4l2, name) == REQUESTS[name]


@pytest.mark.parametrize(("structure", "field"), OFFSETS)
def test_a_field_lies_where_the_kernel_puts_it(structure: type[ctypes.Structure], field: str) -> None:
    assert getattr(structure, field).offset == OFFSETS[structure, field]


def test_four_letters_and_their_number_are_each_others_inverse() -> None:
    for code in ("GREY", "Y16", "YUYV", "NV12", "MJPG"):
        assert v4l2.code_of(v4l2.fourcc(code)) == code
    assert v4l2.fourcc("GREY") == int.from_bytes(b"GREY", "little")


def test_a_signal_that_breaks_off_a_request_does_not_lose_it(monkeypatch: pytest.MonkeyPatch) -> None:
    from drivers.camera import node

    calls = []

    def interrupted_once(_fd: int, request: int, _argument: object) -> None:
        calls.append(request)
        if len(calls) == 1:
            raise InterruptedError

    monkeypatch.setattr(fcntl, "ioctl", interrupted_once)
    opened = node.FileNode(os.devnull)
    try:
        v4l2.stream_on(opened)
    finally:
        opened.close()
        opened.close()
    assert calls == [v4l2.STREAMON, v4l2.STREAMON]
