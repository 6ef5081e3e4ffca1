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
    check_tool,
    dialect,
    each_of,
    puma_arm,
)
from daemon.cell.val2_arm import Val2Arm
from daemon.config import Config
from drivers.camera.v4l2_stereo import V4L2StereoCamera
from drivers.val2.link import Link


def v4l2_cameras(config: Config, clock: Callable[[], float]) -> ThreadedCameras:
    """The V4L2 cameras of the section `cameras`, not yet opened. Raises ConfigError."""
    return ThreadedCameras(V4L2StereoCamera(camera_settings(config), clock), clock, alone(config))


def _real(config: Config, given: Surroundings) -> Hardware:
    port = config.values.arm.port
    link = Link(port, dialect(config), given.clock, given.on_wire)
    robot = Val2Arm(link, arm_geometry(config), given.beliefs)
    return Hardware("real", robot, v4l2_cameras(config, given.clock), given.clock, port)


def _linuxcnc_settings(config: Config) -> LinuxcncSettings:
    return config.document.convert(LinuxcncSettings, at=("backend",))


def _linuxcnc(config: Config, given: Surroundings) -> Hardware:
    settings = _linuxcnc_settings(config)
    robot = LinuxcncArm(settings, arm_geometry(config), given.on_wire, given.clock, given.beliefs)
    where = f"{settings.host}:{settings.port}"
    return Hardware("linuxcnc", robot, v4l2_cameras(config, given.clock), given.clock, where)


def _recorded(config: Config, given: Surroundings) -> Hardware:
    folder = config.file(config.values.recorded.pairs)
    cameras = ThreadedCameras(RepeatedPairs(folder, again=True, clock=given.clock), given.clock)
    return Hardware("recorded", NoArm(given.beliefs, arm_geometry(config)), cameras, given.clock, str(folder))


REAL = CellBackend(each_of(dialect, check_tool, check_cameras), puma_arm, _real)
LINUXCNC = CellBackend(each_of(_linuxcnc_settings, check_tool, check_cameras), puma_arm, _linuxcnc)
RECORDED = CellBackend(each_of(dialect, check_tool), puma_arm, _recorded)
