"""Sections of facetd.yaml with drivers' types: cameras, arm.dialect, the arm's geometry, the simulated cell's truth.

In: Config. Out: the drivers' settings, or a ConfigError that names file, line and key. Opens no device.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
from msgspec import Meta

from daemon import frames
from daemon.arm import (
    ARM,
    BODY_MM,
    CAMERA_NAMES,
    CAMERAS,
    CAMERAS_ON_HAND,
    ArmModel,
    CameraName,
    body_of,
    in_view,
    plausible,
)
from daemon.arm import Limits as GuardLimits
from daemon.arrays import Array
from daemon.calibration.file import SIMULATED, Calibration, load_calibration, rigid
from daemon.calibration.plausible import implausible_rig
from daemon.cell.backends import backend_of
from daemon.cell.puma_arm import PumaArm
from daemon.config import Config, Matrix4
from daemon.pick.grippers import SuctionCup, TwoFingers
from daemon.store.yamlfile import ConfigError, Document, Key, read
from daemon.vision.geometry import StereoRig
from drivers.camera.settings import CameraSettings, Mounting
from drivers.puma560 import PUMA560, ArmGeometry
from drivers.val2.dialect import SLOWEST_BAUD, Dialect

Angle = Annotated[float, Meta(ge=-720, le=720)]
Limits = tuple[Angle, Angle]
LIMIT_MARGIN_DEG = 0.2
"""Margin to the limits of joints whose zeros were estimated: they differ from the controller's in the last digits, and
it may refuse what facetd takes for reachable."""


def check(config: Config) -> None:
    """Check the back-end's own sections, and limits and gripper against its arm, with each gripper. Raises
    ConfigError."""
    backend = backend_of(config)
    for each in config.each_gripper().values():
        backend.check(each)
        _check_geometry(each, backend.arm(each))


def _check_geometry(config: Config, arm: ArmModel) -> None:
    limits, gripper = config.values.pick.limits, config.values.pick.gripper
    for wrong in (
        *plausible.limits(limits, arm.reach_mm, arm.shoulder_mm),
        *plausible.hand(guarded(config, arm), gripper.tip_mm, gripper.outside),
    ):
        raise config.document.error(_keys_of_gripper(config, wrong.keys), wrong.problem)


def each_of(*checks: Callable[[Config], object]) -> Callable[[Config], None]:
    """One check of a configuration made of several, for a CellBackend. It raises the first ConfigError."""

    def check_all(config: Config) -> None:
        for one in checks:
            one(config)

    return check_all


def check_tool(config: Config) -> None:
    """Check geometry and tool of a PUMA. Raises ConfigError."""
    for wrong in plausible.tool(arm_geometry(config).flange_from_tool):
        raise config.document.error(_keys_of_gripper(config, wrong.keys), wrong.problem)


def _keys_of_gripper(config: Config, keys: tuple[Key, ...]) -> tuple[Key, ...]:
    """The keys of a value of the mounted gripper in the file: in the section `grippers`, where there is one."""
    name = config.gripper or next(iter(config.values.grippers), None)
    if not config.values.grippers or keys[:2] not in (("pick", "gripper"), ("arm", "flange_from_tool")):
        return keys
    return "grippers", str(name), *keys[1:]


def out_of_reach(config: Config) -> Iterator[str]:
    """A line for each position of the file that the configured arm cannot reach: better found at the start than with a
    part in the gripper."""
    arm, pick = backend_of(config).arm(config), config.values.pick
    for name, place in (("home", pick.home), ("bin", pick.bin)):
        if not arm.ways(place.pose()):
            x, y, z = place.point_mm
            yield f"pick.{name}: the arm in its present configuration cannot reach {x:g}, {y:g}, {z:g} mm at that angle"


def of_another_size(config: Config, calibration: Calibration) -> Iterator[str]:
    """A line where the configured image size is not the calibration's. Not an error: the cell must start to be
    calibrated."""
    if config.kind == "real":
        cameras, calibrated = camera_settings(config), calibration.rig.image_size
        if calibrated != (cameras.width, cameras.height):
            found = (
                f"{cameras.width}x{cameras.height}, cameras.width and height, are not {calibrated[0]}x{calibrated[1]}"
            )
            yield f"{config.calibration}: {found}, of which it was made: `calibrate stereo`, or the size as it was"


def camera_settings(config: Config) -> CameraSettings:
    """The section `cameras`. Raises ConfigError."""
    return config.document.convert(CameraSettings, at=("cameras",))


def check_cameras(config: Config) -> None:
    """Check the V4L2 cameras of the section `cameras`. Raises ConfigError."""
    settings = camera_settings(config)
    if settings.left == settings.right:
        problem = f"expected another camera than left's, found the same: {settings.right}"
        raise config.document.error(("cameras", "right"), problem)


def alone(config: Config) -> CameraName | None:
    """The only camera of the section `cameras`; None where it names both, or none."""
    named: list[CameraName] = [name for name in CAMERA_NAMES if name in config.values.cameras]
    return named[0] if len(named) == 1 and config.kind != "recorded" else None


def dialect(config: Config) -> Dialect:
    """The dialect of arm.yaml, overridden by the section `arm.dialect`; control characters are written as in "\\r".

    Raises ConfigError.
    """
    section = _as_bytes(config.values.arm.dialect)
    file = _arm_file(config)
    if file is not None:
        from_file = _as_bytes({name: entry.value for name, entry in file[1].dialect.items()})
        replace(file[0], data={"dialect": from_file}).convert(Dialect, at=("dialect",))
        section = from_file | section
    document = replace(config.document, data={"arm": {"dialect": section}})
    made = document.convert(Dialect, at=("arm", "dialect"))
    if made.baud < SLOWEST_BAUD:
        problem = (
            f"{made.baud} is too slow, a stop would be confirmed too late; set the controller's terminal line, and "
            f"arm.dialect.baud, to {SLOWEST_BAUD} or more"
        )
        if file is not None and "baud" not in config.values.arm.dialect:
            raise file[0].error(("dialect", "baud"), problem)
        raise config.document.error(("arm", "dialect", "baud"), problem)
    return made


def _as_bytes(section: Mapping[str, Any]) -> dict[str, Any]:
    return {
        key: value.encode("latin-1") if key in ("line_end", "cancel_line") and isinstance(value, str) else value
        for key, value in section.items()
    }


def arm_geometry(config: Config) -> ArmGeometry:
    """The arm of arm.yaml, or a PUMA 560, with its tool: arm.flange_from_tool, (4, 4) mm. Raises ConfigError."""
    tool = rigid(
        config.document, _keys_of_gripper(config, ("arm", "flange_from_tool")), config.values.arm.flange_from_tool
    )
    file = _arm_file(config)
    if file is None or not file[1].geometry:
        return ArmGeometry(flange_from_tool=tool)
    document = replace(file[0], data={"geometry": {name: each.value for name, each in file[1].geometry.items()}})
    values = document.convert(_Geometry, at=("geometry",))
    limits = np.degrees(PUMA560.limits_rad)
    if values.limits_deg is not None:
        convention = dialect(config)
        ends = (
            np.array(values.limits_deg) * np.array(convention.joint_signs)[:, None]
            + np.array(convention.joint_zeros_deg)[:, None]
        )
        limits = np.sort(ends, axis=1)
    return ArmGeometry(
        values.a2_mm,
        values.a3_mm,
        values.d3_mm,
        values.d4_mm,
        rigid(document, ("geometry", "world_from_base"), values.world_from_base),
        tool,
        rigid(document, ("geometry", "controller_flange"), values.controller_flange),
        np.radians(limits + np.array([LIMIT_MARGIN_DEG, -LIMIT_MARGIN_DEG])),
    )


@dataclass(frozen=True, kw_only=True)
class _Entry:
    """One value of arm.yaml; found and sure (how it was found, and how certainly) are for people."""

    value: Any
    found: str = ""
    sure: str = ""


@dataclass(frozen=True, kw_only=True)
class _ArmFile:
    version: Literal[1]
    dialect: dict[str, _Entry] = field(default_factory=dict)
    geometry: dict[str, _Entry] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class _Geometry:
    """Lengths and frames of ArmGeometry. limits_deg: lowest and highest angle of each joint from the type plate,
    counted as WHERE does; joint 3's against the upper arm."""

    a2_mm: Annotated[float, Meta(ge=10, le=5000)]
    a3_mm: Annotated[float, Meta(ge=-1000, le=1000)]
    d3_mm: Annotated[float, Meta(ge=-2000, le=2000)]
    d4_mm: Annotated[float, Meta(ge=10, le=5000)]
    world_from_base: Matrix4
    controller_flange: Matrix4
    limits_deg: tuple[Limits, Limits, Limits, Limits, Limits, Limits] | None = None


