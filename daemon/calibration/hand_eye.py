"""Hand-eye calibration: the pose of the cameras on the tool or, where they are fixed, in the world. Pure.

AX = XB by two closed forms, then least squares. Cameras on the hand see a board that lies still, fixed ones a board
that the gripper holds: the same equations with the arm's poses inverted.

Two solvers that share no algebra (relative motions, absolute poses) give a warning when they disagree. The joint
refinement minimises the corners' residuals in px over the hand-eye, the board's pose and one error of the arm a pose,
because an arm errs once a pose and not once a corner. How far it errs is estimated from the poses themselves.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import cv2
import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.arm_error import (
    SHARED,
    ArmError,
    PoseEquations,
    estimated_arm_error,
    motion_by_parameters,
    pose_equations,
    solution,
)
from daemon.calibration.least_squares import Problem, UndeterminedError, chain, minimise, pose_of, solve, transform_of
from daemon.errors import FacetdError
from daemon.vision.geometry import Camera, StereoRig

MIN_POSES = 5
PIXEL_SIGMA = 0.1
"""Standard deviation of a board's corner, px; only its ratio to the arm's error matters."""
MIN_NOISE = 0.1
"""Least noise of the corners, in PIXEL_SIGMA: none in made pictures would leave no doubt at all."""
MIN_TURN_DEG = 12.0
"""Least rms rotation about the second axis that determines the translation."""


class HandEyeError(FacetdError):
    """These poses do not determine the hand-eye; the message says what is missing."""


@dataclass(frozen=True, eq=False)
class Sample:
    """The board seen from one pose of the arm: world_from_tool (4, 4) as the controller reports it; points_mm (N, 3)
    in the board frame; left_px and right_px (N, 2), right None where only one camera is in use; board_in_gripper:
    whether the gripper holds the board and the cameras are fixed."""

    world_from_tool: Array
    points_mm: Array
    left_px: Array
    right_px: Array | None
    board_in_gripper: bool = False

    @property
    def board_from_cameras(self) -> Array:
        """(4, 4) mm, as the controller reports it: from what carries the cameras to what carries the board."""
        return frames.inverse(self.world_from_tool) if self.board_in_gripper else self.world_from_tool


@dataclass(frozen=True, eq=False)
class HandEyeResult:
    """mounting (4, 4): tool_from_cyclopean, or world_from_cyclopean of fixed cameras; covariance (6, 6) of its motion
    (see frames), mm and rad, with what no residual shows (see `_covariance`), of fixed cameras about about_mm (3,),
    world, the middle of where the board was; solvers_mm, solvers_deg: difference of the two closed forms;
    diversity_deg: see `diversity_deg`; left_out_mm: error of each pose when predicted from all others; arm: see
    `estimated_arm_error`."""

    mounting: Array
    covariance: Array
    solvers_mm: float
    solvers_deg: float
    diversity_deg: float
    left_out_mm: tuple[float, ...]
    arm: ArmError
    about_mm: Array | None = None

    @property
    def sigma_mm(self) -> float:
        """Standard deviation of the place, mm, over all three axes."""
        return float(np.sqrt(np.trace(self.covariance[:3, :3])))

    @property
    def sigma_deg(self) -> float:
        """Standard deviation of the orientation, degrees, over all three axes."""
        return frames.rms_deg(self.covariance[3:, 3:])

    @property
    def warning(self) -> str | None:
        """A message where the two closed forms disagree by more than chance, or None."""
        limit_mm, limit_deg = max(2.0, 8 * self.sigma_mm), max(0.3, 8 * self.sigma_deg)
        if self.solvers_mm <= limit_mm and self.solvers_deg <= limit_deg:
            return None
        return (
            f"two solvers disagree by {self.solvers_mm:.1f} mm and {self.solvers_deg:.2f} degrees: "
            "a pose is wrong, or the poses differ by too little rotation"
        )


def diversity_deg(poses: Sequence[Array]) -> float:
    """Rotation of the arm about its second axis: rms angle, degrees; 0 where all rotations are about one axis.

    Square root of the second eigenvalue of the mean of v v^T over the rotation vectors v between all pairs of poses;
    hand-eye calibration needs rotation about two axes (Tsai and Lenz 1989).
    """
    turns = np.array([frames.vector_from_rotation(a[:3, :3].T @ b[:3, :3]) for a, b in combinations(poses, 2)])
    if len(turns) == 0:
        return 0.0
    second = float(np.linalg.eigvalsh(turns.T @ turns / len(turns))[1])
    return float(np.degrees(np.sqrt(max(second, 0.0))))


def cyclopean_from_board(sample: Sample, rig: StereoRig) -> Array:
    """The board's pose in one view, (4, 4) mm: PnP on the left image, refined on the corners of both."""
    start = _pnp(rig.left, sample.points_mm, sample.left_px)

    def problem(x: Array) -> tuple[Array, Array]:
        rows = [_camera_rows(camera, x, sample.points_mm, px) for camera, px in _views(rig, sample)]
        return np.concatenate([r for r, _ in rows]), np.vstack([j for _, j in rows])

    return transform_of(solve(problem, pose_of(start), passes=20).parameters)


