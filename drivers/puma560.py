"""A PUMA's forward and inverse kinematics. Pure functions on arrays; no controller, no motion.

Joint angles are those of the standard Denavit-Hartenberg table of ArmGeometry (the robotics toolbox's), in rad; lengths
in mm, those of the arm given; without one it is a PUMA 560.
The base frame sits at the shoulder (crossing of axes 1 and 2), z up; the flange frame's origin is the wrist centre.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from math import atan2, ceil, cos, hypot, pi, sin

import numpy as np

from drivers import rigid
from drivers.arrays import Array

TWISTS_RAD = (pi / 2, 0.0, -pi / 2, pi / 2, -pi / 2, 0.0)
SINGULAR_SIN_Q5 = 1e-6
LIMIT_SLACK_RAD = 1e-9

READY_RAD = np.radians([0.0, 90.0, -90.0, 0.0, 0.0, 0.0])
"""Arm straight up."""
NEST_RAD = np.radians([0.0, 130.0, -205.0, 0.0, -60.0, 0.0])
"""Arm folded over the shoulder."""
LIMITS_RAD = np.radians(
    [[-160, 160], [90 - 110, 90 + 110], [-90 - 135, -90 + 135], [-266, 266], [-100, 100], [-266, 266]]
)
"""(6, 2): lowest and highest angles of a PUMA 560."""
LIMITS_RAD.setflags(write=False)


@dataclass(frozen=True, eq=False)
class ArmGeometry:
    """The geometry of one arm: lengths, base, tool, joint limits.

    a2_mm, a3_mm: upper arm, and how far the forearm's axis passes the elbow's. d3_mm: the shoulder's offset (to the
    right of an arm that reaches forward; negative: to the left). d4_mm: forearm. Where not given, a PUMA 560's.
    world_from_base, flange_from_tool: (4, 4) mm. controller_flange: (4, 4) mm, where the controller that drives the arm
    has its own flange, from the wrist centre: from where its TOOL counts. limits_rad: (6, 2) lowest and highest angle.
    """

    a2_mm: float = 431.8
    a3_mm: float = 20.3
    d3_mm: float = 150.05
    d4_mm: float = 431.8
    world_from_base: Array = field(default_factory=lambda: np.eye(4))
    flange_from_tool: Array = field(default_factory=lambda: np.eye(4))
    controller_flange: Array = field(default_factory=lambda: np.eye(4))
    limits_rad: Array = field(default_factory=lambda: LIMITS_RAD)

    @property
    def lengths_mm(self) -> tuple[float, float, float, float]:
        return self.a2_mm, self.a3_mm, self.d3_mm, self.d4_mm

    @property
    def forearm_mm(self) -> float:
        """From the elbow's axis to the wrist centre."""
        return hypot(self.a3_mm, self.d4_mm)

    @property
    def reach_mm(self) -> float:
        """How far from the shoulder the tool centre point gets, at most, the shoulder's offset aside."""
        return self.a2_mm + self.forearm_mm + float(np.linalg.norm(self.flange_from_tool[:3, 3]))

    @cached_property
    def base_from_world(self) -> Array:
        """(4, 4) mm."""
        return rigid.inverse(self.world_from_base)

    @cached_property
    def tool_from_flange(self) -> Array:
        """(4, 4) mm."""
        return rigid.inverse(self.flange_from_tool)

    @property
    def tool_for_controller(self) -> Array:
        """(4, 4) mm: the tool as the controller's TOOL has it."""
        return rigid.inverse(self.controller_flange) @ self.flange_from_tool


PUMA560 = ArmGeometry()


@dataclass(frozen=True)
class Configuration:
    """Which of the eight ways the arm reaches a pose: shoulder, elbow, wrist."""

    lefty: bool = False
    above: bool = True
    flip: bool = False


CONFIGURATIONS = tuple(Configuration(*way) for way in product((False, True), (True, False), (False, True)))


class UnreachableError(Exception):
    """No joint angles put the tool there. joint: whose limit is in the way (1 to 6), None where it is out of reach."""

    code = "out_of_reach"

    def __init__(self, text: str, joint: int | None = None) -> None:
        super().__init__(text)
        self.joint = joint


