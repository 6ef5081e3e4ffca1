"""The error of a claimed pose against the true one."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.store import folders
from drivers.rigid import apply, rigid, turn
from drivers.simcell.arm import SimulatedArm
from drivers.simcell.controller import Machine
from drivers.simcell.ground_truth import GroundTruth, pose_error
from drivers.simcell.truth import load_truth
from drivers.simcell.world import World

TRUTH = load_truth(folders.HOUSE / "etc" / "simcell.yaml")


def test_the_error_of_a_claimed_pose_against_the_true_one() -> None:
    world = World(TRUTH)
    part = world.stand("pentagonal_prism", 1, 520.0, 0.0, 0.4)
    ground_truth = GroundTruth(TRUTH, world, Machine(SimulatedArm()), lambda: np.eye(4))
    truth = ground_truth.corners(part.name)
    middle = truth.mean(axis=0)
    off = rigid(turn([1, 2, 3], np.radians(1.5)), [0.0, 0.0, 0.0])
    claimed = apply(off, truth[:7] - middle) + middle + np.array([0.6, -0.8, 0.0])
    mm, deg = pose_error(claimed, ground_truth.corners(part.name))
    assert deg == pytest.approx(1.5, abs=1e-6)
    assert mm == pytest.approx(1.0, abs=0.5)
    assert pose_error(truth, truth) == pytest.approx((0.0, 0.0), abs=1e-6)


@pytest.mark.parametrize("degrees", [0.0, 0.5, 2.0])
def test_corners_in_the_inside_of_an_angle_do_not_turn_a_claimed_pose(degrees: float) -> None:
    """A bracket, x and z of its section: the corner between its legs is none of the hull's."""
    section = np.array([[0.0, 0.0], [60.0, 0.0], [60.0, 12.0], [12.0, 12.0], [12.0, 46.0], [0.0, 46.0]])
    corners = np.array([[x, y, z] for y in (0.0, 40.0) for x, z in section])
    outer = np.delete(corners, [3, 9], axis=0)
    middle = outer.mean(axis=0)
    claimed = apply(rigid(turn([1, 2, 3], np.radians(degrees)), [0.0, 0.0, 0.0]), corners - middle) + middle
    mm, deg = pose_error(claimed, outer)
    assert (mm, deg) == pytest.approx((0.0, degrees), abs=1e-6)
