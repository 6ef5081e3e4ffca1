"""The simulated cell in simulated time, with the daemon's own parts and commands on top: hours of it in minutes.

Simulated time is that of arm and cameras; computing takes none of it.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Any

from daemon.arm import CameraName
from daemon.arm.belief import Beliefs
from daemon.calibration.file import load_calibration
from daemon.cell.cameras import ThreadedCameras
from daemon.cell.hardware import Hardware
from daemon.cell.pick_cell import pick_cell
from daemon.cell.sections import arm_geometry, dialect, truth
from daemon.cell.val2_arm import Val2Arm
from daemon.config import load_config
from daemon.console.context import CommandContext
from daemon.maintenance.troubles import Troubles
from daemon.pick.cycle import PickCycle
from daemon.pick.recogniser import ModelRecogniser
from daemon.store.library import load_facets
from daemon.vision.model.model import Model, empty_model
from drivers.simcell.cell import SimulatedCell
from drivers.val2.link import Link
from tests.fakes.computing import ComputesHere
from tests.fakes.memory_line import MemoryLine
from tests.fakes.simulated_cell import CONFIG, ListLog, Rig, tell_the_motion_monitor
from tests.fakes.simulated_time import SimulatedLoop


@dataclass(eq=False)
class Hours(Rig):
    """The cell, the cycle, and what commands work with."""

    context: CommandContext

    @property
    def now_s(self) -> float:
        """The cell's time."""
        return asyncio.get_running_loop().time()


@contextlib.asynccontextmanager
async def cell_in_time(seed: int, model: Model | None = None, alone: CameraName | None = None) -> AsyncIterator[Hours]:
    """Build, open, enable, on the running SimulatedLoop; close at the end. The motion monitor must find nothing."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, SimulatedLoop)
    config = load_config(CONFIG, simulated=True)
    calibration = load_calibration(config.calibration)
    cell, log = SimulatedCell(truth(config), seed, loop=loop), ListLog()
    geometry: Any = arm_geometry(config)
    assert isinstance(cell.server, MemoryLine)
    link = Link("memory", dialect(config), loop.time, log.wire.append, cell.server.open)
    cell.camera.use(alone)
    cameras = ThreadedCameras(cell.camera, loop.time, alone)
    robot = Val2Arm(link, geometry, Beliefs(loop.time, log.record))
    hardware = Hardware("simulated", robot, cameras, loop.time, "memory", seed)
    try:
        await hardware.open()
        start = model or empty_model(load_facets(config.file(config.values.files.facets)))
        sight = ModelRecogniser(start, calibration.rig, config.values.vision)
        cycle = PickCycle(*pick_cell(config, calibration, hardware, log, asyncio.to_thread), sight)
        tell_the_motion_monitor(cell, cycle, log)
        await cycle.supervisor.test_stop()
        cycle.supervisor.enable()
        trainer: Any = None
        context = CommandContext(
            config,
            calibration,
            hardware,
            cycle,
            trainer,
            trainer,
            log,
            Troubles(),
            trainer,
            ComputesHere(),
            ComputesHere(),
            started_s=0.0,
        )
        try:
            yield Hours(cell, cycle, log, hardware.robot, context)
        finally:
            await cycle.supervisor.close()
        found = cell.violations()
        assert not found, "\n".join(map(str, found))
    finally:
        await hardware.close()
        cell.stop()