def calibrate_hand_eye(samples: Sequence[Sample], rig: StereoRig) -> HandEyeResult:
    """Solve for the hand-eye and refine it on all corners, with standard deviations. Raises HandEyeError."""
    if len(samples) < MIN_POSES:
        raise HandEyeError(f"{len(samples)} poses, {MIN_POSES} are needed")
    arm = [s.board_from_cameras for s in samples]
    turned = diversity_deg(arm)
    if turned < MIN_TURN_DEG:
        raise HandEyeError(
            f"the arm turned by {turned:.1f} degrees about its second axis, {MIN_TURN_DEG:g} are needed: "
            "tilt the gripper about two directions, not one"
        )
    camera = [cyclopean_from_board(s, rig) for s in samples]
    first, second = park_martin(arm, camera), shah(arm, camera)
    boards = [a @ first @ e for a, e in zip(arm, camera, strict=True)]
    board, _ = frames.fuse(boards, [np.eye(6)] * len(boards))
    parameters, poses = _joint(samples, rig, _start(first, board, len(samples)))
    try:
        arm_error = estimated_arm_error(poses, ArmError())
        step, covariance = solution(poses, arm_error)
    except UndeterminedError as error:
        raise HandEyeError(
            f"the poses do not determine the hand-eye ({error}): turn the gripper about more axes"
        ) from None
    shared = parameters[:SHARED] + step
    mounting = transform_of(shared[:6])
    about_mm = _middle(samples, transform_of(shared[6:])) if samples[0].board_in_gripper else None
    return HandEyeResult(
        mounting=mounting,
        about_mm=about_mm,
        covariance=_covariance(shared[:6], covariance[:6, :6], arm_error, about_mm),
        solvers_mm=float(np.linalg.norm(first[:3, 3] - second[:3, 3])),
        solvers_deg=float(np.degrees(frames.angle_between(first, second))),
        diversity_deg=turned,
        left_out_mm=tuple(
            _left_out_mm(sample, seen, parameters[:SHARED] + solution([*poses[:k], *poses[k + 1 :]], arm_error)[0])
            for k, (sample, seen) in enumerate(zip(samples, camera, strict=True))
        ),
        arm=arm_error,
    )


def _joint(samples: Sequence[Sample], rig: StereoRig, start: Array) -> tuple[Array, list[PoseEquations]]:
    """Parameters of the joint solution, and the equations of each pose there, weighed by the corners' own noise."""
    parameters, residuals, jacobian = minimise(hand_eye_problem(samples, rig, ArmError()), start)
    ends = np.cumsum([6 * len(samples), *(2 * len(px) for s in samples for _, px in _views(rig, s))])
    first, each = ends[0], len(_views(rig, samples[0]))
    rows = [slice(int(low), int(high)) for low, high in pairwise(ends[::each])]
    corners = residuals[first:]
    sigma = float(np.sqrt((corners**2).sum() / max(len(corners) - len(parameters), 1)))
    scaled = max(sigma, MIN_NOISE)
    return parameters, pose_equations(jacobian / scaled, residuals / scaled, parameters, rows)


