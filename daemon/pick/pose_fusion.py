"""What several looks at one part say together. Pure: poses and covariances in, verdicts out.

What errs the same way in every look (hand-eye, the cameras' calibration) is kept apart from what errs anew in each
(pixels, the arm's repeatability): the first does not shrink by looking more often, and two looks may still be compared
much more sharply than either is known.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.quantities import Sigma
from daemon.vision.facets import shared_motion

CHI_SQUARE_6 = 22.46
"""What a chi-square with 6 degrees of freedom passes once in a thousand times."""


@dataclass(frozen=True)
class Doubt:
    """One-sigma uncertainties of the cell, which enter each predicted error."""

    hand_eye_mm: Sigma = 0.3
    """Of the hand-eye translation, per axis, mm."""
    hand_eye_deg: Sigma = 0.05
    """Of the hand-eye rotation, per axis, degrees."""
    arm_mm: Sigma = 0.1
    """Repeatability of the arm's position, per axis, mm."""
    arm_deg: Sigma = 0.02
    """Repeatability of the arm's orientation, per axis, degrees."""
    pixels: Sigma = 0.3
    """Of the calibrated image centre and of the disparity, px."""

    def arm(self) -> Array:
        """Covariance (6, 6) of a pose the arm is at."""
        return np.diag([self.arm_mm**2] * 3 + [np.radians(self.arm_deg) ** 2] * 3)

    def shared(self) -> Array:
        """Covariance (9, 9) of what all looks share: hand-eye motion (6), then u, v and disparity offsets in px."""
        hand_eye = [self.hand_eye_mm**2] * 3 + [np.radians(self.hand_eye_deg) ** 2] * 3
        return np.diag([*hand_eye, self.pixels**2, self.pixels**2, 2 * self.pixels**2])


@dataclass(frozen=True, eq=False)
class Sighting:
    """One look at the part: world_from_part (4, 4); covariance (6, 6) of what errs anew in each look; shared (6, 9)
    how the errors of Doubt.shared move the pose; distance_mm from the cyclopean centre."""

    world_from_part: Array
    covariance: Array
    shared: Array
    distance_mm: float


@dataclass(frozen=True, eq=False)
class Estimate:
    """What the looks say together: world_from_part, covariance (6, 6) with everything in it, and at_grasp (6, 6), the
    same with the arm's error at the grasp. Errors predicted there are rms over all directions together (sqrt(3) times
    what an axis errs by where all err alike)."""

    world_from_part: Array
    covariance: Array
    at_grasp: Array

    @property
    def predicted_mm(self) -> float:
        return float(np.sqrt(np.trace(self.at_grasp[:3, :3])))

    @property
    def predicted_deg(self) -> float:
        return frames.rms_deg(self.at_grasp[3:, 3:])

    def of_any_turn(self, axis: Array) -> "Estimate":
        """The same for a part whose turn about an axis (3,), world, does not matter."""
        covariance, at_grasp = (frames.with_known_turn(each, axis) for each in (self.covariance, self.at_grasp))
        return replace(self, covariance=covariance, at_grasp=at_grasp)


def sighting(
    world_from_tool: Array,
    tool_from_cyclopean: Array,
    cyclopean_from_part: Array,
    covariance: Array,
    doubt: Doubt,
    focal_px: float,
    baseline_mm: float,
) -> Sighting:
    """Bring one look's pose, covariance (6, 6) in the cyclopean frame, to the world; see Sighting. world_from_tool: of
    fixed cameras that of the frame about whose origin their pose errs."""
    world_from_cyclopean = world_from_tool @ tool_from_cyclopean
    world_from_part = world_from_cyclopean @ cyclopean_from_part
    anew = frames.transport_covariance(world_from_cyclopean, covariance)
    anew = anew + frames.lever_covariance(tool_from_cyclopean @ cyclopean_from_part, doubt.arm(), world_from_tool)
    shared = np.zeros((6, 9))
    turn = world_from_tool[:3, :3]
    lever = frames.cross_matrices(turn @ (tool_from_cyclopean @ cyclopean_from_part)[:3, 3])
    shared[:3, :3] = shared[3:, 3:6] = turn
    shared[:3, 3:6] = -lever @ turn
    pixels = shared_motion(cyclopean_from_part[None, :3, 3], focal_px, baseline_mm)[0, :, 6:]
    shared[:3, 6:] = world_from_cyclopean[:3, :3] @ pixels
    distance = float(np.linalg.norm(cyclopean_from_part[:3, 3]))
    return Sighting(world_from_part, anew, shared, distance)


def fuse(sightings: Sequence[Sighting], doubt: Doubt) -> Estimate:
    """Weigh the looks together, and with them the errors they share.

    The part's pose (6) and Doubt.shared's errors (9, about zero as doubted) are estimated at once: looks from several
    distances tell a disparity offset from a part that lies deeper, and what they cannot tell stays in the covariance
    whole. Source: linear least squares with priors, about the last look's pose.
    """
    reference = sightings[-1].world_from_part
    prior = np.linalg.inv(doubt.shared())
    total = np.zeros((15, 15))
    total[6:, 6:] = prior
    right = np.zeros(15)
    for one in sightings:
        jacobian = np.hstack([np.eye(6), one.shared])
        weighed = jacobian.T @ np.linalg.inv(one.covariance)
        total += weighed @ jacobian
        right += weighed @ frames.difference(one.world_from_part, reference)
    every = np.asarray(np.linalg.inv(total), float)
    covariance = every[:6, :6]
    return Estimate(frames.perturb(reference, (every @ right)[:6]), covariance, covariance + doubt.arm())


def disagreement(a: Sighting, b: Sighting, doubt: Doubt) -> float:
    """Chi-square (6 degrees of freedom) of two looks at one part; what they share counts only by its difference."""
    motion = frames.difference(b.world_from_part, a.world_from_part)
    lever = b.shared - a.shared
    covariance = a.covariance + b.covariance + lever @ doubt.shared() @ lever.T
    return float(motion @ np.linalg.solve(covariance, motion))


def suspect(others: Sequence[float]) -> Literal["hand-eye", "part", "unclear"]:
    """Which is to blame when two looks at the target disagree. others: chi-squares of the other parts in them."""
    if not others:
        return "unclear"
    return "hand-eye" if sum(c > CHI_SQUARE_6 for c in others) * 2 >= len(others) else "part"
