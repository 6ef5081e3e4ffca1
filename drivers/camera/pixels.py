"""Bytes of a V4L2 buffer -> grey image. Pure; one small reader a pixel format, and what a whole frame must measure.

Belongs here: layouts. Not here: where the bytes come from, or what to do when they are short.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]


class DamagedFrameError(Exception):
    """The bytes are no whole frame; the message says how."""


@dataclass(frozen=True)
class Layout:
    """What the driver agreed to: format code, width and height px, bytes from one row to the next (0 for MJPEG)."""

    code: str
    width: int
    height: int
    stride: int


def _rows(data: bytes, layout: Layout) -> Image:
    """The first plane, (height, stride) bytes."""
    return np.frombuffer(data, np.uint8, layout.stride * layout.height).reshape(layout.height, layout.stride)


def _grey(data: bytes, layout: Layout) -> Image:
    return _rows(data, layout)[:, : layout.width].copy()


def _y16(data: bytes, layout: Layout) -> Image:
    """Little-endian 16 bit, the upper eight kept."""
    return _rows(data, layout)[:, 1 : 2 * layout.width : 2].copy()


def _yuyv(data: bytes, layout: Layout) -> Image:
    """Y0 U Y1 V: every other byte. The luma scale (16..235 or 0..255) stays the camera's."""
    return _rows(data, layout)[:, : 2 * layout.width : 2].copy()


def _mjpeg(data: bytes, layout: Layout) -> Image:
    body = data.rstrip(b"\0")
    if not body.startswith(b"\xff\xd8"):
        raise DamagedFrameError(f"no JPEG: {len(data)} bytes that begin with {data[:2].hex() or 'nothing'}")
    if not body.endswith(b"\xff\xd9"):
        raise DamagedFrameError(f"JPEG cut off after {len(body)} bytes")
    image = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None:
        raise DamagedFrameError(f"JPEG of {len(body)} bytes cannot be decoded")
    if image.shape != (layout.height, layout.width):
        raise DamagedFrameError(f"JPEG is {image.shape[1]}x{image.shape[0]}, not {layout.width}x{layout.height}")
    return np.asarray(image, np.uint8)


_READERS: dict[str, Callable[[bytes, Layout], Image]] = {
    "GREY": _grey, "Y16": _y16, "YUYV": _yuyv, "NV12": _grey, "MJPEG": _mjpeg,
}  # fmt: skip
_BYTES_PER_PIXEL = {"GREY": 1, "Y16": 2, "YUYV": 2, "NV12": 1}
FORMATS = {"GREY": "GREY", "Y16": "Y16", "YUYV": "YUYV", "NV12": "NV12", "MJPEG": "MJPG"}
"""Our names and V4L2's codes, best first: plain grey, then what carries colour nobody looks at, then compressed."""


def stride(code: str, width: int, granted: int) -> int:
    """Bytes from row to row: what the driver granted, at least a row's own; 0 for MJPEG, which has no rows."""
    return max(granted, _BYTES_PER_PIXEL[code] * width) if code in _BYTES_PER_PIXEL else 0


def whole_frame_bytes(layout: Layout) -> int:
    """Bytes of an undamaged frame; 0 where the format has no fixed size."""
    planes = layout.stride * layout.height
    return planes * 3 // 2 if layout.code == "NV12" else planes


def read_grey(data: bytes, layout: Layout) -> Image:
    """One buffer as a grey image (height, width), bit for bit the format's luma. Raises DamagedFrameError."""
    expected = whole_frame_bytes(layout)
    if len(data) < expected:
        raise DamagedFrameError(f"{len(data)} of {expected} bytes")
    return _READERS[layout.code](data, layout)
