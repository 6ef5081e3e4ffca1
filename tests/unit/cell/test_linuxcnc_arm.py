"""The arm behind LinuxCNC against a shell that answers as LinuxCNC 2.9 did: what is sent, and what keeps it back.

tests/cell/test_linuxcnc.py has the real one.
"""

from __future__ import annotations

import asyncio
import re
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import numpy as np
import pytest

from daemon import frames
from daemon.arm import Beliefs, HeldBackError, MoveCommand, Reading, StopRefusedError
from daemon.arm.permission import Grant
from daemon.cell import sections
from daemon.cell.backends import Surroundings
from daemon.cell.linuxcnc_arm import BLEND_DEG, LinuxcncArm, LinuxcncSettings
from daemon.cell.no_arm import CellError
from daemon.cell.own_cells import LINUXCNC as BACKEND
from daemon.store.yamlfile import ConfigError
from drivers.linuxcnc.shell import RemoteShell, ShellError
from drivers.puma560 import ArmGeometry
from tests.fakes.waiting import PATIENCE_S
from tests.unit.cell.test_backends import configured

ZEROS_DEG = (24.0, 91.0, -214.0, -12.0, -40.0, 32.0)
SIGNS = (1, -1, 1, 1, -1, 1)
SETTINGS = {"joint_zeros_deg": ZEROS_DEG, "joint_signs": SIGNS, "full_speed_deg_s": (50.0,) * 6}


class LinuxCNC:
    """Answers as the remote shell does; its joints are at once where a block sends them."""

    def __init__(self) -> None:
        self.joints = [0.0] * 6
        self.state = {
            "enable": "ON", "estop": "OFF", "machine": "ON", "joint_homed": " ".join(["YES"] * 9), "mode": "MANUAL",
            "feed_override": "100", "program_status": "IDLE",
        }  # fmt: skip
        self.errors: list[str] = []
        self.heard: list[str] = []
        self.refuses = ""
        """Words of `set` that it does not acknowledge."""
        self.left = asyncio.Event()

    @property
    def blocks(self) -> list[str]:
        return [line.removeprefix("set mdi ") for line in self.heard if line.startswith("set mdi")]

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while line := (await reader.readline()).decode().strip():
            self.heard.append(line)
            writer.write(f"{self.answer(line)}\r\n\r\n".encode())
        writer.close()
        self.left.set()

    def answer(self, line: str) -> str:
        word, _, rest = line.partition(" ")
        name, _, value = rest.partition(" ")
        if word == "hello":
            return "HELLO ACK EMCNETSVR 1.1"
        if line == "set echo off":
            return line
        if word == "get":
            if name == "joint_pos":
                return "JOINT_POS " + " ".join(f"{joint:.6f}" for joint in (*self.joints, 0.0, 0.0, 0.0))
            if name == "error":
                return f"ERROR {self.errors.pop(0) if self.errors else 'OK'}"
            return f"{name.upper()} {self.state.get(name, 'NAK')}"
        if name in self.refuses.split():
            return f"SET {name.upper()} NAK"
        if name == "mdi":
            for k, letter in enumerate("XYZABC"):
                if found := re.search(rf"G1.* {letter}(-?[\d.]+)", f"{value} "):
                    self.joints[k] = float(found[1])
        elif name in self.state and name != "enable":
            self.state[name] = value.upper()
        return f"SET {name.upper()} ACK"


def lived(story: Callable[[LinuxCNC, LinuxcncArm], Awaitable[None]], opened: bool = True) -> None:
    async def whole() -> None:
        there = LinuxCNC()
        server = await asyncio.start_server(there.serve, "127.0.0.1", 0)
        settings = LinuxcncSettings(port=server.sockets[0].getsockname()[1], **SETTINGS)  # type: ignore[arg-type]
        beliefs = Beliefs(time.monotonic, lambda *_, **__: None)
        arm = LinuxcncArm(settings, ArmGeometry(), lambda _: None, time.monotonic, beliefs)
        try:
            if opened:
                await arm.open()
                await arm.test_stop()
                arm.permission.grant(Grant.ALL)
            await story(there, arm)
        finally:
            await arm.close()
            server.close()
            await there.left.wait()

    asyncio.run(asyncio.wait_for(whole(), PATIENCE_S))


async def moved(
    arm: LinuxcncArm, target: np.ndarray, straight: bool, starts: Callable[[Reading], None] = print
) -> Reading:
    return await arm.move(MoveCommand(target, straight, 20.0, "test"), starts, timeout_s=5.0)


def beside(pose: np.ndarray, mm: tuple[float, float, float]) -> np.ndarray:
    return frames.perturb(pose, np.array([*mm, 0.0, 0.0, 0.1]))


