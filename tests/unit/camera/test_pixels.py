"""Buffers of every format become the grey image that was put into them; anything less than a frame is refused."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from drivers.camera.pixels import DamagedFrameError, Layout, read_grey, stride, whole_frame_bytes

GREY = np.random.default_rng(5).integers(0, 256, (48, 64), np.uint8)
SMOOTH = cv2.GaussianBlur(GREY, (0, 0), 6)


def pack(code: str, grey: np.ndarray, padding: int = 0) -> tuple[bytes, Layout]:
    """One frame of `grey` as a driver would hand it over, rows padded with rubbish."""
    height, width = grey.shape
    rows = {
        "GREY": grey,
        "Y16": np.stack([np.full_like(grey, 0x5A), grey], axis=-1).reshape(height, -1),
        "YUYV": np.stack([grey, np.full_like(grey, 0x80)], axis=-1).reshape(height, -1),
        "NV12": grey,
    }[code]
    padded = np.pad(rows, ((0, 0), (0, padding)), constant_values=0xEE)
    chroma = b"\x80" * (padded.shape[1] * height // 2) if code == "NV12" else b""
    return padded.tobytes() + chroma, Layout(code, width, height, padded.shape[1])


@pytest.mark.parametrize("padding", [0, 6])
@pytest.mark.parametrize("code", ["GREY", "Y16", "YUYV", "NV12"])
def test_every_uncompressed_format_gives_its_luma_bit_for_bit(code: str, padding: int) -> None:
    data, layout = pack(code, GREY, padding)
    image = read_grey(data, layout)
    assert np.array_equal(image, GREY)
    assert image.flags.owndata


@pytest.mark.parametrize("code", ["GREY", "Y16", "YUYV", "NV12"])
def test_half_a_frame_is_refused_with_how_much_came(code: str) -> None:
    data, layout = pack(code, GREY)
    with pytest.raises(DamagedFrameError, match=f"{len(data) // 2} of {len(data)} bytes"):
        read_grey(data[: len(data) // 2], layout)
    assert whole_frame_bytes(layout) == len(data)


def test_what_a_driver_adds_after_the_frame_does_not_disturb() -> None:
    data, layout = pack("GREY", GREY)
    assert np.array_equal(read_grey(data + b"metadata", layout), GREY)


def test_a_jpeg_frame_is_read_close_to_what_was_put_in() -> None:
    data = cv2.imencode(".jpg", SMOOTH, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
    image = read_grey(data + b"\0" * 100, Layout("MJPEG", 64, 48, 0))
    assert np.abs(image.astype(int) - SMOOTH).max() <= 4


def _segment(data: bytes, marker: bytes) -> tuple[int, int]:
    start = data.index(marker)
    return start, start + 2 + int.from_bytes(data[start + 2 : start + 4], "big")


def test_a_jpeg_frame_without_huffman_tables_is_read_as_webcams_send_it() -> None:
    data = cv2.imencode(".jpg", SMOOTH, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
    while b"\xff\xc4" in data:
        start, end = _segment(data, b"\xff\xc4")
        data = data[:start] + data[end:]
    assert np.abs(read_grey(data, Layout("MJPEG", 64, 48, 0)).astype(int) - SMOOTH).max() <= 4


def test_a_jpeg_frame_that_is_cut_off_or_no_jpeg_or_of_another_size_is_refused() -> None:
    data = cv2.imencode(".jpg", SMOOTH)[1].tobytes()
    for broken, words in ((data[:300], "cut off"), (b"no jpeg", "no JPEG"), (b"", "begin with nothing")):
        with pytest.raises(DamagedFrameError, match=words):
            read_grey(broken, Layout("MJPEG", 64, 48, 0))
    with pytest.raises(DamagedFrameError, match="JPEG is 64x48, not 640x480"):
        read_grey(data, Layout("MJPEG", 640, 480, 0))


def test_a_driver_that_does_not_say_how_long_a_row_is_gets_the_rows_own_length() -> None:
    assert stride("YUYV", 640, 0) == 1280
    assert stride("GREY", 640, 704) == 704
    assert stride("MJPEG", 640, 1280) == 0
