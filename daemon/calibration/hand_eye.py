"""Where the cameras sit on the tool: AX = XB by two closed forms, then one least squares on everything. Pure.

Two solvers that share no algebra (relative motions, and absolute poses) warn when they disagree. The joint refinement
minimises what was measured, corners in px, over the hand-eye and the board's place. Standard deviations come from
leaving out one pose after the other, because an arm errs once a pose and not once a corner.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.least_squares import Problem, UndeterminedError, chain, pose_of, solve, transform_of
from daemon.errors import FacetdError
from daemon.vision.geometry import Camera, StereoRig

FEWEST_POSES = 5
BLOCKS = 6
PIXEL_SIGMA = 0.1
"""What a board's corner is worth, px; only its ratio to the arm's doubt matters."""
ROUNDS = 8
"""Of finding how far the arm errs; the last ones change it by less than a tenth."""
LEAST_TURN_DEG = 12.0
"""Two rotations about axes that differ must be at least this large, as root mean squares, for translation to show."""


class HandEyeError(FacetdError):
    """These poses fix no hand-eye; the message says what is missing."""


@dataclass(frozen=True, eq=False)
class Sample:
    """The board seen while the arm stood: world_from_tool (4, 4) by the controller's word; points_mm (N, 3) in the
    board frame; left_px and right_px (N, 2), None where there is one eye, the left."""

    world_from_tool: Array
    points_mm: Array
    left_px: Array
    right_px: Array | None


@dataclass(frozen=True)
class ArmDoubt:
    """One standard deviation of where the arm stands from where the controller says, per axis: mm and degrees."""

    mm: float = 0.1
    deg: float = 0.03


@dataclass(frozen=True, eq=False)
class HandEyeResult:
    """tool_from_cyclopean (4, 4); sigma_mm, sigma_deg: one standard deviation of the hand-eye over
    all axes (jackknife, and what no residual shows: see `_with_hidden`); reprojection_px rms per point; solvers_mm,
    solvers_deg: how far the two closed forms differ; diversity_deg: see `diversity_deg`; left_out_mm: what each pose,
    predicted by all others, was off by; arm: what the arm was off its word by (see `arms_own`).
    """

    tool_from_cyclopean: Array
    sigma_mm: float
    sigma_deg: float
    reprojection_px: float
    solvers_mm: float
    solvers_deg: float
    diversity_deg: float
    left_out_mm: tuple[float, ...]
    arm: ArmDoubt

    @property
    def warning(self) -> str | None:
        """In words, where the two closed forms disagree by more than chance would have it."""
        limit_mm, limit_deg = max(2.0, 8 * self.sigma_mm), max(0.3, 8 * self.sigma_deg)
        if self.solvers_mm <= limit_mm and self.solvers_deg <= limit_deg:
            return None
        return (
            f"two solvers disagree by {self.solvers_mm:.1f} mm and {self.solvers_deg:.2f} degrees: "
            "a mistaken pose, or too little turning between them"
        )


def diversity_deg(poses: Sequence[Array]) -> float:
    """How much the arm turned about its second-best axis: rms angle, degrees. About one axis alone, it is 0.

    The eigenvalues of the mean of v v^T over the rotation vectors v between all pairs of poses tell how much turning
    there was about each axis; hand-eye needs two (Tsai and Lenz 1989).
    """
    turns = np.array([frames.vector_from_rotation(a[:3, :3].T @ b[:3, :3]) for a, b in combinations(poses, 2)])
    if len(turns) == 0:
        return 0.0
    second = float(np.linalg.eigvalsh(turns.T @ turns / len(turns))[1])
    return float(np.degrees(np.sqrt(max(second, 0.0))))


def cyclopean_from_board(sample: Sample, rig: StereoRig) -> Array:
    """The board's pose from one look, (4, 4) mm: PnP on the left, refined on all corners of both eyes."""
    start = _pnp(rig.left, sample.points_mm, sample.left_px)

    def problem(x: Array) -> tuple[Array, Array]:
        rows = [_eye_rows(eye, x, sample.points_mm, px) for eye, px in _views(rig, sample)]
        return np.concatenate([r for r, _ in rows]), np.vstack([j for _, j in rows])

    return transform_of(solve(problem, pose_of(start), passes=20).parameters)


