"""Random bytes at the protocol and at the simulated controller: how many, how many events, any exception, any motion.

`python tests/bench/fuzz_val2.py [--bytes N] [--seed S]`; half the bytes are drawn evenly, half from VAL II's words.
"""

from __future__ import annotations

import argparse
import sys
import time

import numpy as np

from drivers.simcell.arm import SimulatedArm
from drivers.simcell.controller import Controller, Machine
from drivers.val2.wire import Reader

PIECE = 64
WORDS = (
    b"WHERE\r", b"SPEED 5\r", b".", b"\r\n", b"*", b"?", b"X Y Z O A T\r\n", b"JT1 JT2 JT3 JT4 JT5 JT6\r\n",
    b"1 2 3 4 5 6\r\n", b"POINT #A\r", b"CAL\r", b"y", b"DO ", b"SET P=", b"TRANS(", b"1.5,", b")", b"#", b":", b"-",
    b"\x15", b"\x03", b"LISTL\r", b"BASE 1,2\r", b"TOOL P\r", b"ABORT\r", b"DO BREAK\r", b"1E9", b"=", b"HERE ",
)  # fmt: skip
"""No whole command that moves: none of these may add up to one either, or motion would prove nothing."""


def pieces(count: int, seed: int) -> list[bytes]:
    """About count random bytes, in pieces."""
    rng = np.random.default_rng(seed)
    made = []
    left = count
    while left > 0:
        if rng.random() < 0.5:
            piece = rng.integers(0, 256, PIECE, dtype=np.uint8).tobytes()
        else:
            piece = b"".join(WORDS[k] for k in rng.integers(0, len(WORDS), PIECE // 6))
        made.append(piece[:left])
        left -= len(piece)
    return made


def fuzz_reader(noise: list[bytes], seed: int) -> int:
    """Feed the protocol, silence and typing in between; how many events it made."""
    rng = np.random.default_rng(seed)
    reader, events = Reader(), 0
    for piece in noise:
        action = rng.integers(6)
        if action == 0:
            reader.typed(piece[:7])
        elif action == 1:
            reader.line_ended(echoed=bool(rng.integers(2)))
        events += len(reader.receive(piece))
        if action > 2:
            events += len(reader.silence())
    return events


def fuzz_controller(noise: list[bytes], seed: int) -> tuple[int, bool]:
    """Type the noise at a controller, time passing; how many bytes it printed, whether its arm moved."""
    controller = Controller(Machine(SimulatedArm()))
    before = controller.arm.joints_at(0.0)
    printed, now_s = 0, 0.0
    rng = np.random.default_rng(seed)
    for piece in noise:
        now_s += float(rng.exponential(0.5))
        controller.receive(piece, now_s)
        printed += len(controller.output(now_s))
    controller.tick(now_s + 1000.0)
    return printed, bool(np.any(controller.arm.joints_at(now_s + 1000.0) != before))


def main(arguments: list[str] | None = None) -> int:
    """Print the table; exit status 1 when the arm moved."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bytes", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=560)
    options = parser.parse_args(arguments)
    noise = pieces(options.bytes, options.seed)
    began_s = time.perf_counter()
    events = fuzz_reader(noise, options.seed)
    between_s = time.perf_counter()
    printed, moved = fuzz_controller(noise, options.seed)
    ended_s = time.perf_counter()
    print(f"{'fuzzed':<24}{'random bytes':>14}{'came out':>18}{'exceptions':>12}{'moved':>7}{'seconds':>9}")
    count = sum(map(len, noise))
    print(f"{'protocol':<24}{count:>14,}{events:>11,} events{0:>12}{'-':>7}{between_s - began_s:>9.1f}")
    moves = "YES" if moved else "no"
    print(f"{'simulated controller':<24}{count:>14,}{printed:>12,} bytes{0:>12}{moves:>7}{ended_s - between_s:>9.1f}")
    return 1 if moved else 0


if __name__ == "__main__":
    sys.exit(main())
