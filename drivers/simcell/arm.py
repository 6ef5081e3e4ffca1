"""Simulated arm: joint angles over time, trapezoidal motion between poses. Time is an argument.

The pose that the controller reports (`reported_*`) differs from the true one (`pose_at`) by joint offsets and the
repeatability of each stop. A motion is an immutable value, so that another thread (a camera) can read the pose while
the controller moves the arm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from drivers.arrays import Array
from drivers.puma560 import (
    NEST_RAD,
    ArmGeometry,
    Configuration,
    UnreachableError,
    configuration_of,
    forward,
    inverse,
    joint_out_of_limits,
    wrist_is_singular,
)
from drivers.rigid import axis_and_angle, rigid, turn

JOINT_SPEED_RAD_S = np.radians([82.0, 74.0, 122.0, 228.0, 241.0, 228.0])
JOINT_ACCELERATION_RAD_S2 = JOINT_SPEED_RAD_S / 0.25
LINE_SPEED_MM_S, LINE_ACCELERATION_MM_S2 = 500.0, 2000.0
TURN_SPEED_RAD_S, TURN_ACCELERATION_RAD_S2 = 1.6, 6.4
EMERGENCY_BRAKING = 4.0
WRIST_TOO_STRAIGHT_RAD = np.radians(1.0)
CHECKS = 40
"""Number of points of a straight line at which the joints are solved in advance."""


class SingularWristError(UnreachableError):
    """A straight line passes a wrist singularity, where joints 4 and 6 would turn without bound."""


@dataclass(frozen=True)
class Trapezoid:
    """Trapezoidal velocity profile over a path of length 1, with speed in 1/s and acceleration in 1/s2.

    cut_s: when an early braking begins (None: none), at `braking` times the acceleration.
    """

    speed: float
    acceleration: float
    cut_s: float | None = None
    braking: float = 1.0

    @property
    def _peak(self) -> float:
        return min(self.speed, sqrt(self.acceleration))

    @property
    def _natural_s(self) -> float:
        return self._peak / self.acceleration + 1.0 / self._peak

    @property
    def duration_s(self) -> float:
        """From start to rest."""
        if self.cut_s is None:
            return self._natural_s
        return min(self._natural_s, self.cut_s + self._velocity(self.cut_s) / (self.acceleration * self.braking))

    def _velocity(self, t_s: float) -> float:
        return max(0.0, min(self.acceleration * t_s, self._peak, self.acceleration * (self._natural_s - t_s)))

    def _natural_way(self, t_s: float) -> float:
        ramp_s, end_s = self._peak / self.acceleration, self._natural_s
        if t_s <= ramp_s:
            return self.acceleration * t_s**2 / 2
        if t_s <= end_s - ramp_s:
            return self._peak * (t_s - ramp_s / 2)
        return 1.0 - self.acceleration * (end_s - t_s) ** 2 / 2

    def way(self, t_s: float) -> float:
        """Share of the path covered after t_s, 0 to 1."""
        t_s = min(max(t_s, 0.0), self.duration_s)
        if self.cut_s is None or t_s <= self.cut_s:
            return self._natural_way(t_s)
        since = t_s - self.cut_s
        braked = self._velocity(self.cut_s) * since - self.acceleration * self.braking * since**2 / 2
        return min(1.0, self._natural_way(self.cut_s) + braked)

    def cut(self, t_s: float, braking: float) -> Trapezoid:
        """The same profile, braked from t_s on, or from an earlier cut on."""
        if t_s >= self.duration_s or (self.cut_s is not None and self.cut_s <= t_s):
            return self
        return replace(self, cut_s=max(t_s, 0.0), braking=braking)


@dataclass(frozen=True, eq=False)
class Motion:
    """One motion: joints (6,) rad along a path from 0 to 1, started at started_s.

    scatter_mm (2, 3): offset of the true tool from its path at the start and at the end.
    """

    path: Callable[[float], Array]
    profile: Trapezoid
    started_s: float
    scatter_mm: Array

    @property
    def ends_s(self) -> float:
        """When the arm is at rest."""
        return self.started_s + self.profile.duration_s

    def cut(self, now_s: float, braking: float = 1.0) -> Motion:
        """The same motion, braked from now_s on."""
        return replace(self, profile=self.profile.cut(now_s - self.started_s, braking))

    def uncut(self) -> Motion:
        """The motion as commanded, without braking."""
        return replace(self, profile=replace(self.profile, cut_s=None))

    def joints_at(self, now_s: float) -> Array:
        """Joint angles (6,) rad."""
        return self.path(self.profile.way(now_s - self.started_s))

    def scatter_at(self, now_s: float) -> Array:
        """(3,) mm."""
        way = self.profile.way(now_s - self.started_s)
        return np.asarray((1 - way) * self.scatter_mm[0] + way * self.scatter_mm[1])


class SimulatedArm:
    """A moving PUMA. Lengths mm, angles rad, times on the caller's clock.

    geometry: the controller's base and tool; changing it (TOOL, BASE) does not move the arm.
    """

    def __init__(
        self,
        geometry: ArmGeometry | None = None,
        joints_rad: Array = NEST_RAD,
        joint_offsets_rad: Array | None = None,
        repeatability_mm: float = 0.0,
        rng: np.random.Generator | None = None,
    ) -> None:
        """joint_offsets_rad (6,): true minus reported angle. repeatability_mm: standard deviation of a stop, per axis.
        geometry: also the true one.
        """
        self.geometry = self.true_geometry = geometry or ArmGeometry()
        self.joint_offsets_rad = (
            np.zeros(6) if joint_offsets_rad is None else np.asarray(joint_offsets_rad, dtype=float)
        )
        self._repeatability_mm = repeatability_mm
        self._rng = rng or np.random.default_rng(0)
        self.motion = standing(np.array(joints_rad, dtype=float))
        """The motion under way or, at rest, the last one."""

    @property
    def tool(self) -> Array:
        """The controller's TOOL, from its own flange: (4, 4) mm."""
        return self.geometry.tool_for_controller

    @tool.setter
    def tool(self, tool: Array) -> None:
        self.geometry = replace(self.geometry, flange_from_tool=self.geometry.controller_flange @ tool)

    def joints_at(self, now_s: float) -> Array:
        """The reported joint angles (6,) rad."""
        return self.motion.joints_at(now_s)

    def reported_pose_at(self, now_s: float) -> Array:
        """world_from_tool (4, 4) as the controller reports it."""
        return forward(self.joints_at(now_s), self.geometry)

    def pose_at(self, now_s: float) -> Array:
        """The true world_from_tool (4, 4), with joint offsets and the scatter of the stop."""
        motion = self.motion
        pose = forward(motion.joints_at(now_s) + self.joint_offsets_rad, self.true_geometry)
        pose[:3, 3] += motion.scatter_at(now_s)
        return pose

    def at_rest(self, now_s: float) -> bool:
        return now_s >= self.rests_s

    @property
    def rests_s(self) -> float:
        """When the motion under way ends (in the past when none is)."""
        return self.motion.ends_s

    def move_joints(self, target_rad: Array, speed: float, now_s: float) -> None:
        """Start a joint-interpolated motion to (6,) rad; all joints start and end together.

        speed: share of full speed, 0 to 1. Raises UnreachableError past a joint's limit.
        """
        self._start(*plan_joints(self.joints_at(now_s), target_rad, speed, self.geometry), now_s)

    def joints_for(self, world_from_tool: Array, configuration: Configuration, now_s: float) -> Array:
        """Joints (6,) rad that reach a pose, nearest to the present ones. Raises UnreachableError."""
        return inverse(world_from_tool, configuration, self.geometry, self.joints_at(now_s))

    def move_straight(self, world_from_tool: Array, speed: float, now_s: float) -> None:
        """Start a motion along a straight line, turning evenly. Raises UnreachableError, SingularWristError."""
        self._start(*plan_straight(self.joints_at(now_s), world_from_tool, speed, self.geometry), now_s)

    def halt(self, now_s: float, braking: float = 1.0) -> None:
        """Come to rest along the path; braking: times the usual deceleration."""
        self.motion = self.motion.cut(now_s, braking)

    def _start(self, path: Callable[[float], Array], profile: Trapezoid, now_s: float) -> None:
        scatter_mm = np.stack([self.motion.scatter_at(now_s), self._rng.normal(0.0, 1.0, 3) * self._repeatability_mm])
        self.motion = Motion(path, profile, now_s, scatter_mm)