def puma_arm(config: Config) -> ArmModel:
    """The arm of cells with a PUMA, as data. Raises ConfigError."""
    return PumaArm(arm_geometry(config))


def _arm_file(config: Config) -> tuple[Document, _ArmFile] | None:
    """arm.yaml where the configuration names one. Raises ConfigError."""
    name = config.values.arm.file
    if name is None:
        return None
    document = read(config.file(name))
    return document, document.convert(_ArmFile)


def check_hand_eye(config: Config, calibration: Calibration) -> None:
    """Check that the calibration matches the configured cameras and is plausible. Raises ConfigError."""
    if calibration.alone is not None and alone(config) != calibration.alone:
        only = f"{config.calibration} is of the {calibration.alone} camera alone"
        problem = f"{only}: name only `{calibration.alone}` here; for two cameras, `calibrate use` one of both first"
        raise config.document.error(("cameras",), problem)
    for camera in implausible_rig(calibration.rig):
        raise read(config.calibration).error(camera.keys, camera.problem)
    arm, fixed, on_hand = (
        backend_of(config).arm(config),
        calibration.world_from_cyclopean,
        calibration.tool_from_cyclopean,
    )
    if (fixed if mounting(config) == "hand" else on_hand) is not None:
        is_of, key = ("on the hand", "hand") if fixed is None else ("fixed in the world", "world")
        problem = f"expected `mounting: {key}`, as {config.calibration} is of cameras {is_of}"
        raise config.document.error(("cameras",), problem)
    if mounting(config) == "world":
        _check_fixed(config)
    wrong: Iterator[plausible.Implausible] = iter(())
    if fixed is not None:
        wrong = plausible.fixed_cameras(fixed, config.values.pick.limits, arm.reach_mm)
    elif on_hand is not None:
        wrong = plausible.hand_eye(on_hand, arm.reach_mm)
    for each in wrong:
        raise read(config.calibration).error(each.keys, each.problem)
    if fixed is not None and (piece := _home_in_view(config, calibration.rig, fixed, arm)):
        problem = f"expected the arm out of the fixed cameras' view, found its {piece} in it: move home, or the cameras"
        raise config.document.error(("pick", "home"), problem)