def calibrate_hand_eye(samples: Sequence[Sample], rig: StereoRig) -> HandEyeResult:
    """Solve for the hand-eye, refine it on all corners, and say how well it is known. Raises HandEyeError."""
    if len(samples) < FEWEST_POSES:
        raise HandEyeError(f"{len(samples)} poses, {FEWEST_POSES} are needed")
    arm = [s.world_from_tool for s in samples]
    turned = diversity_deg(arm)
    if turned < LEAST_TURN_DEG:
        raise HandEyeError(
            f"the arm turned by {turned:.1f} degrees about its second axis, {LEAST_TURN_DEG:g} are needed: "
            "tilt the hand about two directions, not one"
        )
    eye = [cyclopean_from_board(s, rig) for s in samples]
    first, second = park_martin(arm, eye), shah(arm, eye)
    boards = [a @ first @ e for a, e in zip(arm, eye, strict=True)]
    board, _ = frames.fuse(boards, [np.eye(6)] * len(boards))
    doubt = ArmDoubt()
    try:
        whole = solve(hand_eye_problem(samples, rig, doubt), _start(first, board, len(samples)))
        hand, place = transform_of(whole.parameters[:6]), transform_of(whole.parameters[6:12])
        spared = [
            solve(hand_eye_problem(rest, rig, doubt), _start(hand, place, len(rest)), passes=8)
            for rest in ([*samples[:out], *samples[out + 1 :]] for out in range(len(samples)))
        ]
    except UndeterminedError as error:
        raise HandEyeError(f"the poses leave the hand-eye open ({error}): turn the hand about more axes") from None
    sigma_mm, sigma_deg = _jackknife(whole.parameters, [s.parameters for s in spared])
    if len(samples) >= 3 * BLOCKS:
        blocks_mm, blocks_deg = _jackknife(whole.parameters, _without_blocks(samples, rig, doubt, hand, place))
        sigma_mm, sigma_deg = max(sigma_mm, blocks_mm), max(sigma_deg, blocks_deg)
    sigma_mm, sigma_deg = _with_hidden(sigma_mm, sigma_deg, doubt)
    return HandEyeResult(
        tool_from_cyclopean=hand,
        sigma_mm=sigma_mm,
        sigma_deg=sigma_deg,
        reprojection_px=PIXEL_SIGMA * float(np.sqrt(2 * (whole.residuals[6 * len(samples) :] ** 2).mean())),
        solvers_mm=float(np.linalg.norm(first[:3, 3] - second[:3, 3])),
        solvers_deg=float(np.degrees(frames.angle_between(first, second))),
        diversity_deg=turned,
        left_out_mm=tuple(
            _left_out_mm(sample, seen, part.parameters) for sample, seen, part in zip(samples, eye, spared, strict=True)
        ),
        arm=arms_own(samples, rig, whole.parameters, doubt),
    )


def _start(tool_from_cyclopean: Array, world_from_board: Array, count: int) -> Array:
    return np.concatenate([pose_of(tool_from_cyclopean), pose_of(world_from_board), np.zeros(6 * count)])


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


def hand_eye_problem(samples: Sequence[Sample], rig: StereoRig, arm: ArmDoubt) -> Problem:
    """Parameters: tool_from_cyclopean (6), world_from_board (6), then how far the arm was from its word (6) a sample.

    Poses are rotation vector and translation, the arm's error in the tool frame. Residuals are in standard deviations:
    corners over PIXEL_SIGMA, the arm's errors over its doubt. Without the latter, one pose's error would count as
    often as it has corners.
    """
    doubt = np.array([np.radians(arm.deg)] * 3 + [arm.mm] * 3)

    def problem(x: Array) -> tuple[Array, Array]:
        residuals, jacobians = [x[12:] / np.tile(doubt, len(samples))], [np.zeros((6 * len(samples), len(x)))]
        jacobians[0][:, 12:] = np.diag(np.tile(1 / doubt, len(samples)))
        hand, by_hand = _inverted(x[:6])
        for k, sample in enumerate(samples):
            own = slice(12 + 6 * k, 18 + 6 * k)
            to_said, by_board, _ = chain(x[6:12], pose_of(frames.inverse(sample.world_from_tool)))
            to_tool, by_said, by_own = chain(to_said, x[own])
            to_eye, by_tool, by_hand_pose = chain(to_tool, hand)
            for eye, px in _views(rig, sample):
                errors, by_pose = _eye_rows(eye, to_eye, sample.points_mm, px)
                rows = np.zeros((len(errors), len(x)))
                rows[:, :6] = by_pose @ by_hand_pose @ by_hand
                rows[:, 6:12] = by_pose @ by_tool @ by_said @ by_board
                rows[:, own] = by_pose @ by_tool @ by_own
                residuals.append(errors / PIXEL_SIGMA)
                jacobians.append(rows / PIXEL_SIGMA)
        return np.concatenate(residuals), np.vstack(jacobians)

    return problem


