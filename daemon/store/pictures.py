"""Read images from disk: a file in, pixels out, or an error. Size limits apply before anything is decoded."""

import math
import re
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.store.outside import FileError, read_below, read_file

PNG, JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"
FRAME_HEADERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""JPEG markers whose segment holds the size."""
ALONE, NO_SEGMENT = frozenset({0x01, *range(0xD0, 0xD8)}), frozenset({0x00, 0xD8, 0xD9, 0xDA})
"""Markers without a length field (T.81 B.1.1.3), and markers that may not precede the size."""
SCAN = b"\xff\xda"
NETPBM = re.compile(rb"P[2356](?:\s|#[^\r\n]*[\r\n])+(\d{1,9})\s(?:\s|#[^\r\n]*[\r\n])*(\d{1,9})\s")
"""Header of a Netpbm file as OpenCV reads it, which takes the character after a number for a space."""
CORE_HEADER = 12
"""Bytes of a bitmap's older header, whose sides are 16 bits."""
_AROUND = 12
"""Bytes of a PNG chunk that are not its data: length, type and checksum, four each."""


LARGEST_BYTES = 50_000_000
MAX_PIXELS = 20_000_000
"""Largest decoded image; a file of 1 MB can declare a thousand million pixels."""
MAX_SCANS = 100
"""Largest number of scans of a JPEG: each, of as few as thirty bytes, costs a pass over all pixels; usual are ten."""


class PictureError(FileError):
    """A file is not an image, is cut short, or too large: which file."""


def read_grey(path: Path, folder: Path | None = None) -> NDArray[np.uint8]:
    """Read an image as (H, W) grey, 8 bits. folder: the path is inside it, and relative. Raises FileError."""
    return np.asarray(_decoded(path, folder, cv2.IMREAD_GRAYSCALE), np.uint8)


def read_as_stored(path: Path, folder: Path | None = None) -> NDArray[Any]:
    """Read an image as (H, W) grey, (H, W, 3) BGR or (H, W, 4) BGRA, in the file's bit depth; else as read_grey."""
    return _decoded(path, folder, cv2.IMREAD_UNCHANGED)


def _decoded(path: Path, folder: Path | None, flags: int) -> NDArray[Any]:
    """Decode with cv2.imdecode. libpng reports damage on stderr, so that a PNG is checked first."""
    content = read_file(path, LARGEST_BYTES) if folder is None else read_below(folder, str(path), LARGEST_BYTES)
    pixels = claimed_pixels(content)
    if pixels is not None and pixels > MAX_PIXELS:
        raise PictureError(f"{path}: too large: {pixels / 1e6:.0f} million pixels, at most {MAX_PIXELS // 1_000_000}")
    if content.startswith(JPEG) and content.count(SCAN) > MAX_SCANS:
        raise PictureError(f"{path}: {content.count(SCAN)} scans, at most {MAX_SCANS} are read")
    try:
        complete = pixels is not None and not (content.startswith(PNG) and _is_damaged(content))
        image = cv2.imdecode(np.frombuffer(content, np.uint8), flags) if complete else None
    except cv2.error:
        image = None
    if image is None:
        raise PictureError(f"{path}: not an image, or cut short")
    return image


def claimed_pixels(content: bytes) -> int | None:
    """Number of pixels that an image file declares, without decoding it; None: not PNG, JPEG, BMP or netpbm.

    Sources: PNG 11.2.2 (IHDR), JPEG B.2.2 (frame header), BITMAPCOREHEADER and BITMAPINFOHEADER, netpbm's pgm(5).
    """
    if content.startswith(PNG) and content[12:16] == b"IHDR":
        return int.from_bytes(content[16:20], "big") * int.from_bytes(content[20:24], "big")
    if content.startswith(JPEG):
        return _of_jpeg(content)
    if content.startswith(b"BM"):
        core = int.from_bytes(content[14:18], "little") == CORE_HEADER
        sides = [content[18:20], content[20:22]] if core else [content[18:22], content[22:26]]
        return abs(math.prod(int.from_bytes(side, "little", signed=not core) for side in sides))
    netpbm = NETPBM.match(content)
    return None if netpbm is None else int(netpbm[1]) * int(netpbm[2])


def _of_jpeg(content: bytes) -> int | None:
    at = 2
    while content[at : at + 1] == b"\xff":
        marker = int.from_bytes(content[at + 1 : at + 2], "big")
        if marker == 0xFF:  # any number of these may precede a marker
            at += 1
        elif marker in ALONE:
            at += 2
        elif marker in NO_SEGMENT:
            return None
        elif marker in FRAME_HEADERS:
            return int.from_bytes(content[at + 5 : at + 7], "big") * int.from_bytes(content[at + 7 : at + 9], "big")
        else:
            at += 2 + max(int.from_bytes(content[at + 2 : at + 4], "big"), 2)
    return None


def _is_damaged(png: bytes) -> bool:
    """Whether a chunk has a wrong checksum, or the last one is missing."""
    at = len(PNG)
    while at + _AROUND <= len(png):
        end = at + _AROUND + int.from_bytes(png[at : at + 4], "big")
        kind = png[at + 4 : at + 8]
        if zlib.crc32(png[at + 4 : end - 4]) != int.from_bytes(png[end - 4 : end], "big"):
            return True
        if kind == b"IEND":
            return False
        at = end
    return True
