"""How soon the daemon answers at each of its frontends while looks, fused objects, plans and training are computed.

usage: python -m tests.bench.long.heartbeat [SECONDS [TIME_SCALE]]
An idle event loop of another process answers beside it, at the same moments: what it takes is this computer's, and the
ratio of the two is the daemon's own. The cell is simulated in the daemon's process, whose images take its time as well.
Prints how long the daemon takes to be ready, too, and what it and its worker hold.
"""

from __future__ import annotations

import contextlib
import json
import os
import pty
import select
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from tests.fakes.running import Running

EVERY_S = 0.02
ENOUGH_S, WORST_S, SHARE = 0.05, 0.2, 99.9
IDLE_LOOP = """
import asyncio, sys
async def echo(reader, writer):
    while line := await reader.readline():
        writer.write(line)
async def main():
    server = await asyncio.start_unix_server(echo, sys.argv[1])
    await server.serve_forever()
asyncio.run(main())
"""
Ask = Callable[[], None]


@contextmanager
def socket_at(path: Path, until: bytes, said: bytes) -> Iterator[Ask]:
    """What says a line at a socket and returns with the answer."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line:
        line.connect(str(path))

        def ask() -> None:
            line.sendall(said)
            heard = b""
            while until not in heard or not heard.endswith(b"\n"):
                heard += line.recv(1 << 16)

        yield ask


def ask_terminal(master: int) -> None:
    """A letter typed at the serial terminal, and its echo; taken back."""
    os.write(master, b"~\x7f")
    heard = b""
    while b"~" not in heard:
        ready, _, _ = select.select([master], [], [], 30.0)
        assert ready, "the serial terminal says nothing"
        heard += os.read(master, 1 << 16)


class Hearts:
    """Asks everybody by turns; took_s: by phase and frontend."""

    def __init__(self, asks: dict[str, Ask]) -> None:
        self.phase, self.took_s = "", dict[tuple[str, str], list[float]]()
        self._asks, self._over = asks, threading.Event()
        self._thread = threading.Thread(target=self._beat)

    def __enter__(self) -> Hearts:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _beat(self) -> None:
        while not self._over.wait(EVERY_S):
            for name, ask in self._asks.items():
                phase, began_s = self.phase, time.perf_counter()
                ask()
                self.took_s.setdefault((phase, name), []).append(time.perf_counter() - began_s)


def worked(daemon: Running, hearts: Hearts, seconds: float) -> None:
    """The phases, each so long at least."""

    def during(phase: str, work: Callable[[], object]) -> None:
        hearts.phase, until_s = phase, time.monotonic() + seconds
        while time.monotonic() < until_s:
            work()

    during("idle", lambda: time.sleep(0.1))
    daemon.do("enable")
    daemon.do("go home")
    daemon.do("scatter")
    during("looks", lambda: daemon.do("look"))
    during("look around: fused objects", lambda: daemon.do("look around"))

    def pick() -> None:
        daemon.do("pick", "y")
        for text in ("clear", "scatter", "resume", "enable"):
            daemon.do(text, "y")

    during("picks: plans", pick)
    during("training", lambda: daemon.do("train", "y"))


def table(took_s: dict[tuple[str, str], list[float]]) -> None:
    """Print it."""
    print(f"{'ms':<30}{'frontend':<12}{'asked':>7}{'median':>9}{'99 %':>9}{'99.9 %':>9}{'worst':>9}")
    for (phase, name), seconds in took_s.items():
        ms = 1e3 * np.array(seconds)
        figures = (*np.percentile(ms, (50, 99, SHARE)), ms.max())
        print(f"{phase:<30}{name:<12}{len(ms):>7}" + "".join(f"{value:>9.1f}" for value in figures))
    for name in ("socket", "terminal"):
        ours, idle = (
            np.percentile(
                np.concatenate([s for (phase, who), s in took_s.items() if who == one and phase != "idle"]),
                (50, 99, SHARE, 100),
            )
            for one in (name, "idle loop")
        )
        print(f"{name} at work against an idle loop: " + ", ".join(
            f"{what} {a * 1e3:.1f} / {b * 1e3:.1f} ms = {a / b:.1f}"
            for what, a, b in zip(("median", "99 %", "99.9 %", "worst"), ours, idle, strict=True)))  # fmt: skip
        print(f"  wanted: {SHARE} % within {1e3 * ENOUGH_S:.0f} ms, worst {1e3 * WORST_S:.0f}")


def main(seconds: float = 20.0, time_scale: float = 5.0) -> int:
    """Measure and print."""
    folder = Path(tempfile.mkdtemp(prefix="facetd-"))
    master, slave = pty.openpty()
    tty.setraw(slave)
    terminal = f"console: {{tty: {{device: {os.ttyname(slave)}, may: look}}}}\n"
    daemon = Running(folder, terminal, time_scale=time_scale)
    idle = subprocess.Popen([sys.executable, "-c", IDLE_LOOP, str(folder / "idle")])
    try:
        daemon.start()
        print(f"ready after {daemon.ready_s:.1f} s")
        daemon.teach()
        status = json.dumps({"do": "status", "id": 1}).encode() + b"\n"
        with (
            socket_at(folder / "facetd.sock", b'"done"', status) as at_socket,
            socket_at(folder / "idle", b"", b"x\n") as at_idle,
            Hearts({"socket": at_socket, "terminal": lambda: ask_terminal(master), "idle loop": at_idle}) as hearts,
        ):
            worked(daemon, hearts, seconds)
        table(hearts.took_s)
        assert daemon.process is not None
        print(f"the daemon holds {daemon.footprint().resident_mib:.0f} MiB", end="")
        for child in Path(f"/proc/{daemon.process.pid}/task/{daemon.process.pid}/children").read_text().split():
            with contextlib.suppress(OSError):
                words = Path(f"/proc/{child}/status").read_text().split()
                print(f", its worker {int(words[words.index('VmRSS:') + 1]) / 1024:.0f} MiB", end="")
        print()
    finally:
        idle.kill()
        daemon.kill()
        shutil.rmtree(folder, ignore_errors=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(*(float(word) for word in sys.argv[1:])))
