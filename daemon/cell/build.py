"""Configuration -> cameras and arm: real, recorded or simulated. The only module that names drivers.

In: Config. Out: a Hardware that the cycle's Workcell protocols fit, and its errors as CellError, each
one line that says what, where and what to do. When to look or move is decided elsewhere.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
import time
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.arm.workcell import Reading
from daemon.cell.no_arm import CellError, NoArm
from daemon.cell.simulated_hand import SimulatedHand
from daemon.config import Config
from daemon.store.bounds import check_dialect
from drivers import puma560
from drivers.camera.pair import CameraError, Frame, StereoPair
from drivers.camera.pair import StereoCamera as StereoCamera
from drivers.camera.recorded import RecordedCamera
from drivers.camera.report import device_rows as device_rows
from drivers.camera.report import eye_rows as eye_rows
from drivers.camera.settings import CameraSettings
from drivers.camera.stereo import V4L2StereoCamera
from drivers.val2.commands import moves_the_arm as moves_the_arm
from drivers.val2.dialect import Dialect
from drivers.val2.errors import Elsewhere, LinkError, Preempted
from drivers.val2.link import Link
from drivers.val2.location import apart, location_from_matrix, matrix_from_location
from drivers.val2.wire import Where

Array = NDArray[np.float64]
WireListener = Callable[[dict[str, Any]], None]
Clock = Callable[[], float]


NEAR_SINGULAR_RAD = float(np.radians(3.0))
"""A wrist this near to straight is kept out of: joints 4 and 6 would turn far for little."""

EXPECTED_ERRORS: tuple[type[Exception], ...] = (CellError, CameraError, LinkError)
"""What cameras and arm raise when the world, and not the program, is at fault."""


class ThreadedEyes:
    """A stereo camera whose blocking calls run in a thread of their own; one caller after the other."""

    def __init__(self, camera: StereoCamera, clock: Callable[[], float] = time.monotonic) -> None:
        self.camera = camera
        self.heard_s: float | None = None
        """When the last pair was delivered, on the cell's clock."""
        self._clock = clock
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="cameras")

    async def open(self) -> None:
        """Claim the cameras. Raises CameraError."""
        await self._call(self.camera.open)

    async def grab(self, not_before_s: float, timeout_s: float) -> StereoPair:
        """The newest pair exposed wholly after not_before_s. Raises CameraError."""
        pair: StereoPair = await self._call(lambda: self.camera.grab(not_before_s, timeout_s))
        self.heard_s = self._clock()
        return pair

    def step(self) -> bool:
        """Recorded pairs: show the next one. False where the cameras are not recorded."""
        if isinstance(self.camera, HeldPairs):
            self.camera.step()
            return True
        return False

    async def close(self) -> None:
        """Release the cameras; safe to call twice."""
        with contextlib.suppress(RuntimeError, TimeoutError, CameraError):
            await asyncio.wait_for(self._call(self.camera.close), 1.0)
        self._thread.shutdown(wait=False, cancel_futures=True)

    def describe(self) -> str:
        """One line for people."""
        return self.camera.describe()

    async def _call(self, job: Callable[[], Any]) -> Any:
        return await asyncio.get_running_loop().run_in_executor(self._thread, job)


class HeldPairs(RecordedCamera):
    """Recorded pairs that hold still: each pair is shown, as if taken now, until the next one is asked for."""

    _shown: StereoPair | None = None
    _shows = 0

    def grab(self, not_before_s: float, timeout_s: float) -> StereoPair:
        """The pair that is shown. Raises CameraError."""
        pair = self._shown = self._shown or super().grab(not_before_s, timeout_s)
        now_s = max(time.monotonic(), not_before_s)
        return StereoPair(self._live(pair.left, now_s), self._live(pair.right, now_s))

    def _live(self, frame: Frame, now_s: float) -> Frame:
        """The frame as of now. A corner pixel flickers by two grey levels, as otherwise the camera looks frozen."""
        self._shows += 1
        pixels = frame.pixels.copy()
        pixels[0, 0] ^= self._shows & 2
        return Frame(pixels, now_s, frame.sequence + self._shows)

    def step(self) -> None:
        """Go on to the next pair; after the last one the first comes again."""
        self._shown = None


