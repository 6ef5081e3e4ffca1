"""Stereo calibration: views of a board by both cameras -> intrinsics, poses, their standard deviations. Pure.

A residual measures how well the model fits these images; it is not an accuracy.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.board import Board, BoardError, DetectedBoard
from daemon.calibration.least_squares import (
    INTRINSICS,
    MatchedCorners,
    Problem,
    Solution,
    UndeterminedError,
    camera_matrix,
    intrinsics_of,
    pose_of,
    solve,
    stereo_problem,
    transform_of,
)
from daemon.errors import FacetdError
from daemon.vision.geometry import Camera, StereoRig

MIN_PAIRS, MIN_SHARED = 6, 8
"""Pairs of a calibration; corners that both cameras must see in a pair."""
WORST_SHARE = 0.02
"""Largest relative standard deviation of a focal length or baseline that counts as measured."""
POSE = slice(2 * INTRINSICS, 2 * INTRINSICS + 6)
K3 = (8, INTRINSICS + 8)
CELLS = 8
NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


class StereoError(FacetdError):
    """These pairs give no calibration; the message says why, and what to do."""


@dataclass(frozen=True, eq=False)
class Pair:
    """One view of the board by both cameras, or by the only one (right None); its name is for messages."""

    name: str
    left: DetectedBoard
    right: DetectedBoard | None


@dataclass(frozen=True, eq=False)
class StereoResult:
    """Reprojection rms over both cameras (px, per point) and of each, mean distance from the epipolar line (px); rms by
    pair; dropped pairs with the reason; sigmas: one standard deviation by parameter name (`left.fx` px, ...,
    `baseline_mm`, `vergence_deg`, `right.turn_deg`); coverage: share of the image with corners."""

    rig: StereoRig
    stereo_rms_px: float
    left_rms_px: float
    right_rms_px: float
    epipolar_px: float
    by_pair: dict[str, float]
    dropped: dict[str, str]
    sigmas: dict[str, float]
    coverage: float


def match_corners(pair: Pair, board: Board) -> MatchedCorners:
    """Corners in both images of a pair. Raises BoardError where they are fewer than MIN_SHARED, StereoError where
    only one camera is in use."""
    if pair.right is None:
        raise StereoError(f"{pair.name}: one camera saw the board, both are needed")
    ids, left, right = np.intersect1d(pair.left.corner_ids, pair.right.corner_ids, return_indices=True)
    if len(ids) < MIN_SHARED:
        raise BoardError(
            f"the cameras share {len(ids)} of its corners, {MIN_SHARED} are needed: show more of it to both"
        )
    return MatchedCorners(board.points_mm()[ids], pair.left.corners_px[left], pair.right.corners_px[right])


def calibrate_stereo(pairs: Sequence[Pair], board: Board, image_size: tuple[int, int]) -> StereoResult:
    """Calibrate both cameras and their relative pose by one least-squares fit over all corners; drop outlying pairs.

    Raises StereoError: too few pairs, pairs too similar, cameras swapped, one image mirrored.
    """
    kept, dropped = list(pairs), dict[str, str]()
    if len(kept) < MIN_PAIRS:
        raise StereoError(f"{len(kept)} usable pairs, {MIN_PAIRS} are needed; take more, tilted different ways")
    while True:
        matches = [match_corners(p, board) for p in kept]
        solution = _solve(matches, image_size)
        rms = _rms_by_match(matches, solution.residuals)
        usual = float(np.median(rms))
        worst = int(np.argmax(rms))
        spread = 1.4826 * float(np.median(np.abs(rms - usual)))
        if rms[worst] <= max(usual + 5 * spread, 2.5 * usual) or len(kept) - 1 < max(MIN_PAIRS, 0.7 * len(pairs)):
            return _result(kept, matches, solution, dropped, image_size)
        dropped[kept[worst].name] = (
            f"its corners are {rms[worst]:.2f} px off, {usual:.2f} px is usual: moved or misread"
        )
        del kept[worst]


def _solve(matches: Sequence[MatchedCorners], image_size: tuple[int, int]) -> Solution:
    start = _start(matches, image_size)
    problem = stereo_problem(matches)
    try:
        full = solve(problem, start)
        # The third radial term stays only where it is significant: a wrong value distorts the corners of the image,
        # where no board was.
        if all(abs(full.parameters[k]) > 3 * np.sqrt(full.covariance[k, k]) for k in K3):
            return full
        fixed = start.copy()
        fixed[list(K3)] = 0.0
        return _solve_without(problem, fixed, K3)
    except UndeterminedError as error:
        raise StereoError(f"the views are too similar ({error}); tilt the board about both of its axes") from None


def _solve_without(problem: Problem, start: Array, left_out: Sequence[int]) -> Solution:
    free = np.setdiff1d(np.arange(len(start)), left_out)

    def reduced(x: Array) -> tuple[Array, Array]:
        whole = start.copy()
        whole[free] = x
        residuals, jacobian = problem(whole)
        return residuals, jacobian[:, free]

    part = solve(reduced, start[free])
    parameters, covariance = start.copy(), np.zeros((len(start), len(start)))
    parameters[free] = part.parameters
    covariance[np.ix_(free, free)] = part.covariance
    return Solution(parameters, covariance, part.residuals)


def _start(matches: Sequence[MatchedCorners], image_size: tuple[int, int]) -> Array:
    points = [m.points_mm.astype(np.float32) for m in matches]
    cameras, boards = [], []
    for side in ("left", "right"):
        corners = [getattr(m, f"{side}_px").astype(np.float32).reshape(-1, 1, 2) for m in matches]
        _, matrix, distortion, turns, shifts = cv2.calibrateCamera(
            points, corners, image_size, None, None, flags=cv2.CALIB_FIX_K3
        )
        cameras.append(intrinsics_of(np.asarray(matrix, float), np.asarray(distortion, float)))
        boards.append([np.concatenate([r.ravel(), t.ravel()]) for r, t in zip(turns, shifts, strict=True)])
    stereo = _middle_pose(*boards)
    _refuse_impossible(stereo, boards)
    return np.concatenate([*cameras, stereo, *boards[0]])


def _middle_pose(left: Sequence[Array], right: Sequence[Array]) -> Array:
    """right_from_left (6,): of the poses from single views, the one nearest to all others."""
    each = [transform_of(r) @ frames.inverse(transform_of(m)) for m, r in zip(left, right, strict=True)]
    gaps = [[np.linalg.norm(frames.difference(a, b) * (1, 1, 1, 300, 300, 300)) for b in each] for a in each]
    best = each[int(np.argmin(np.median(gaps, axis=1)))]
    return pose_of(best)


def _refuse_impossible(stereo: Array, boards: list[list[Array]]) -> None:
    right_from_left = transform_of(stereo)
    spread = [
        frames.angle_between(transform_of(r), right_from_left @ transform_of(m)) for m, r in zip(*boards, strict=True)
    ]
    if np.degrees(np.median(spread)) > 10.0:
        raise StereoError(
            "the two cameras see the board turned differently from pair to pair: one image is mirrored, "
            "or left and right files are not of the same moment"
        )
    x, y, z = frames.inverse(right_from_left)[:3, 3]
    if x < 0 and abs(x) > max(abs(y), abs(z)):
        raise StereoError("the right camera comes out to the left of the left one: swap the cameras, or the file lists")


def _rms_by_match(matches: Sequence[MatchedCorners], residuals: Array) -> Array:
    return np.array([np.sqrt(2 * (part**2).mean()) for part in _by_match(matches, residuals)])


def _by_match(matches: Sequence[MatchedCorners], residuals: Array) -> list[Array]:
    return np.split(residuals, np.cumsum([4 * len(m.points_mm) for m in matches])[:-1])


def _result(
    kept: Sequence[Pair],
    matches: Sequence[MatchedCorners],
    solution: Solution,
    dropped: dict[str, str],
    image_size: tuple[int, int],
) -> StereoResult:
    rig = rig_from_parameters(solution.parameters, image_size)
    sigmas = _sigmas(solution)
    relative_sigma = max(sigmas["left.fx"] / rig.left.matrix[0, 0], sigmas["right.fx"] / rig.right.matrix[0, 0])
    relative_sigma = max(relative_sigma, sigmas["baseline_mm"] / rig.baseline_mm)
    if relative_sigma > WORST_SHARE:
        raise StereoError(
            f"the views are too similar: they determine focal length or baseline to {100 * relative_sigma:.1f} % only; "
            "tilt the board about both of its axes, near and far"
        )
    halves = [np.split(part, 2) for part in _by_match(matches, solution.residuals)]
    left, right = (np.concatenate([h[k] for h in halves]) for k in (0, 1))
    rms = _rms_by_match(matches, solution.residuals)
    return StereoResult(
        rig=rig,
        stereo_rms_px=float(np.sqrt(2 * (solution.residuals**2).mean())),
        left_rms_px=float(np.sqrt(2 * (left**2).mean())),
        right_rms_px=float(np.sqrt(2 * (right**2).mean())),
        epipolar_px=float(np.mean(np.concatenate([epipolar_distances(rig, m.left_px, m.right_px) for m in matches]))),
        by_pair={p.name: float(v) for p, v in zip(kept, rms, strict=True)},
        dropped=dropped,
        sigmas=sigmas,
        coverage=coverage(matches, image_size),
    )


def rig_from_parameters(x: Array, image_size: tuple[int, int]) -> StereoRig:
    """Parameters of least_squares.stereo_problem -> the rig in its cyclopean frame (midway, x along the baseline)."""
    left, right = (camera_matrix(x[first : first + INTRINSICS].copy()) for first in (0, INTRINSICS))
    return rig_of(left, right, frames.inverse(transform_of(x[POSE])), image_size)


def rig_of(
    left: tuple[Array, Array], right: tuple[Array, Array], left_from_right: Array, image_size: tuple[int, int]
) -> StereoRig:
    """(matrix, distortion) of both cameras and their relative pose (4, 4) mm -> the rig in its cyclopean frame."""
    cyclopean_from_left = frames.inverse(cyclopean_frame(left_from_right))
    return StereoRig(
        Camera(*left, cyclopean_from_left), Camera(*right, cyclopean_from_left @ left_from_right), image_size
    )


def cyclopean_frame(left_from_right: Array) -> Array:
    """left_from_cyclopean: origin midway, x along the baseline, z as near to both optical axes as x allows."""
    along = left_from_right[:3, 3] / np.linalg.norm(left_from_right[:3, 3])
    forward = np.array([0.0, 0.0, 1.0]) + left_from_right[:3, 2]
    forward -= along * (along @ forward)
    forward /= np.linalg.norm(forward)
    return frames.rigid(np.column_stack([along, np.cross(forward, along), forward]), left_from_right[:3, 3] / 2)


def epipolar_distances(rig: StereoRig, left_px: Array, right_px: Array) -> Array:
    """Distance of each point from the epipolar line of its partner, (2N,) px, undistorted, in both images."""
    right_from_left = frames.inverse(rig.right.cyclopean_from_camera) @ rig.left.cyclopean_from_camera
    essential = frames.cross_matrices(right_from_left[:3, 3]) @ right_from_left[:3, :3]
    a, b = (
        np.column_stack([c.normalised(p), np.ones(len(p))]) for c, p in ((rig.left, left_px), (rig.right, right_px))
    )
    lines_right, lines_left = a @ essential.T, b @ essential
    gap = np.einsum("ni,ni->n", b, lines_right)
    return np.concatenate(
        [
            rig.right.matrix[0, 0] * np.abs(gap) / np.linalg.norm(lines_right[:, :2], axis=1),
            rig.left.matrix[0, 0] * np.abs(gap) / np.linalg.norm(lines_left[:, :2], axis=1),
        ]
    )


def _sigmas(solution: Solution) -> dict[str, float]:
    sigma = np.sqrt(np.diag(solution.covariance))
    named = {
        f"{side}.{name}": float(sigma[k + offset])
        for side, offset in (("left", 0), ("right", INTRINSICS))
        for k, name in enumerate(NAMES)
    }
    shift = solution.parameters[POSE][3:]
    along = shift / np.linalg.norm(shift)
    place = solution.covariance[POSE, POSE][3:, 3:]
    turn = solution.covariance[POSE, POSE][:3, :3]
    named["baseline_mm"] = float(np.sqrt(along @ place @ along))
    named["vergence_deg"] = float(np.degrees(np.sqrt(turn[1, 1])))
    named["right.turn_deg"] = frames.rms_deg(turn)
    return named


def coverage(matches: Sequence[MatchedCorners], image_size: tuple[int, int]) -> float:
    """Share of the CELLS x CELLS fields of both images in which at least one corner was seen (0 to 1)."""
    shares = []
    for side in ("left_px", "right_px"):
        px = np.concatenate([getattr(m, side) for m in matches]) / np.array(image_size) * CELLS
        fields = np.clip(px.astype(int), 0, CELLS - 1)
        shares.append(len(np.unique(fields[:, 0] * CELLS + fields[:, 1])) / CELLS**2)
    return float(np.mean(shares))
