"""Build the hardware of a cell from its configuration; open and close it as one."""

import asyncio
import contextlib
import random
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from daemon.arm import Beliefs
from daemon.cell.arm_on_link import ArmOnLink, WireListener, arm_on_link
from daemon.cell.cameras import RepeatedPairs, StereoCamera, ThreadedCameras
from daemon.cell.no_arm import CellError, NoArm
from daemon.cell.sections import alone, arm_geometry, camera_settings, dialect, truth
from daemon.cell.simulated_operator import SimulatedOperator
from daemon.config import Config, kind_of
from drivers.camera.pair import CameraError
from drivers.camera.recorded import RecordedCamera
from drivers.camera.stereo import V4L2StereoCamera
from drivers.val2.errors import LinkError, NoAnswer

EXPECTED_ERRORS: tuple[type[Exception], ...] = (CellError, CameraError, LinkError)
"""Errors of cameras and arm that are not faults of the program."""


def _unrecorded(kind: str, /, **fields: object) -> None:
    """Record nothing: there is no run."""


@dataclass(eq=False)
class Hardware:
    """Cameras and arm of a cell. operator: the simulated person of a simulated cell, None in a real one."""

    kind: str
    robot: ArmOnLink | NoArm
    cameras: ThreadedCameras
    clock: Callable[[], float]
    where: str
    seed: int | None = None
    operator: SimulatedOperator | None = None

    async def open(self) -> None:
        """Open arm and cameras, both or neither. Raises CellError."""
        results = await asyncio.gather(self.cameras.open(), self.robot.open(), return_exceptions=True)
        failed = [result for result in results if isinstance(result, BaseException)]
        if failed:
            await self.close()
            for error in failed:
                if not isinstance(error, EXPECTED_ERRORS):
                    raise error
            advice = "; ".join(_advice(error, self.where) for error in failed if isinstance(error, Exception))
            raise CellError(advice) from failed[0]

    async def close(self) -> None:
        """Close everything; safe to call twice."""
        await asyncio.gather(self.cameras.close(), self.robot.close(), return_exceptions=True)
        if self.operator is not None:
            await asyncio.to_thread(self.operator.cell.stop)


def build(
    config: Config,
    on_wire: WireListener,
    clock: Callable[[], float] = time.monotonic,
    record: Callable[..., None] = _unrecorded,
) -> Hardware:
    """The hardware as configured, not yet opened (a simulated cell already runs). record: the run log's function, for
    beliefs about arm and gripper. Raises ConfigError, CellError."""
    beliefs = Beliefs(clock, record)
    if config.kind == "simulated":
        return _simulated(config, on_wire, clock, beliefs)
    if config.kind == "recorded":
        folder = config.file(config.values.recorded.pairs)
        cameras = ThreadedCameras(RepeatedPairs(folder, again=True, clock=clock), clock)
        return Hardware("recorded", NoArm(beliefs), cameras, clock, str(folder))
    cameras = ThreadedCameras(V4L2StereoCamera(camera_settings(config), clock), clock, alone(config))
    port = config.values.arm.port
    robot = arm_on_link(port, dialect(config), arm_geometry(config), on_wire, clock, beliefs)
    return Hardware("real", robot, cameras, clock, port)


@contextlib.contextmanager
def cameras_alone(config: Config) -> Iterator[StereoCamera]:
    """Context: the configured cameras, open, without the arm. Raises ConfigError, CameraError.

    Recorded cameras return the next pair at each grab; simulated cameras see one part.
    """
    hardware = build(config, lambda _: None)
    if config.kind == "recorded":
        hardware.cameras.camera = RecordedCamera(config.file(config.values.recorded.pairs), again=True)
    if hardware.operator is not None:
        hardware.operator.show(hardware.operator.labels[0], 0)
    try:
        hardware.cameras.camera.open()
        yield hardware.cameras.camera
    finally:
        asyncio.run(hardware.close())


def _simulated(config: Config, on_wire: WireListener, clock: Callable[[], float], beliefs: Beliefs) -> Hardware:
    from drivers.simcell.boards import BoardPrint
    from drivers.simcell.cell import SimulatedCell
    from drivers.simcell.stand import VIEWS

    simulated = config.values.simulated
    seed = simulated.seed if simulated.seed is not None else random.SystemRandom().randrange(1_000_000)
    verdict = None if simulated.verdict is None else config.file(simulated.verdict)
    truth_file = truth(config)
    cell = SimulatedCell(
        truth_file, seed, simulated.time_scale, table=simulated.table, parts=simulated.parts, verdict=verdict
    )
    line_dialect = dialect(config).on_a_faster_line(simulated.time_scale)
    robot = arm_on_link(cell.port, line_dialect, arm_geometry(config), on_wire, clock, beliefs)
    operator = SimulatedOperator(cell, {label: len(views) for label, views in VIEWS.items()}, BoardPrint)
    operator.mount(kind_of(config.values.pick.gripper))
    cell.camera.use(alone(config))
    return Hardware(
        "simulated", robot, ThreadedCameras(cell.camera, clock, alone(config)), clock, cell.port, seed, operator
    )


def _advice(error: Exception, where: str) -> str:
    """A device's error on one line, with what to do."""
    text = " ".join(str(error).split())
    if isinstance(error, LinkError) and where not in text:
        text = f"{where}: {text}"
    if type(error) is NoAnswer:
        text += "; is the controller switched on, the cable in its terminal port, and arm.dialect.baud right?"
    return text