class ArmOnLink:
    """daemon/arm/workcell.py's Robot over VAL II, and what only an operator does: power-up, CAL, the monitor."""

    def __init__(self, link: Link, arm: puma560.Puma560) -> None:
        self.link = link
        self.heard_s: float | None = None
        """When the controller last answered, on the cell's clock."""
        self.aside = False
        """Somebody talks to the controller; nobody else is to ask it anything."""
        self._arm = arm
        self._speed_pct: float | None = None
        self._introduced = False
        self._o_deg = 0.0

    async def open(self) -> None:
        """Claim the port and find the controller's prompt. Raises LinkError."""
        await self.link.open()
        await self._introduce_tool()
        self._heard()

    async def close(self) -> None:
        """Let go of the port; does not stop the arm."""
        await self.link.close()

    async def where(self) -> Reading:
        """Ask the controller where the arm is; after a stop, remind it of our tool first (it may have been off)."""
        if not self._introduced:
            await self._introduce_tool()
        return self._reading(await self.link.where())

    async def check(self) -> None:
        """Does the controller answer? Raises LinkError where it does not; being stopped meanwhile is an answer."""
        with contextlib.suppress(Preempted):
            await self.where()

    async def move(self, world_from_tool: Array, *, straight: bool, speed_pct: float, timeout_s: float) -> Reading:
        """One move; returns when the arm is at rest, there or elsewhere. Raises LinkError."""
        location = location_from_matrix(world_from_tool, self._o_deg)
        if speed_pct != self._speed_pct:
            self._speed_pct = None
            await self.link.speed(speed_pct)
            self._speed_pct = speed_pct
        await (self.link.move_straight if straight else self.link.move)(location, timeout_s)
        try:
            return self._reading(await self.link.rest(location, timeout_s))
        except Elsewhere as elsewhere:
            if elsewhere.where is None:
                raise
            return self._reading(elsewhere.where)

    async def hand(self, closed: bool) -> None:
        """CLOSEI or OPENI."""
        await (self.link.close_hand if closed else self.link.open_hand)()
        self._heard()

    async def abort(self) -> None:
        """Stop the arm now. Raises LinkError when the controller does not confirm it."""
        self._speed_pct, self._introduced = None, False
        await self.link.abort()
        self._heard()

    def reachable(self, world_from_tool: Array, joints_rad: Array) -> Array | None:
        """Joints (6,) rad that reach the pose as the arm is configured now, clear of a singular wrist, or None."""
        configuration = puma560.configuration_of(joints_rad)
        try:
            joints = puma560.inverse(world_from_tool, configuration, self._arm, joints_rad)
        except puma560.UnreachableError:
            return None
        return None if puma560.wrist_is_singular(joints, within_rad=NEAR_SINGULAR_RAD) else joints

    def between(self, joints_rad: Array, to_rad: Array, share: float) -> Array:
        """Where the tool is a share of the way of a joint-interpolated move."""
        return puma560.forward(joints_rad + share * (to_rad - joints_rad), self._arm)

    def frames(self, joints_rad: Array) -> Array:
        """Where base, links and tool are, (N, 8, 4, 4)."""
        return puma560.link_frames(joints_rad, self._arm)

    def along(self, world_from_tool: Array, joints_rad: Array) -> Array:
        """Joints (N, 6) along a straight way, nan where it leaves reach or comes near a singular wrist."""
        joints = puma560.inverse_along(world_from_tool, joints_rad, self._arm)
        joints[np.abs(np.sin(joints[:, 4])) < np.sin(NEAR_SINGULAR_RAD)] = np.nan
        return joints

    @property
    def stopped_on_opening(self) -> bool:
        """Whether the arm was found at work when the port was opened last, and was stopped."""
        return self.link.stopped_on_opening

    @property
    def question(self) -> str | None:
        """What the controller asks since it was switched on, or None."""
        return self.link.question

    async def power_up(self, replies: Sequence[str]) -> list[str]:
        """Answer what the controller asks after it was switched on; gives what it said."""
        answer = await self.link.power_up(tuple(replies))
        self._speed_pct, self._introduced = None, False
        await self._introduce_tool()
        return _said(answer)

    async def calibrate(self, reply: str) -> list[str]:
        """CAL: the arm finds its zero (it moves a little)."""
        return _said(await self.link.calibrate(reply))

    async def monitor(self, text: str) -> list[str]:
        """Any command, as typed at the controller's own terminal; gives what it said."""
        return _said(await self.link.command(text))

    @contextlib.asynccontextmanager
    async def terminal(self, show: Callable[[bytes], None]) -> AsyncIterator[Callable[[bytes], None]]:
        """The controller's own terminal for a person: what it says goes to show, what they type to the function given.

        Afterwards its TOOL and SPEED are ours again, whatever was typed. abort() still works, and ends it.
        """
        self.aside = True
        try:
            async with self.link.terminal(show) as send:
                yield send
            self._speed_pct = None
            await self._introduce_tool()
        finally:
            self.aside = False

    async def _introduce_tool(self) -> None:
        """Tell the controller of our tool: switched on, it knows none, and would bring the bare wrist to each place."""
        if self.link.question is None:
            await self.link.tool(location_from_matrix(self._arm.flange_from_tool))
            self._introduced = True

    def _reading(self, where: Any) -> Reading:
        self._heard()
        self._o_deg = where.location.o_deg
        return Reading(matrix_from_location(where.location), np.radians(where.joints_deg))

    def _heard(self) -> None:
        self.heard_s = self.link.clock()


