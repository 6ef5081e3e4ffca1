"""Random controllers, arms and lines on simulated time, and the identification of each."""

from __future__ import annotations

import asyncio
import errno
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.cell.identified_arm import Arm as ArmSeen
from daemon.cell.identified_arm import arm_file, arm_of
from daemon.cell.identify import Person, identify
from drivers.puma560 import ArmGeometry
from drivers.pumas import PUBLISHED
from drivers.simcell.arm import SimulatedArm
from drivers.simcell.controller import Controller, Machine, Manners
from drivers.simcell.controller.manners import drawn
from drivers.val2.contact_findings import Consult, ContactFindings
from drivers.val2.dialect import Dialect
from drivers.val2.errors import PortError
from drivers.val2.first_contact import PACES_S
from drivers.val2.link import Link
from tests.fakes.memory_line import MemoryLine, MemoryPort
from tests.fakes.simulated_time import SimulatedLoop

BAUDS = (9600, 9600, 9600, 4800, 1200)
START_DEG = np.array([10.0, 60.0, -150.0, 20.0, -40.0, 30.0])


class PacedLine(MemoryLine):
    """A line of limited speed in both directions, on which a wrong baud rate damages every byte."""

    def __init__(self, controller: Controller, loop: asyncio.AbstractEventLoop, baud: int) -> None:
        super().__init__(controller, loop)
        self._baud, self._spoilt = baud, False
        self._in_s = self._out_s = 0.0

    def open(
        self, path: str, dialect: Dialect, on_bytes: Callable[[bytes], None], on_lost: Callable[[PortError], None]
    ) -> MemoryPort:
        self._spoilt = dialect.baud != self._baud

        def paced(data: bytes) -> None:
            for byte in data:
                self._out_s = max(self._out_s, self._loop.time()) + 10.0 / self._baud
                self._loop.call_at(self._out_s, on_bytes, self._carried(byte))

        return super().open(path, dialect, paced, on_lost)

    def typed(self, port: MemoryPort, data: bytes) -> None:
        for byte in data:
            self._in_s = max(self._in_s, self._loop.time()) + 10.0 / self._baud
            self._loop.call_at(self._in_s, self._arrive, self._carried(byte))

    def _carried(self, byte: int) -> bytes:
        return bytes([byte ^ 0xA5 if self._spoilt else byte])

    def _arrive(self, data: bytes) -> None:
        self._controller.receive(data, self.now_s())
        self.turn()


@dataclass(frozen=True, eq=False)
class Strange:
    """One drawn: how the controller speaks, what arm it has, at what speed its line runs."""

    seed: int
    manners: Manners
    geometry: ArmGeometry
    joints_deg: Array
    cold: bool
    baud: int
    name: str


def draw(seed: int) -> Strange:
    """A random controller, arm and line; the same for the same seed."""
    rng = np.random.default_rng([560, seed])
    published = PUBLISHED[int(rng.integers(len(PUBLISHED)))]
    a2, a3, d3, d4 = published.lengths_mm
    base = frames.rigid(np.eye(3), np.round(rng.uniform(-300, 300, 3) * rng.integers(0, 2), 2))
    flange = np.eye(4)
    flange[2, 3] = float(rng.choice([0.0, 56.25, 63.5, 125.0]))
    geometry = ArmGeometry(
        a2, a3, float(rng.choice([-1.0, 1.0])) * d3, d4, base, flange_from_tool=flange, controller_flange=flange
    )
    return Strange(
        seed, drawn(rng), geometry, START_DEG + rng.uniform(-8, 8, 6), bool(rng.random() < 0.4),
        BAUDS[int(rng.integers(len(BAUDS)))], published.name,
    )  # fmt: skip


def dialect_of(strange: Strange) -> Dialect:
    """The dialect that a first contact finds."""
    how = strange.manners
    return Dialect(
        baud=strange.baud,
        echo=how.echo,
        line_end=b"\n" if how.line_ends == "lf" else b"\r",
        cancel_line=b"\x15" if how.line_editing else b"",
        character_pause_s=next(p for p in PACES_S if p == how.lost_within_s == 0.0 or p > how.lost_within_s),
        prompt_late_s=how.prompt_late_s,
        resync_s=max(1.0, 2 * how.prompt_late_s + 0.5),
        prompt_after_move=how.prompt_after_move,
        break_after_move=how.knows_break,
        abort_word="ABORT" if how.stops_at_once else "PANIC",
        joint_signs=how.joint_signs,
        joint_zeros_deg=how.joint_zeros_deg,
        joint_3_against_horizon=how.against_horizon,
        same_place_mm=max(0.03, 2 * how.unit_mm * 10.0 ** -how.decimals[0]),
        unit_mm=how.unit_mm,
    )


@dataclass(frozen=True)
class StopTimes:
    """Of one stop, seconds from when it was asked for: until something was heard behind its word, until rest was
    proven; tried_s: what it took as it was tried before."""

    answered_s: float
    confirmed_s: float
    tried_s: float


