"""Forward kinematics of many PUMA-like arms at once, for each way of counting the joints. Pure.

Angles are those of the standard Denavit-Hartenberg table in drivers/puma560.py. Parameters (M, 18) are in the order of
NAMES, rad and mm. arm_from_readings.py finds the arm that made given readings.
"""

from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.arrays import Array

NAMES = ("zero_1", "zero_2", "zero_23", "zero_4", "zero_5", "a2", "a3", "d3", "d4",
         "tool_turn_x", "tool_turn_y", "tool_turn_z", "tool_x", "tool_y", "tool_z",
         "base_x", "base_y", "base_z")  # fmt: skip
"""The parameters of one arm, in order."""


@dataclass(frozen=True)
class Convention:
    """How a controller counts joints. signs (6,): +1 or -1. against_horizon: joint 3 is measured from the horizon, not
    from the upper arm."""

    signs: tuple[float, ...]
    against_horizon: bool


def about_z(angle: Array | float) -> Array:
    """Rotation matrices (..., 3, 3)."""
    return _turned(angle, 0, 1)


def about_y(angle: Array | float) -> Array:
    """Rotation matrices (..., 3, 3)."""
    return _turned(angle, 2, 0)


def _turned(angle: Array | float, first: int, second: int) -> Array:
    """The rotations that turn the first axis towards the second. Filled in place: each trial of a fit makes many."""
    turn = np.zeros((*np.shape(angle), 3, 3))
    turn[..., first, first] = turn[..., second, second] = np.cos(angle)
    turn[..., second, first] = np.sin(angle)
    turn[..., first, second] = -turn[..., second, first]
    turn[..., 3 - first - second, 3 - first - second] = 1.0
    return turn


def arm_angles(zeros: Array, convention: Convention, printed: Array) -> tuple[Array, ...]:
    """Reported joint angles -> q1, q2, q2 + q3, q4, q5, q6, each (M, N). zeros (M, 5): of joints 1, 2, 2 + 3, 4 and 5;
    the tool's rotation contains joint 6's."""
    p = printed * np.array(convention.signs)
    both = p[:, 2] if convention.against_horizon else p[:, 1] + p[:, 2]
    counted = np.stack([p[:, 0], p[:, 1], both, p[:, 3], p[:, 4]])
    q = counted[None] + zeros[:, :, None]
    return q[:, 0], q[:, 1], q[:, 2], q[:, 3], q[:, 4], np.broadcast_to(p[:, 5], q[:, 0].shape)


def flange_turns(q: tuple[Array, ...]) -> Array:
    """Orientation of the flange, (M, N, 3, 3)."""
    q1, _, q23, q4, q5, q6 = q
    return about_z(q1) @ about_y(-q23) @ about_z(q4) @ about_y(-q5) @ about_z(q6)


def tool_places(x: Array, convention: Convention, printed: Array) -> tuple[Array, Array]:
    """Orientation (M, N, 3, 3) and position (M, N, 3) mm of the tool, for parameters (M, 18)."""
    q = arm_angles(x[:, :5], convention, printed)
    q1, q2, q23 = q[:3]
    a2, a3, d3, d4 = (x[:, k, None] for k in range(5, 9))
    turned = flange_turns(q)
    tool = frames.rotations_from_vectors(x[:, 9:12])
    outward = a2 * np.cos(q2) + a3 * np.cos(q23) - d4 * np.sin(q23)
    upward = a2 * np.sin(q2) + a3 * np.sin(q23) + d4 * np.cos(q23)
    c, s = np.cos(q1), np.sin(q1)
    wrist = np.stack([c * outward + s * d3, s * outward - c * d3, upward], -1)
    places = x[:, None, 15:18] + wrist + np.einsum("mnij,mj->mni", turned, x[:, 12:15])
    return turned @ tool[:, None], places
