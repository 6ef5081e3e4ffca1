"""True values of the simulated cell: etc/simcell.yaml as typed values with bounds. The daemon never reads that file."""

from __future__ import annotations

from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta, structs

from drivers.arrays import Array
from drivers.puma560 import NEST_RAD, PUMA560, ArmGeometry
from drivers.rigid import apply, inverse
from drivers.simcell.controller.manners import Manners
from drivers.simcell.optics import LensCamera

Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Fraction = Annotated[float, Meta(ge=0, le=1)]
Vector2 = Annotated[list[float], Meta(min_length=2, max_length=2)]
Vector3 = Annotated[list[float], Meta(min_length=3, max_length=3)]
Four = Annotated[list[float], Meta(min_length=4, max_length=4)]
Six = Annotated[list[float], Meta(min_length=6, max_length=6)]
Distortion = Annotated[list[float], Meta(min_length=5, max_length=5)]
Matrix3 = Annotated[list[Vector3], Meta(min_length=3, max_length=3)]
Matrix4 = Annotated[list[Four], Meta(min_length=4, max_length=4)]


class TruthError(Exception):
    """etc/simcell.yaml is unusable: which file, which value, what was expected."""


def rigid_matrix(rows: Matrix4, name: str = "transform") -> Array:
    """Rows of a 4x4 -> array. Raises ValueError where it is not a rigid transform to 1e-6."""
    matrix = np.array(rows)
    rotation = matrix[:3, :3]
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rotation) < 0:
        raise ValueError(f"{name}: the upper left 3x3 is not a rotation")
    if not np.array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0]):
        raise ValueError(f"{name}: the last row must be 0 0 0 1")
    return matrix


