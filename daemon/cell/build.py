"""Configuration -> a cell's hardware: opened and closed as one, its errors one line that says what to do."""

from __future__ import annotations

import asyncio
import contextlib
import random
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from daemon.arm import Beliefs
from daemon.cell.arm_on_link import ArmOnLink, WireListener, arm_on_link
from daemon.cell.cameras import HeldPairs, StereoCamera, ThreadedEyes
from daemon.cell.no_arm import CellError, NoArm
from daemon.cell.sections import alone, arm_geometry, camera_settings, dialect, truth
from daemon.cell.simulated_hand import SimulatedHand
from daemon.config import Config
from drivers.camera.pair import CameraError
from drivers.camera.recorded import RecordedCamera
from drivers.camera.stereo import V4L2StereoCamera
from drivers.val2.errors import LinkError, NoAnswer

EXPECTED_ERRORS: tuple[type[Exception], ...] = (CellError, CameraError, LinkError)
"""What cameras and arm raise when the world, and not the program, is at fault."""


def _unrecorded(kind: str, /, **fields: object) -> None:
    """Where no run is kept."""


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


def build(
    config: Config,
    on_wire: WireListener,
    clock: Callable[[], float] = time.monotonic,
    record: Callable[..., None] = _unrecorded,
) -> Hardware:
    """The hardware as configured, not yet opened (a simulated cell runs already). record: the run log's, for what is no
    longer believed of the gripper. Raises ConfigError, CellError."""
    beliefs = Beliefs(clock, record)
    if config.kind == "simulated":
        return _simulated(config, on_wire, clock, beliefs)
    if config.kind == "recorded":
        folder = config.file(config.values.recorded.pairs)
        eyes = ThreadedEyes(HeldPairs(folder, again=True, clock=clock), clock)
        return Hardware("recorded", NoArm(beliefs), eyes, clock, str(folder))
    eyes = ThreadedEyes(V4L2StereoCamera(camera_settings(config), clock), clock, alone(config))
    port = config.values.arm.port
    robot = arm_on_link(port, dialect(config), arm_geometry(config), on_wire, clock, beliefs)
    return Hardware("real", robot, eyes, clock, port)


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


def _simulated(config: Config, on_wire: WireListener, clock: Callable[[], float], beliefs: Beliefs) -> Hardware:
    from drivers.simcell.boards import BoardPrint
    from drivers.simcell.cell import SimulatedCell
    from drivers.simcell.stand import VIEWS

    simulated = config.values.simulated
    seed = simulated.seed if simulated.seed is not None else random.SystemRandom().randrange(1_000_000)
    verdict = None if simulated.verdict is None else config.file(simulated.verdict)
    here = truth(config)
    cell = SimulatedCell(
        here, seed, simulated.time_scale, table=simulated.table, parts=simulated.parts, verdict=verdict
    )
    manners = dialect(config).on_a_faster_line(simulated.time_scale)
    robot = arm_on_link(cell.port, manners, arm_geometry(config), on_wire, clock, beliefs)
    hand = SimulatedHand(cell, {label: len(views) for label, views in VIEWS.items()}, BoardPrint)
    cell.camera.use(alone(config))
    return Hardware("simulated", robot, ThreadedEyes(cell.camera, clock, alone(config)), clock, cell.port, seed, hand)


def _advice(error: Exception, where: str) -> str:
    """What a device's error means for the one who must act, on one line."""
    text = " ".join(str(error).split())
    if isinstance(error, LinkError) and where not in text:
        text = f"{where}: {text}"
    if type(error) is NoAnswer:
        text += "; is the controller switched on, the cable in its terminal port, and arm.dialect.baud right?"
    return text