def _covariance(pose: Array, covariance: Array, arm: ArmError, about_mm: Array | None) -> Array:
    """Covariance (6, 6) of the mounting's motion from that of its parameters, with what no residual shows: an error of
    the arm that all poses share. In the tool frame (the last joint's zero, the TOOL) it moves cameras on the hand as a
    whole, about the tool's origin; of fixed cameras it counts where the board was, about_mm (3,)."""
    slope, about = motion_by_parameters(pose), np.eye(6)
    if about_mm is not None:
        about[:3] = frames.point_motion((about_mm - pose[3:])[None])[0]
    found = about @ slope @ covariance @ slope.T @ about.T
    common = np.diag(np.roll(arm.variances(), 3))
    if about_mm is None:
        return np.asarray(found + frames.lever_covariance(transform_of(pose), common, np.eye(4)))
    return np.asarray(found + common)


def _start(tool_from_cyclopean: Array, world_from_board: Array, count: int) -> Array:
    return np.concatenate([pose_of(tool_from_cyclopean), pose_of(world_from_board), np.zeros(6 * count)])


def _middle(samples: Sequence[Sample], tool_from_board: Array) -> Array:
    """(3,) world mm: the middle of all places of a board that the gripper held."""
    places = [frames.apply(s.world_from_tool @ tool_from_board, s.points_mm.mean(axis=0)) for s in samples]
    return np.asarray(np.mean(places, axis=0))


def park_martin(world_from_tool: Sequence[Array], cyclopean_from_board_: Sequence[Array]) -> Array:
    """tool_from_cyclopean from all relative motions: A X = X B, rotation by logarithms, then translation.

    Source: Park and Martin, Robot sensor calibration: solving AX = XB on the Euclidean group, IEEE TRA 10(5), 1994.
    """
    motions = [
        (
            frames.inverse(world_from_tool[j]) @ world_from_tool[i],
            cyclopean_from_board_[j] @ frames.inverse(cyclopean_from_board_[i]),
        )
        for i, j in combinations(range(len(world_from_tool)), 2)
    ]
    outer = np.zeros((3, 3))
    for a, b in motions:
        outer += np.outer(frames.vector_from_rotation(a[:3, :3]), frames.vector_from_rotation(b[:3, :3]))
    rotation = frames.nearest_rotation(outer)
    left = np.vstack([a[:3, :3] - np.eye(3) for a, _ in motions])
    right = np.concatenate([rotation @ b[:3, 3] - a[:3, 3] for a, b in motions])
    return frames.rigid(rotation, np.linalg.lstsq(left, right, rcond=None)[0])


def shah(world_from_tool: Sequence[Array], cyclopean_from_board_: Sequence[Array]) -> Array:
    """tool_from_cyclopean from absolute poses: A X = Z B^-1 with X hand-eye and Z the board in the world.

    Source: Shah, Solving the robot-world/hand-eye calibration problem using the Kronecker product, J. Mechanisms and
    Robotics 5(3), 2013.
    """
    total = np.zeros((9, 9))
    inverse = [frames.inverse(e) for e in cyclopean_from_board_]
    for a, b in zip(world_from_tool, inverse, strict=True):
        total += np.kron(b[:3, :3], a[:3, :3])
    u, _, vt = np.linalg.svd(total)
    either = np.stack([vt[0].reshape(3, 3).T, u[:, 0].reshape(3, 3).T])
    x, z = frames.nearest_rotation(either * np.sign(np.linalg.det(either))[:, None, None])
    rows = [np.hstack([-a[:3, :3], np.eye(3)]) for a in world_from_tool]
    right = [a[:3, 3] - z @ b[:3, 3] for a, b in zip(world_from_tool, inverse, strict=True)]
    shifts = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=None)[0]
    return frames.rigid(x, shifts[:3])