@dataclass(eq=False)
class Hardware:
    """What a cell is made of. hand: the person's in a simulated cell, None in a real one."""

    kind: str
    robot: ArmOnLink | NoArm
    eyes: ThreadedEyes
    clock: Callable[[], float]
    where: str
    seed: int | None = None
    hand: SimulatedHand | None = None

    async def open(self) -> None:
        """Claim arm and cameras, both or neither. Raises CellError."""
        results = await asyncio.gather(self.eyes.open(), self.robot.open(), return_exceptions=True)
        failed = [result for result in results if isinstance(result, BaseException)]
        if failed:
            await self.close()
            for error in failed:
                if not isinstance(error, EXPECTED_ERRORS):
                    raise error
            told = "; ".join(_advice(error, self.where) for error in failed if isinstance(error, Exception))
            raise CellError(told) from failed[0]

    async def close(self) -> None:
        """Let go of everything; safe to call twice."""
        await asyncio.gather(self.eyes.close(), self.robot.close(), return_exceptions=True)
        if self.hand is not None:
            await asyncio.to_thread(self.hand.cell.stop)


def build(config: Config, on_wire: WireListener, clock: Callable[[], float] = time.monotonic) -> Hardware:
    """The hardware as configured, not yet opened (a simulated cell runs already). Raises ConfigError, CellError."""
    if config.kind == "simulated":
        return _simulated(config, on_wire, clock)
    if config.kind == "recorded":
        folder = config.file(config.values.recorded.pairs)
        eyes = ThreadedEyes(HeldPairs(folder, again=True, clock=clock), clock)
        return Hardware("recorded", NoArm(), eyes, clock, str(folder))
    eyes = ThreadedEyes(V4L2StereoCamera(camera_settings(config), clock), clock)
    port = config.values.arm.port
    return Hardware("real", _arm(config, dialect(config), port, on_wire, clock), eyes, clock, port)


@contextlib.contextmanager
def cameras_alone(config: Config) -> Iterator[StereoCamera]:
    """The cameras as configured, opened, without the arm. Raises ConfigError, CameraError.

    Recorded pairs go by, one a grab; before simulated cameras a part is held.
    """
    hardware = build(config, lambda _: None)
    if config.kind == "recorded":
        hardware.eyes.camera = RecordedCamera(config.file(config.values.recorded.pairs), again=True)
    if hardware.hand is not None:
        hardware.hand.show(hardware.hand.labels[0], 0)
    try:
        hardware.eyes.camera.open()
        yield hardware.eyes.camera
    finally:
        asyncio.run(hardware.close())