class CameraTruth(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One camera: as in calibration.yaml."""

    camera_matrix: Matrix3
    distortion: Distortion
    cyclopean_from_camera: Matrix4

    def __post_init__(self) -> None:
        rigid_matrix(self.cyclopean_from_camera, "cyclopean_from_camera")

    def lens(self) -> LensCamera:
        return LensCamera(
            np.array(self.camera_matrix), np.array(self.distortion), rigid_matrix(self.cyclopean_from_camera)
        )


class ArmTruth(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The arm and its controller, with the arm's errors.

    flange_from_tool: the tool centre point, from the wrist centre (known to the controller); joint_offset_deg: true
    minus reported angle of each joint; repeatability_mm: standard deviation of a stop, per axis. lengths_mm: a2, a3,
    d3, d4; world_from_base, controller_flange: as in ArmGeometry; start_deg: the joints at power-up, in the angles of
    our kinematics. manners: values of Manners other than the default. baud: of its line. cold: powered up with
    the cell, else long before.
    """

    flange_from_tool: Matrix4
    joint_offset_deg: Six
    repeatability_mm: NotNegative
    lengths_mm: Four = msgspec.field(default_factory=lambda: list(PUMA560.lengths_mm))
    world_from_base: Matrix4 = msgspec.field(default_factory=lambda: np.eye(4).tolist())
    controller_flange: Matrix4 = msgspec.field(default_factory=lambda: np.eye(4).tolist())
    start_deg: Six = msgspec.field(default_factory=lambda: np.degrees(NEST_RAD).tolist())
    manners: dict[str, Any] = {}
    baud: Annotated[int, Meta(ge=50, le=4_000_000)] = 9600
    cold: bool = False

    def __post_init__(self) -> None:
        for name in ("flange_from_tool", "world_from_base", "controller_flange"):
            rigid_matrix(getattr(self, name), name)
        unknown = self.manners.keys() - {field.name for field in fields(Manners)}
        if unknown:
            raise ValueError(f"manners: {', '.join(sorted(unknown))}: no such manner")
        self.controller_manners()

    def geometry(self) -> ArmGeometry:
        a2, a3, d3, d4 = self.lengths_mm
        frames = (self.world_from_base, self.flange_from_tool, self.controller_flange)
        return ArmGeometry(a2, a3, d3, d4, *(rigid_matrix(rows) for rows in frames))

    def controller_manners(self) -> Manners:
        return msgspec.convert(self.manners, Manners)


class Sensor(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The image sensors. Noise variance = read_noise^2 + photon_noise * level, in grey levels.

    skew_s: delay of the right camera's exposure.
    """

    frame_rate_hz: Positive
    exposure_s: Positive
    skew_s: NotNegative
    blur_px: Positive
    read_noise: NotNegative
    photon_noise: NotNegative
    gain_left: Positive
    gain_right: Positive
    vignette: Fraction


class Lamp(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A round lamp: centre in world mm, radius (softness of shadows), grey level of white that faces it at 1 m."""

    position_mm: Vector3
    radius_mm: Positive
    level: NotNegative


class Lighting(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """ambient: grey level of white in ambient light; lamps; gloss: share of a lamp's level in a facet's highlight."""

    ambient: NotNegative
    lamps: list[Lamp]
    gloss: Fraction
    facet_albedo: Fraction
    table_albedo: Fraction


class TableTruth(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The table's top: z in world mm, the area over which parts are scattered (centre, radius), its half size."""

    height_mm: float
    centre_mm: Vector2
    scatter_radius_mm: Positive
    half_size_mm: Positive


class BinTruth(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The bin: a rectangle, centre and full size, world mm."""

    centre_mm: Vector2
    size_mm: Vector2


GripperKind = Literal["fingers", "suction"]
Works = Literal["works", "stuck on", "stuck off"]


class GripperTruth(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The parallel gripper: jaws close along tool y, both alike; fingers lie along tool z.

    opening_mm between the open jaws; finger_width_mm along tool x; tip_mm from the TCP to the tips; finger_length_mm
    from the tips to the palm; finger_thickness_mm outside the opening; friction coefficient; centring_mm and turn_deg:
    the most a closing jaw pushes or turns a part; lever_mm: the centre of mass's greatest distance from the grip line;
    bite_mm: the least depth of part between the fingers.
    """

    opening_mm: Positive
    finger_width_mm: Positive
    tip_mm: Positive
    finger_length_mm: Positive
    finger_thickness_mm: Positive
    friction: Positive
    centring_mm: Positive
    turn_deg: Positive
    lever_mm: Positive
    bite_mm: Positive


class SuctionTruth(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A suction cup in place of the jaws: the middle of its lip at the TCP, its axis along tool z.

    radius_mm of the lip; lip_mm: how far the lip gives; length_mm from the lip to the palm; vacuum_bar below the air's
    pressure on a tight part; friction coefficient of the lip; density_g_cm3 of the parts. switch_input: number of the
    controller's input that the vacuum switch is wired to; switch: whether it works or lies. vacuum_output: number of
    the controller's output that works the valve, in place of its hand valves; blow_off_output: of the one that blows a
    part off, which sticks to the lip until then; valve: whether it works or sticks.
    """

    radius_mm: Positive
    lip_mm: Positive
    length_mm: Positive
    vacuum_bar: Positive
    friction: Positive
    density_g_cm3: Positive
    switch_input: Annotated[int, Meta(ge=1, le=9999)]
    switch: Works = "works"
    vacuum_output: Annotated[int, Meta(ge=1, le=9999)] | None = None
    blow_off_output: Annotated[int, Meta(ge=1, le=9999)] | None = None
    valve: Works = "works"


class Rod(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A round bar of the arm's body: from one end to the other, mm, in the frame it is fixed to.

    frame: tool; forearm (origin at the wrist centre, z from there towards the elbow); or upper_arm (origin where the
    forearm turns, x away from the shoulder, z along the elbow's axis away from the column).
    """

    name: str
    frame: Literal["tool", "forearm", "upper_arm"]
    from_mm: Vector3
    to_mm: Vector3
    radius_mm: Positive


class Box(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An upright box in the world, mm."""

    low_mm: Vector3
    high_mm: Vector3


class Safety(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Limits that the motion monitor checks (motion_monitor.py).

    body: rods that must stay above the table, inside the room and out of the keep_out boxes. fastest_percent,
    fastest_mm_s: monitor speed, and speed of the tool centre point; longest_step_mm: of one commanded motion;
    rest_within_s: after a stop; drop_mm: largest fall of a part released outside of the bin.
    """

    room: Box = Box([-2000.0, -2000.0, -2000.0], [2000.0, 2000.0, 2000.0])
    keep_out: list[Box] = []
    body: list[Rod] = []
    fastest_percent: Positive = 100.0
    fastest_mm_s: Positive = 3000.0
    longest_step_mm: Positive = 450.0
    rest_within_s: Positive = 0.5
    drop_mm: NotNegative = 5.0


class Truth(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The whole file. suction: a suction gripper, instead of or besides the jaws of `gripper`; mounted: which of the
    two is mounted at first, if the cell has both; flange_from_lip: the cup's TCP in that case, if it is not the arm's;
    fixture: boxes on the table that the cameras see and that nothing may touch; tool_from_cyclopean: for cameras on
    the arm; world_from_cyclopean: for fixed ones."""

    version: int
    image_size: Annotated[list[int], Meta(min_length=2, max_length=2)]
    left: CameraTruth
    right: CameraTruth
    arm: ArmTruth
    sensor: Sensor
    lighting: Lighting
    table: TableTruth
    bin: BinTruth
    gripper: GripperTruth
    safety: Safety = Safety()
    suction: SuctionTruth | None = None
    mounted: GripperKind | None = None
    flange_from_lip: Matrix4 | None = None
    fixture: list[Box] = []
    tool_from_cyclopean: Matrix4 | None = None
    world_from_cyclopean: Matrix4 | None = None

    def __post_init__(self) -> None:
        poses = {name: getattr(self, name) for name in ("tool_from_cyclopean", "world_from_cyclopean")}
        given = {name: pose for name, pose in poses.items() if pose is not None}
        if len(given) != 1:
            raise ValueError("expected tool_from_cyclopean or world_from_cyclopean, one of them")
        for name, pose in given.items():
            rigid_matrix(pose, name)
        if self.mounted is not None and self.suction is None:
            raise ValueError("expected `suction` beside `mounted`: a cell with both")
        if self.flange_from_lip is not None:
            rigid_matrix(self.flange_from_lip, "flange_from_lip")

    @property
    def grippers(self) -> tuple[GripperKind, ...]:
        """Those of the cell, the one on the arm at first before the other."""
        if self.suction is None:
            return ("fingers",)
        if self.mounted is None:
            return ("suction",)
        return ("fingers", "suction") if self.mounted == "fingers" else ("suction", "fingers")

    def with_gripper(self, kind: GripperKind) -> Truth:
        """The same with one of the cell's grippers on the arm, and no other. Bodies and cameras in the tool's frame
        keep their place on the wrist."""
        if kind not in self.grippers:
            raise ValueError(f"this cell has no {kind}")
        if kind == "fingers" or self.suction is None:
            return structs.replace(self, suction=None, mounted=None)
        new = self.flange_from_lip or self.arm.flange_from_tool
        moved = inverse(rigid_matrix(new)) @ rigid_matrix(self.arm.flange_from_tool)
        cameras = self.tool_from_cyclopean
        body = [rod if rod.frame != "tool" else _moved(rod, moved) for rod in self.safety.body]
        return structs.replace(
            self,
            mounted=None,
            arm=structs.replace(self.arm, flange_from_tool=new),
            safety=structs.replace(self.safety, body=body),
            tool_from_cyclopean=None if cameras is None else (moved @ np.array(cameras)).tolist(),
        )

    def world_from_cyclopean_at(self, world_from_tool: Array) -> Array:
        """The pose of the cameras (4, 4) mm while the tool is there: they go with it, or are fixed in the world."""
        if self.tool_from_cyclopean is not None:
            return np.asarray(world_from_tool @ np.array(self.tool_from_cyclopean))
        return np.array(self.world_from_cyclopean)


def _moved(rod: Rod, new_from_old: Array) -> Rod:
    ends = apply(new_from_old, np.array([rod.from_mm, rod.to_mm])).tolist()
    return structs.replace(rod, from_mm=ends[0], to_mm=ends[1])


def load_truth(path: Path | str) -> Truth:
    """Read etc/simcell.yaml. Raises TruthError with file, value and what was expected."""
    try:
        truth = _decoded(Path(path).read_bytes())
    except OSError as error:
        raise TruthError(f"{path}: cannot be read: {error.strerror}") from error
    except msgspec.DecodeError as error:
        raise TruthError(f"{path}: {error}") from error
    if truth.version != 1:
        raise TruthError(f"{path}: version: expected 1, found {truth.version}")
    return truth


@lru_cache(maxsize=1)
def _decoded(content: bytes) -> Truth:
    """Decode, with a cache: a daemon reads the same file at each reload."""
    return msgspec.yaml.decode(content, type=Truth)