def plan_joints(
    start_rad: Array, target_rad: Array, speed: float, geometry: ArmGeometry
) -> tuple[Callable[[float], Array], Trapezoid]:
    """The path and profile of a joint-interpolated motion; the slowest joint sets the pace."""
    joint = joint_out_of_limits(target_rad, geometry)
    if joint is not None:
        raise UnreachableError(f"joint {joint} out of range", joint)
    change = target_rad - start_rad
    reach = np.maximum(np.abs(change), 1e-12)
    profile = Trapezoid(
        speed=float(np.min(JOINT_SPEED_RAD_S / reach)) * speed,
        acceleration=float(np.min(JOINT_ACCELERATION_RAD_S2 / reach)) * speed,
    )
    return lambda way: start_rad + way * change, profile


def plan_straight(
    start_rad: Array, world_from_tool: Array, speed: float, geometry: ArmGeometry
) -> tuple[Callable[[float], Array], Trapezoid]:
    """The path and profile of a straight-line motion in the arm's present configuration.

    The joints are solved at CHECKS + 1 points; between them they follow from the pose, seeded by the nearest point.
    Raises UnreachableError where the line leaves reach, SingularWristError where it passes a straight wrist.
    """
    start = forward(start_rad, geometry)
    configuration = configuration_of(start_rad, geometry)
    axis, angle = axis_and_angle(start[:3, :3].T @ world_from_tool[:3, :3])
    shift = world_from_tool[:3, 3] - start[:3, 3]

    def pose(way: float) -> Array:
        return rigid(start[:3, :3] @ turn(axis, angle * way), start[:3, 3] + shift * way)

    knots = [start_rad]
    for k in range(1, CHECKS + 1):
        knots.append(inverse(pose(k / CHECKS), configuration, geometry, knots[-1]))
        if wrist_is_singular(knots[-1], WRIST_TOO_STRAIGHT_RAD) and not np.allclose(knots[-1], start_rad):
            raise SingularWristError("the wrist is straight on the way")
        if np.max(np.abs(knots[-1] - knots[-2])) > np.radians(45):
            raise SingularWristError("the wrist would flip on the way")

    def path(way: float) -> Array:
        return inverse(pose(way), configuration, geometry, knots[round(way * CHECKS)])

    distance = max(float(np.linalg.norm(shift)), 1e-9)
    turned = max(angle, 1e-9)
    step = max(float(np.max(np.abs(np.diff(knots, axis=0)) / JOINT_SPEED_RAD_S)) * CHECKS, 1e-9)
    profile = Trapezoid(
        speed=speed * min(LINE_SPEED_MM_S / distance, TURN_SPEED_RAD_S / turned, 1.0 / step),
        acceleration=speed * min(LINE_ACCELERATION_MM_S2 / distance, TURN_ACCELERATION_RAD_S2 / turned, 4.0 / step),
    )
    return path, profile


def standing(joints_rad: Array, since_s: float = float("-inf"), seconds: float = 0.0) -> Motion:
    """A motion without displacement, of some duration."""
    profile = Trapezoid(1 / max(seconds, 1e-9), 1e12)
    return Motion(lambda way: joints_rad.copy(), profile, since_s, np.zeros((2, 3)))
