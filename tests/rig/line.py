"""The line between the guest and the controller beside it, as lines are in a hall: two stop bits, adapters, noise.

The controller's cable is in the guest's second serial port (ttyS1), or in a USB adapter: qemu's own usb-serial device,
an FTDI FT232B to the guest's kernel, which is in as long as its socket here is connected, and pulled out, as by a hand,
when it is closed.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import threading
import time
import tty
from pathlib import Path

import numpy as np

BAUD = 9600
FRAME_BITS = 11
"""A start bit, eight of data, two stop bits: to whoever reads, the second is a pause."""
TTYS1, ARM, OTHER = "TTYS1", "ARM", "OTHER"
"""The serial port, and by their serial numbers the adapter at the arm and one that somebody uses for a terminal."""
MOTOR_STARTS = b"DO MOVE"
RANDOM_BYTES, FLIPPED_BYTES = 12, 4
PAUSE_S = 0.05


def qemu_devices(folder: Path) -> list[str]:
    """qemu's arguments: the serial port, a USB controller and two adapters, and the monitor that sends breaks."""
    line = ["-monitor", f"unix:{folder / 'monitor'},server=on,wait=off", "-device", "qemu-xhci"]
    for name in (TTYS1, ARM, OTHER):
        line += ["-chardev", f"socket,id={name},path={folder / name},server=on,wait=off"]
    line += ["-serial", f"chardev:{TTYS1}"]
    for name in (ARM, OTHER):
        line += ["-device", f"usb-serial,chardev={name},serial={name}"]
    return line


class Plug:
    """A port of the guest's, seen from outside: in while connected."""

    def __init__(self, path: Path) -> None:
        self._path, self._lock = path, threading.Lock()
        self._link: socket.socket | None = None

    def put_in(self) -> None:
        """Raises OSError where qemu is not there (yet)."""
        link = socket.socket(socket.AF_UNIX)
        try:
            link.connect(str(self._path))
        except OSError:
            link.close()
            raise
        self._link = link

    def pull(self) -> None:
        """Of an adapter: whoever has its device open is told by the guest's kernel that it is gone."""
        link, self._link = self._link, None
        if link is not None:
            link.shutdown(socket.SHUT_RDWR)
            link.close()

    def read(self) -> bytes:
        """What the guest sent; after a pause nothing, also where it is out."""
        link = self._link
        if link is None:
            time.sleep(PAUSE_S)
            return b""
        with contextlib.suppress(OSError, ValueError):  # pulled out at this moment, or qemu has ended
            if not select.select([link], [], [], PAUSE_S)[0]:
                return b""
            if data := link.recv(4096):
                return data
        if self._link is link:
            self._link = None
        return b""

    def write(self, data: bytes) -> None:
        """To the guest; lost where it is out."""
        link = self._link
        with self._lock, contextlib.suppress(OSError):
            if link is not None:
                link.sendall(data)


class Line:
    """Carries bytes between the guest and the controller's port until it is told to end."""

    def __init__(self, port: str, folder: Path, ending: threading.Event) -> None:
        self._port = os.open(port, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self._port)
        self._monitor, self._ending = folder / "monitor", ending
        self.plugs = {name: Plug(folder / name) for name in (TTYS1, ARM, OTHER)}
        self.end = self.plugs[TTYS1]
        """Where the controller's cable is."""
        self.echoes = False
        """Whether a converter in the line sends back what comes from the guest."""
        self.noise: str | None = None
        """What the next start of a motor is heard as: random, flips or break."""
        self.bursts = 0
        self._rng = np.random.default_rng(1)
        self._to_flip = {"guest": 0, "controller": 0}
        self._typed = b""
        for carry in (self._put_in, self._to_controller, self._to_guest):
            threading.Thread(target=carry, daemon=True).start()

    def _put_in(self) -> None:
        """The serial port is there as soon as qemu is."""
        while not self._ending.wait(0.1):
            with contextlib.suppress(OSError):
                self.plugs[TTYS1].put_in()
                return

    def _to_controller(self) -> None:
        while not self._ending.is_set():
            free_s = time.monotonic()
            for byte in self.end.read():
                free_s = _paced(free_s)
                if self.echoes:
                    self.end.write(bytes([byte]))
                os.write(self._port, self._harmed(byte, "controller"))
                self._hear_typed(byte)

    def _to_guest(self) -> None:
        while not self._ending.is_set():
            try:
                data = os.read(self._port, 4096)
            except OSError:  # the cell has ended
                return
            free_s = time.monotonic()
            for byte in data:
                free_s = _paced(free_s)
                self.end.write(self._harmed(byte, "guest"))

    def _harmed(self, byte: int, to: str) -> bytes:
        """One bit the other way round, as long as the burst lasts."""
        if self._to_flip[to]:
            self._to_flip[to] -= 1
            byte ^= 1 << int(self._rng.integers(7))
        return bytes([byte])

    def _hear_typed(self, byte: int) -> None:
        """Motors start when a line that moves the arm is ended."""
        self._typed += bytes([byte])
        if byte != ord("\r"):
            return
        if self.noise is not None and MOTOR_STARTS in self._typed:
            {"random": self._random, "flips": self._flips, "break": self._break}[self.noise]()
            self.noise, self.bursts = None, self.bursts + 1
        self._typed = b""

    def _random(self) -> None:
        """Bytes that nobody sent, at both ends."""
        self.end.write(self._rng.integers(0, 256, RANDOM_BYTES, dtype=np.uint8).tobytes())
        os.write(self._port, self._rng.integers(0, 256, RANDOM_BYTES, dtype=np.uint8).tobytes())

    def _flips(self) -> None:
        self._to_flip = dict.fromkeys(self._to_flip, FLIPPED_BYTES)

    def _break(self) -> None:
        """The line low for longer than a character: the adapter tells its kernel, the controller reads a NUL."""
        os.write(self._port, b"\0")
        with socket.socket(socket.AF_UNIX) as monitor:
            monitor.connect(str(self._monitor))
            monitor.sendall(f"chardev-send-break {ARM}\n".encode())
            time.sleep(2 * PAUSE_S)  # hung up sooner, it does nothing


def _paced(free_s: float) -> float:
    """Wait until the line is free; when it will be free after one more byte."""
    time.sleep(max(0.0, free_s - time.monotonic()))
    return free_s + FRAME_BITS / BAUD
