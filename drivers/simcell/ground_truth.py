"""Ground truth of the simulated cell, for demos and tests; never for the daemon's decisions."""

from collections.abc import Callable

import numpy as np

from drivers.arrays import Array
from drivers.rigid import angle_of, apply, rigid
from drivers.simcell.controller import Machine
from drivers.simcell.history import MotionRecord
from drivers.simcell.parts import hull
from drivers.simcell.truth import Truth
from drivers.simcell.world import Closing, World

MATCHING_ROUNDS = 10


class GroundTruth:
    """The true motions, grasps and poses, with all errors of arm and hand-eye."""

    def __init__(self, truth: Truth, world: World, machine: Machine, world_from_tool: Callable[[], Array]) -> None:
        """machine: the controller's present state (speed_percent, arm.tool, hand_closed, arm_power)."""
        self.settings, self.machine = truth, machine
        self._world, self._world_from_tool = world, world_from_tool

    @property
    def motions(self) -> tuple[MotionRecord, ...]:
        """All motions of the arm, oldest first."""
        return tuple(event for event in self.machine.history if isinstance(event, MotionRecord))

    @property
    def grasps(self) -> tuple[Closing, ...]:
        """All closings of the jaws, oldest first."""
        return tuple(self._world.closings)

    def corners(self, name: str) -> Array:
        """Corners (V, 3), world mm, of the part of that name (not label)."""
        part = next(part for part in self._world.parts if part.name == name)
        return apply(part.world_from_part(self._world_from_tool()), part.shape.hull.vertices)

    def grasp_pose_error(self, expected_corners_tool_mm: Array) -> tuple[float, float]:
        """Error (mm, degrees) of the expected corners (N, 3) at the last closing, in the tool frame, before the jaws
        moved the part. Raises ValueError where the jaws closed on nothing.
        """
        closing = self._world.closings[-1] if self._world.closings else None
        if closing is None or closing.part is None or closing.grip is None:
            raise ValueError("the gripper last closed on no part")
        found = apply(closing.grip.tool_from_part_before, closing.part.shape.hull.vertices)
        return pose_error(expected_corners_tool_mm, found)


def pose_error(claimed_mm: Array, true_mm: Array, axis: Array | None = None) -> tuple[float, float]:
    """Error (mm at the middle, degrees) of claimed corners (N, 3) against those of the true hull (V, 3), matched by
    iterated closest points; N >= 3. Claimed corners within their own hull have no match there, and are left out. axis:
    unit direction (3,) about which a turn is no error.
    """
    claimed_mm = claimed_mm[sorted({corner for face in hull(claimed_mm).faces for corner in face})]
    moved = claimed_mm
    for _ in range(MATCHING_ROUNDS):
        nearest = np.argmin(np.linalg.norm(moved[:, None] - true_mm[None], axis=2), axis=1)
        true_from_claimed = fit(claimed_mm, true_mm[nearest])
        moved = apply(true_from_claimed, claimed_mm)
    middle = claimed_mm.mean(axis=0)
    shift = apply(true_from_claimed, middle) - middle
    turned = angle_of(true_from_claimed)
    if axis is not None:
        tilted = true_from_claimed[:3, :3] @ axis
        turned = float(np.arctan2(np.linalg.norm(np.cross(axis, tilted)), axis @ tilted))
    return float(np.linalg.norm(shift)), float(np.degrees(turned))


def fit(start: Array, end: Array) -> Array:
    """Rigid transform (4, 4) from (N, 3) points start to end with least squared error (Kabsch)."""
    a, b = start.mean(axis=0), end.mean(axis=0)
    u, _, vt = np.linalg.svd((start - a).T @ (end - b))
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    rotation = vt.T @ flip @ u.T
    return rigid(rotation, b - rotation @ a)