def mounting(config: Config) -> Mounting:
    """Where the configuration says that the cameras are. Raises ConfigError."""
    where: Mounting = config.values.cameras.get("mounting", "hand")
    if where not in get_args(Mounting):
        raise config.document.error(("cameras", "mounting"), f"expected hand or world, found {where!r}")
    return where


def _check_fixed(config: Config) -> None:
    """What needs cameras on the hand. Raises ConfigError."""
    if alone(config) is not None:
        problem = "expected two cameras: one fixed camera alone cannot measure distances"
        raise config.document.error(("cameras",), problem)
    if config.places.places:
        problem = f"expected no places in {config.places_file}: no fixed camera measures how the gripper holds a part"
        raise config.document.error(("cameras", "mounting"), problem)


def guarded(config: Config, arm: ArmModel) -> GuardLimits:
    """pick.limits with the capsules of this arm, of the mounted gripper and of the cameras, where the file has
    the default ones; and with their points, where it has those. Of several grippers the mounted one always counts."""
    limits, hand, cameras = config.values.pick.limits, config.values.pick.gripper.body, CAMERAS
    if mounting(config) == "hand":
        cameras = CAMERAS.seen_from(_tool_from(config, config.calibrated_tool))
    if limits.capsules == ARM:
        limits = replace(limits, capsules=(*arm.links, *hand.capsules, *cameras.capsules))
    elif config.values.grippers:
        limits = replace(limits, capsules=(*limits.capsules, *hand.capsules))
    if limits.body_mm == BODY_MM:
        limits = replace(limits, body_mm=(*hand.points_mm, *cameras.points_mm))
    return limits


