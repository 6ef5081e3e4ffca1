"""An arm behind LinuxCNC: the daemon's Robot protocol on LinuxCNC's remote shell. Matrices in, readings out.

LinuxCNC moves joints (KINEMATICS = trivkins, joints 1 to 6 as X Y Z A B C in degrees); facetd computes the tool's pose
from them. A joint-interpolated move is one block; a straight one is many, each short enough that the tool stays on its
line. Every block states units, coordinates, path control and its own time, so that it does not depend on modes set at
LinuxCNC's screen. One block is sent at a time: none runs after a stop.
"""

import asyncio
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from math import ceil
from typing import Annotated, Literal, NoReturn

import numpy as np
from msgspec import Meta

from daemon import frames
from daemon.arm import Beliefs, HeldBackError, MotionPermission, MoveCommand, Reading, StopRefusedError, VoidingEvent
from daemon.arrays import Array
from daemon.cell.backends import WireListener
from daemon.cell.no_arm import CellError
from daemon.cell.puma_arm import PumaArm
from drivers import puma560
from drivers.ledger import Ledger
from drivers.linuxcnc.shell import RemoteShell, ShellError

REST_S, AGAIN_S = 5.0, 0.05
"""How long to wait for a motion that facetd did not command; interval between two readings."""
ABORTS = 3
"""How often to send the stop before its refusal counts."""
SAME_DEG = 1e-3
"""Largest difference between two readings of joints at rest."""
STEP_MM, STEP_RAD = 15.0, 0.035
"""Longest block of a straight move: between its ends the tool is within 0.1 mm of its line."""
BLEND_DEG = 0.01
"""How far from the corner between two blocks LinuxCNC may begin to turn."""
LETTERS = "XYZABC"
SIX = Meta(min_length=6, max_length=6)
Text = Annotated[str, Meta(min_length=1, max_length=200)]
Outputs = tuple[Annotated[int, Meta(ge=-64, le=64)], ...]


@dataclass(frozen=True, kw_only=True)
class LinuxcncSettings:
    """The section `backend` of a cell with LinuxCNC."""

    host: Text = "127.0.0.1"
    """Where linuxcncrsh listens."""
    port: Annotated[int, Meta(ge=1, le=65535)] = 5007
    """Its TCP port."""
    password: Text = "EMCTOO"
    """Its password for commands; LinuxCNC's own unless it was given another."""
    full_speed_deg_s: Annotated[tuple[Annotated[float, Meta(gt=0, le=1000)], ...], SIX] = (60, 60, 60, 60, 60, 60)
    """How fast each joint turns at a speed of 100 %, degrees/s."""
    joint_signs: Annotated[tuple[Literal[1, -1], ...], SIX] = (1, 1, 1, 1, 1, 1)
    """1 or -1: whether LinuxCNC counts a joint as facetd does."""
    joint_zeros_deg: Annotated[tuple[Annotated[float, Meta(ge=-720, le=720)], ...], SIX] = (0, 0, 0, 0, 0, 0)
    """What facetd counts where LinuxCNC's joint is at 0, degrees."""
    close_outputs: Outputs = (1,)
    """Digital outputs that close the gripper: n is M64 P(n - 1), -n M65 P(n - 1)."""
    open_outputs: Outputs = (-1,)
    """Those that open it."""


