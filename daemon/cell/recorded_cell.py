"""The recorded cell: pairs from a folder; nothing moves."""

from daemon.cell.backends import CellBackend, Surroundings
from daemon.cell.cameras import RepeatedPairs, ThreadedCameras
from daemon.cell.hardware import Hardware
from daemon.cell.no_arm import NoArm
from daemon.cell.sections import arm_geometry, check_dialect_and_tool, puma_arm
from daemon.config import Config


def _build(config: Config, given: Surroundings) -> Hardware:
    folder = config.file(config.values.recorded.pairs)
    cameras = ThreadedCameras(RepeatedPairs(folder, again=True, clock=given.clock), given.clock)
    return Hardware("recorded", NoArm(given.beliefs, arm_geometry(config)), cameras, given.clock, str(folder))


BACKEND = CellBackend(check_dialect_and_tool, puma_arm, _build)