def calibration_in_use(config: Config) -> Calibration:
    """The calibration in use, its hand-eye pose from the mounted gripper's tool centre point: cameras on the hand stay
    where they are as grippers change. Raises ConfigError."""
    calibration = load_calibration(config.calibration)
    if calibration.quality.method == SIMULATED and config.kind not in ("simulated", "recorded"):
        raise ConfigError(
            f"{config.calibration}: hand_eye is the simulated cell's: enter where your cameras are, measured by ruler, "
            "then delete the line `quality` (FIRST-DAY.md, Two files, step 6); or delete both: then the arm moves only "
            "by `robot cal` and `robot monitor`"
        )
    made_with = calibration.flange_from_tool
    made_with = np.array(config.calibrated_tool if made_with is None else made_with)
    pose = calibration.tool_from_cyclopean
    mounted = np.array(config.values.arm.flange_from_tool)
    if pose is not None and not np.array_equal(made_with, mounted):
        pose = _tool_from(config, made_with) @ pose
    return replace(calibration, tool_from_cyclopean=pose, flange_from_tool=mounted)


def _tool_from(config: Config, flange_from_other: Matrix4 | Array) -> Array:
    """(4, 4): the mounted gripper's tool frame from another tool's; exactly the identity where they are one."""
    mounted, other = np.array(config.values.arm.flange_from_tool), np.array(flange_from_other)
    return np.eye(4) if np.array_equal(mounted, other) else frames.inverse(mounted) @ other


def _home_in_view(config: Config, rig: StereoRig, world_from_cyclopean: Array, arm: ArmModel) -> str | None:
    """The section of the arm that fixed cameras see while it waits at pick.home; None where they see none, or home is
    out of reach."""
    capsules = guarded(config, arm).capsules
    body = body_of(tuple(piece for piece in capsules if piece not in CAMERAS_ON_HAND), ())
    ways = arm.ways(config.values.pick.home.pose())
    seen = [in_view(arm.frames(joints[None])[0], body, rig, world_from_cyclopean) for joints in ways]
    return seen[0] if seen and all(seen) else None


def truth(config: Config) -> Path:
    """The checked file of the simulated cell. Raises ConfigError."""
    from drivers.simcell.truth import TruthError, load_truth

    path = config.file(config.values.simulated.truth)
    try:
        cell = load_truth(path)
    except TruthError as error:
        raise config.document.error(("simulated", "truth"), " ".join(str(error).split())) from None
    key = "hand" if cell.world_from_cyclopean is None else "world"
    if key != mounting(config):
        raise config.document.error(("cameras",), f"expected `mounting: {key}`, as {path} has the cameras there")
    kinds = {"fingers": TwoFingers, "suction": SuctionCup}
    there = [kinds[name] for name in cell.grippers]
    if not isinstance(config.values.pick.gripper, tuple(there)):
        words = " or ".join(str(kind.__struct_config__.tag) for kind in there)
        problem = f"expected `kind: {words}`, as {path} has that gripper"
        raise config.document.error(_keys_of_gripper(config, ("pick", "gripper")), problem)
    return path
