"""Check that a baseline JPEG is complete, without decoding its pixels. Pure.

libjpeg fills in missing data and reports it on stderr only. Here the scan must contain exactly the blocks that the
header announces, with valid Huffman codes and brightnesses within 8 bits.

Of 10,000 small frames (python -m tests.bench.long.damaged_jpegs) none passes that was cut short, ended early or had
lost a packet, and every sound and every padded one does. What still passes is damage that USB's own checksums exclude:
of 1,428 frames with one wrong bit 985, of 1,429 that had lost 1 to 60 bytes 216. A look compares two frames, which
shows it 315 of the 825 of these with a pixel visibly wrong. It uses the other 510: half of them have no pixel more than
9 grey levels off, and of 99 in a hundred the damage covers at most 2.3 blocks. To compare the two frames block by block
as well does not pay: at limits that refuse 2.5 % of the sound pairs it still uses 28 % of the frames with one wrong
bit, without it 35 %.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

END, SCAN, TABLES, RESTART_INTERVAL, QUANTISATION = 0xD9, 0xDA, 0xC4, 0xDD, 0xDB
BASELINE = (0xC0, 0xC1)
ALONE = (0x01, *range(0xD0, 0xDA))
"""Markers without a length field."""
BLOCK = 64
PADDING = (0x00, 0xFF)
"""Bytes that cameras insert between the scan and the end marker."""
LARGEST_DC, LARGEST_DC_BITS = 1024, 11
NO_CODE = 0
STANDARD_BITS = {
    0x00: "00010501010101010100000000000000",
    0x01: "00030101010101010101010000000000",
    0x10: "0002010303020403050504040000017d",
    0x11: "00020102040403040705040400010277",
}
STANDARD_VALUES = {
    0x00: "000102030405060708090a0b",
    0x01: "000102030405060708090a0b",
    0x10: "01020300041105122131410613516107227114328191a1082342b1c11552d1f02433627282090a161718191a25262728292a34353637"
    "38393a434445464748494a535455565758595a636465666768696a737475767778797a838485868788898a92939495969798999aa2a3"
    "a4a5a6a7a8a9aab2b3b4b5b6b7b8b9bac2c3c4c5c6c7c8c9cad2d3d4d5d6d7d8d9dae1e2e3e4e5e6e7e8e9eaf1f2f3f4f5f6f7f8f9fa",
    0x11: "000102031104052131061241510761711322328108144291a1b1c109233352f0156272d10a162434e125f11718191a262728292a3536"
    "3738393a434445464748494a535455565758595a636465666768696a737475767778797a82838485868788898a92939495969798999a"
    "a2a3a4a5a6a7a8a9aab2b3b4b5b6b7b8b9bac2c3c4c5c6c7c8c9cad2d3d4d5d6d7d8d9dae2e3e4e5e6e7e8e9eaf2f3f4f5f6f7f8f9fa",
}
"""Huffman tables of annex K.3 (T.81), which cameras omit: number of codes by length, then their values."""


class JpegError(Exception):
    """The bytes are not a complete picture; the message says why."""


@dataclass(frozen=True)
class _Component:
    """A colour plane: number, blocks in one MCU, number of its quantisation table."""

    number: int
    blocks: int
    quantisation: int


@dataclass
class _Header:
    """What comes before the scan: width, height px; across, down: largest sampling factors; restart: interval in MCUs;
    tables: Huffman codes by class and number; steps: quantisation of the DC values by table."""

    width: int = 0
    height: int = 0
    across: int = 1
    down: int = 1
    restart: int = 0
    components: tuple[_Component, ...] = ()
    tables: dict[int, tuple[int, ...]] = field(default_factory=lambda: _standard_tables())
    steps: dict[int, int] = field(default_factory=dict)


def check_whole(data: bytes) -> int:
    """Check a baseline JPEG. Returns its length in bytes, end marker included: what follows is padding.

    Raises JpegError: cut off, bytes lost, not a JPEG, or not baseline.
    """
    if data[:2] != b"\xff\xd8":
        raise JpegError(f"no JPEG: {len(data)} bytes that begin with {data[:2].hex() or 'nothing'}")
    header, at = _Header(), 2
    while True:
        marker, at = _marker(data, at)
        if marker in ALONE:
            raise JpegError(f"ends after {at} bytes, before its picture begins")
        size = int.from_bytes(data[at : at + 2], "big")
        body = data[at + 2 : at + size]
        if size < 2 or len(body) < size - 2:
            raise JpegError(f"cut off after {len(data)} bytes, in its header")
        at += size
        _read_segment(marker, body, header)
        if marker == SCAN:
            return _scan(data, at, body, header)


def _marker(data: bytes, at: int) -> tuple[int, int]:
    while data[at : at + 1] == b"\xff" and data[at + 1 : at + 2] == b"\xff":
        at += 1
    if at + 1 >= len(data):
        raise JpegError(f"cut off after {len(data)} bytes, in its header")
    if data[at] != 0xFF:
        raise JpegError(f"bytes lost: byte {at} is no marker")
    return data[at + 1], at + 2


def _read_segment(marker: int, body: bytes, header: _Header) -> None:
    try:
        if marker in BASELINE:
            _read_frame(body, header)
        elif marker == TABLES:
            while body:
                count = sum(body[1:17])
                header.tables[body[0]] = _codes(bytes(body[1:17]), bytes(body[17 : 17 + count]))
                body = body[17 + count :]
        elif marker == QUANTISATION:
            while body:
                wide = body[0] >> 4
                header.steps[body[0] & 15] = int.from_bytes(body[1 : 2 + wide], "big")
                body = body[1 + BLOCK * (1 + wide) :]
        elif marker == RESTART_INTERVAL:
            header.restart = int.from_bytes(body[:2], "big")
        elif 0xC2 <= marker <= 0xCF and marker != 0xC8 and marker != 0xCC:
            raise JpegError("not a baseline JPEG, which every camera of this kind sends")
    except IndexError:
        raise JpegError("bytes lost in its header") from None


def _read_frame(body: bytes, header: _Header) -> None:
    header.height, header.width = int.from_bytes(body[1:3], "big"), int.from_bytes(body[3:5], "big")
    parts = [body[6 + 3 * k : 9 + 3 * k] for k in range(body[5])]
    if len(parts) == 1:
        header.across = header.down = 1
        header.components = (_Component(parts[0][0], 1, parts[0][2]),)
        return
    header.across, header.down = max(p[1] >> 4 for p in parts), max(p[1] & 15 for p in parts)
    header.components = tuple(_Component(p[0], (p[1] >> 4) * (p[1] & 15), p[2]) for p in parts)


@lru_cache(maxsize=32)
def _codes(counts: bytes, values: bytes) -> tuple[int, ...]:
    """Look-up table by the next 16 bits: value * 256 + number of bits of code and amplitude, or NO_CODE."""
    table = [NO_CODE] * 65536
    code = index = 0
    for length, count in enumerate(counts, start=1):
        for _ in range(count):
            value = values[index]
            first, span = code << (16 - length), 1 << (16 - length)
            if first + span > 65536:
                raise JpegError("bytes lost in its header: codes overlap")
            table[first : first + span] = [value << 8 | length + (value & 15)] * span
            code, index = code + 1, index + 1
        code <<= 1
    return tuple(table)


def _standard_tables() -> dict[int, tuple[int, ...]]:
    return {
        name: _codes(bytes.fromhex(STANDARD_BITS[name]), bytes.fromhex(STANDARD_VALUES[name])) for name in STANDARD_BITS
    }


def _scan(data: bytes, at: int, body: bytes, header: _Header) -> int:
    """Check the scan. Returns the offset of the picture's end. Raises JpegError."""
    if not header.components or not header.width or not header.height:
        raise JpegError("bytes lost in its header: the size is missing")
    if len(body) < 1 + 2 * len(header.components) or body[0] != len(header.components):
        raise JpegError("not one scan of all its planes, which every camera of this kind sends")
    chosen = {body[1 + 2 * k]: body[2 + 2 * k] for k in range(body[0])}
    try:
        plan = [
            (
                k,
                header.tables[chosen[c.number] >> 4],
                header.tables[0x10 | chosen[c.number] & 15],
                LARGEST_DC // max(header.steps[c.quantisation], 1) + 2,
            )
            for k, c in enumerate(header.components)
            for _ in range(c.blocks)
        ]
    except KeyError:
        raise JpegError("bytes lost in its header: a table is missing") from None
    pieces, end = _pieces(data, at)
    across, down = 8 * header.across, 8 * header.down
    left = -(-header.width // across) * -(-header.height // down)
    interval = header.restart or left
    if len(pieces) != -(-left // interval):
        raise JpegError(f"bytes lost: {len(pieces) - 1} restart marks, {-(-left // interval) - 1} belong there")
    for piece in pieces:
        _walk(piece, min(interval, left), plan, len(header.components))
        left -= interval
    return end


def _pieces(data: bytes, at: int) -> tuple[list[NDArray[np.uint8]], int]:
    """The scan split at its restart markers, stuffing removed, and the offset behind the end marker."""
    raw = np.frombuffer(data, np.uint8)
    marks = np.flatnonzero((raw[at:-1] == 0xFF) & (raw[at + 1 :] != 0) & (raw[at + 1 :] != 0xFF)) + at
    pieces: list[NDArray[np.uint8]] = []
    for mark in marks:
        kind = int(raw[mark + 1])
        pieces.append(_unstuffed(raw[at:mark]))
        at = int(mark) + 2
        if kind == END:
            return pieces, at
        if kind != 0xD0 + (len(pieces) - 1) % 8:
            raise JpegError(f"bytes lost: the mark {kind:02x} in the picture")
    raise JpegError(f"cut off after {len(data)} bytes")


def _unstuffed(raw: NDArray[np.uint8]) -> NDArray[np.uint8]:
    stuffed = np.zeros(len(raw), bool)
    stuffed[1:] = (raw[:-1] == 0xFF) & (raw[1:] == 0)
    return np.asarray(raw[~stuffed])


def _walk(
    piece: NDArray[np.uint8], units: int, plan: Sequence[tuple[int, tuple[int, ...], tuple[int, ...], int]], planes: int
) -> None:
    """Follow the codes of so many MCUs; plan: plane, tables and largest DC of each block in one. Raises JpegError where
    the bytes end before or after."""
    wide = np.concatenate([piece, np.full(8, 0xFF, np.uint8)]).astype(np.uint32)
    three = (wide[:-2] << 16) | (wide[1:-1] << 8) | wide[2:]
    windows: list[int] = ((three[:, None] >> np.arange(8, 0, -1, dtype=np.uint32)) & 0xFFFF).ravel().tolist()
    bits, at = 8 * len(piece), 0
    level = [0] * planes
    for unit in range(units):
        for plane, dc, ac, most in plan:
            entry = dc[windows[at]]
            size = entry >> 8
            if at >= bits or entry == NO_CODE or size > LARGEST_DC_BITS:
                raise JpegError(_short(at, bits, unit, units))
            if size:
                amplitude = windows[at + (entry & 255) - size] >> (16 - size)
                level[plane] += amplitude if amplitude >> (size - 1) else amplitude - (1 << size) + 1
                if not -most <= level[plane] <= most:
                    raise JpegError(f"bytes lost: a brightness out of range, {unit} of {units} parts into it")
            at += entry & 255
            k = 1
            while k < BLOCK:
                entry = ac[windows[at]]
                if at >= bits or entry == NO_CODE:
                    raise JpegError(_short(at, bits, unit, units))
                at += entry & 255
                value = entry >> 8
                if value & 15:
                    k += (value >> 4) + 1
                elif value == 0xF0:
                    k += 16
                else:
                    break
            if k > BLOCK:
                raise JpegError(_short(at, bits, unit, units))
    rest = piece[-(-at // 8) :]
    if at > bits or not np.isin(rest, PADDING).all():
        raise JpegError(f"bytes lost: {len(rest)} are left behind its last part")


def _short(at: int, bits: int, unit: int, units: int) -> str:
    where = f"{unit} of {units} parts into it"
    return f"cut off inside, {where}" if at >= bits else f"bytes lost, {where} or before"
