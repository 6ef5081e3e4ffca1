"""The real cell: V4L2 cameras and an arm behind a VAL II controller."""

from daemon.cell.arm_on_link import arm_on_link
from daemon.cell.backends import CellBackend, Surroundings
from daemon.cell.cameras import ThreadedCameras
from daemon.cell.hardware import Hardware
from daemon.cell.sections import alone, arm_geometry, camera_settings, check_dialect_and_tool, dialect, puma_arm
from daemon.config import Config
from drivers.camera.stereo import V4L2StereoCamera


def _check(config: Config) -> None:
    check_dialect_and_tool(config)
    cameras = camera_settings(config)
    if cameras.left == cameras.right:
        problem = f"expected another camera than left's, found the same: {cameras.right}"
        raise config.document.error(("cameras", "right"), problem)


def _build(config: Config, given: Surroundings) -> Hardware:
    cameras = ThreadedCameras(V4L2StereoCamera(camera_settings(config), given.clock), given.clock, alone(config))
    port = config.values.arm.port
    robot = arm_on_link(port, dialect(config), arm_geometry(config), given.on_wire, given.clock, given.beliefs)
    return Hardware("real", robot, cameras, given.clock, port)


BACKEND = CellBackend(_check, puma_arm, _build)
