"""Which damaged JPEG frames are refused, and whether sound ones are read: cut, flipped and padded ones.

usage: python -m tests.bench.long.damaged_jpegs [COUNT]

COUNT frames (10,000) as cameras send them, in turn: cut short, ended early, 1 to 60 bytes lost inside, a packet lost,
one bit flipped, padded before or behind the end mark, and sound. `read`: as every frame is (drivers/camera/pixels.py);
`visible`: of these, those with a pixel off by more than a block of a still scene may be; `used`: of these, those that a
look takes for a still scene beside a sound frame (daemon/arm/settling.py): their blocks keep their means. `worst`: how
far their worst pixel is off, and `share`: how much of the picture is off visibly, each half of these frames and 99 % of
them. USB's own checksums exclude lost bytes short of a packet and flipped bits.
"""

import sys
from collections import Counter

import numpy as np

from daemon.arm.settling import Settling, change
from drivers.camera.pixels import DamagedFrameError, read_grey
from tests.unit.camera.test_jpeg import LAYOUT, frame, scan_of

KINDS = ("cut short", "ended early", "bytes lost", "packet lost", "bit flipped", "padded", "sound")
SOUND = ("padded", "sound")
FRAMES = 50
"""Pictures that are damaged in turn."""
VISIBLE_GREY = Settling().floor_grey
"""By so much a block of a still scene may always change."""


def damaged(data: bytes, kind: str, rng: np.random.Generator) -> bytes:
    """A frame with damage, or padding, of one kind."""
    first = scan_of(data)
    at = int(rng.integers(first, len(data) - 200))
    if kind == "cut short":
        return data[: rng.integers(2, len(data) - 1)]
    if kind == "ended early":
        return data[:at] + b"\xff\xd9"
    if kind in ("bytes lost", "packet lost"):
        most = len(data) - 2 - at
        lost = int(rng.integers(1, 61) if kind == "bytes lost" else rng.integers(100, max(most, 101)))
        return data[:at] + data[at + min(lost, most) :]
    if kind == "bit flipped":
        return data[:at] + bytes([data[at] ^ (1 << int(rng.integers(8)))]) + data[at + 1 :]
    if kind == "padded":
        padding = b"\x00" * int(rng.integers(1, 600)) if rng.random() < 0.5 else rng.bytes(int(rng.integers(1, 600)))
        return data + padding if rng.random() < 0.7 else data[:-2] + b"\x00" * int(rng.integers(1, 4)) + data[-2:]
    return data


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    rng = np.random.default_rng(0)
    frames = [frame(rng) for _ in range(FRAMES)]
    pictures = [read_grey(one, LAYOUT) for one in frames]
    tried, read, visible = Counter[str](), Counter[str](), Counter[str]()
    used: dict[str, list[tuple[float, float]]] = {kind: [] for kind in KINDS}
    for k in range(count):
        kind, which = KINDS[k % len(KINDS)], k // len(KINDS) % FRAMES
        tried[kind] += 1
        try:
            image = read_grey(damaged(frames[which], kind, rng), LAYOUT)
        except DamagedFrameError:
            continue
        read[kind] += 1
        if not np.array_equal(image, pictures[which]):
            off = np.abs(image.astype(float) - pictures[which])
            if off.max() > VISIBLE_GREY:
                visible[kind] += 1
                if change(pictures[which], image)[0] <= VISIBLE_GREY:
                    used[kind].append((off.max(), (off > VISIBLE_GREY).mean()))
    print(f"{'frames':12}{'tried':>7}{'read':>7}{'visible':>9}{'used':>6}{'worst':>10}{'share, %':>12}")
    for kind in KINDS:
        row = f"{kind:12}{tried[kind]:7}{read[kind]:7}{visible[kind]:9}{len(used[kind]):6}"
        if used[kind]:
            (worst, most), (share, largest) = (np.quantile(one, [0.5, 0.99]) for one in np.transpose(used[kind]))
            row += f"{worst:6.0f} {most:3.0f}{100 * share:7.2f} {100 * largest:4.2f}"
        print(row)
    all_used = sum(map(len, used.values()))
    print(f"{all_used} of {count} damaged frames used, {sum(tried[k] - read[k] for k in SOUND)} sound refused")


if __name__ == "__main__":
    main()