def check(config: Config) -> None:
    """Type the drivers' own sections without touching a device. Raises ConfigError."""
    dialect(config)
    arm_geometry(config)
    if config.kind == "real":
        camera_settings(config)
    if config.kind == "simulated":
        _truth(config)


def camera_settings(config: Config) -> CameraSettings:
    """The section `cameras`. Raises ConfigError."""
    try:
        return config.document.section(("cameras",), CameraSettings)
    except CameraError as error:
        raise config.document.error(("cameras",), str(error)) from None


def dialect(config: Config) -> Dialect:
    """The section `arm.dialect`; control characters are written as in "\\r". Raises ConfigError."""
    said = config.values.arm.dialect
    typed = {
        k: v.encode("latin-1") if k in ("line_end", "cancel_line") and isinstance(v, str) else v
        for k, v in said.items()
    }
    document = replace(config.document, data={"arm": {"dialect": typed}})
    found = document.section(("arm", "dialect"), Dialect)
    check_dialect(config.document, found)
    return found


def arm_geometry(config: Config) -> puma560.Puma560:
    """The arm with its tool: arm.flange_from_tool, (4, 4) mm. Raises ConfigError."""
    matrix = np.array(config.values.arm.flange_from_tool, float)
    if not np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-4) or not np.allclose(
        matrix[3], [0, 0, 0, 1]
    ):
        raise config.document.error(("arm", "flange_from_tool"), "expected a rotation, mm, and a last row [0, 0, 0, 1]")
    return puma560.Puma560(flange_from_tool=matrix)


def _arm(config: Config, manners: Dialect, port: str, on_wire: WireListener, clock: Clock) -> ArmOnLink:
    arm = arm_geometry(config)
    link = Link(port, manners, clock=clock, on_wire=on_wire, belongs_together=partial(_belongs_together, arm))
    return ArmOnLink(link, arm)


def _belongs_together(arm: puma560.Puma560, where: Where) -> bool:
    """Whether a WHERE's joints put our tool at its place, to more than its digits and less than any spoiled one."""
    place = location_from_matrix(puma560.forward(np.radians(where.joints_deg), arm))
    off_mm, off_deg = apart(place, where.location)
    return off_mm < 0.5 and off_deg < 0.2


def _truth(config: Config) -> Path:
    """The simulated cell's file, once it was read without complaint. Raises ConfigError."""
    from drivers.simcell.truth import TruthError, load_truth

    path = config.file(config.values.simulated.truth)
    try:
        load_truth(path)
    except TruthError as error:
        raise config.document.error(("simulated", "truth"), " ".join(str(error).split())) from None
    return path


def _simulated(config: Config, on_wire: WireListener, clock: Callable[[], float]) -> Hardware:
    from drivers.simcell.boards import BoardPrint
    from drivers.simcell.cell import SimulatedCell
    from drivers.simcell.stand import VIEWS

    said = config.values.simulated
    seed = said.seed if said.seed is not None else random.SystemRandom().randrange(1_000_000)
    cell = SimulatedCell(_truth(config), seed, said.time_scale)
    eyes = ThreadedEyes(cell.camera, clock)
    robot = _arm(config, dialect(config).on_a_faster_line(said.time_scale), cell.port, on_wire, clock)
    return Hardware(
        "simulated",
        robot,
        eyes,
        clock,
        cell.port,
        seed,
        SimulatedHand(cell, {k: len(v) for k, v in VIEWS.items()}, BoardPrint),
    )


def _said(answer: Any) -> list[str]:
    lines: list[str] = list(answer.lines)
    return lines


def _advice(error: Exception, where: str) -> str:
    """What a device's error means for the one who must act, on one line."""
    text = " ".join(str(error).split())
    if isinstance(error, LinkError) and where not in text:
        text = f"{where}: {text}"
    if type(error).__name__ == "NoAnswer":
        text += "; is the controller switched on, the cable in its terminal port, and arm.dialect.baud right?"
    return text