def test_a_block_says_all_that_it_means_in_linuxcnc_s_own_joints_and_takes_its_time() -> None:
    async def story(there: LinuxCNC, arm: LinuxcncArm) -> None:
        here = await arm.wait_until_at_rest()
        assert np.degrees(here.joints_rad) == pytest.approx(ZEROS_DEG)
        target = beside(here.world_from_tool, (20.0, 60.0, -40.0))
        there.state["feed_override"] = "120"
        reading = await moved(arm, target, straight=False)
        assert frames.difference(reading.world_from_tool, target) == pytest.approx(np.zeros(6), abs=1e-3)
        (block,) = there.blocks
        assert block.startswith(f"G21 G90 G93 G64 P{BLEND_DEG} G53 G1 X")
        assert there.state["feed_override"] == "100"
        turned_deg = np.degrees(np.abs(reading.joints_rad - here.joints_rad)).max()
        seconds = 60.0 / float(block.rpartition("F")[2])
        assert seconds == pytest.approx(turned_deg / 50.0 / 0.2, rel=1e-3)
        expected = (np.degrees(reading.joints_rad) - ZEROS_DEG) * SIGNS
        assert [float(word[1:]) for word in block.split()[-7:-1]] == pytest.approx(expected, abs=1e-4)

    lived(story)


def test_a_straight_move_is_as_many_blocks_as_keep_the_tool_on_its_line() -> None:
    async def story(there: LinuxCNC, arm: LinuxcncArm) -> None:
        here = await arm.wait_until_at_rest()
        target = beside(here.world_from_tool, (0.0, 90.0, 0.0))
        reading = await moved(arm, target, straight=True)
        assert frames.difference(reading.world_from_tool, target) == pytest.approx(np.zeros(6), abs=1e-3)
        assert len(there.blocks) == 6
        with pytest.raises(CellError, match="cannot reach it"):
            await moved(arm, beside(target, (900.0, 0.0, 0.0)), straight=True)
        assert len(there.blocks) == 6

    lived(story)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"enable": "OFF"}, "another connection took its remote shell over"),
        ({"estop": "ON"}, "release the emergency stop"),
        ({"machine": "OFF"}, "switch the machine on"),
        ({"joint_homed": "YES YES NO YES YES YES NO NO NO"}, "home all six joints"),
        ({"mode": "AUTO"}, "somebody uses it at its own screen"),
    ],
)
def test_of_what_linuxcnc_would_not_carry_out_nothing_is_sent_and_the_arm_is_no_longer_enabled(
    wrong: dict[str, str], told: str
) -> None:
    async def story(there: LinuxCNC, arm: LinuxcncArm) -> None:
        target = beside((await arm.wait_until_at_rest()).world_from_tool, (0.0, 40.0, 0.0))
        there.state.update(wrong)
        with pytest.raises(CellError, match=told):
            await moved(arm, target, straight=False)
        assert there.blocks == []
        assert not arm.permission.enabled
        assert (arm.beliefs.now.holds_part is None) == ("mode" in wrong)

    lived(story)


def test_what_is_held_or_begins_elsewhere_is_not_sent() -> None:
    async def story(there: LinuxCNC, arm: LinuxcncArm) -> None:
        target = beside((await arm.wait_until_at_rest()).world_from_tool, (0.0, 40.0, 0.0))

        def elsewhere(_: Reading) -> None:
            raise CellError("elsewhere")

        with pytest.raises(CellError, match="elsewhere"):
            await moved(arm, target, straight=False, starts=elsewhere)
        arm.permission.require_wait()
        for act in (moved(arm, target, straight=True), arm.set_gripper(closed=True)):
            with pytest.raises(HeldBackError):
                await act
        assert there.blocks == []
        arm.permission.release()
        await arm.set_gripper(closed=True)
        await arm.set_gripper(closed=False)
        await arm.set_outputs((3, -4))
        assert there.blocks == ["M64 P0", "M65 P0", "M64 P2", "M65 P3"]

    lived(story)


def test_behind_a_stop_no_further_block_of_a_straight_move_is_sent() -> None:
    async def story(there: LinuxCNC, arm: LinuxcncArm) -> None:
        target = beside((await arm.wait_until_at_rest()).world_from_tool, (0.0, 150.0, 0.0))
        going = asyncio.ensure_future(moved(arm, target, straight=True))
        while len(there.blocks) < 3:
            await asyncio.sleep(0)
        await arm.stop_motion()
        with pytest.raises(CellError, match="the move was stopped"):
            await going
        assert len(there.blocks) < 10
        (*_, stop) = (k for k, line in enumerate(there.heard) if line == "set abort")
        assert not any(line.startswith("set mdi") for line in there.heard[stop:])

    lived(story)