class LinuxcncArm:
    """Robot (daemon/arm/robot.py) on one connection: LinuxCNC accepts commands from one at a time."""

    controller = None
    aside = False

    def __init__(
        self,
        settings: LinuxcncSettings,
        geometry: puma560.ArmGeometry,
        on_wire: WireListener,
        clock: Callable[[], float],
        beliefs: Beliefs,
    ) -> None:
        self.heard_s: float | None = None
        ledger = Ledger(on_wire)

        def on_line(line: str, sent: bool) -> None:
            if sent:
                ledger.sent(line.encode("latin-1", "replace"), clock())
                return
            self.heard_s = heard_s = clock()
            self.permission.heard += 1
            ledger.heard("answer", line.encode("latin-1", "replace"), heard_s)

        self._settings, self._clock = settings, clock
        self._shell = RemoteShell(settings.host, settings.port, on_line)
        self._signs, self._zeros_deg = np.array(settings.joint_signs), np.array(settings.joint_zeros_deg)
        self._stops = self._times_tested = 0
        self.kinematics = PumaArm(geometry)
        self.permission, self.beliefs = MotionPermission(), beliefs
        self.stopped_on_opening = False

    # The line.

    @property
    def connected(self) -> bool:
        return self._shell.connected

    async def open(self) -> None:
        """Connect, and stop the arm if it moves. Raises CellError."""
        self.beliefs.void(VoidingEvent.RECONNECTED)
        self._unsee_the_stop()
        self.stopped_on_opening = False
        with self._as_cell_errors():
            await self._shell.open("facetd", self._settings.password)
            if await self._still() is None:
                self.stopped_on_opening = True
                await self._halt()
            await self._take_over()

    async def close(self) -> None:
        self._unsee_the_stop()
        await self._shell.close()

    async def check(self) -> None:
        await self.where()

    def _unsee_the_stop(self) -> None:
        self.permission.stop_tests, self.permission.stop_took_s = 0, 0.0

    @contextmanager
    def _as_cell_errors(self) -> Iterator[None]:
        try:
            yield
        except ShellError as error:
            self._unsee_the_stop()
            raise CellError(str(error)) from error

    async def _take_over(self) -> None:
        """Switch LinuxCNC to MDI mode. Raises CellError, with what to do, where it would run no block."""
        await self._must_be_ready()
        await self._shell.tell("mode mdi")

    async def _must_be_ready(self) -> None:
        """Raise CellError, with what to do, where LinuxCNC would run no block."""
        for name, wanted, remedy in (
            ("enable", ["ON"], "another connection took its remote shell over: end that one, or let it be"),
            ("estop", ["OFF"], "release the emergency stop at its screen"),
            ("machine", ["ON"], "switch the machine on at its screen"),
            ("joint_homed", ["YES"] * 6, "home all six joints at its screen"),
        ):
            if (await self._shell.ask(name))[:6] != wanted:
                self._unsee_the_stop()
                raise CellError(f"{self._shell.where}: {remedy}, then `enable`")

    async def _must_be_ours(self) -> None:
        """Raise CellError where a person uses LinuxCNC at its own screen; set the feed override to 100 %."""
        await self._must_be_ready()
        if (mode := await self._shell.ask("mode")) != ["MDI"]:
            self._unsee_the_stop()
            self.beliefs.void(VoidingEvent.OTHERS_TYPED)
            raise CellError(
                f"{self._shell.where}: somebody uses it at its own screen (mode {' '.join(mode)}); then `enable`"
            )
        if await self._shell.ask("feed_override") != ["100"]:
            await self._shell.tell("feed_override 100")
        await self._errors()

    # Where it is.

    async def where(self) -> Reading:
        with self._as_cell_errors():
            return self._reading(await self._joints_deg())

    async def wait_until_at_rest(self) -> Reading:
        with self._as_cell_errors():
            return await self._at_rest_within(REST_S)

    async def at_rest(self) -> bool:
        with self._as_cell_errors():
            return await self._still() is not None

    async def _still(self) -> Reading | None:
        """The reading of an arm at rest; None while it moves."""
        before = await self._joints_deg()
        await asyncio.sleep(AGAIN_S)
        idle = await self._shell.ask("program_status") == ["IDLE"]
        now = await self._joints_deg()
        return self._reading(now) if idle and np.abs(now - before).max() <= SAME_DEG else None

    async def _at_rest_within(self, seconds: float) -> Reading:
        until_s = self._clock() + seconds
        while (reading := await self._still()) is None:
            if self._clock() > until_s:
                raise CellError(f"{self._shell.where}: the arm still moves after {seconds:.0f} s")
        return reading

    async def _joints_deg(self) -> Array:
        words = await self._shell.ask("joint_pos")
        try:
            return np.array([float(word) for word in words[:6]]).reshape(6)
        except ValueError as error:
            raise ShellError(f"{self._shell.where}: joint_pos was answered by {' '.join(words)!r}") from error

    def _reading(self, linuxcnc_deg: Array) -> Reading:
        joints = np.radians(linuxcnc_deg * self._signs + self._zeros_deg)
        return Reading(puma560.forward(joints, self.kinematics.geometry), joints)

    # What moves.

    async def move(
        self, command: MoveCommand, starts: Callable[[Reading], None], timeout_s: float, then: MoveCommand | None = None
    ) -> Reading:
        stops = self._stops
        with self._as_cell_errors():
            await self._must_be_ours()
            here = await self._at_rest_within(0.0)
            starts(here)
            joints = self._on_the_way(here, command)
            turns_deg = np.degrees(np.abs(np.diff(joints, axis=0)))
            times_s = (turns_deg / self._settings.full_speed_deg_s).max(axis=1) / (command.speed_pct / 100.0)
            for k, (target, time_s) in enumerate(zip(joints[1:], times_s, strict=True)):
                if time_s > 0:
                    await self._block(target, time_s, partial(self._may_go_on, stops, begun=k > 0))
            there = await self._at_rest_within(timeout_s)
            if errors := await self._errors():
                raise CellError(f"{self._shell.where} says: {errors}")
        return there

    def _on_the_way(self, here: Reading, command: MoveCommand) -> Array:
        """(N, 6) rad, from here to the target. Raises CellError where the arm cannot reach it."""
        if not command.straight:
            end = self.kinematics.reachable(command.world_from_tool, here.joints_rad)
            joints = np.full((2, 6), np.nan) if end is None else np.stack([here.joints_rad, end])
        else:
            motion = frames.difference(command.world_from_tool, here.world_from_tool)
            mm, rad = frames.size(motion)
            shares = np.linspace(0.0, 1.0, ceil(max(1.0, mm / STEP_MM, rad / STEP_RAD)) + 1)
            poses = np.stack([frames.perturb(here.world_from_tool, share * motion) for share in shares])
            joints = self.kinematics.along(poses, here.joints_rad)
            joints[0] = here.joints_rad
        if not np.isfinite(joints).all():
            raise CellError("the arm cannot reach it in its present configuration; nothing was sent")
        return joints

    async def _block(self, joints_rad: Array, time_s: float, may: Callable[[], None]) -> None:
        linuxcnc_deg = (np.degrees(joints_rad) - self._zeros_deg) * self._signs
        words = " ".join(f"{letter}{value:.5f}" for letter, value in zip(LETTERS, linuxcnc_deg, strict=True))
        modes = f"G21 G90 G93 G64 P{BLEND_DEG} G53"
        await self._shell.tell(f"mdi {modes} G1 {words} F{60.0 / time_s:.5f}", may)

    def _may_go_on(self, stops: int, begun: bool) -> None:
        """Called before a block is sent. Raises HeldBackError before the first, CellError before a later one of a move
        that was stopped."""
        if self._stops != stops or self.permission.blocked:
            raise CellError("the move was stopped")
        if not begun and self.permission.withheld:
            raise HeldBackError("held back before it was sent")

    async def _errors(self) -> str:
        """LinuxCNC's error messages since the last call; empty without any."""
        messages: list[str] = []
        while (words := await self._shell.ask("error")) != ["OK"]:
            messages.append(" ".join(words))
        return "; ".join(messages)

    async def set_gripper(self, closed: bool) -> None:
        await self.work_valves(self._settings.close_outputs if closed else self._settings.open_outputs)

    async def work_valves(self, numbers: Sequence[int]) -> None:
        await self._switch(numbers, partial(self._may_go_on, self._stops, begun=False))

    async def set_outputs(self, numbers: Sequence[int]) -> None:
        await self._switch(numbers, lambda: None)

    async def _switch(self, numbers: Sequence[int], may: Callable[[], None]) -> None:
        with self._as_cell_errors():
            await self._must_be_ours()
            for number in numbers:
                await self._shell.tell(f"mdi M{64 if number > 0 else 65} P{abs(number) - 1}", may)
            if errors := await self._errors():
                raise CellError(f"{self._shell.where} says: {errors}")

    async def ask_input(self, text: str) -> NoReturn:
        raise CellError("LinuxCNC's remote shell reads no inputs")

    # The stop.

    async def stop_motion(self) -> None:
        self.beliefs.void(VoidingEvent.STOPPED)
        with self._as_cell_errors():
            await self._halt()

    async def test_stop(self) -> None:
        began_s = self._clock()
        await self.stop_motion()
        self.permission.stop_took_s = self._clock() - began_s
        with self._as_cell_errors():
            await self._take_over()
        self._times_tested += 1
        self.permission.stop_tests = self._times_tested

    async def _halt(self) -> None:
        """Send the stop right after the line that is being sent, within a tenth of a second, then wait for rest. Raises
        StopRefusedError, ShellError, CellError."""
        self._stops += 1
        for tries in range(ABORTS):
            try:
                await self._shell.tell("abort")
                break
            except ShellError as error:  # a busy task acknowledges late, and that reads as a refusal
                if self._shell.connected and await self._shell.ask("machine") != ["ON"]:
                    break  # its drives are off: there is nothing to abort, and that is refused
                if tries + 1 == ABORTS or not self._shell.connected:
                    self._unsee_the_stop()
                    raise StopRefusedError(str(error)) from error
        self.permission.stop_answered += 1
        await self._at_rest_within(REST_S)

    def use_tool(self, flange_from_tool: Array) -> None:
        self.kinematics = PumaArm(replace(self.kinematics.geometry, flange_from_tool=flange_from_tool))
        self.beliefs.void(VoidingEvent.GRIPPER_CHANGED)