def hand_eye_problem(samples: Sequence[Sample], rig: StereoRig, arm: ArmError) -> Problem:
    """Parameters: tool_from_cyclopean (6), world_from_board (6), then the arm's error (6) of each sample. Of fixed
    cameras: world_from_cyclopean, tool_from_board.

    Poses are rotation vector and translation, the arm's error in the tool frame. Residuals are in standard deviations:
    corners over PIXEL_SIGMA, the arm's errors over `arm`. Without the latter, one pose's error would count once a
    corner.
    """
    arm_error = np.array([np.radians(arm.deg)] * 3 + [arm.mm] * 3)

    def problem(x: Array) -> tuple[Array, Array]:
        residuals, jacobians = [x[12:] / np.tile(arm_error, len(samples))], [np.zeros((6 * len(samples), len(x)))]
        jacobians[0][:, 12:] = np.diag(np.tile(1 / arm_error, len(samples)))
        mounting, by_mounting = _inverted(x[:6])
        for k, sample in enumerate(samples):
            own = slice(12 + 6 * k, 18 + 6 * k)
            reported = pose_of(frames.inverse(sample.board_from_cameras))
            if sample.board_in_gripper:
                to_tool, by_first, by_own = chain(x[6:12], x[own])
                there, by_then, _ = chain(to_tool, reported)
                by_board, by_error = by_then @ by_first, by_then @ by_own
            else:
                to_reported, by_first, _ = chain(x[6:12], reported)
                there, by_then, by_error = chain(to_reported, x[own])
                by_board = by_then @ by_first
            to_cyclopean, by_place, by_inverse = chain(there, mounting)
            for camera, px in _views(rig, sample):
                errors, by_pose = _camera_rows(camera, to_cyclopean, sample.points_mm, px)
                rows = np.zeros((len(errors), len(x)))
                rows[:, :6] = by_pose @ by_inverse @ by_mounting
                rows[:, 6:12] = by_pose @ by_place @ by_board
                rows[:, own] = by_pose @ by_place @ by_error
                residuals.append(errors / PIXEL_SIGMA)
                jacobians.append(rows / PIXEL_SIGMA)
        return np.concatenate(residuals), np.vstack(jacobians)

    return problem


def _inverted(pose: Array) -> tuple[Array, Array]:
    """Inverse of a pose (6,) and its Jacobian (6, 6): r' = -r, t' = -R(r)^T t."""
    back, slope = cv2.Rodrigues(-pose[:3])
    jacobian = np.zeros((6, 6))
    jacobian[:3, :3] = -np.eye(3)
    jacobian[3:, 3:] = -back
    # slope is (3, 9) by rows of the matrix (OpenCV); d(-R t)/dr' = -sum over columns, and dr'/dr = -1.
    jacobian[3:, :3] = np.einsum("kij,j->ik", slope.reshape(3, 3, 3), pose[3:])
    return np.concatenate([-pose[:3], -back @ pose[3:]]), jacobian


def _camera_rows(camera: Camera, cyclopean_pose: Array, points: Array, px: Array) -> tuple[Array, Array]:
    """Residuals (2N,) px of one camera and their Jacobian (2N, 6) by a pose (6,) of cyclopean_from_points."""
    pose, by_pose, _ = chain(cyclopean_pose, pose_of(frames.inverse(camera.cyclopean_from_camera)))
    image, jacobian = cv2.projectPoints(points, pose[:3], pose[3:], camera.matrix, camera.distortion)
    return (np.asarray(image, float).reshape(-1, 2) - px).ravel(), np.asarray(jacobian[:, :6], float) @ by_pose


def _views(rig: StereoRig, sample: Sample) -> list[tuple[Camera, Array]]:
    right = [] if sample.right_px is None else [(rig.right, sample.right_px)]
    return [(rig.left, sample.left_px), *right]


def _pnp(camera: Camera, points: Array, px: Array) -> Array:
    found, turn, shift = cv2.solvePnP(points, px, camera.matrix, camera.distortion, flags=cv2.SOLVEPNP_IPPE)
    if not found:
        raise HandEyeError("the board's pose cannot be determined in one view: its corners are nearly on a line")
    camera_from_board = frames.rigid(frames.rotation_from_vector(np.ravel(turn)), np.ravel(shift))
    return camera.cyclopean_from_camera @ camera_from_board


def _left_out_mm(sample: Sample, cyclopean_from_board_: Array, others: Array) -> float:
    """Distance of the board's corners seen from one pose to where all other poses put them, rms mm."""
    seen = sample.board_from_cameras @ transform_of(others[:6]) @ cyclopean_from_board_
    gaps = frames.apply(seen, sample.points_mm) - frames.apply(transform_of(others[6:12]), sample.points_mm)
    return float(np.sqrt((gaps**2).sum(axis=1).mean()))