def forward(joints_rad: Array, arm: ArmGeometry = PUMA560) -> Array:
    """world_from_tool (4, 4) mm at (6,) joint angles."""
    base_from_flange = _base_from_forearm(joints_rad, arm)
    wrist = _rotation_z(joints_rad[3]) @ _rotation_y(-joints_rad[4]) @ _rotation_z(joints_rad[5])
    base_from_flange[:3, :3] = base_from_flange[:3, :3] @ wrist
    pose: Array = arm.world_from_base @ base_from_flange @ arm.flange_from_tool
    return pose


def elbow_mm(joints_rad: Array, arm: ArmGeometry = PUMA560) -> Array:
    """(3,) mm in the world: where the forearm turns about axis 3; it runs from here to the wrist centre."""
    c1, s1, outward = cos(joints_rad[0]), sin(joints_rad[0]), arm.a2_mm * cos(joints_rad[1])
    elbow = np.array(
        [c1 * outward + s1 * arm.d3_mm, s1 * outward - c1 * arm.d3_mm, arm.a2_mm * sin(joints_rad[1]), 1.0]
    )
    return np.asarray((arm.world_from_base @ elbow)[:3])


def link_frames(joints_rad: Array, arm: ArmGeometry = PUMA560) -> Array:
    """(N, 8, 4, 4) mm at (N, 6) joint angles: world from the base, from links 1 to 6 and from the tool.

    Standard Denavit-Hartenberg: z of frame k - 1 is the axis of joint k, which passes its origin; frame k goes with
    joint k. Frames 4 to 6 have their origin in the wrist centre; frame 3's is beside the elbow, its z the forearm.
    """
    count = len(joints_rad)
    c, s = np.cos(joints_rad), np.sin(joints_rad)
    ct, st = np.round(np.cos(TWISTS_RAD), 12), np.round(np.sin(TWISTS_RAD), 12)
    lengths = np.array([0.0, arm.a2_mm, arm.a3_mm, 0.0, 0.0, 0.0])
    offsets = np.array([0.0, 0.0, arm.d3_mm, arm.d4_mm, 0.0, 0.0])
    step = np.zeros((count, 6, 4, 4))
    step[..., 0, 0], step[..., 0, 1], step[..., 0, 2], step[..., 0, 3] = c, -s * ct, s * st, c * lengths
    step[..., 1, 0], step[..., 1, 1], step[..., 1, 2], step[..., 1, 3] = s, c * ct, -c * st, s * lengths
    step[..., 2, 1], step[..., 2, 2], step[..., 2, 3], step[..., 3, 3] = st, ct, offsets, 1.0
    found = np.empty((count, 8, 4, 4))
    found[:, 0] = arm.world_from_base
    for joint in range(6):
        found[:, joint + 1] = found[:, joint] @ step[:, joint]
    found[:, 7] = found[:, 6] @ arm.flange_from_tool
    return found


def inverse_along(world_from_tool: Array, near_rad: Array, arm: ArmGeometry = PUMA560) -> Array:
    """(N, 6) joint angles along a way of (N, 4, 4) poses, in the configuration of near_rad.

    near_rad (6,): where the way begins; each angle follows the row before (the first one near_rad) by the shorter turn,
    as the arm does that goes the way. near_rad (N, 6): each row follows its own. A row that is out of reach or past a
    joint's limit is nan. At a straight wrist joint 4 is not to be relied on.
    """
    configuration = configuration_of(near_rad.reshape(-1, 6)[0], arm)
    base_from_flange = arm.base_from_world @ world_from_tool @ arm.tool_from_flange
    arm_rad = _arm_angles(base_from_flange[:, :3, 3], configuration, arm)
    q1, q23 = arm_rad[:, 0], arm_rad[:, 1] + arm_rad[:, 2]
    c1, s1, c23, s23 = np.cos(q1), np.sin(q1), np.cos(q23), np.sin(q23)
    forearm = np.array([[c1 * c23, -s1, -c1 * s23], [s1 * c23, c1, -s1 * s23], [s23, np.zeros_like(c1), c23]])
    forearm_from_flange = np.einsum("ijn,nik->njk", forearm, base_from_flange[:, :3, :3])
    joints = np.hstack([arm_rad, _wrist_angles(forearm_from_flange, configuration.flip)])
    if near_rad.ndim == 1:
        known = np.isfinite(joints).all(axis=1)
        joints[known] = np.unwrap(np.vstack([near_rad, joints[known]]), axis=0)[1:]
    else:
        joints -= 2 * pi * np.round((joints - near_rad) / (2 * pi))
    low, high = arm.limits_rad[:, 0] - LIMIT_SLACK_RAD, arm.limits_rad[:, 1] + LIMIT_SLACK_RAD
    joints[~((joints >= low) & (joints <= high)).all(axis=1)] = np.nan
    return joints


