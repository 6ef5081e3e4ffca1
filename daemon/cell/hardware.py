"""The devices of a cell, opened and closed as one, and their errors."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

from daemon.arm import Robot
from daemon.cell.cameras import ThreadedCameras
from daemon.cell.no_arm import CellError
from daemon.cell.simulated_operator import SimulatedOperator
from drivers.camera.pair import CameraError
from drivers.val2.errors import LinkError, NoAnswer

EXPECTED_ERRORS: tuple[type[Exception], ...] = (CellError, CameraError, LinkError)
"""Errors of cameras and arm that are not faults of the program."""


@dataclass(eq=False)
class Hardware:
    """Cameras and arm of a cell. kind: the name of its back-end; where: what it is reached by, for people; operator:
    the simulated person of a simulated cell, None in a real one."""

    kind: str
    robot: Robot
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


def _advice(error: Exception, where: str) -> str:
    """A device's error on one line, with what to do."""
    text = " ".join(str(error).split())
    if isinstance(error, LinkError) and where not in text:
        text = f"{where}: {text}"
    if type(error) is NoAnswer:
        text += "; is the controller switched on, the cable in its terminal port, and arm.dialect.baud right?"
    return text
