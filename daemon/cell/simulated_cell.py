"""The simulated cell: rendered cameras, and an arm behind a simulated VAL II controller on a pseudo-terminal."""

import random

from daemon.cell.backends import CellBackend, Surroundings
from daemon.cell.cameras import ThreadedCameras
from daemon.cell.hardware import Hardware
from daemon.cell.sections import alone, arm_geometry, check_tool, dialect, each_of, puma_arm, truth
from daemon.cell.simulated_operator import SimulatedOperator
from daemon.cell.val2_arm import Val2Arm
from daemon.config import Config, kind_of
from drivers.simcell.cell import SimulatedCell
from drivers.val2.link import Link


def _build(config: Config, given: Surroundings) -> Hardware:
    """The cell already runs."""
    simulated = config.values.simulated
    seed = simulated.seed if simulated.seed is not None else random.SystemRandom().randrange(1_000_000)
    verdict = None if simulated.verdict is None else config.file(simulated.verdict)
    truth_file = truth(config)
    cell = SimulatedCell(
        truth_file, seed, simulated.time_scale, table=simulated.table, parts=simulated.parts, verdict=verdict
    )
    line_dialect = dialect(config).on_a_faster_line(simulated.time_scale)
    robot = Val2Arm(Link(cell.port, line_dialect, given.clock, given.on_wire), arm_geometry(config), given.beliefs)
    operator = SimulatedOperator(cell)
    operator.mount(kind_of(config.values.pick.gripper))
    cell.camera.use(alone(config))
    cameras = ThreadedCameras(cell.camera, given.clock, alone(config))
    return Hardware("simulated", robot, cameras, given.clock, cell.port, seed, operator)


SIMULATED = CellBackend(each_of(dialect, check_tool, truth), puma_arm, _build)
