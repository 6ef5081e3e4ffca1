"""A JPEG that lost anything on its way is no frame; what a camera adds behind one does no harm."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from drivers.camera.jpeg import JpegError, check_whole
from drivers.camera.pixels import DamagedFrameError, Layout, read_grey, without_padding

SIZE = (160, 120)
LAYOUT = Layout("MJPEG", *SIZE, 0)
SAMPLING = (0x411111, 0x221111, 0x211111, 0x111111)


def photograph(rng: np.random.Generator) -> np.ndarray:
    image = np.full((SIZE[1], SIZE[0], 3), rng.integers(60, 200, 3), np.uint8)
    for _ in range(8):
        corners = rng.integers(-20, 180, (4, 2)).astype(np.int32)
        cv2.fillConvexPoly(image, cv2.convexHull(corners), rng.integers(0, 255, 3).tolist())
    return np.clip(cv2.GaussianBlur(image, (0, 0), 0.8) + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)


def frame(rng: np.random.Generator) -> bytes:
    """As one camera or another sends it: quality, colours halved or not, restart marks or none, grey."""
    image = photograph(rng)
    wishes = [
        cv2.IMWRITE_JPEG_QUALITY, int(rng.choice([60, 85, 95])),
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR, int(rng.choice(SAMPLING)),
        cv2.IMWRITE_JPEG_RST_INTERVAL, int(rng.choice([0, 0, 3, 20])),
        cv2.IMWRITE_JPEG_OPTIMIZE, int(rng.integers(2)),
    ]  # fmt: skip
    return cv2.imencode(".jpg", image if rng.random() < 0.8 else image[..., 0], wishes)[1].tobytes()


def scan_of(data: bytes) -> int:
    """Where the picture's codes begin."""
    at = data.index(b"\xff\xda")
    return at + 2 + int.from_bytes(data[at + 2 : at + 4], "big")


def is_read(data: bytes) -> bool:
    try:
        read_grey(data, LAYOUT)
    except DamagedFrameError:
        return False
    return True


@pytest.mark.parametrize("seed", range(60))
def test_a_frame_that_lost_a_packet_or_its_end_is_refused_and_a_padded_one_is_read(seed: int) -> None:
    rng = np.random.default_rng(seed)
    data = frame(rng)
    whole, first = read_grey(data, LAYOUT), scan_of(data)
    at = int(rng.integers(first, len(data) - 200))
    packet = int(rng.integers(100, len(data) - 2 - at))
    damaged = {
        "cut": data[: rng.integers(2, len(data) - 1)],
        "ended early": data[:at] + b"\xff\xd9",
        "packet lost": data[:at] + data[at + packet :],
    }
    assert [how for how, broken in damaged.items() if is_read(broken)] == []
    for behind in (b"\x00", b"\x17", rng.bytes(40), b"\x00" * 500, data[:300]):
        assert np.array_equal(read_grey(data + behind, LAYOUT), whole)


@pytest.mark.parametrize("padding", [b"\x00", b"\x00\x00\x00", b"\xff", b"\xff\xff"])
@pytest.mark.parametrize("seed", range(3, 9))
def test_padding_before_the_end_mark_is_no_damage_and_fills_no_journal(
    padding: bytes, seed: int, capfd: pytest.CaptureFixture[str]
) -> None:
    data = frame(np.random.default_rng(seed))
    padded = data[:-2] + padding + data[-2:]
    assert check_whole(padded) == len(padded)
    assert np.array_equal(read_grey(padded, LAYOUT), read_grey(data, LAYOUT))
    assert capfd.readouterr().err == ""


def test_a_picture_whose_last_byte_is_a_stuffed_one_keeps_it() -> None:
    scan = b"\xff\xd8...\xff\x00"
    assert without_padding(scan + b"\xff\xd9") == without_padding(scan + b"\x00\x00\xff\xd9") == scan + b"\xff\xd9"


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda d: b"", "begin with nothing"),
        (lambda d: b"GIF89a", "no JPEG"),
        (lambda d: d[:40], "cut off after 40 bytes, in its header"),
        (lambda d: d[:-2], "cut off after"),
        (lambda d: d.replace(b"\xff\xc0", b"\xff\xc2", 1), "not a baseline JPEG"),
        (lambda d: d[:2] + b"\xff\xd9", "before its picture begins"),
    ],
)
def test_each_damage_is_said(spoil: Callable[[bytes], bytes], words: str) -> None:
    with pytest.raises(JpegError, match=words):
        check_whole(spoil(frame(np.random.default_rng(8))))


def test_no_bytes_whatever_make_the_check_fail_otherwise() -> None:
    rng = np.random.default_rng(11)
    sound = [frame(rng) for _ in range(15)]
    for k in range(300):
        spoilt = bytearray(sound[k % len(sound)])
        for at in rng.integers(2, len(spoilt), 3):
            spoilt[at] = rng.integers(256)
        with contextlib.suppress(JpegError):
            assert 0 < check_whole(bytes(spoilt)) <= len(spoilt)