def arms_own(samples: Sequence[Sample], rig: StereoRig, parameters: Array, doubt: ArmDoubt) -> ArmDoubt:
    """How far the arm was from its word in these looks, from where the problem's solution (12 + 6 n,) has it with the
    doubt that was thought. An error that all poses share does not show.

    Source: variance components by expectation and maximisation (Dempster, Laird and Rubin 1977): what each pose was off
    by, and how unsure that is, tell the doubt, and the doubt tells both anew.
    """
    for _ in range(ROUNDS):
        found = solve(hand_eye_problem(samples, rig, doubt), parameters, passes=4)
        parameters = found.parameters
        unsure = np.diag(found.covariance)[12:] / found.sigma**2
        turn, shift = (parameters[12:] ** 2 + unsure).reshape(-1, 2, 3).mean(axis=(0, 2))
        doubt = ArmDoubt(float(np.sqrt(shift)), float(np.degrees(np.sqrt(turn))))
    return doubt


def _inverted(pose: Array) -> tuple[Array, Array]:
    """The inverse of a pose (6,) and its Jacobian (6, 6): r' = -r, t' = -R(r)^T t."""
    back, slope = cv2.Rodrigues(-pose[:3])
    jacobian = np.zeros((6, 6))
    jacobian[:3, :3] = -np.eye(3)
    jacobian[3:, 3:] = -back
    # slope is (3, 9) by rows of the matrix (OpenCV); d(-R t)/dr' = -sum over columns, and dr'/dr = -1.
    jacobian[3:, :3] = np.einsum("kij,j->ik", slope.reshape(3, 3, 3), pose[3:])
    return np.concatenate([-pose[:3], -back @ pose[3:]]), jacobian


def _eye_rows(eye: Camera, cyclopean_pose: Array, points: Array, px: Array) -> tuple[Array, Array]:
    """Residuals (2N,) px and Jacobian (2N, 6) of one eye by a pose (6,) of cyclopean_from_points."""
    pose, by_pose, _ = chain(cyclopean_pose, pose_of(frames.inverse(eye.cyclopean_from_camera)))
    image, jacobian = cv2.projectPoints(points, pose[:3], pose[3:], eye.matrix, eye.distortion)
    return (np.asarray(image, float).reshape(-1, 2) - px).ravel(), np.asarray(jacobian[:, :6], float) @ by_pose


def _views(rig: StereoRig, sample: Sample) -> list[tuple[Camera, Array]]:
    right = [] if sample.right_px is None else [(rig.right, sample.right_px)]
    return [(rig.left, sample.left_px), *right]


def _pnp(eye: Camera, points: Array, px: Array) -> Array:
    found, turn, shift = cv2.solvePnP(points, px, eye.matrix, eye.distortion, flags=cv2.SOLVEPNP_IPPE)
    if not found:
        raise HandEyeError("the board's pose cannot be found in one of the looks: its corners are nearly on a line")
    camera_from_board = frames.rigid(frames.rotation_from_vector(np.ravel(turn)), np.ravel(shift))
    return eye.cyclopean_from_camera @ camera_from_board


def _jackknife(whole: Array, spared: Sequence[Array]) -> tuple[float, float]:
    """(mm, degrees) over all three axes: variance (n - 1) / n times the summed squares of the left-out differences."""
    reference = transform_of(whole[:6])
    motions = np.array([frames.difference(transform_of(p[:6]), reference) for p in spared])
    motions -= motions.mean(axis=0)
    variance = (len(motions) - 1) / len(motions) * (motions**2).sum(axis=0)
    return float(np.sqrt(variance[:3].sum())), float(np.degrees(np.sqrt(variance[3:].sum())))


def _without_blocks(
    samples: Sequence[Sample], rig: StereoRig, doubt: ArmDoubt, hand: Array, place: Array
) -> list[Array]:
    """Solutions without one block of neighbouring poses after the other. An arm's joints err alike in poses alike,
    which leaving out single poses cannot show; leaving out blocks of a tour's neighbours does."""
    rests = [[s for k, s in enumerate(samples) if k * BLOCKS // len(samples) != out] for out in range(BLOCKS)]
    return [
        solve(hand_eye_problem(rest, rig, doubt), _start(hand, place, len(rest)), passes=8).parameters for rest in rests
    ]


def _with_hidden(sigma_mm: float, sigma_deg: float, arm: ArmDoubt) -> tuple[float, float]:
    """With the arm's own doubt on top: an error that all poses share, seen from the hand (the last joint's zero, the
    TOOL), moves the hand-eye as a whole and leaves no residual anywhere. Over three axes, as the rest."""
    return float(np.hypot(sigma_mm, np.sqrt(3) * arm.mm)), float(np.hypot(sigma_deg, np.sqrt(3) * arm.deg))


def _left_out_mm(sample: Sample, cyclopean_from_board_: Array, others: Array) -> float:
    """How far the board's corners, seen in this pose, lie from where all other poses put them, rms mm."""
    seen = sample.world_from_tool @ transform_of(others[:6]) @ cyclopean_from_board_
    gaps = frames.apply(seen, sample.points_mm) - frames.apply(transform_of(others[6:12]), sample.points_mm)
    return float(np.sqrt((gaps**2).sum(axis=1).mean()))
