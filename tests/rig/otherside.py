"""What stands around the guest: the simulated cell, on this machine, reached only as a real one would be.

The arm's controller is on the guest's second serial line (the cell's own pty). The cameras' light goes through one
virtio port: the guest asks for a pair, and gets what the eyes see from where the arm is at that moment. What a person
at the cell would do (put parts on the table) and know (what is held) goes through another, as a JSON object a line.
"""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from drivers.simcell.cell import SimulatedCell

PORTS = ("light", "person")


def qemu_devices(serial: str, folder: Path) -> list[str]:
    """qemu's arguments: the serial line at ttyS1, and the two ports as unix sockets in the folder."""
    line = ["-chardev", f"serial,id=arm,path={serial}", "-serial", "chardev:arm", "-device", "virtio-serial-pci"]
    for name in PORTS:
        line += ["-chardev", f"socket,id={name},path={folder / name},server=on,wait=off"]
        line += ["-device", f"virtserialport,chardev={name},name=rig.{name}"]
    return line


def _connect(path: Path, ending: threading.Event) -> socket.socket | None:
    """Wait for qemu to open the socket."""
    while not ending.wait(0.1):
        link = socket.socket(socket.AF_UNIX)
        try:
            link.connect(str(path))
        except OSError:
            link.close()
            continue
        return link
    return None


def _serve(path: Path, ending: threading.Event, answer: Callable[[bytes], bytes]) -> None:
    """Answer every line that comes in until the other end closes; each begins with its number, as the answer does."""
    link = _connect(path, ending)
    if link is None:
        return
    with link, link.makefile("rwb") as stream:
        try:
            for line in stream:
                number, _, question = line.partition(b" ")
                stream.write(number + b" " + answer(question))
                stream.flush()
        except OSError:
            return


class Surroundings:
    """Answers the guest's two ports from a simulated cell."""

    def __init__(self, cell: SimulatedCell) -> None:
        self.cell = cell
        cell.camera.open()

    def light(self, _: bytes) -> bytes:
        """A pair exposed after this moment: left then right, row by row."""
        pair = self.cell.camera.grab(time.monotonic(), 5.0)
        return pair.left.pixels.tobytes() + pair.right.pixels.tobytes()

    def person(self, line: bytes) -> bytes:
        """Do or tell one thing; {"error": ...} where it cannot be done."""
        try:
            words = json.loads(line)
            answer = getattr(self, f"do_{words.pop('do')}")(**words)
        except Exception as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        return json.dumps(answer).encode() + b"\n"

    def do_show(self, label: str, view: int) -> dict[str, Any]:
        """Hold a part before the cameras."""
        self.cell.place_for_teaching(label, view)
        return {}

    def do_lay(self, label: str, rest: int) -> dict[str, Any]:
        """Clear the table and lay a part in its middle, on one of its stable faces."""
        self.cell.clear()
        self.cell.world.stand(label, rest, 520.0, 0.0, 0.4)
        return {}

    def do_clear(self) -> dict[str, Any]:
        """Take everything away."""
        self.cell.clear()
        return {}

    def do_tell(self) -> dict[str, Any]:
        """What is held, what the arm struck, which parts lie where, where the gripper is and whether it moves."""
        world, now = self.cell.world, time.monotonic()
        here, soon = self.cell.world_from_tool(now), self.cell.world_from_tool(now + 0.05)
        return {
            "held": world.held and world.held.label, "strikes": world.strikes,
            "parts": {part.name: part.where.name for part in world.parts},
            "gripper_mm": here[:3, 3].tolist(), "moves": bool(abs(soon - here).max() > 0.05),
        }  # fmt: skip


@contextmanager
def surroundings(truth: Path, seed: int, folder: Path) -> Iterator[list[str]]:
    """The cell, answering; gives the arguments that connect qemu to it."""
    ending = threading.Event()
    with SimulatedCell(truth, seed) as cell:
        around = Surroundings(cell)
        threads = [
            threading.Thread(target=_serve, args=(folder / name, ending, getattr(around, name)), daemon=True)
            for name in PORTS
        ]
        for thread in threads:
            thread.start()
        try:
            yield qemu_devices(cell.port, folder)
        finally:
            ending.set()
