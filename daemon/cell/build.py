"""Build the hardware of a cell from its configuration, by the back-end that it names."""

import asyncio
import contextlib
import time
from collections.abc import Callable, Iterator

from daemon.arm import Beliefs
from daemon.cell.backends import Surroundings, WireListener, backend_of
from daemon.cell.cameras import StereoCamera
from daemon.cell.hardware import Hardware
from daemon.config import Config
from drivers.camera.recorded import RecordedCamera


def build(config: Config, on_wire: WireListener, record: Callable[..., None] = lambda *_, **__: None) -> Hardware:
    """The hardware as configured, not yet opened (a simulated cell already runs). record: the run log's function, for
    beliefs about arm and gripper. Raises ConfigError, CellError."""
    clock = time.monotonic
    return backend_of(config).build(config, Surroundings(on_wire, clock, Beliefs(clock, record)))


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
