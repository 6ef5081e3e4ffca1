"""Pictures from the disk: a file in, pixels out, or an error. What is in the picture, and in which words a damaged one
is told of, is the caller's."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.errors import FacetdError

PNG = b"\x89PNG\r\n\x1a\n"
_AROUND = 12
"""Bytes of a PNG chunk that are not its data: length, type and checksum, four each."""


class PictureError(FacetdError, ValueError):
    """A file could be read, but is no picture, or not a whole one: which file."""


def read_grey(path: Path) -> NDArray[np.uint8]:
    """(H, W) grey, whatever is stored: colours are weighed, 16 bits become 8. Raises OSError, PictureError."""
    return np.asarray(_decoded(path, cv2.IMREAD_GRAYSCALE), np.uint8)


def read_as_stored(path: Path) -> NDArray[Any]:
    """(H, W) grey, (H, W, 3) BGR or (H, W, 4) BGRA, of as many bits as the file has. Raises OSError, PictureError."""
    return _decoded(path, cv2.IMREAD_UNCHANGED)


def _decoded(path: Path, flags: int) -> NDArray[Any]:
    """cv2.imread would say on stderr what is missing; and libpng what is damaged, so that a PNG is checked first."""
    content = path.read_bytes()
    try:
        whole = bool(content) and not (content.startswith(PNG) and _is_damaged(content))
        image = cv2.imdecode(np.frombuffer(content, np.uint8), flags) if whole else None
    except cv2.error:  # a header that claims more than 2**30 pixels
        image = None
    if image is None:
        raise PictureError(f"{path}: not a picture, or cut short")
    return image


def _is_damaged(png: bytes) -> bool:
    """Whether a chunk does not have the checksum it says, or the last one is missing."""
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
