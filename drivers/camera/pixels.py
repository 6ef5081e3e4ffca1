"""Decode the bytes of a V4L2 buffer to a grey image: pixel formats and frame sizes. Pure."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.camera.jpeg import JpegError, check_whole

Image = NDArray[np.uint8]


class DamagedFrameError(Exception):
    """The bytes are not a complete frame; the message says why."""


@dataclass(frozen=True)
class Layout:
    """The format that the driver granted: code, width and height px, stride in bytes (0 for MJPEG)."""

    code: str
    width: int
    height: int
    stride: int


@dataclass(frozen=True)
class PixelEncoding:
    """A pixel format: V4L2's code; bytes per pixel of the first plane (0: compressed); offset of the luma byte."""

    code: str
    bytes_per_pixel: int
    luma: int = 0


FORMATS = {
    "GREY": PixelEncoding("GREY", 1),
    "Y16": PixelEncoding("Y16", 2, luma=1),  # little-endian 16 bit; only the upper eight are used
    "YUYV": PixelEncoding("YUYV", 2),  # Y0 U Y1 V; the luma scale (16..235 or 0..255) is the camera's
    "NV12": PixelEncoding("NV12", 1),
    "MJPEG": PixelEncoding("MJPG", 0),
}
"""By our names, in order of preference: grey, then colour (which is dropped), then compressed."""


def _mjpeg(data: bytes, layout: Layout) -> Image:
    try:
        end = check_whole(data)
    except JpegError as error:
        raise DamagedFrameError(f"JPEG: {error}") from None
    body = without_padding(data[:end])
    image = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None:
        raise DamagedFrameError(f"JPEG of {len(body)} bytes cannot be decoded")
    if image.shape != (layout.height, layout.width):
        raise DamagedFrameError(f"JPEG is {image.shape[1]}x{image.shape[0]}, not {layout.width}x{layout.height}")
    return np.asarray(image, np.uint8)


def without_padding(data: bytes) -> bytes:
    """A complete JPEG without zeros before its end mark: libjpeg prints a line to stderr for each of them."""
    scan = data[:-2].rstrip(b"\x00")
    stuffing = data[len(scan) : len(scan) + 1] if scan.endswith(b"\xff") and len(scan) < len(data) - 2 else b""
    return scan + stuffing + data[-2:]


def stride(code: str, width: int, granted: int) -> int:
    """Bytes from row to row: as the driver granted, at least one row's; 0 for MJPEG, which has no rows."""
    row = FORMATS[code].bytes_per_pixel * width
    return max(granted, row) if row else 0


def whole_frame_bytes(layout: Layout) -> int:
    """Bytes of an undamaged frame; 0 where the format has no fixed size."""
    planes = layout.stride * layout.height
    return planes * 3 // 2 if layout.code == "NV12" else planes


def read_grey(data: bytes, layout: Layout) -> Image:
    """Decode one buffer to a grey image (height, width): the luma, unchanged. Raises DamagedFrameError."""
    expected = whole_frame_bytes(layout)
    if len(data) < expected:
        raise DamagedFrameError(f"{len(data)} of {expected} bytes")
    step, luma = FORMATS[layout.code].bytes_per_pixel, FORMATS[layout.code].luma
    if not step:
        return _mjpeg(data, layout)
    rows = np.frombuffer(data, np.uint8, layout.stride * layout.height).reshape(layout.height, layout.stride)
    return rows[:, luma : step * layout.width : step].copy()
