"""Video4Linux ioctls, one function each. Structures, request numbers and constants as in <linux/videodev2.h>.

Every function raises OSError with the kernel's errno.
"""

import ctypes
from collections.abc import Callable, Iterator
from ctypes import c_char, c_int32, c_int64, c_long, c_uint8, c_uint32, c_ulong
from errno import EINVAL
from itertools import count
from typing import Protocol, TypeVar

CAPTURE = 1  # V4L2_BUF_TYPE_VIDEO_CAPTURE
OUTPUT = 2  # V4L2_BUF_TYPE_VIDEO_OUTPUT
MMAP = 1  # V4L2_MEMORY_MMAP
NO_FIELD = 1

CAP_CAPTURE = 0x00000001
CAP_STREAMING = 0x04000000
CAP_DEVICE_CAPS = 0x80000000

BUFFER_ERROR = 0x0040
BUFFER_CLOCK_MASK, BUFFER_CLOCK_UNKNOWN, BUFFER_CLOCK_MONOTONIC = 0xE000, 0x0000, 0x2000
BUFFER_STAMP_MASK, BUFFER_STAMP_START_OF_EXPOSURE = 0x70000, 0x10000

SIZE_DISCRETE = 1
NEXT_CONTROL = 0x80000000
CONTROL_DISABLED, CONTROL_READ_ONLY, CONTROL_WRITE_ONLY = 0x1, 0x4, 0x40
INTEGER, BOOLEAN, MENU, BUTTON, INTEGER64, CLASS, STRING, BITMASK, INTEGER_MENU = range(1, 10)


class Capability(ctypes.Structure):
    """struct v4l2_capability."""

    _fields_ = (("driver", c_char * 16), ("card", c_char * 32), ("bus_info", c_char * 32), ("version", c_uint32),
                ("capabilities", c_uint32), ("device_caps", c_uint32), ("reserved", c_uint32 * 3))  # fmt: skip


class FormatDescription(ctypes.Structure):
    """struct v4l2_fmtdesc."""

    _fields_ = (("index", c_uint32), ("type", c_uint32), ("flags", c_uint32), ("description", c_char * 32),
                ("pixelformat", c_uint32), ("mbus_code", c_uint32), ("reserved", c_uint32 * 3))  # fmt: skip


class PixelFormat(ctypes.Structure):
    """struct v4l2_pix_format."""

    _fields_ = tuple((name, c_uint32) for name in (
        "width", "height", "pixelformat", "field", "bytesperline", "sizeimage", "colorspace", "priv", "flags",
        "encoding", "quantization", "transfer"))  # fmt: skip


class _FormatUnion(ctypes.Union):
    _fields_ = (("pix", PixelFormat), ("raw", c_uint8 * 200), ("align", c_ulong))


class StreamFormat(ctypes.Structure):
    """struct v4l2_format."""

    _fields_ = (("type", c_uint32), ("fmt", _FormatUnion))


class Fraction(ctypes.Structure):
    """struct v4l2_fract."""

    _fields_ = (("numerator", c_uint32), ("denominator", c_uint32))


class FrameSize(ctypes.Structure):
    """struct v4l2_frmsizeenum; `values` is width, height where discrete, else min, max, step of width and of height."""

    _fields_ = (("index", c_uint32), ("pixel_format", c_uint32), ("type", c_uint32), ("values", c_uint32 * 6),
                ("reserved", c_uint32 * 2))  # fmt: skip


class FrameInterval(ctypes.Structure):
    """struct v4l2_frmivalenum; `values` is one interval where discrete, else shortest, longest, step."""

    _fields_ = (("index", c_uint32), ("pixel_format", c_uint32), ("width", c_uint32), ("height", c_uint32),
                ("type", c_uint32), ("values", Fraction * 3), ("reserved", c_uint32 * 2))  # fmt: skip


class _CaptureParameters(ctypes.Structure):
    _fields_ = (("capability", c_uint32), ("capturemode", c_uint32), ("timeperframe", Fraction),
                ("extendedmode", c_uint32), ("readbuffers", c_uint32), ("reserved", c_uint32 * 4))  # fmt: skip


class _ParametersUnion(ctypes.Union):
    _fields_ = (("capture", _CaptureParameters), ("raw", c_uint8 * 200))


class StreamParameters(ctypes.Structure):
    """struct v4l2_streamparm."""

    _fields_ = (("type", c_uint32), ("parm", _ParametersUnion))


