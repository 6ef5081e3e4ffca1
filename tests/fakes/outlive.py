"""A simulated cell that outlives the daemon: when facetd is killed, controller and arm continue, as in a real cell.

The simulated cell runs in this process, with the received commands and the true pose of the arm; facetd runs in
another, configured as for a real cell, on the cell's serial line. tests/bench/long/kill.py measures with it.
"""

from __future__ import annotations

import shutil
import signal
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from drivers.simcell.cell import SimulatedCell
from drivers.simcell.controller import Manners, Mishap
from drivers.val2.commands import moves_the_arm
from drivers.val2.dialect import Dialect
from tests.fakes.daemon_process import write_own_calibration
from tests.fakes.remote_cameras import PLACE, lend
from tests.fakes.running import ETC, SHOWN
from tests.fakes.sentry import CONFIG, Act, Found, Sentry, come_back, go_on, killed, look_over, sent

POISONED = ("!!", "\x15")
"""Bytes that make a line an error at any controller; a cancelled line leaves them."""
SAME_DEG = 0.002
RESTS_S, DRAINED_S, MOMENT_S = 60.0, 0.2, 30.0


MOMENTS: dict[str, Callable[[SimulatedCell], bool]] = {
    "moving": lambda cell: not cell.arm.at_rest(cell.server.now_s()),
    "half a line": lambda cell: bool(cell.controller.half_typed),
    "a question": lambda cell: cell.controller.question is not None,
    "a part held": lambda cell: cell.world.held is not None,
}
"""The states in which a killed daemon can leave a cell."""


@dataclass(frozen=True)
class Ways:
    """How a cell and its line are. pause_s: between typed characters; travel_pct: how fast the arm goes; at: what the
    kill waits for, one of MOMENTS."""

    time_scale: float = 4.0
    pause_s: float = 0.0
    travel_pct: float = 100.0
    cancels_lines: bool = True
    prompt_after_move: str = "start"
    at: str | None = None


class Beside(Sentry):
    """A facetd process, and the cell in which it works."""

    def __init__(self, folder: Path, ways: Ways, seed: int = 9) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        manners = Manners(line_editing=ways.cancels_lines, prompt_after_move=ways.prompt_after_move)  # type: ignore[arg-type]
        self.cell = SimulatedCell(ETC / "simcell.yaml", seed, ways.time_scale, manners)
        self.at, self._enabled = ways.at, False
        self.cell.camera.open()
        self._cameras = lend(self.cell.camera, folder / "eyes")
        line = Dialect().on_a_faster_line(ways.time_scale)
        dialect = f"{{character_pause_s: {ways.pause_s}, prompt_silence_s: {line.prompt_silence_s}, " \
                  f"echo_settle_s: {line.echo_settle_s}, poll_s: {line.poll_s}}}"  # fmt: skip
        config = (f"cell: real\ncameras: {{left: a, right: b}}\narm: {{port: {self.cell.port}, dialect: {dialect}}}\n"
                  f"pick: {{travel_pct: {ways.travel_pct}}}\n")  # fmt: skip
        super().__init__(folder, CONFIG + config, seed, ways.time_scale)
        write_own_calibration(folder)
        self.program = "tests.fakes.remote_cameras"
        self.environment = {PLACE: str(folder / "eyes")}

    def start(self, arguments: Any = (), timeout_s: float = 60.0) -> None:
        """Start it as systemd would: again, where a device could not be had. Until it is ready nobody can stop the arm,
        which may be at work still."""
        motion_monitor, server = self.cell.motion_monitor, self.cell.server
        self._enabled = False
        motion_monitor.line_works(server.now_s(), False)
        motion_monitor.motion_permitted(server.now_s(), False)
        super().start((), timeout_s)
        motion_monitor.line_works(server.now_s(), True)

    def do(self, text: str, answer: str | None = None) -> dict[str, Any]:
        """Send one command; reports to the cell's motion monitor what it permits."""
        self._enabled |= text == "enable"
        if self._enabled and text not in ("stop", "disable"):
            self.cell.motion_monitor.motion_permitted(self.cell.server.now_s(), True)
        return super().do(text, answer)

    def judged(self) -> list[str]:
        """Forbidden motions of the arm."""
        return list(map(str, self.cell.violations()))

    def await_moment(self) -> None:
        """Wait until the cell is in the wanted state, and stop the daemon there: a busy computer may be late."""
        if self.at is None or self.process is None:
            return
        there, until_s = MOMENTS[self.at], time.monotonic() + MOMENT_S
        while time.monotonic() < until_s:
            if there(self.cell):
                self.process.send_signal(signal.SIGSTOP)
                time.sleep(DRAINED_S)
                if there(self.cell):
                    return
                self.process.send_signal(signal.SIGCONT)
            time.sleep(0.001)

    @property
    def holds(self) -> bool:
        """Whether a part really is in the gripper."""
        return self.cell.world.held is not None

    def joints_deg(self) -> list[float]:
        """The joints of the arm once it is at rest, from the controller."""
        self.rests()
        return np.degrees(self.cell.arm.joints_at(self.cell.server.now_s())).round(3).tolist()

    def rests(self) -> bool:
        """Wait until the arm is at rest; returns whether it is."""
        until_s = time.monotonic() + RESTS_S
        while not (rests := self.cell.arm.at_rest(self.cell.server.now_s())) and time.monotonic() < until_s:
            time.sleep(0.05)
        return rests

    def teach(self, views: Sequence[tuple[str, int]] = SHOWN) -> None:
        """Show the views; see Running.teach."""
        self.do("enable")
        self.do("go survey")
        super().teach(views)
        self.cell.clear()

    def show(self, label: str, view: int) -> None:
        """Show the part to the cameras."""
        self.cell.place_for_teaching(label, view)

    def answer_questions(self) -> None:
        """Answer an open question as an operator would: power-up, arm power, CAL."""
        with self.cell.server.controller() as controller:
            asks, calibrated = controller.question is not None, controller.machine.calibrated
            controller.machine.arm_power = True
        if asks:
            self.do("robot power-up")
        if not calibrated:
            for text in ("resume", "enable", "robot cal"):
                self.do(text)

    def close(self) -> None:
        """End both."""
        self.kill()
        self._cameras.close()
        self.cell.stop()


