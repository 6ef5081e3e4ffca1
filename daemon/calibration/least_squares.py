"""Bundle adjustment: nonlinear least squares over cameras, their poses and the board's poses. Pure.

A problem is a function from parameters to residuals and their Jacobian; `solve` minimises it by Levenberg-Marquardt and
returns the covariance of the parameters. Residuals are in px with unit weight unless a problem scales them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from daemon import frames
from daemon.arrays import Array

Problem = Callable[[Array], tuple[Array, Array]]

INTRINSICS = 9
"""Number of parameters of one camera: fx fy cx cy, then k1 k2 p1 p2 k3."""


@dataclass(frozen=True, eq=False)
class Solution:
    """parameters (P,) at the minimum; covariance (P, P), scaled by the residuals' variance; residuals (R,)."""

    parameters: Array
    covariance: Array
    residuals: Array


class UndeterminedError(Exception):
    """The observations do not determine the parameters; the message says how many directions are undetermined."""


def solve(problem: Problem, start: Array, passes: int = 60) -> Solution:
    """Minimise the sum of squared residuals from start. Raises UndeterminedError where the minimum is not a single
    point.

    Source: Levenberg-Marquardt with Marquardt's scaling; covariance sigma^2 (J^T J)^-1 at the minimum.
    """
    parameters, residuals, jacobian = minimise(problem, start, passes)
    variance = float(residuals @ residuals) / max(len(residuals) - len(parameters), 1)
    return Solution(parameters, inverse_of_normal(jacobian.T @ jacobian) * variance, residuals)


def minimise(problem: Problem, start: Array, passes: int = 60) -> tuple[Array, Array, Array]:
    """Parameters, residuals and Jacobian at the minimum reached from start, whether it is a single point or not."""
    parameters, damping = np.array(start, float), 1e-3
    residuals, jacobian = problem(parameters)
    cost = float(residuals @ residuals)
    for _ in range(passes):
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ residuals
        step = np.linalg.lstsq(normal + damping * np.diag(np.diag(normal) + 1e-12), -gradient, rcond=None)[0]
        tried, tried_jacobian = problem(parameters + step)
        tried_cost = float(tried @ tried)
        if not tried_cost < cost:
            damping *= 10
            if damping > 1e12:
                break
            continue
        gain = cost - tried_cost
        parameters, residuals, jacobian, cost = parameters + step, tried, tried_jacobian, tried_cost
        damping = max(damping / 10, 1e-12)
        if gain <= 1e-10 * cost:
            break
    return parameters, residuals, jacobian


def inverse_of_normal(normal: Array) -> Array:
    """Inverse of a normal matrix (P, P), each parameter in its own scale. Raises UndeterminedError."""
    scale = np.sqrt(np.diag(normal))
    if not np.all(scale > 0):
        raise UndeterminedError(f"{int((scale == 0).sum())} of {len(scale)} parameters affect no observation")
    values, vectors = np.linalg.eigh(normal / np.outer(scale, scale))
    if values[0] < 1e-12 * values[-1]:
        raise UndeterminedError(
            f"{int((values < 1e-12 * values[-1]).sum())} directions of {len(scale)} are undetermined"
        )
    return np.asarray((vectors / values) @ vectors.T / np.outer(scale, scale))


def intrinsics_of(matrix: Array, distortion: Array) -> Array:
    """(9,) parameters of a camera: fx, fy, cx, cy, k1, k2, p1, p2, k3; distortion (5,) or more."""
    return np.concatenate([[matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]], np.ravel(distortion)[:5]])


def camera_matrix(intrinsics: Array) -> tuple[Array, Array]:
    """(9,) parameters -> camera matrix (3, 3) and distortion (5,)."""
    fx, fy, cx, cy = intrinsics[:4]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), intrinsics[4:9]


def project(points: Array, pose: Array, intrinsics: Array) -> tuple[Array, Array, Array]:
    """Project (N, 3) points: pose (6,) = rotation vector and translation of camera_from_points.

    Returns ((N, 2) px, Jacobian (2N, 6) by the pose, (2N, 9) by the intrinsics).
    """
    matrix, distortion = camera_matrix(intrinsics)
    px, jacobian = cv2.projectPoints(points, pose[:3], pose[3:], matrix, distortion)
    return (
        np.asarray(px, float).reshape(-1, 2),
        np.asarray(jacobian[:, :6], float),
        np.asarray(jacobian[:, 6:15], float),
    )


def pose_of(transform: Array) -> Array:
    """Rigid transform (4, 4) -> (6,) rotation vector and translation."""
    return np.concatenate([frames.vector_from_rotation(transform[:3, :3]), transform[:3, 3]])


def transform_of(pose: Array) -> Array:
    """(6,) rotation vector and translation -> rigid transform (4, 4)."""
    return frames.rigid(frames.rotation_from_vector(pose[:3]), pose[3:6])


def chain(first: Array, second: Array) -> tuple[Array, Array, Array]:
    """Compose two poses (6,), first then second: the pose and its Jacobians (6, 6) by each."""
    r3, t3, *parts = cv2.composeRT(first[:3], first[3:], second[:3], second[3:])
    slopes: Array = np.vstack([np.hstack(parts[:4]), np.hstack(parts[4:])])  # columns: r1, t1, r2, t2
    return np.concatenate([r3.ravel(), t3.ravel()]), slopes[:, :6], slopes[:, 6:]


@dataclass(frozen=True, eq=False)
class MatchedCorners:
    """Board corners in both images of one pair: points_mm (N, 3), left_px and right_px (N, 2)."""

    points_mm: Array
    left_px: Array
    right_px: Array


def stereo_problem(matches: Sequence[MatchedCorners]) -> Problem:
    """Reprojection of all matches. Parameters: left intrinsics (9), right intrinsics (9), right_from_left (6), then
    left_from_board (6) a match."""
    rows = sum(4 * len(m.points_mm) for m in matches)
    width = 2 * INTRINSICS + 6 + 6 * len(matches)

    def problem(x: Array) -> tuple[Array, Array]:
        residuals, jacobian, row = np.empty(rows), np.zeros((rows, width)), 0
        for k, match in enumerate(matches):
            own = slice(2 * INTRINSICS + 6 + 6 * k, 2 * INTRINSICS + 12 + 6 * k)
            px, by_pose, by_camera = project(match.points_mm, x[own], x[:INTRINSICS])
            end = row + 2 * len(px)
            residuals[row:end] = (px - match.left_px).ravel()
            jacobian[row:end, :INTRINSICS], jacobian[row:end, own] = by_camera, by_pose
            shared = slice(2 * INTRINSICS, 2 * INTRINSICS + 6)
            pose, by_board, by_stereo = chain(x[own], x[shared])
            px, by_pose, by_camera = project(match.points_mm, pose, x[INTRINSICS : 2 * INTRINSICS])
            row, end = end, end + 2 * len(px)
            residuals[row:end] = (px - match.right_px).ravel()
            jacobian[row:end, INTRINSICS : 2 * INTRINSICS] = by_camera
            jacobian[row:end, own], jacobian[row:end, shared] = by_pose @ by_board, by_pose @ by_stereo
            row = end
        return residuals, jacobian

    return problem