class RequestBuffers(ctypes.Structure):
    """struct v4l2_requestbuffers."""

    _fields_ = (("count", c_uint32), ("type", c_uint32), ("memory", c_uint32), ("capabilities", c_uint32),
                ("flags", c_uint8), ("reserved", c_uint8 * 3))  # fmt: skip


class Timecode(ctypes.Structure):
    """struct v4l2_timecode: unused but for its size."""

    _fields_ = (("type", c_uint32), ("flags", c_uint32), ("digits", c_uint8 * 4), ("userbits", c_uint8 * 4))


class _BufferPlace(ctypes.Union):
    _fields_ = (("offset", c_uint32), ("userptr", c_ulong))


class Buffer(ctypes.Structure):
    """struct v4l2_buffer."""

    _fields_ = (("index", c_uint32), ("type", c_uint32), ("bytesused", c_uint32), ("flags", c_uint32),
                ("field", c_uint32), ("seconds", c_long), ("microseconds", c_long), ("timecode", Timecode),
                ("sequence", c_uint32), ("memory", c_uint32), ("m", _BufferPlace), ("length", c_uint32),
                ("reserved2", c_uint32), ("request_fd", c_int32))  # fmt: skip


class ControlValue(ctypes.Structure):
    """struct v4l2_control."""

    _fields_ = (("id", c_uint32), ("value", c_int32))


class QueryControl(ctypes.Structure):
    """struct v4l2_queryctrl."""

    _fields_ = (("id", c_uint32), ("type", c_uint32), ("name", c_char * 32), ("minimum", c_int32), ("maximum", c_int32),
                ("step", c_int32), ("default_value", c_int32), ("flags", c_uint32),
                ("reserved", c_uint32 * 2))  # fmt: skip


class _MenuUnion(ctypes.Union):
    _pack_ = 1
    _fields_ = (("name", c_char * 32), ("value", c_int64))


class QueryMenu(ctypes.Structure):
    """struct v4l2_querymenu."""

    _pack_ = 1
    _fields_ = (("id", c_uint32), ("index", c_uint32), ("item", _MenuUnion), ("reserved", c_uint32))


def _request(direction: int, number: int, argument: type[ctypes.Structure] | type[c_int32]) -> int:
    """The request number as asm-generic/ioctl.h composes it (x86, ARM, RISC-V); direction 1 writes, 2 reads, 3 both."""
    return direction << 30 | ctypes.sizeof(argument) << 16 | ord("V") << 8 | number


QUERYCAP = _request(2, 0, Capability)
ENUM_FMT = _request(3, 2, FormatDescription)
G_FMT, S_FMT = _request(3, 4, StreamFormat), _request(3, 5, StreamFormat)
REQBUFS, QUERYBUF = _request(3, 8, RequestBuffers), _request(3, 9, Buffer)
QBUF, DQBUF = _request(3, 15, Buffer), _request(3, 17, Buffer)
STREAMON, STREAMOFF = _request(1, 18, c_int32), _request(1, 19, c_int32)
G_PARM, S_PARM = _request(3, 21, StreamParameters), _request(3, 22, StreamParameters)
G_CTRL, S_CTRL = _request(3, 27, ControlValue), _request(3, 28, ControlValue)
QUERYCTRL, QUERYMENU = _request(3, 36, QueryControl), _request(3, 37, QueryMenu)
ENUM_FRAMESIZES, ENUM_FRAMEINTERVALS = _request(3, 74, FrameSize), _request(3, 75, FrameInterval)


class Node(Protocol):
    """An open /dev/videoN (drivers/camera/node.py, or a test's fake)."""

    def ioctl(self, request: int, argument: ctypes.Structure | c_int32) -> None:
        """One request, in place. Raises OSError."""


Described = TypeVar("Described", FormatDescription, FrameSize, FrameInterval)


def _is_there(node: Node, request: int, entry: ctypes.Structure) -> bool:
    """Have the driver fill in an entry; False where there is none."""
    try:
        node.ioctl(request, entry)
    except OSError as error:
        if error.errno == EINVAL:
            return False
        raise
    return True


def _enumerate(node: Node, request: int, make: Callable[[], Described]) -> Iterator[Described]:
    """Entries 0, 1, 2, ... until the driver has no more."""
    for index in count():
        entry = make()
        entry.index = index
        if not _is_there(node, request, entry):
            return
        yield entry


def query_capability(node: Node) -> Capability:
    """Identity and capabilities of the device."""
    capability = Capability()
    node.ioctl(QUERYCAP, capability)
    return capability


