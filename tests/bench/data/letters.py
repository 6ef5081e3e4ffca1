"""The letter recognition data (Frey and Slate 1991) as Debian packages it, fetched into a temporary folder.

Debian's r-cran-mlbench carries the data in R's binary save format; enough of a reader for one data frame is here, so
that the benchmark needs neither R nor a package for it. Nothing of the data is kept.
"""

from __future__ import annotations

import bz2
import gzip
import lzma
import struct
import tempfile
from pathlib import Path

import numpy as np

from tests.bench.data.packages import debian_package

PACKAGE = "r-cran-mlbench"
FILE = "usr/lib/R/site-library/mlbench/data/LetterRecognition.rda"

# kinds of R objects in the format, from the R Internals manual, chapter "Serialization Formats"
NIL, GLOBAL, BASE, REFERENCE = 254, 253, 241, 255
SYMBOL, PAIR, CHARS, LOGICAL, INTEGER, REAL, STRING, LIST = 1, 2, 9, 10, 13, 14, 16, 19


def letters() -> tuple[np.ndarray, np.ndarray] | str:
    """(20000, 16) in [0, 1] and (20000,) letter numbers in the order of the file; or why they cannot be had."""
    with tempfile.TemporaryDirectory() as folder:
        root = debian_package(PACKAGE, FILE, Path(folder))
        return root if isinstance(root, str) else _table((root / FILE).read_bytes())


def _table(packed: bytes) -> tuple[np.ndarray, np.ndarray]:
    frame = data_frame(packed)
    names = list(frame)
    _, numbers = np.unique(frame[names[0]], return_inverse=True)
    return np.column_stack([frame[name] for name in names[1:]]) / 15.0, numbers


def data_frame(packed: bytes) -> dict[str, np.ndarray]:
    """The columns of the one data frame saved in an .rda file; factors become their level names."""
    for magic, unpack in ((b"\x1f\x8b", gzip.decompress), (b"BZh", bz2.decompress), (b"\xfd7zXZ", lzma.decompress)):
        if packed.startswith(magic):
            packed = unpack(packed)
    if packed[:7] not in (b"RDX2\nX\n", b"RDX3\nX\n"):
        raise ValueError(f"not an R save file in XDR: it starts {packed[:7]!r}")
    reader = _Reader(packed[7:])
    reader.header()
    (_, (columns, attributes)), *_ = reader.item()
    names = dict(attributes)["names"][0]
    return {name: _column(*column) for name, column in zip(names, columns, strict=True)}


def _column(values, attributes) -> np.ndarray:
    levels = dict(attributes).get("levels")
    return np.asarray(levels[0])[values - 1] if levels else values


class _Reader:
    """One item after the other: vectors as (values, attributes), pair lists as [(tag, item), ...]."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0
        self.symbols: list[str] = []

    def take(self, count: int) -> bytes:
        self.at += count
        return self.data[self.at - count : self.at]

    def integer(self) -> int:
        return int(struct.unpack(">i", self.take(4))[0])

    def header(self) -> None:
        version, _writer, _least = (self.integer() for _ in range(3))
        if version == 3:
            self.take(self.integer())

    def item(self):
        flags = self.integer()
        kind = flags & 0xFF
        if kind in (NIL, GLOBAL, BASE):
            return []
        if kind == SYMBOL:
            self.symbols.append(self.item())
            return self.symbols[-1]
        if kind == REFERENCE:
            return self.symbols[(flags >> 8 or self.integer()) - 1]
        if kind == CHARS:
            return self.take(max(self.integer(), 0)).decode()
        if kind == PAIR:
            return self.pair(bool(flags & 0x200), bool(flags & 0x400))
        values = self.vector(kind)
        return values, self.item() if flags & 0x200 else []

    def pair(self, has_attributes: bool, has_tag: bool) -> list:
        if has_attributes:
            self.item()
        tag = self.item() if has_tag else ""
        return [(tag, self.item()), *self.item()]

    def vector(self, kind: int):
        length = self.integer()
        if kind in (INTEGER, LOGICAL):
            return np.frombuffer(self.take(4 * length), dtype=">i4").astype(np.int64)
        if kind == REAL:
            return np.frombuffer(self.take(8 * length), dtype=">f8").astype(np.float64)
        if kind in (STRING, LIST):
            return [self.item() for _ in range(length)]
        raise ValueError(f"an R object of kind {kind} at byte {self.at}: not expected in a data frame")
