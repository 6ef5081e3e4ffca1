"""What stands around the guest: the simulated cell, on this machine, reached only as a real one would be.

The arm's controller is at the other end of a serial line (line.py). The cameras' light goes through one virtio port:
the guest asks for a pair, and gets what the cameras see from where the arm is at that moment. What a person at the cell
would do (put parts on the table, pull an adapter out) and know (what is held) goes through another, as a JSON object a
line.
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

import line

from drivers.simcell.cell import SimulatedCell

PORTS = ("light", "person")


def qemu_devices(folder: Path) -> list[str]:
    """qemu's arguments: the serial line, and the two ports as unix sockets in the folder."""
    devices = [*line.qemu_devices(folder), "-device", "virtio-serial-pci"]
    for name in PORTS:
        devices += ["-chardev", f"socket,id={name},path={folder / name},server=on,wait=off"]
        devices += ["-device", f"virtserialport,chardev={name},name=rig.{name}"]
    return devices


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
            for asked in stream:
                number, _, question = asked.partition(b" ")
                stream.write(number + b" " + answer(question))
                stream.flush()
        except OSError:
            return


class Surroundings:
    """Answers the guest's two ports from a simulated cell."""

    def __init__(self, cell: SimulatedCell, to_controller: line.Line) -> None:
        self.cell, self.line = cell, to_controller
        cell.camera.open()

    def light(self, _: bytes) -> bytes:
        """A pair exposed after this moment: left then right, row by row."""
        pair = self.cell.camera.grab(time.monotonic(), 5.0)
        return pair.left.pixels.tobytes() + pair.right.pixels.tobytes()

    def person(self, asked: bytes) -> bytes:
        """Do or tell one thing; {"error": ...} where it cannot be done."""
        try:
            words = json.loads(asked)
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

    def do_plug(self, adapter: str) -> dict[str, Any]:
        """Put an adapter in; the controller's cable goes with its own."""
        self.line.plugs[adapter].put_in()
        if adapter == line.ARM:
            self.line.end = self.line.plugs[adapter]
        return {}

    def do_pull(self) -> dict[str, Any]:
        """Pull the arm's adapter out: nothing that is typed gets through any more."""
        with self.cell.server.controller() as controller:
            self.cell.motion_monitor.line_works(controller.now_s, False)
            self.cell.motion_monitor.motion_permitted(controller.now_s, False)
        self.line.plugs[line.ARM].pull()
        return {}

    def do_echo(self, on: bool) -> dict[str, Any]:
        """The converter's switch."""
        self.line.echoes = on
        return {}

    def do_noise(self, kind: str) -> dict[str, Any]:
        """What the next start of a motor is heard as."""
        self.line.noise = kind
        return {}

    def do_allow(self, may: bool) -> dict[str, Any]:
        """Tell the motion monitor that the arm may move from now on, or may not, and that a stop would be heard."""
        with self.cell.server.controller() as controller:
            self.cell.motion_monitor.line_works(controller.now_s, True)
            self.cell.motion_monitor.motion_permitted(controller.now_s, may)
        return {}

    def do_judged(self) -> dict[str, Any]:
        """What the arm did that it must never do, how often it set out, how many bursts of noise there were."""
        found = [str(violation) for violation in self.cell.violations()]
        return {"violations": found, "motions": len(self.cell.truth.motions), "bursts": self.line.bursts}


@contextmanager
def surroundings(truth: Path, seed: int, folder: Path) -> Iterator[list[str]]:
    """The cell, answering; gives the arguments that connect qemu to it."""
    ending = threading.Event()
    with SimulatedCell(truth, seed) as cell:
        around = Surroundings(cell, line.Line(cell.port, folder, ending))
        threads = [
            threading.Thread(target=_serve, args=(folder / name, ending, getattr(around, name)), daemon=True)
            for name in PORTS
        ]
        for thread in threads:
            thread.start()
        try:
            yield qemu_devices(folder)
        finally:
            ending.set()
