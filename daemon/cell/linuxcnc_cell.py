"""A cell of V4L2 cameras and an arm behind LinuxCNC."""

from daemon.cell.backends import CellBackend, Surroundings
from daemon.cell.hardware import Hardware
from daemon.cell.linuxcnc_arm import LinuxcncArm, LinuxcncSettings
from daemon.cell.real_cell import v4l2_cameras
from daemon.cell.sections import arm_geometry, check_cameras, check_tool, puma_arm
from daemon.config import Config


def _settings(config: Config) -> LinuxcncSettings:
    return config.document.convert(LinuxcncSettings, at=("backend",))


def _check(config: Config) -> None:
    _settings(config)
    check_tool(config)
    check_cameras(config)


def _build(config: Config, given: Surroundings) -> Hardware:
    settings = _settings(config)
    robot = LinuxcncArm(settings, arm_geometry(config), given.on_wire, given.clock, given.beliefs)
    where = f"{settings.host}:{settings.port}"
    return Hardware("linuxcnc", robot, v4l2_cameras(config, given.clock), given.clock, where)


BACKEND = CellBackend(_check, puma_arm, _build)