def test_a_block_that_went_wrong_is_told_in_linuxcnc_s_words() -> None:
    async def story(there: LinuxCNC, arm: LinuxcncArm) -> None:
        target = beside((await arm.wait_until_at_rest()).world_from_tool, (0.0, 40.0, 0.0))
        there.errors = ["an old one"]
        asked = there.answer

        def answer(line: str) -> str:
            if line.startswith("set mdi"):
                there.errors = ["Linear move on line 0 would exceed joint 1's positive limit"]
                return "SET MDI ACK"
            return asked(line)

        there.answer = answer
        with pytest.raises(CellError, match="joint 1's positive limit") as raised:
            await moved(arm, target, straight=False)
        assert "an old one" not in str(raised.value)

    lived(story)


def test_a_stop_that_is_refused_is_told_as_such_and_nothing_may_move() -> None:
    async def story(there: LinuxCNC, arm: LinuxcncArm) -> None:
        assert arm.permission.enabled
        there.refuses = "abort"
        with pytest.raises(StopRefusedError, match="refuses 'abort'"):
            await arm.stop_motion()
        assert not arm.permission.enabled
        there.state["machine"] = "OFF"
        await arm.stop_motion()
        with pytest.raises(CellError, match="switch the machine on"):
            await arm.test_stop()
        assert not arm.permission.stop_tests, "that proves nothing"

    lived(story)


def test_an_arm_that_moves_as_the_line_is_opened_is_stopped() -> None:
    async def story(there: LinuxCNC, arm: LinuxcncArm) -> None:
        there.state["program_status"] = "RUNNING"
        asked = there.answer

        def answer(line: str) -> str:
            if line == "set abort":
                there.state["program_status"] = "IDLE"
            return asked(line)

        there.answer = answer
        await arm.open()
        assert arm.stopped_on_opening
        assert "set abort" in there.heard

    lived(story, opened=False)


@pytest.mark.parametrize("wrong", [2, 3])
def test_what_is_asked_is_asked_again_where_the_shell_mixed_it_up(wrong: int) -> None:
    async def story(there: LinuxCNC, arm: LinuxcncArm) -> None:
        asked, left = there.answer, [wrong]

        def answer(line: str) -> str:
            if line != "get joint_pos" or not left[0]:
                return asked(line)
            left[0] -= 1
            return ("JOINT_POS NAK", "MODE MDI")[left[0] % 2]

        there.answer = answer
        if wrong < 3:
            assert np.degrees((await arm.where()).joints_rad) == pytest.approx(ZEROS_DEG)
        else:
            with pytest.raises(CellError, match="'joint_pos' was answered by"):
                await arm.where()

    lived(story)


def test_a_shell_that_is_not_there_refuses_or_says_nothing_is_told() -> None:
    async def story() -> None:
        async def silent(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            await reader.readline()
            writer.write(b"HELLO NAK\r\n")
            await reader.read()
            writer.close()

        server = await asyncio.start_server(silent, "127.0.0.1", 0)
        shell = RemoteShell("127.0.0.1", server.sockets[0].getsockname()[1], lambda *_: None)
        with pytest.raises(ShellError, match="refuses the connection"):
            await shell.open("facetd", "x")
        assert not shell.connected
        with pytest.raises(ShellError, match="no connection"):
            await shell.ask("mode")
        server.close()
        await server.wait_closed()
        with pytest.raises(ShellError, match="does LinuxCNC run"):
            await shell.open("facetd", "x")

    asyncio.run(asyncio.wait_for(story(), PATIENCE_S))


def test_a_cell_with_linuxcnc_is_configured_checked_and_built(tmp_path: Path) -> None:
    cameras = "cameras: {left: /dev/video0, right: /dev/video2}"
    config = configured(
        tmp_path, f"cell: linuxcnc\n{cameras}\nbackend: {{port: 5107, joint_signs: [1, -1, 1, 1, 1, 1]}}"
    )
    sections.check(config)
    given = Surroundings(lambda _: None, time.monotonic, Beliefs(time.monotonic, lambda *_, **__: None))
    hardware = BACKEND.build(config, given)
    assert (hardware.kind, hardware.where) == ("linuxcnc", "127.0.0.1:5107")
    wrong = configured(tmp_path, f"cell: linuxcnc\n{cameras}\nbackend: {{joint_signs: [1, 2]}}")
    with pytest.raises(ConfigError, match="joint_signs"):
        sections.check(wrong)
