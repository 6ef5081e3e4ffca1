"""Which poses tell most about a hand-eye."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.board import parse_board
from daemon.calibration.hand_eye import Sample, hand_eye_problem
from daemon.calibration.hand_eye_doubt import SHARED, ArmError, motion_by_parameters, pose_equations
from daemon.calibration.least_squares import pose_of
from daemon.calibration.telling_poses import Setup, error_mm, information, most_telling
from daemon.calibration.tour import looks_at, spread_out
from tests.fakes.fake_cell import rig

BOARD = parse_board("9x6", 16.0, [])
HAND_EYE = frames.rigid(frames.rotation_from_vector(np.radians([3.0, -4.0, 90.0])), np.array([10.0, -80.0, 60.0]))
LIES = frames.rigid(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 400.0, 0.0]))
IN_WORLD = frames.rigid(np.diag([1.0, -1.0, -1.0]), np.array([500.0, 0.0, 700.0]))
IN_GRIPPER = frames.rigid(np.eye(3), np.array([-60.0, -40.0, 20.0]))


def setup_with(held: bool) -> Setup:
    mounting, rest = (IN_WORLD, IN_GRIPPER) if held else (HAND_EYE, LIES)
    at_mm = frames.apply(mounting, np.array([0.0, 0.0, 330.0]))
    return Setup(rig(), mounting, rest, BOARD.points_mm(), at_mm, held, ArmError())


def tools(setup: Setup) -> list[Array]:
    """world_from_tool of looks around the board."""
    looks = looks_at(LIES, BOARD.points_mm().mean(axis=0), np.array([1.0, 0.0, 0.0]))[::7]
    if not setup.held:
        return [look @ frames.inverse(HAND_EYE) for look in looks]
    return [IN_WORLD @ frames.inverse(look) @ LIES @ frames.inverse(IN_GRIPPER) for look in looks]


def by_equations(setup: Setup, world_from_tool: Array) -> Array:
    """(12, 12) information about the motions of mounting and rest, by the solver's own equations of that view."""
    carried = world_from_tool if setup.held else frames.inverse(world_from_tool)
    seen = frames.inverse(setup.mounting) @ carried @ setup.rest
    px = [camera.project(frames.apply(seen, setup.points_mm)) for camera in (setup.rig.left, setup.rig.right)]
    at = np.concatenate([pose_of(setup.mounting), pose_of(setup.rest), np.zeros(6)])
    sample = Sample(world_from_tool, setup.points_mm, *px, held=setup.held)
    residuals, jacobian = hand_eye_problem([sample], setup.rig, setup.arm)(at)
    shared, _ = pose_equations(jacobian, residuals, at, [slice(6, None)])[0].without_own(setup.arm)
    back = np.zeros((SHARED, SHARED))
    for k in (0, 6):
        back[k : k + 6, k : k + 6] = np.linalg.inv(motion_by_parameters(at[k : k + 6]))
    return np.asarray(back.T @ shared @ back)


@pytest.mark.parametrize("held", [False, True])
def test_what_a_pose_adds_is_what_the_solver_takes_from_a_view_there(held: bool) -> None:
    """Few corners stand for all: the error that several poses leave is the same within a few per cent."""
    setup = setup_with(held)
    poses = tools(setup)[::20]
    adds, in_view = information(setup, poses)
    ours = error_mm(setup, adds.sum(axis=0))
    solver = error_mm(setup, np.sum([by_equations(setup, pose) for pose in poses], axis=0))
    assert len(poses) > 5
    assert in_view.any()
    assert ours == pytest.approx(solver, rel=0.05)


def test_sixteen_telling_poses_leave_as_little_error_as_twentyfour_that_differ_most() -> None:
    setup = setup_with(held=False)
    poses = tools(setup)
    first = [poses[0]]
    telling = [poses[k] for k in most_telling(setup, poses, 16, lambda _: True, first)]
    differing = spread_out(poses, 24, lambda _: True, first[0])
    left = [error_mm(setup, information(setup, first + more)[0].sum(axis=0)) for more in (telling, differing)]
    assert len(telling) == 16
    assert left[0] < 1.1 * left[1]


def test_poses_that_are_not_allowed_or_that_do_not_show_the_whole_board_are_left_out() -> None:
    setup = setup_with(held=False)
    poses = tools(setup)
    turned_away = poses[0] @ frames.rigid(frames.rotation_from_vector(np.array([0.0, np.pi / 2, 0.0])), np.zeros(3))
    assert not information(setup, [turned_away])[1][0]
    chosen = most_telling(setup, [turned_away, *poses], 5, lambda pose: pose[0, 3] > 0, [poses[0]])
    assert len(chosen) == len(set(chosen)) == 5
    assert all(poses[k - 1][0, 3] > 0 for k in chosen)
    assert most_telling(setup, poses, 5, lambda _: False, [poses[0]]) == []


def test_one_camera_tells_less_than_two() -> None:
    setup = setup_with(held=False)
    poses = tools(setup)[::20]
    one = replace(setup, cameras=1)
    assert error_mm(one, information(one, poses)[0].sum(axis=0)) > error_mm(
        setup, information(setup, poses)[0].sum(axis=0)
    )
