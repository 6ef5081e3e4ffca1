"""Which poses of the arm tell most about the hand-eye: an optimal design of experiment. Pure.

Each candidate pose adds its information to that of the poses before it; the next one is that which leaves the least
error where parts are. What a pose adds is what arm_error's normal equations of it would, with some of the board's
corners for all.

Source: sequential optimal design (Fedorov, Theory of Optimal Experiments, 1972), with the trace of a point's covariance
as the criterion.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.arm_error import SHARED, ArmError
from daemon.calibration.hand_eye import PIXEL_SIGMA
from daemon.vision.geometry import StereoRig

FEW = 9
"""Number of corners, spread over the board, that stand for all of it."""
RULER = (20.0, 0.2)
"""Standard deviations of a hand-eye entered by ruler, and of the board's place by it: mm and rad an axis."""


@dataclass(frozen=True, eq=False)
class Setup:
    """A hand-eye to be made surer: mounting (4, 4), tool_from_cyclopean, or of fixed cameras (board_in_gripper: the
    gripper holds the board) world_from_cyclopean; rest (4, 4): world_from_board, or with the board in the gripper
    tool_from_board; points_mm (N, 3), board frame; at_mm (3,): where parts are, in the frame the mounting is given
    in; cameras: 1 or 2 of the rig's."""

    rig: StereoRig
    mounting: Array
    rest: Array
    points_mm: Array
    at_mm: Array
    board_in_gripper: bool
    arm: ArmError
    cameras: int = 2


def information(setup: Setup, world_from_tools: Sequence[Array] | Array) -> tuple[Array, Array]:
    """(K, 12, 12) information of a view from each pose about mounting and rest, the arm's error of that pose free; (K,)
    whether the whole board is in all pictures there."""
    poses = np.array(world_from_tools).reshape(-1, 4, 4)
    carried = (
        poses if setup.board_in_gripper else frames.inverse(poses)
    )  # from where the board rests to what carries the cameras
    some = setup.points_mm[:: max(1, len(setup.points_mm) // FEW)]
    placed = frames.apply(setup.rest, some)
    turns = carried[:, None, :3, :3]
    there = (turns @ placed[..., None])[..., 0] + carried[:, None, :3, 3]
    by_rest = turns @ frames.point_motion(placed - setup.rest[:3, 3])
    by_arm = turns @ frames.point_motion(placed) if setup.board_in_gripper else frames.point_motion(there)
    motion = np.concatenate([frames.point_motion(there - setup.mounting[:3, 3]), -by_rest, by_arm], axis=-1)
    back = setup.mounting[:3, :3].T
    seen = np.einsum("ij,kpj->kpi", back, there - setup.mounting[:3, 3])
    motion = back @ motion
    total, in_view = np.zeros((len(poses), 18, 18)), (seen[..., 2] > 0).all(axis=1)
    for camera in (setup.rig.left, setup.rig.right)[: setup.cameras]:
        px, slope = camera.project_with_slope(seen)
        rows = slope.reshape(*seen.shape[:2], 2, 3) @ motion
        total += np.einsum("kpil,kpim->klm", rows, rows) * (len(setup.points_mm) / len(some) / PIXEL_SIGMA**2)
        in_view &= ((px >= 0) & (px < setup.rig.image_size)).all(axis=1).reshape(seen.shape[:2]).all(axis=1)
    own = total[:, SHARED:, SHARED:] + np.diag(1.0 / np.roll(setup.arm.variances(), 3))
    cross = total[:, :SHARED, SHARED:]
    return total[:, :SHARED, :SHARED] - cross @ np.linalg.solve(own, cross.transpose(0, 2, 1)), in_view


def error_mm(setup: Setup, total: Array) -> Array:
    """(...) rms error of a part's place in mm that information (..., 12, 12) leaves, on top of a hand-eye by ruler."""
    by_ruler = np.diag(np.tile(np.repeat(np.reciprocal(RULER) ** 2, 3), 2))
    covariance = np.linalg.inv(total + by_ruler)[..., :6, :6]
    lever = frames.point_motion((setup.at_mm - setup.mounting[:3, 3])[None])[0]  # (3, 6): of a part's place
    return np.asarray(np.sqrt(np.einsum("il,...lm,im->...", lever, covariance, lever)))


def most_informative(
    setup: Setup, poses: Sequence[Array] | Array, count: int, allowed: Callable[[Array], bool], done: Sequence[Array]
) -> list[int]:
    """Choose the poses world_from_tool to view from: at most `count` allowed ones, each the one that leaves the least
    error after those done and all chosen before. Calls `allowed` only for a pose that it would choose next."""
    adds, in_view = information(setup, poses)
    total = information(setup, done)[0].sum(axis=0)
    remaining = np.flatnonzero(in_view)
    chosen: list[int] = []
    while len(remaining) and len(chosen) < count:
        by_error = np.argsort(error_mm(setup, total + adds[remaining]))
        k = next((k for k in by_error if allowed(poses[remaining[k]])), None)
        if k is None:
            break
        chosen.append(int(remaining[k]))
        total = total + adds[remaining[k]]
        remaining = np.delete(remaining, k)
    return chosen
