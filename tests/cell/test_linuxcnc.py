"""The arm behind a LinuxCNC that was not made here: its own task, motion planner and remote shell, joints simulated."""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.arm import Beliefs, JobEvent, Limits, MovedByOthersError, MoveRefusedError, Supervisor
from daemon.arm.guard import MoveCommand
from daemon.arm.motion import Arrival
from daemon.arm.workcell import Workcell
from daemon.cell.linuxcnc_arm import LinuxcncArm, LinuxcncSettings
from daemon.cell.no_arm import CellError
from drivers.puma560 import ArmGeometry
from tests.fakes.fake_cell import ON_HAND, rig

pytestmark = pytest.mark.long
NOBODY = 65534
STARTS_S = 60.0
HOMED_DEG = (24.0, 91.0, -214.0, -12.0, -40.0, 32.0)
HERE = Path(__file__).parent / "linuxcnc"


def as_nobody() -> dict[str, Any]:
    """LinuxCNC refuses root."""
    return {"user": NOBODY, "group": NOBODY, "extra_groups": []} if os.getuid() == 0 else {}


def free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A LinuxCNC whose machine is on and whose joints are homed; one at a time on a computer."""
    if shutil.which("linuxcnc") is None:
        pytest.skip("LinuxCNC is not here (Debian's package linuxcnc-uspace): an arm behind it is not tried")
    with contextlib.ExitStack() as stack:
        alone = stack.enter_context(open(Path(tempfile.gettempdir()) / "facetd-linuxcnc.lock", "w"))
        fcntl.flock(alone, fcntl.LOCK_EX)
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="facetd-linuxcnc-")))
        shutil.copytree(HERE, folder, dirs_exist_ok=True)
        port = free_port()
        ini = folder / "puma.ini"
        ini.write_text(ini.read_text().replace("-p 5007", f"-p {port}"))
        if os.getuid() == 0:
            for path in (folder, *folder.iterdir()):
                os.chown(path, NOBODY, NOBODY)
        monkeypatch.setenv("HOME", str(folder))  # where its own screens find what they share with it
        environment = {"PATH": os.environ["PATH"], "HOME": str(folder), "LANG": "C.UTF-8"}
        with open(folder / "log", "w") as log:
            running = subprocess.Popen(
                ["linuxcnc", "-r", "puma.ini"],
                cwd=folder, env=environment, stdout=log, stderr=log, start_new_session=True, **as_nobody(),
            )  # fmt: skip
        try:
            screen = Shell(port, running, folder / "log")
            screen.say("enable EMCTOO", "estop off", "machine on", *(f"home {joint}" for joint in range(6)))
            screen.until("joint_homed", "YES YES YES YES YES YES")
            screen.close()
            yield port
        finally:
            with contextlib.suppress(OSError, AssertionError):
                Shell(port, running, folder / "log").leave()
            with contextlib.suppress(subprocess.TimeoutExpired):
                running.wait(20.0)
            with contextlib.suppress(ProcessLookupError):
                os.killpg(running.pid, signal.SIGKILL)
            running.wait()


class Shell:
    """Another connection to the remote shell; only the last one that said `enable` can set anything."""

    def __init__(self, port: int, running: subprocess.Popen[bytes] | None = None, log: Path | None = None) -> None:
        until_s = time.monotonic() + STARTS_S
        while True:
            try:
                self._line = socket.create_connection(("127.0.0.1", port), timeout=5.0)
                break
            except OSError:
                assert running is None or running.poll() is None, log and log.read_text()
                assert time.monotonic() < until_s, log and log.read_text()
                time.sleep(0.05)
        self._heard = self._line.makefile("r")
        self._line.sendall(b"hello EMC screen 1.0\r\nset echo off\r\nset verbose on\r\n")
        while not self._heard.readline().startswith("SET VERBOSE"):
            pass

    def say(self, *texts: str) -> None:
        for text in texts:
            assert self._answer(f"set {text}").endswith("ACK")

    def ask(self, name: str) -> str:
        return self._answer(f"get {name}").partition(" ")[2]

    def _answer(self, line: str) -> str:
        self._line.sendall(f"{line}\r\n".encode())
        while not (answer := self._heard.readline().strip()):
            pass
        return answer

    def until(self, name: str, said: str) -> None:
        until_s = time.monotonic() + STARTS_S
        while not self.ask(name).startswith(said):
            assert time.monotonic() < until_s, (name, self.ask(name))
            time.sleep(0.02)

    def leave(self) -> None:
        """End LinuxCNC."""
        self.say("enable EMCTOO")
        self._line.sendall(b"shutdown\r\n")
        self.close()

    def close(self) -> None:
        self._heard.close()
        self._line.close()


async def at_its_screen(*steps: str) -> None:
    """What somebody does at LinuxCNC's own screen, which commands it past the remote shell."""
    program = "import linuxcnc; c = linuxcnc.command(); " + "; ".join(steps)
    run: Any = subprocess.run
    done = await asyncio.to_thread(run, ["/usr/bin/python3", "-c", program], check=False, **as_nobody())
    assert done.returncode == 0