def inverse(
    world_from_tool: Array, configuration: Configuration, arm: ArmGeometry = PUMA560, near_rad: Array | None = None
) -> Array:
    """(6,) joint angles within the limits that put the tool at (4, 4) world_from_tool in one configuration.

    near_rad: where the arm is now; each angle is taken as the turn of it nearest to there, and joint 4 is kept
    where it is at a singular wrist (joint 5 at zero), where only joints 4 and 6 together are determined.
    Raises UnreachableError: out of range, or which joint would pass its limit.
    """
    near = np.zeros(6) if near_rad is None else near_rad
    base_from_flange = arm.base_from_world @ world_from_tool @ arm.tool_from_flange
    arm_rad = _arm_angles(base_from_flange[:3, 3], configuration, arm)
    if not np.isfinite(arm_rad).all():
        raise UnreachableError(_out_of_reach(base_from_flange[:3, 3], arm))
    turned = _base_from_forearm(arm_rad, arm)[:3, :3].T @ base_from_flange[:3, :3]
    wrist = _wrist_angles(turned, configuration.flip)
    if hypot(turned[0, 2], turned[1, 2]) < SINGULAR_SIN_Q5:
        rest = _rotation_z(-near[3]) @ turned
        wrist = np.array([near[3], wrist[1], atan2(rest[1, 0], rest[1, 1])])
    raw, limits = [*arm_rad.tolist(), *wrist.tolist()], arm.limits_rad.tolist()
    return np.array([_within(k, raw[k], float(near[k]), *limits[k]) for k in range(6)])


def solutions(
    world_from_tool: Array, arm: ArmGeometry = PUMA560, near_rad: Array | None = None
) -> Iterator[tuple[Configuration, Array]]:
    """Every configuration that reaches the pose within the limits, with its joint angles."""
    for configuration in CONFIGURATIONS:
        try:
            yield configuration, inverse(world_from_tool, configuration, arm, near_rad)
        except UnreachableError:
            continue


def configuration_of(joints_rad: Array, arm: ArmGeometry = PUMA560) -> Configuration:
    """The configuration an arm at (6,) joint angles is in."""
    q2, q3 = joints_rad[1], joints_rad[2]
    outward = arm.a2_mm * cos(q2) + arm.a3_mm * cos(q2 + q3) - arm.d4_mm * sin(q2 + q3)
    bend = sin(q3 + atan2(arm.d4_mm, arm.a3_mm))
    righty = outward >= 0
    return Configuration(lefty=not righty, above=(bend < 0) == righty, flip=sin(joints_rad[4]) > 0)


def wrist_is_singular(joints_rad: Array, within_rad: float = SINGULAR_SIN_Q5) -> bool:
    """Whether axes 4 and 6 lie along each other to within an angle."""
    return abs(sin(joints_rad[4])) < within_rad


def joint_out_of_limits(joints_rad: Array, arm: ArmGeometry = PUMA560) -> int | None:
    """The first joint (1 to 6) past its limit, or None."""
    low, high = arm.limits_rad[:, 0] - LIMIT_SLACK_RAD, arm.limits_rad[:, 1] + LIMIT_SLACK_RAD
    past = np.flatnonzero((joints_rad < low) | (joints_rad > high))
    return int(past[0]) + 1 if past.size else None


