"""The sections of facetd.yaml that drivers type: cameras, arm.dialect, the arm's geometry, the simulated cell's truth.

In: Config. Out: the drivers' own settings, or a ConfigError that names file, line and key. No device is touched.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from daemon.arm import plausible
from daemon.calibration.file import Calibration, rigid
from daemon.config import Config
from daemon.store.yamlfile import read
from drivers.camera.settings import CameraSettings
from drivers.puma560 import ArmGeometry
from drivers.val2.dialect import Dialect


def check(config: Config) -> None:
    """Type every one of them, and ask whether the geometry can be meant. Raises ConfigError."""
    dialect(config)
    arm = arm_geometry(config)
    for wrong in (*plausible.tool(arm.flange_from_tool), *plausible.limits(config.values.pick.limits, arm.reach_mm)):
        raise config.document.error(wrong.keys, wrong.problem)
    if config.kind == "real":
        camera_settings(config)
    if config.kind == "simulated":
        truth(config)


def camera_settings(config: Config) -> CameraSettings:
    """The section `cameras`. Raises ConfigError."""
    return config.document.convert(CameraSettings, at=("cameras",))


def dialect(config: Config) -> Dialect:
    """The section `arm.dialect`; control characters are written as in "\\r". Raises ConfigError."""
    section = {
        key: value.encode("latin-1") if key in ("line_end", "cancel_line") and isinstance(value, str) else value
        for key, value in config.values.arm.dialect.items()
    }
    document = replace(config.document, data={"arm": {"dialect": section}})
    return document.convert(Dialect, at=("arm", "dialect"))


def arm_geometry(config: Config) -> ArmGeometry:
    """The arm with its tool: arm.flange_from_tool, (4, 4) mm. Raises ConfigError."""
    rows = config.values.arm.flange_from_tool
    return ArmGeometry(flange_from_tool=rigid(config.document, ("arm", "flange_from_tool"), rows))


def check_hand_eye(config: Config, calibration: Calibration) -> None:
    """Whether the cameras can be on the hand where the calibration has them. Raises ConfigError."""
    if calibration.tool_from_cyclopean is None:
        return
    for wrong in plausible.hand_eye(calibration.tool_from_cyclopean, arm_geometry(config).reach_mm):
        raise read(config.calibration).error(wrong.keys, wrong.problem)


def truth(config: Config) -> Path:
    """The simulated cell's file, once it was read without complaint. Raises ConfigError."""
    from drivers.simcell.truth import TruthError, load_truth

    path = config.file(config.values.simulated.truth)
    try:
        load_truth(path)
    except TruthError as error:
        raise config.document.error(("simulated", "truth"), " ".join(str(error).split())) from None
    return path