def can_capture(capability: Capability) -> bool:
    """Whether this node itself (not a sibling of the device) streams captured video."""
    own = capability.device_caps if capability.capabilities & CAP_DEVICE_CAPS else capability.capabilities
    return bool(own & CAP_CAPTURE and own & CAP_STREAMING)


def enumerate_formats(node: Node) -> Iterator[FormatDescription]:
    """Pixel formats, in the driver's order."""
    return _enumerate(node, ENUM_FMT, lambda: FormatDescription(type=CAPTURE))


def enumerate_sizes(node: Node, pixelformat: int) -> Iterator[FrameSize]:
    """Frame sizes of one pixel format."""
    return _enumerate(node, ENUM_FRAMESIZES, lambda: FrameSize(pixel_format=pixelformat))


def enumerate_intervals(node: Node, pixelformat: int, width: int, height: int) -> Iterator[FrameInterval]:
    """Frame intervals of one pixel format and size."""
    ask = {"pixel_format": pixelformat, "width": width, "height": height}
    return _enumerate(node, ENUM_FRAMEINTERVALS, lambda: FrameInterval(**ask))


def set_format(node: Node, pixelformat: int, width: int, height: int, stream: int = CAPTURE) -> PixelFormat:
    """Request a format; returns the one that the driver grants, which may differ."""
    wish = StreamFormat(type=stream)
    wish.fmt.pix = PixelFormat(width=width, height=height, pixelformat=pixelformat, field=NO_FIELD)
    node.ioctl(S_FMT, wish)
    granted: PixelFormat = wish.fmt.pix
    return granted


def set_interval(node: Node, interval: Fraction) -> Fraction:
    """Request a frame period; returns the one that the driver grants."""
    wish = StreamParameters(type=CAPTURE)
    wish.parm.capture.timeperframe = interval
    node.ioctl(S_PARM, wish)
    granted: Fraction = wish.parm.capture.timeperframe
    return granted


def request_buffers(node: Node, count: int) -> int:
    """Request that many buffers (0 frees them); returns how many the driver granted."""
    request = RequestBuffers(count=count, type=CAPTURE, memory=MMAP)
    node.ioctl(REQBUFS, request)
    return int(request.count)


def query_buffer(node: Node, index: int) -> Buffer:
    """Offset (m.offset) and length of a buffer."""
    buffer = Buffer(index=index, type=CAPTURE, memory=MMAP)
    node.ioctl(QUERYBUF, buffer)
    return buffer


def queue_buffer(node: Node, index: int) -> None:
    """Give a buffer to the driver to fill."""
    node.ioctl(QBUF, Buffer(index=index, type=CAPTURE, memory=MMAP))


def dequeue_buffer(node: Node) -> Buffer:
    """Take back the oldest filled buffer. BlockingIOError where none is filled yet."""
    buffer = Buffer(type=CAPTURE, memory=MMAP)
    node.ioctl(DQBUF, buffer)
    return buffer


def stream_on(node: Node) -> None:
    """Start filling buffers."""
    node.ioctl(STREAMON, c_int32(CAPTURE))


def stream_off(node: Node) -> None:
    """Stop, and take all buffers back."""
    node.ioctl(STREAMOFF, c_int32(CAPTURE))


def enumerate_controls(node: Node) -> Iterator[QueryControl]:
    """All controls without section titles and disabled ones."""
    last = 0
    while _is_there(node, QUERYCTRL, entry := QueryControl(id=last | NEXT_CONTROL)):
        last = entry.id
        if entry.type != CLASS and not entry.flags & CONTROL_DISABLED:
            yield entry


def menu_item(node: Node, control: int, index: int) -> QueryMenu:
    """One line of a menu control. OSError EINVAL where the menu has no such line."""
    item = QueryMenu(id=control, index=index)
    node.ioctl(QUERYMENU, item)
    return item


def get_control(node: Node, control: int) -> int:
    """Read a control."""
    value = ControlValue(id=control)
    node.ioctl(G_CTRL, value)
    return int(value.value)


def set_control(node: Node, control: int, value: int) -> int:
    """Set a control; returns the value that the driver reports."""
    wish = ControlValue(id=control, value=value)
    node.ioctl(S_CTRL, wish)
    return int(wish.value)


def fourcc(code: str) -> int:
    """Pixel format code, such as `GREY` or `Y16 ` -> V4L2's number."""
    return int.from_bytes(code.ljust(4).encode("ascii"), "little")


def code_of(number: int) -> str:
    """V4L2's number of a pixel format -> its code, without trailing blanks."""
    return (number & 0x7FFFFFFF).to_bytes(4, "little").decode("ascii", "replace").rstrip()
