"""Picture files as they come: whole ones give their pixels, all others an error, and nothing is said on stderr."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from daemon.store.outside import FileError
from daemon.store.pictures import PNG, PictureError, claimed_pixels, read_as_stored, read_grey

GREY = np.random.default_rng(0).integers(0, 255, (60, 80), np.uint8)
COLOUR = np.dstack([GREY, GREY // 2, 255 - GREY])
PACKED = cv2.imencode(".png", GREY)[1].tobytes()
READERS = pytest.mark.parametrize("read", [read_grey, read_as_stored])


def on_disk(folder: Path, image: np.ndarray, kind: str = ".png") -> Path:
    path = folder / f"picture{kind}"
    path.write_bytes(cv2.imencode(kind, image)[1].tobytes())
    return path


def flipped(content: bytes, at: int) -> bytes:
    return content[:at] + bytes([content[at] ^ 0xFF]) + content[at + 1 :]


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def of_claimed_size(side_px: int) -> bytes:
    """A PNG with right checksums that says it is so large, and holds a few bytes."""
    header = struct.pack(">IIBBBBB", side_px, side_px, 8, 0, 0, 0, 0)
    return PNG + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(99))) + chunk(b"IEND", b"")


@READERS
@pytest.mark.parametrize("kind", [".png", ".bmp", ".pgm"])
def test_a_grey_picture_is_read_to_the_last_bit(read, kind: str, tmp_path: Path) -> None:
    image = read(on_disk(tmp_path, GREY, kind))
    assert image.dtype == np.uint8
    assert np.array_equal(image, GREY)


def test_colours_are_kept_as_stored_and_weighed_as_grey(tmp_path: Path) -> None:
    path = on_disk(tmp_path, COLOUR)
    assert np.array_equal(read_as_stored(path), COLOUR)
    weighed = COLOUR @ np.array([0.114, 0.587, 0.299])
    assert read_grey(path).shape == GREY.shape
    assert np.abs(read_grey(path) - weighed).max() < 1


def test_sixteen_bits_are_kept_as_stored_and_cut_to_eight_as_grey(tmp_path: Path) -> None:
    deep = GREY.astype(np.uint16) * 256 + 77
    path = on_disk(tmp_path, deep)
    assert read_as_stored(path).dtype == np.uint16
    assert np.array_equal(read_as_stored(path), deep)
    assert np.array_equal(read_grey(path), GREY)


@READERS
def test_a_file_that_cannot_be_read_says_why(read, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"none\.png: cannot be read: No such file"):
        read(tmp_path / "none.png")
    with pytest.raises(FileError, match="cannot be read: not a regular file"):
        read(tmp_path)


@READERS
@pytest.mark.parametrize(
    "content",
    [
        pytest.param(b"", id="empty"),
        pytest.param(b"no picture at all", id="text"),
        pytest.param(PNG, id="a PNG's first bytes"),
        pytest.param(PACKED[:20], id="cut in the header"),
        pytest.param(PACKED[: len(PACKED) // 2], id="cut in the pixels"),
        pytest.param(PACKED[:-12], id="cut before the end"),
        pytest.param(flipped(PACKED, 18), id="a bit of the size"),
        pytest.param(flipped(PACKED, 9), id="a bit of a length"),
        pytest.param(flipped(PACKED, len(PACKED) // 2), id="a bit of the pixels"),
        pytest.param(cv2.imencode(".jpg", GREY)[1].tobytes()[:900], id="half a JPEG"),
    ],
)
def test_what_is_no_whole_picture_is_named_and_nothing_is_said_on_stderr(
    read, content: bytes, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bad.png"
    path.write_bytes(content)
    with pytest.raises(PictureError, match=r"bad\.png: not an image, or cut short"):
        read(path)
    assert capfd.readouterr() == ("", "")


def test_what_follows_the_end_of_a_png_does_not_matter(tmp_path: Path) -> None:
    path = tmp_path / "longer.png"
    path.write_bytes(PACKED + b"and more")
    assert np.array_equal(read_grey(path), GREY)


def test_a_size_is_taken_from_a_png_only_where_its_header_stands() -> None:
    header = b"\0\0\0\rIHDR" + (3).to_bytes(4, "big") + (5).to_bytes(4, "big")
    assert claimed_pixels(PNG + header) == 15
    assert claimed_pixels(PNG + header.replace(b"IHDR", b"IDAT")) is None
    assert claimed_pixels(bytes(8) + header) is None
