"""Where the cameras are while the arm is somewhere, and where the arm must be for a look."""

from __future__ import annotations

import numpy as np

from daemon import frames
from daemon.arm import InWorld, OnHand, body_of, cameras_box, in_view
from daemon.arm.body import Capsule, away_mm
from tests.fakes.fake_cell import HEAD_DOWN, ON_HAND, TOOL_FROM_CYCLOPEAN, rig

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


OVER = frames.rigid(np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]), np.array([500.0, 0.0, 300.0]))
FIXED = InWorld(OVER, HEAD_DOWN, np.array([500.0, 0.0, -300.0]))


def test_fixed_cameras_are_where_they_are_and_move_against_the_tool() -> None:
    for pose in (HEAD_DOWN, frames.rigid(np.eye(3), POINT)):
        assert np.array_equal(FIXED.world_from_cyclopean_at(pose), OVER)
        assert np.allclose(pose @ FIXED.tool_from_cyclopean_at(pose), OVER)


def test_fixed_cameras_look_while_the_arm_is_out_of_their_view_and_it_goes_straight_to_the_grasp() -> None:
    assert FIXED.look_pose(ROTATION, POINT, 300.0) is HEAD_DOWN
    approach = FIXED.approach_pose(HEAD_DOWN, POINT, 80.0)
    assert np.allclose(frames.inverse(HEAD_DOWN) @ approach, frames.rigid(np.eye(3), np.array([0.0, 0.0, -80.0])))
    on_hand = OnHand(TOOL_FROM_CYCLOPEAN)
    assert np.array_equal(on_hand.approach_pose(HEAD_DOWN, POINT, 80.0), on_hand.look_pose(ROTATION, POINT, 80.0))


def test_the_box_around_fixed_cameras_holds_both_with_their_brackets() -> None:
    box = cameras_box(rig(), OVER)
    for camera in (rig().left, rig().right):
        centre = (OVER @ camera.cyclopean_from_camera)[:3, 3]
        ends, radius = np.tile(centre, (1, 1, 2, 1)), np.array([1.0])
        assert away_mm(ends, radius, [box], 100.0).item() < -50.0


def seen(x: float, y: float, z: float, radius_mm: float = 5.0, length_mm: float = 0.0) -> str | None:
    """What fixed cameras see of a piece that begins there and goes up."""
    piece = Capsule("piece", "tool", (0.0, 0.0, 0.0), (0.0, 0.0, length_mm), radius_mm)
    links = np.tile(np.eye(4), (8, 1, 1))
    links[:, :3, 3] = x, y, z
    return in_view(links, body_of((piece,), ()), rig(), OVER)


def test_what_of_the_arm_fixed_cameras_see_is_named() -> None:
    assert seen(500.0, 0.0, -100.0) == "piece"
    assert seen(500.0, 400.0, -100.0) is None
    assert seen(500.0, 0.0, 400.0) is None, "behind the cameras"
    beyond = 510.0 + 400.0 * 240.0 / 700.0
    assert seen(beyond, 0.0, -100.0) is None
    assert seen(beyond, 0.0, -100.0, radius_mm=15.0) == "piece"
    assert seen(beyond, 0.0, -100.0, length_mm=-200.0) == "piece", "farther away it comes into view"