# What is being done when the kill comes


def _picking(daemon: Sentry) -> None:
    assert isinstance(daemon, Beside)
    while True:
        if not daemon.holds:
            daemon.cell.scatter(("cube", "pyramid", "triangular_prism"))
        daemon.do("auto on")
        daemon.do("auto wait")


def _going(daemon: Sentry) -> None:
    while True:
        for place in ("survey", "home", "bin"):
            daemon.do(f"go {place}")


def _looking(daemon: Sentry) -> None:
    assert isinstance(daemon, Beside)
    daemon.do("go survey")
    while True:
        daemon.cell.place_for_teaching("cube", 0)
        for text in ("look", "teach cube", "forget cube 2"):
            daemon.do(text)


def _switching_on(daemon: Sentry) -> None:
    assert isinstance(daemon, Beside)
    while True:
        with daemon.cell.server.controller() as controller:
            controller.mishap(Mishap.POWER_CYCLED)
            controller.machine.arm_power = True
        for text in ("status", "robot power-up", "resume", "enable", "robot cal", "go home"):
            daemon.do(text)


SLOWLY = Ways(time_scale=1.0, travel_pct=30.0, at="moving")
TYPED = Ways(time_scale=2.0, pause_s=0.006, at="half a line")
ASKED = Ways(time_scale=2.0, pause_s=0.004, at="a question")
ACTS: dict[str, tuple[Act, float, Ways]] = {
    "picking": (_picking, 8.0, Ways(time_scale=10.0)),
    "carrying a part": (_picking, 1.0, Ways(time_scale=4.0, at="a part held")),
    "moving slowly": (_going, 3.0, SLOWLY),
    "moving, prompt at the end": (_going, 3.0, replace(SLOWLY, prompt_after_move="end")),
    "typing": (_going, 3.0, TYPED),
    "typing, lines not cancelled": (_going, 3.0, replace(TYPED, cancels_lines=False)),
    "looking, teaching": (_looking, 3.0, Ways()),
    "power-up, CAL": (_switching_on, 6.0, ASKED),
    "power-up, lines not cancelled": (_switching_on, 6.0, replace(ASKED, cancels_lines=False)),
    "starting": (lambda _: None, 1.5, replace(TYPED, pause_s=0.02)),
}
"""Each act: what it does, within how many seconds the kill comes, and in which cell."""


def harm(kills: int, seed: int, names: Sequence[str] = tuple(ACTS)) -> dict[str, Found]:
    """Kill the daemon repeatedly, at random moments of every act in turn, each in a new cell; returns {row: found}."""
    rng = np.random.default_rng(seed)
    table = {}
    for row, name in enumerate(names):
        act, within_s, ways = ACTS[name]
        folder = Path(tempfile.mkdtemp(prefix="facetd-kill-"))
        daemon, found = Beside(folder, ways, seed + row), Found()
        try:
            daemon.start()
            daemon.do("enable")
            if act is _picking:
                daemon.teach()
            for k in range(row, kills, len(names)):
                strike(daemon, act, float(rng.uniform(0.02, within_s)), found, f"{name}, kill {k + 1}")
            found.moved += daemon.judged()
        finally:
            daemon.close()
            shutil.rmtree(folder, ignore_errors=True)
        table[name] = found
    return table


def strike(daemon: Beside, act: Act, after_s: float, found: Found, name: str) -> None:
    """Kill the daemon once; check what that left, and how the daemon restarts in the cell, which went on."""
    starting = name.startswith("starting")
    if starting:
        daemon.kill()
    killed(daemon, act, after_s, starting)
    found.kills += 1
    in_cycle = look_over(daemon, found, name)
    time.sleep(DRAINED_S)
    for moment, holds in MOMENTS.items():
        found.met[moment] += holds(daemon.cell)
    with daemon.cell.server.controller() as controller:
        controller.lines.clear()
    come_back(daemon, found, name, in_cycle)
    witness(daemon, found, name)
    go_on(daemon, found, name)


def witness(daemon: Beside, found: Found, name: str) -> None:
    """The commands that the controller received since the kill, and whether the daemon knows the arm's position."""
    with daemon.cell.server.controller() as controller:
        lines = [line for line in controller.lines if not any(mark in line for mark in POISONED)]
    meant = sent(daemon).replace("\x15", "\r").split("\r")
    found.moved += [f"{name}: {line!r} was carried out after a restart" for line in lines if moves_the_arm(line)]
    found.moved += [f"{name}: {line!r} was carried out, which nobody typed" for line in lines if line not in meant]
    daemon.answer_questions()
    where = daemon.do("where")
    off = np.abs(np.subtract((where["data"] or {}).get("joints_deg", np.inf), daemon.joints_deg())).max()
    if off > SAME_DEG:
        found.stuck.append(f"{name}: WHERE is {off:.3f} degrees from the controller's: {where['text']}")
