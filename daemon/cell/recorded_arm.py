"""The arm of a recorded run as bodies in the world, for pages that draw it. Reads the kept files; opens no device."""

from dataclasses import dataclass, replace
from pathlib import Path

from daemon.arm import ArmModel, body_of
from daemon.arrays import Array
from daemon.cell.backends import backend_of
from daemon.cell.sections import guarded
from daemon.config import OBSOLETE, Config, ConfigFile, with_mounted
from daemon.pick.settings import Settings
from daemon.store.mounted_gripper import MountedGripper
from daemon.store.yamlfile import read


@dataclass(frozen=True, eq=False)
class RecordedArm:
    """The arm as data; settings: with the limits that its bodies, table and boxes are in."""

    kinematics: ArmModel
    settings: Settings

    def capsules(self, joints_rad: Array) -> tuple[list[float], Array]:
        """Radii of its C capsules, mm, and their ends (N, C, 2, 3), mm in the world, at joints (N, 6) rad."""
        body = body_of(self.settings.limits.capsules, ())
        solid = body.radius_mm > 0
        return body.radius_mm[solid].tolist(), body.placed(self.kinematics.frames(joints_rad))[:, solid]


def recorded_arm(config: Path, arm_file: Path | None, gripper: str | None = None) -> RecordedArm:
    """The arm of a kept configuration, and of the arm.yaml that was kept with it. gripper: name of the mounted one.
    Raises ConfigError."""
    document, _ = read(config).without(OBSOLETE)
    values = document.convert(ConfigFile)
    if arm_file is not None:
        values = replace(values, arm=replace(values.arm, file=str(arm_file)))
    made = Config(values, document, values.cell)
    if values.grippers:
        made = with_mounted(made, None if gripper is None else MountedGripper(gripper, "", ""))
    arm = backend_of(made).arm(made)
    return RecordedArm(arm, replace(made.values.pick, limits=guarded(made, arm)))