async def stop_of_a_drawn_one(strange: Strange) -> StopTimes:
    """The stop of an arm that its pendant moves, on the line of one that was drawn."""
    loop = asyncio.get_running_loop()
    controller = Controller(Machine(SimulatedArm(strange.geometry, np.radians(strange.joints_deg)), strange.manners))
    line = PacedLine(controller, loop, strange.baud)
    link = Link("memory", dialect_of(strange), loop.time, open_port=line.open)
    await link.open()
    await link.test_stop()
    turned = controller.machine.joints().copy()
    turned[0] += np.radians(60.0)
    controller.machine.drive_by_pendant(turned)
    await asyncio.sleep(0.5)
    before, tried_s, asked_s = link.permission.stop_answered, link.permission.stop_took_s, loop.time()
    stop = asyncio.create_task(link.stop_motion())
    while link.permission.stop_answered == before:
        await asyncio.sleep(0.005)
    answered_s = loop.time() - asked_s
    await stop
    confirmed_s = loop.time() - asked_s
    assert controller.machine.at_rest()
    await link.close()
    assert link.permission.stop_took_s == 0, "behind another line there may be another controller"
    line.stop()
    return StopTimes(answered_s, confirmed_s, tried_s)


@dataclass(eq=False)
class Contact:
    """The result of a first contact. steps: the arm's travel, in printed degrees."""

    known: ContactFindings | None
    transcript: list[dict[str, Any]]
    told: list[str]
    controller: Controller
    line: PacedLine


async def meet(
    strange: Strange,
    answer: Callable[[Controller, Consult], str] | None = None,
    stop_s: float | None = None,
    dead: bool = False,
    pendant: bool = False,
    calibrated: bool = True,
    full: Callable[[Controller], bool] = lambda controller: False,
) -> Contact:
    """The first contact, by a person who says Y to power-up questions and yes to moves. full: whether the disk that the
    transcript is on is. Raises as introduce."""
    loop = asyncio.get_running_loop()
    arm = SimulatedArm(strange.geometry, np.radians(strange.joints_deg))
    controller = Controller(Machine(arm, strange.manners, cold=strange.cold))
    controller.machine.calibrated = calibrated
    if dead:
        controller.machine.alive = False
        controller.output(float("inf"))
    line = PacedLine(controller, loop, strange.baud)
    contact = Contact(None, [], [], controller, line)
    wants_stop = asyncio.Event()
    if stop_s is not None:
        loop.call_later(stop_s, wants_stop.set)

    async def answered(consult: Consult) -> str:
        if answer is not None:
            return answer(controller, consult)
        return willing(controller, consult)

    def write(record: dict[str, Any]) -> None:
        if full(controller):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        contact.transcript.append(record)

    person = Person(contact.told.append, answered, wants_stop)
    try:
        contact.known = await identify("memory", line.open, person, write, pendant=pendant)
    finally:
        strangers.append(contact)
    return contact


strangers: list[Contact] = []
"""The contacts of this process, newest last, those that raised as well."""


def willing(controller: Controller, consult: Consult) -> str:
    """A person who answers yes, and switches arm power on when asked."""
    if consult.about == "power":
        controller.machine.arm_power = True
    return "Y" if consult.about == "power-up" else "yes"


def in_simulated_time(story: Callable[[], Any]) -> Any:
    """Run a coroutine on simulated time."""
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        return runner.run(story())


def wrong(strange: Strange, known: ContactFindings, seen: ArmSeen) -> list[str]:
    """The findings that differ from the truth, as far as the difference would have consequences."""
    manners, found = strange.manners, known.dialect()
    off = [
        f"{name}: {found.get(name)!r} instead of {truth!r}"
        for name, truth in (
            ("baud", strange.baud),
            ("echo", manners.echo),
            ("prompt_after_move", manners.prompt_after_move),
            ("abort_word", "ABORT" if manners.stops_at_once else "PANIC"),
            ("break_after_move", manners.knows_break),
        )
        if found.get(name) != truth
    ]
    if found.get("unit_mm", 1.0) != manners.unit_mm:
        off.append(f"unit_mm {found.get('unit_mm')}")
    if (found["line_end"] == "\n") != (manners.line_ends == "lf"):
        off.append(f"line_end {found['line_end']!r}")
    if found["character_pause_s"] + 10 / strange.baud < manners.lost_within_s:
        off.append(f"character_pause_s {found['character_pause_s']}")
    file = arm_file(known, seen)
    dialect = Dialect(
        joint_signs=tuple(file["dialect"]["joint_signs"]["value"]),
        joint_zeros_deg=tuple(file["dialect"]["joint_zeros_deg"]["value"]),
        joint_3_against_horizon=file["dialect"]["joint_3_against_horizon"]["value"],
    )
    said: dict[str, Any] = {name: entry["value"] for name, entry in file["geometry"].items()}
    said = {name: value if isinstance(value, float) else np.array(value) for name, value in said.items()}
    ours = ArmGeometry(
        **said,
        flange_from_tool=np.array(said["controller_flange"]),
    )
    worst = _farthest(strange, dialect, ours)
    if worst > 0.5:
        off.append(f"places {worst:.2f} mm from where they are ({strange.name})")
    return off


def _farthest(strange: Strange, dialect: Dialect, ours: ArmGeometry) -> float:
    """The largest error of the tool's position with the identified arm, mm, over many joint angles."""
    from drivers.puma560 import forward

    rng = np.random.default_rng(strange.seed)
    worst = 0.0
    for joints_deg in START_DEG + rng.uniform(-60, 60, (20, 6)):
        printed = np.round(strange.manners.printed_deg(np.radians(joints_deg)), 3)
        mine = forward(np.radians(dialect.our_angles_deg(tuple(printed))), ours)
        worst = max(worst, float(np.abs(mine - forward(np.radians(joints_deg), strange.geometry))[:3, 3].max()))
    return worst


__all__ = ["Contact", "PacedLine", "Strange", "arm_of", "draw", "in_simulated_time", "meet", "wrong"]
