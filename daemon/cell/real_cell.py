"""The real cell: V4L2 cameras and an arm behind a VAL II controller."""

from collections.abc import Callable

from daemon.cell.arm_on_link import arm_on_link
from daemon.cell.backends import CellBackend, Surroundings
from daemon.cell.cameras import ThreadedCameras
from daemon.cell.hardware import Hardware
from daemon.cell.sections import (
    alone,
    arm_geometry,
    camera_settings,
    check_cameras,
    check_dialect_and_tool,
    dialect,
    puma_arm,
)
from daemon.config import Config
from drivers.camera.stereo import V4L2StereoCamera


def v4l2_cameras(config: Config, clock: Callable[[], float]) -> ThreadedCameras:
    """The V4L2 cameras of the section `cameras`, not yet opened. Raises ConfigError."""
    return ThreadedCameras(V4L2StereoCamera(camera_settings(config), clock), clock, alone(config))


def _check(config: Config) -> None:
    check_dialect_and_tool(config)
    check_cameras(config)


def _build(config: Config, given: Surroundings) -> Hardware:
    port = config.values.arm.port
    robot = arm_on_link(port, dialect(config), arm_geometry(config), given.on_wire, given.clock, given.beliefs)
    return Hardware("real", robot, v4l2_cameras(config, given.clock), given.clock, port)


BACKEND = CellBackend(_check, puma_arm, _build)