@dataclass
class Cell:
    """The supervisor of a cell with this arm; what was recorded, and every line of the wire."""

    robot: LinuxcncArm
    supervisor: Supervisor
    wire: list[dict[str, Any]] = field(default_factory=list)
    records: list[dict[str, Any]] = field(default_factory=list)

    def record(self, kind: str, /, **fields: object) -> None:
        self.records.append({"kind": kind, **fields})

    def sent(self) -> list[str]:
        return [str(entry["bytes"]) for entry in self.wire if entry["way"] == "out"]

    async def enable(self) -> None:
        await self.supervisor.test_stop()
        self.supervisor.enable()

    async def go(self, pose: np.ndarray, straight: bool, speed_pct: float = 40.0) -> None:
        mover = self.supervisor.mover
        await mover.wait_until_at_rest()
        await self.supervisor.run("go", mover.go(MoveCommand(pose, straight, speed_pct, "go")))


def lived(port: int, story: Callable[[Cell], Awaitable[None]]) -> None:
    """A story of an opened cell."""

    async def whole() -> None:
        cell: Cell = Cell.__new__(Cell)
        cell.wire, cell.records = [], []
        beliefs = Beliefs(time.monotonic, cell.record)
        settings = LinuxcncSettings(port=port, joint_zeros_deg=HOMED_DEG, full_speed_deg_s=(80.0,) * 6)
        cell.robot = LinuxcncArm(settings, ArmGeometry(), cell.wire.append, time.monotonic, beliefs)
        work: Any = Workcell(
            cell.robot,
            None,
            cell,
            time.monotonic,
            rig(),
            ON_HAND,
            asyncio.to_thread,
        )
        interrupted: list[JobEvent] = []
        cell.supervisor = Supervisor(work, Limits(), Arrival(), interrupted.append)
        await cell.robot.open()
        try:
            await story(cell)
        finally:
            await cell.robot.close()

    asyncio.run(asyncio.wait_for(whole(), 120.0))


async def watched(going: Awaitable[None]) -> np.ndarray:
    """(N, 6) rad: the joints as LinuxCNC's own screen sees them all the while."""
    program = (
        "import linuxcnc, time; s = linuxcnc.stat()\n"
        "while True: s.poll(); print(*s.joint_actual_position[:6], flush=True); time.sleep(0.02)"
    )
    with subprocess.Popen(
        ["/usr/bin/python3", "-c", program], stdout=subprocess.PIPE, text=True, **as_nobody()
    ) as screen:
        try:
            assert screen.stdout is not None
            first = await asyncio.to_thread(screen.stdout.readline)
            await going
        finally:
            screen.terminate()
        seen = [first, *screen.stdout.read().splitlines()]
    return np.radians(np.array([[float(word) for word in line.split()] for line in seen]) + HOMED_DEG)


async def until_it_is_gone(cell: Cell) -> None:
    while True:
        await cell.robot.check()
        await asyncio.sleep(0.05)


def shifted(pose: np.ndarray, move_mm: tuple[float, float, float], turn_rad: float = 0.0) -> np.ndarray:
    return frames.perturb(pose, np.array([*move_mm, 0.0, 0.0, turn_rad]))


def test_moves_go_where_the_guard_looked_along_and_end_at_their_target(port: int) -> None:
    async def story(cell: Cell) -> None:
        with pytest.raises(MoveRefusedError, match="not enabled"):
            await cell.go((await cell.robot.where()).world_from_tool, straight=True)
        await cell.enable()
        arm = cell.robot.kinematics
        start = await cell.robot.wait_until_at_rest()
        assert np.degrees(start.joints_rad) == pytest.approx(HOMED_DEG, abs=1e-3)
        for target, straight in (
            (shifted(start.world_from_tool, (30.0, 80.0, -60.0), 0.4), False),
            (shifted(start.world_from_tool, (60.0, -90.0, -90.0), -0.3), True),
        ):
            before = await cell.robot.wait_until_at_rest()
            joints = await watched(cell.go(target, straight))
            there = (await cell.robot.wait_until_at_rest()).world_from_tool
            assert np.linalg.norm(frames.difference(there, target)[:3]) < 0.01
            assert frames.angle_between(there, target) < 1e-4
            assert len(joints) > 10
            if straight:
                tools = np.stack([arm.between(one, one, 0.0)[:3, 3] for one in joints])
                way = target[:3, 3] - before.world_from_tool[:3, 3]
                off = np.cross(tools - before.world_from_tool[:3, 3], way / np.linalg.norm(way))
                assert np.linalg.norm(off, axis=1).max() < 0.2
            else:
                turn = (await cell.robot.wait_until_at_rest()).joints_rad - before.joints_rad
                shares = (joints - before.joints_rad) @ turn / (turn @ turn)
                off = joints - before.joints_rad - shares[:, None] * turn
                assert np.degrees(np.abs(off)).max() < 0.05

    lived(port, story)


