"""The witness tells a claimed pose from the true one."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.store import folders
from drivers.simcell.arm import SimulatedArm
from drivers.simcell.controller import Machine
from drivers.simcell.rigid import apply, rigid, turn
from drivers.simcell.truth import load_truth
from drivers.simcell.witness import Witness, pose_error
from drivers.simcell.world import World

TRUTH = load_truth(folders.HOUSE / "etc" / "simcell.yaml")


def test_the_witness_tells_a_claimed_pose_from_the_true_one() -> None:
    world = World(TRUTH)
    part = world.stand("pentagonal_prism", 1, 520.0, 0.0, 0.4)
    witness = Witness(TRUTH, world, Machine(SimulatedArm()), lambda: np.eye(4))
    truth = witness.corners(part.name)
    middle = truth.mean(axis=0)
    off = rigid(turn([1, 2, 3], np.radians(1.5)), [0.0, 0.0, 0.0])
    claimed = apply(off, truth[:7] - middle) + middle + np.array([0.6, -0.8, 0.0])
    mm, deg = pose_error(claimed, witness.corners(part.name))
    assert deg == pytest.approx(1.5, abs=1e-6)
    assert mm == pytest.approx(1.0, abs=0.5)
    assert pose_error(truth, truth) == pytest.approx((0.0, 0.0), abs=1e-6)
