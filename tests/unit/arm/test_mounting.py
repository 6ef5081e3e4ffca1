"""Where the cameras are while the arm is somewhere, and where the arm must be for a look."""

from __future__ import annotations

import numpy as np

from daemon import frames
from tests.fakes.fake_cell import HEAD_DOWN, ON_HAND, TOOL_FROM_CYCLOPEAN

ROTATION, POINT = HEAD_DOWN[:3, :3], np.array([520.0, 30.0, -280.0])


def test_a_look_pose_puts_the_point_on_the_cameras_axis_at_the_distance() -> None:
    pose = ON_HAND.look_pose(ROTATION, POINT, 300.0)
    assert np.allclose(pose[:3, :3], ROTATION)
    seen = frames.apply(frames.inverse(pose @ TOOL_FROM_CYCLOPEAN), POINT)
    assert np.allclose(seen, [0, 0, 300], atol=1e-9)


def test_cameras_on_the_hand_go_with_the_tool() -> None:
    for pose in (HEAD_DOWN, frames.rigid(np.eye(3), POINT)):
        assert np.array_equal(ON_HAND.world_from_cyclopean_at(pose), pose @ TOOL_FROM_CYCLOPEAN)
        assert ON_HAND.tool_from_cyclopean_at(pose) is TOOL_FROM_CYCLOPEAN
