"""A USB adapter between the daemon and its simulated controller, as adapters are: it goes and comes back under another
name (the one under by-id stays), lets a motor's start be heard as noise, echoes by itself.

`python -m tests.fakes.adapter --config ...` is facetd --sim behind one; what shall befall it is written into the file
`adapter` beside its configuration: `pull`, `plug`, `noise` (once, as the next motor
starts), `echo`. How many of them were, stands in `adapter.done`.
"""

from __future__ import annotations

import contextlib
import os
import select
import sys
import threading
import time
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

BY_ID = "usb-Prolific_USB-Serial_Controller-if00-port0"
NOISE_BYTES = 5
LOOK_S = 0.05


class Adapter:
    """Forwards bytes between its own terminal, to which `name` points, and the controller's port."""

    def __init__(self, far: str, name: Path) -> None:
        self._far = os.open(far, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self._far)
        self._name, self._rng = name, np.random.default_rng(1)
        self._near: tuple[int, int] | None = None
        self._ends = threading.Lock()
        """Nothing is passed on as it is pulled: the daemon runs in this process, and the next socket that it accepts
        gets the number of an end that was closed."""
        self.noisy = self.echoes = False
        self._typed, self._was = b"", ""
        self.plug()
        threading.Thread(target=self._carry, daemon=True).start()

    def plug(self) -> None:
        """Plug in, as a device with another name than before."""
        refused = []
        while os.ttyname((near := os.openpty())[1]) == self._was:
            refused.append(near)
        for end in (end for ends in refused for end in ends):
            os.close(end)
        tty.setraw(near[1])
        self._near, self._was = near, os.ttyname(near[1])
        self._name.symlink_to(self._was)

    def pull(self) -> None:
        """Pull out: a program that has it open gets an error, and the controller's output is lost."""
        self._name.unlink()
        with self._ends:
            near, self._near = self._near, None
            for end in near or ():
                os.close(end)

    def _carry(self) -> None:
        while True:
            near = self._near
            with contextlib.suppress(OSError, ValueError):  # pulled at this moment
                ends = [self._far] if near is None else [self._far, near[0]]
                for end in select.select(ends, [], [], LOOK_S)[0]:
                    with self._ends:
                        if near is self._near:
                            self._pass(end, near)

    def _pass(self, end: int, near: tuple[int, int] | None) -> None:
        data = os.read(end, 4096)
        if near is None:
            return
        if end == self._far:
            os.write(near[0], data)
            return
        if self.echoes:
            os.write(near[0], data)
        os.write(self._far, data)
        self._typed += data
        if b"\r" in self._typed:
            if self.noisy and b"DO " in self._typed:  # a motor starts
                self.noisy = False
                os.write(near[0], self._rng.integers(0, 256, NOISE_BYTES, dtype=np.uint8).tobytes())
            self._typed = self._typed.rpartition(b"\r")[2]


def _obey(orders: Path, adapter: Adapter) -> None:
    done = 0
    does: dict[str, Callable[[], Any]] = {
        "pull": adapter.pull, "plug": adapter.plug, "echo": lambda: setattr(adapter, "echoes", True),
        "noise": lambda: setattr(adapter, "noisy", True),
    }  # fmt: skip
    while True:
        words = orders.read_text().split() if orders.exists() else []
        for word in words[done:]:
            does[word]()
            done += 1
            orders.with_suffix(".done").write_text(str(done))
        time.sleep(LOOK_S)


def main(arguments: list[str]) -> int:
    """Run facetd with an adapter between it and its controller."""
    from daemon import main as program
    from daemon.cell import own_cells, simulated_cell
    from drivers.val2.link import Link

    folder = Path(arguments[arguments.index("--config") + 1]).parent

    def behind(port: str, *more: Any) -> Any:
        adapter = Adapter(port, folder / BY_ID)
        orders = folder / "adapter"
        adapter.echoes = orders.exists() and "echo" in orders.read_text().split()
        threading.Thread(target=_obey, args=(orders, adapter), daemon=True).start()
        return Link(str(folder / BY_ID), *more)

    with patch.object(own_cells, "Link", behind), patch.object(simulated_cell, "Link", behind):
        return program.main(arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
