"""How sure a hand-eye is: the arm's error, the covariance, and what changes without some poses. Pure.

All of it is linear algebra on the normal equations of each pose at the joint solution, so that nothing is projected or
solved again: between a solution and the ones without some poses, everything is linear to a hundredth of its error.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.least_squares import inverse_of_normal, transform_of

SHARED = 12
"""Parameters that all poses share: the mounting, the board's place."""
ROUNDS = 60
"""Iterations of the estimate of the arm's error; the last ones change it by less than a hundredth."""
STEP = 1e-6


@dataclass(frozen=True)
class ArmError:
    """Standard deviation of the arm's pose from the reported one, per axis: mm and degrees."""

    mm: float = 0.1
    deg: float = 0.03

    def variances(self) -> Array:
        """(6,) rad^2 and mm^2, in the order of a pose's parameters."""
        return np.array([np.radians(self.deg) ** 2] * 3 + [self.mm**2] * 3)


@dataclass(frozen=True, eq=False)
class PoseEquations:
    """Normal equations of one pose's corners at a solution: shared (12, 12), cross (12, 6), own (6, 6), their gradients
    (12,) and (6,), and the pose's own error (6,) there."""

    shared: Array
    cross: Array
    own: Array
    shared_gradient: Array
    own_gradient: Array
    error: Array

    def without_own(self, arm: ArmError) -> tuple[Array, Array]:
        """(12, 12) and (12,): the same for the shared parameters alone, the pose's error free with the arm's
        variance."""
        weight = 1.0 / arm.variances()
        gain = np.linalg.solve(self.own + np.diag(weight), self.cross.T).T
        gradient = self.own_gradient + weight * self.error
        return self.shared - gain @ self.cross.T, self.shared_gradient - gain @ gradient


def pose_equations(jacobian: Array, residuals: Array, parameters: Array, rows: Sequence[slice]) -> list[PoseEquations]:
    """Return the normal equations of each pose, of a problem with SHARED parameters, then 6 a pose, whose corners are
    rows[k], in standard deviations."""
    found = []
    for k, there in enumerate(rows):
        own = slice(SHARED + 6 * k, SHARED + 6 * k + 6)
        a, b, r = jacobian[there, :SHARED], jacobian[there, own], residuals[there]
        found.append(PoseEquations(a.T @ a, a.T @ b, b.T @ b, a.T @ r, b.T @ r, parameters[own]))
    return found


def estimated_arm_error(poses: Sequence[PoseEquations], arm: ArmError) -> ArmError:
    """Estimate the arm's error from what the corners of each pose leave, starting from `arm`. An error that all poses
    share does not show.

    Source: variance components by expectation and maximisation (Dempster, Laird and Rubin 1977), alternating between
    each pose's error with its variance, and the standard deviation of all.
    """
    for _ in range(ROUNDS):
        step, covariance = solution(poses, arm)
        weight, squares = 1.0 / arm.variances(), np.zeros(6)
        for pose in poses:
            inner = np.linalg.inv(pose.own + np.diag(weight))
            gain = inner @ pose.cross.T
            error = pose.error - inner @ (pose.own_gradient + weight * pose.error) - gain @ step
            squares += error**2 + np.diag(inner + gain @ covariance @ gain.T)
        turn, shift = (squares / len(poses)).reshape(2, 3).mean(axis=1)
        arm = ArmError(float(np.sqrt(shift)), float(np.degrees(np.sqrt(turn))))
    return arm


def solution(poses: Sequence[PoseEquations], arm: ArmError) -> tuple[Array, Array]:
    """The step (12,) from where the equations were made to the minimum of these poses, and its covariance (12, 12).

    Raises UndeterminedError.
    """
    parts = [pose.without_own(arm) for pose in poses]
    covariance = inverse_of_normal(np.sum([part for part, _ in parts], axis=0))
    return -covariance @ np.sum([gradient for _, gradient in parts], axis=0), covariance


def motion_by_parameters(pose: Array) -> Array:
    """(6, 6) Jacobian of a pose's motion (frames.difference) by its parameters (6,), rotation vector and translation,
    by central differences."""
    there, steps = transform_of(pose), STEP * np.eye(6)
    rows = [
        frames.difference(transform_of(pose + step), there) - frames.difference(transform_of(pose - step), there)
        for step in steps
    ]
    return np.array(rows).T / (2 * STEP)