def _base_from_forearm(joints_rad: Array, arm: ArmGeometry) -> Array:
    """Frame 3 carried to the wrist centre: (4, 4), z along the forearm."""
    q1, q23 = joints_rad[0], joints_rad[1] + joints_rad[2]
    c1, s1, c23, s23 = cos(q1), sin(q1), cos(q23), sin(q23)
    outward = arm.a2_mm * cos(joints_rad[1]) + arm.a3_mm * c23 - arm.d4_mm * s23
    upward = arm.a2_mm * sin(joints_rad[1]) + arm.a3_mm * s23 + arm.d4_mm * c23
    return np.array(
        [
            [c1 * c23, -s1, -c1 * s23, c1 * outward + s1 * arm.d3_mm],
            [s1 * c23, c1, -s1 * s23, s1 * outward - c1 * arm.d3_mm],
            [s23, 0.0, c23, upward],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def _arm_angles(wrist_mm: Array, configuration: Configuration, arm: ArmGeometry) -> Array:
    """(..., 3): joints 1 to 3 that put the wrist centre at (..., 3) mm in the base frame; nan where none do."""
    x, y, z = wrist_mm[..., 0], wrist_mm[..., 1], wrist_mm[..., 2]
    with np.errstate(invalid="ignore"):
        outward = np.sqrt(x * x + y * y - arm.d3_mm * arm.d3_mm) * (-1.0 if configuration.lefty else 1.0)
        stretch = (outward**2 + z * z - arm.a2_mm**2 - arm.forearm_mm**2) / (2 * arm.a2_mm * arm.forearm_mm)
        bend = np.arccos(np.where(np.abs(stretch) < 1 + 1e-12, np.clip(stretch, -1.0, 1.0), np.nan))
    q3 = (bend if configuration.above == configuration.lefty else -bend) - atan2(arm.d4_mm, arm.a3_mm)
    along = arm.a2_mm + arm.a3_mm * np.cos(q3) - arm.d4_mm * np.sin(q3)
    across = arm.a3_mm * np.sin(q3) + arm.d4_mm * np.cos(q3)
    q1 = np.arctan2(y, x) - np.arctan2(-arm.d3_mm, outward)
    return np.stack([q1, np.arctan2(z, outward) - np.arctan2(across, along), q3], axis=-1)


def _out_of_reach(wrist_mm: Array, arm: ArmGeometry) -> str:
    """Why no joints 1 to 3 put the wrist centre at (3,) mm in the base frame."""
    if hypot(wrist_mm[0], wrist_mm[1]) < abs(arm.d3_mm):
        return "too close to the column"
    far = float(wrist_mm @ wrist_mm) - arm.d3_mm**2 > arm.a2_mm**2 + arm.forearm_mm**2
    return "too far from the shoulder" if far else "too close to the shoulder"


def _wrist_angles(forearm_from_flange: Array, flip: bool) -> Array:
    """(..., 3): joints 4 to 6 that turn the flange by (..., 3, 3) against the forearm: Rz(q4) Ry(-q5) Rz(q6)."""
    r, sign = forearm_from_flange, 1.0 if flip else -1.0
    level = np.hypot(r[..., 0, 2], r[..., 1, 2])
    q4 = np.arctan2(-sign * r[..., 1, 2], -sign * r[..., 0, 2])
    return np.stack(
        [q4, np.arctan2(sign * level, r[..., 2, 2]), np.arctan2(-sign * r[..., 2, 1], sign * r[..., 2, 0])], axis=-1
    )


def _within(joint: int, angle: float, near: float, lowest: float, highest: float) -> float:
    """The turn of angle from lowest to highest that is nearest to near. Raises UnreachableError naming the joint (0 to
    5)."""
    low, high = lowest - LIMIT_SLACK_RAD, highest + LIMIT_SLACK_RAD
    first = angle - 2 * pi * ceil((angle - low) / (2 * pi) - 1e-15)
    turns = [turn for turn in (first + 2 * pi * k for k in range(4)) if low <= turn <= high]
    if not turns:
        raise UnreachableError(f"joint {joint + 1} out of range", joint + 1)
    return min(turns, key=lambda turn: abs(turn - near))


def _rotation_z(angle: float) -> Array:
    c, s = cos(angle), sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _rotation_y(angle: float) -> Array:
    c, s = cos(angle), sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
