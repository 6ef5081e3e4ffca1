"""facetd's own cells but the simulated one: behind a VAL II controller, behind LinuxCNC, and recorded pairs."""

from collections.abc import Callable

from daemon.cell.backends import CellBackend, Surroundings
from daemon.cell.cameras import RepeatedPairs, ThreadedCameras
from daemon.cell.hardware import Hardware
from daemon.cell.linuxcnc_arm import LinuxcncArm, LinuxcncSettings
from daemon.cell.no_arm import NoArm
from daemon.cell.sections import (
    alone,
    arm_geometry,
    camera_settings,
    check_cameras,
    check_dialect_and_tool,
    check_tool,
    dialect,
    puma_arm,
)
from daemon.cell.val2_arm import Val2Arm
from daemon.config import Config
from drivers.camera.v4l2_stereo import V4L2StereoCamera
from drivers.val2.link import Link


def v4l2_cameras(config: Config, clock: Callable[[], float]) -> ThreadedCameras:
    """The V4L2 cameras of the section `cameras`, not yet opened. Raises ConfigError."""
    return ThreadedCameras(V4L2StereoCamera(camera_settings(config), clock), clock, alone(config))


def _check_real(config: Config) -> None:
    check_dialect_and_tool(config)
    check_cameras(config)


def _real(config: Config, given: Surroundings) -> Hardware:
    port = config.values.arm.port
    link = Link(port, dialect(config), given.clock, given.on_wire)
    robot = Val2Arm(link, arm_geometry(config), given.beliefs)
    return Hardware("real", robot, v4l2_cameras(config, given.clock), given.clock, port)


def _linuxcnc_settings(config: Config) -> LinuxcncSettings:
    return config.document.convert(LinuxcncSettings, at=("backend",))


def _check_linuxcnc(config: Config) -> None:
    _linuxcnc_settings(config)
    check_tool(config)
    check_cameras(config)


def _linuxcnc(config: Config, given: Surroundings) -> Hardware:
    settings = _linuxcnc_settings(config)
    robot = LinuxcncArm(settings, arm_geometry(config), given.on_wire, given.clock, given.beliefs)
    where = f"{settings.host}:{settings.port}"
    return Hardware("linuxcnc", robot, v4l2_cameras(config, given.clock), given.clock, where)


def _recorded(config: Config, given: Surroundings) -> Hardware:
    folder = config.file(config.values.recorded.pairs)
    cameras = ThreadedCameras(RepeatedPairs(folder, again=True, clock=given.clock), given.clock)
    return Hardware("recorded", NoArm(given.beliefs, arm_geometry(config)), cameras, given.clock, str(folder))


REAL = CellBackend(_check_real, puma_arm, _real)
LINUXCNC = CellBackend(_check_linuxcnc, puma_arm, _linuxcnc)
RECORDED = CellBackend(check_dialect_and_tool, puma_arm, _recorded)