@pytest.mark.parametrize("straight", [True, False])
def test_a_stop_ends_a_move_and_nothing_goes_on_behind_it(port: int, straight: bool) -> None:
    async def story(cell: Cell) -> None:
        await cell.enable()
        start = await cell.robot.wait_until_at_rest()
        going = asyncio.ensure_future(cell.go(shifted(start.world_from_tool, (60.0, -200.0, -90.0)), straight, 10.0))
        while np.abs((await cell.robot.where()).joints_rad - start.joints_rad).max() < 0.03:
            await asyncio.sleep(0)
        moved_to = await cell.robot.where()
        assert await cell.supervisor.stop("by a test") is None
        with pytest.raises(Exception, match="stopped by a test"):
            await going
        stopped = await cell.robot.wait_until_at_rest()
        assert np.degrees(np.abs(stopped.joints_rad - moved_to.joints_rad)).max() < 3.0
        sent = len(cell.sent())
        assert await cell.robot.at_rest()
        assert not any("mdi" in line for line in cell.sent()[sent:])
        assert cell.supervisor.fault_text is not None
        await cell.supervisor.wait_for_stop_end()
        cell.supervisor.resume()
        await cell.enable()
        await cell.go(start.world_from_tool, straight=False)
        assert (
            np.linalg.norm(
                (await cell.robot.wait_until_at_rest()).world_from_tool[:3, 3] - start.world_from_tool[:3, 3]
            )
            < 0.01
        )

    lived(port, story)


def test_an_arm_that_others_moved_or_that_their_screen_has_is_not_sent_on(port: int) -> None:
    async def story(cell: Cell) -> None:
        await cell.enable()
        mover = cell.supervisor.mover
        start = await mover.wait_until_at_rest()
        await at_its_screen("c.mdi('G0 X3')", "c.wait_complete(10)")
        sent = len(cell.sent())
        command = MoveCommand(shifted(start.world_from_tool, (0.0, 40.0, 0.0)), True, 40.0, "go")
        with pytest.raises(MovedByOthersError, match="somebody else moved the arm"):
            await cell.supervisor.run("go", mover.go(command))
        assert not any("mdi" in line for line in cell.sent()[sent:])
        await cell.supervisor.wait_for_stop_end()
        cell.supervisor.resume()
        await cell.enable()
        await at_its_screen("c.feedrate(0.5)", "c.mode(linuxcnc.MODE_MANUAL)", "c.wait_complete(10)")
        with pytest.raises(CellError, match="somebody uses it at its own screen"):
            await cell.go(start.world_from_tool, straight=False)
        assert cell.robot.beliefs.now.holds_part is None
        assert not cell.supervisor.permission.enabled
        await cell.supervisor.wait_for_stop_end()
        cell.supervisor.resume()
        await cell.enable()
        await cell.go(start.world_from_tool, straight=False)
        other = Shell(port)
        assert other.ask("feed_override") == "100"
        other.say("enable EMCTOO")
        with pytest.raises(CellError, match="another connection took its remote shell over"):
            await cell.go(shifted(start.world_from_tool, (0.0, 40.0, 0.0)), straight=True)
        assert not cell.supervisor.permission.enabled
        other.close()

    lived(port, story)


def test_a_machine_that_is_switched_off_and_a_shell_that_is_gone_are_told_with_what_to_do(port: int) -> None:
    async def story(cell: Cell) -> None:
        await cell.enable()
        start = (await cell.robot.wait_until_at_rest()).world_from_tool
        await at_its_screen("c.state(linuxcnc.STATE_OFF)", "c.wait_complete(10)")
        with pytest.raises(CellError, match="switch the machine on"):
            await cell.go(shifted(start, (0.0, 30.0, 0.0)), straight=True)
        assert not cell.supervisor.permission.enabled
        await cell.supervisor.wait_for_stop_end()
        cell.supervisor.resume()
        await at_its_screen("c.state(linuxcnc.STATE_ON)", "c.wait_complete(10)")
        await cell.enable()
        await cell.supervisor.run("close", cell.supervisor.mover.set_gripper(closed=True))
        assert [line for line in cell.sent() if " M6" in line] == ["set mdi M64 P0"]
        Shell(port).leave()
        with pytest.raises(CellError, match="remote shell at"):
            await until_it_is_gone(cell)
        assert not cell.robot.connected
        assert not cell.supervisor.permission.enabled

    lived(port, story)
