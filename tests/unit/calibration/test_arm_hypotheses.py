"""Many arms at once are each the arm that the drivers' kinematics have."""

from __future__ import annotations

import numpy as np
import pytest

from daemon import frames
from daemon.calibration.arm_hypotheses import NAMES, Convention, tool_places
from drivers.puma560 import ArmGeometry, forward

SIGNS = (1.0, -1.0, 1.0, -1.0, 1.0, 1.0)


@pytest.mark.parametrize("against_horizon", [False, True])
def test_each_of_many_hypotheses_is_its_own_arm_as_it_counts_its_joints(against_horizon: bool) -> None:
    rng = np.random.default_rng(3)
    parameters = rng.uniform(-1.0, 1.0, (4, len(NAMES)))
    parameters[:, 5:9] = [431.8, 20.3, 150.05, 431.8] + 10.0 * parameters[:, 5:9]
    parameters[:, 12:] *= 100.0
    printed = rng.uniform(-2.0, 2.0, (5, 6))
    turns, places = tool_places(parameters, Convention(SIGNS, against_horizon), printed)
    for x, turned, placed in zip(parameters, turns, places, strict=True):
        a2, a3, d3, d4 = x[5:9]
        arm = ArmGeometry(
            a2,
            a3,
            d3,
            d4,
            world_from_base=frames.rigid(np.eye(3), x[15:]),
            flange_from_tool=frames.rigid(frames.rotation_from_vector(x[9:12]), x[12:15]),
        )
        for k, joints in enumerate(printed * SIGNS):
            both = joints[2] if against_horizon else joints[1] + joints[2]
            q2 = joints[1] + x[1]
            ours = np.array([joints[0] + x[0], q2, both + x[2] - q2, joints[3] + x[3], joints[4] + x[4], joints[5]])
            pose = forward(ours, arm)
            np.testing.assert_allclose(turned[k], pose[:3, :3], atol=1e-9)
            np.testing.assert_allclose(placed[k], pose[:3, 3], atol=1e-6)
