"""Which poses tell most about a hand-eye."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.arm_error import SHARED, ArmError, motion_by_parameters, pose_equations
from daemon.calibration.board import parse_board
from daemon.calibration.hand_eye import Sample, hand_eye_problem
from daemon.calibration.informative_poses import FEW, Setup, error_mm, information, most_informative
from daemon.calibration.least_squares import pose_of
from daemon.calibration.tour import choose_spread, viewpoints_around
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
    looks = viewpoints_around(LIES, BOARD.points_mm().mean(axis=0), np.array([1.0, 0.0, 0.0]))[::7]
    if not setup.board_in_gripper:
        return [look @ frames.inverse(HAND_EYE) for look in looks]
    return [IN_WORLD @ frames.inverse(look) @ LIES @ frames.inverse(IN_GRIPPER) for look in looks]


def by_equations(setup: Setup, world_from_tool: Array) -> Array:
    """(12, 12) information about the motions of mounting and rest, by the solver's own equations of that view."""
    carried = world_from_tool if setup.board_in_gripper else frames.inverse(world_from_tool)
    seen = frames.inverse(setup.mounting) @ carried @ setup.rest
    left, right = (camera.project(frames.apply(seen, setup.points_mm)) for camera in (setup.rig.left, setup.rig.right))
    at = np.concatenate([pose_of(setup.mounting), pose_of(setup.rest), np.zeros(6)])
    sample = Sample(world_from_tool, setup.points_mm, left, right, board_in_gripper=setup.board_in_gripper)
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
    telling = [poses[k] for k in most_informative(setup, poses, 16, lambda _: True, first)]
    differing = choose_spread(poses, 24, lambda _: True, first[0])
    left = [error_mm(setup, information(setup, first + more)[0].sum(axis=0)) for more in (telling, differing)]
    assert len(telling) == 16
    assert left[0] < 1.1 * left[1]


def test_poses_that_are_not_allowed_or_that_do_not_show_the_whole_board_are_left_out() -> None:
    setup = setup_with(held=False)
    poses = tools(setup)
    turned_away = poses[0] @ frames.rigid(frames.rotation_from_vector(np.array([0.0, np.pi / 2, 0.0])), np.zeros(3))
    assert not information(setup, [turned_away])[1][0]
    chosen = most_informative(setup, [turned_away, *poses], 5, lambda pose: pose[0, 3] > 0, [poses[0]])
    assert len(chosen) == len(set(chosen)) == 5
    assert all(poses[k - 1][0, 3] > 0 for k in chosen)
    assert most_informative(setup, poses, 5, lambda _: False, [poses[0]]) == []


def test_one_camera_tells_less_than_two() -> None:
    setup = setup_with(held=False)
    poses = tools(setup)[::20]
    one = replace(setup, cameras=1)
    assert error_mm(one, information(one, poses)[0].sum(axis=0)) > error_mm(
        setup, information(setup, poses)[0].sum(axis=0)
    )


def test_each_chosen_pose_is_the_one_that_leaves_the_least_error_after_those_before() -> None:
    """Reckoned anew, one pose after the other, from all views together."""
    setup = setup_with(held=False)
    poses = tools(setup)[::9]
    adds, in_view = information(setup, poses)
    done, chosen = [poses[3]], list[int]()
    start = information(setup, done)[0][0]
    for _ in range(4):
        left = {
            k: float(error_mm(setup, start + sum(adds[j] for j in chosen) + adds[k]))
            for k in range(len(poses))
            if in_view[k] and k not in chosen and poses[k][1, 3] > poses[3][1, 3]
        }
        chosen.append(min(left, key=left.__getitem__))
    assert most_informative(setup, poses, 4, lambda pose: bool(pose[1, 3] > poses[3][1, 3]), done) == chosen


def test_no_more_poses_are_chosen_than_show_the_board() -> None:
    setup = setup_with(held=False)
    poses = tools(setup)[::20]
    in_view = np.flatnonzero(information(setup, poses)[1])
    assert sorted(most_informative(setup, poses, 1000, lambda _: True, poses[:1])) == in_view.tolist()
    assert most_informative(setup, poses, 0, lambda _: True, poses[:1]) == []


def test_a_pose_is_asked_about_only_where_it_would_be_chosen_next() -> None:
    """To ask may mean to plan a way there."""
    setup, asked = setup_with(held=False), list[Array]()
    poses = tools(setup)[::9]
    most_informative(setup, poses, 3, lambda pose: asked.append(pose) or True, poses[:1])
    assert len(asked) == 3


@given(st.floats(-300.0, 300.0), st.floats(100.0, 600.0))
def test_with_nothing_seen_a_part_is_off_by_the_rulers_error_at_its_distance_from_the_cameras(
    aside: float, ahead: float
) -> None:
    """20 mm an axis, and 0.2 rad about the two axes that are square to the way there."""
    at_mm = HAND_EYE[:3, 3] + np.array([aside, 0.0, ahead])
    by_ruler = error_mm(replace(setup_with(held=False), at_mm=at_mm), np.zeros((12, 12)))
    assert by_ruler == pytest.approx(np.sqrt(3 * 20.0**2 + 2 * 0.2**2 * (aside**2 + ahead**2)))


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("cameras", [1, 2])
def test_a_pose_shows_the_whole_board_where_each_corner_is_before_each_camera_and_in_its_picture(
    held: bool, cameras: int
) -> None:
    setup = replace(setup_with(held), cameras=cameras, points_mm=BOARD.points_mm()[::6])
    poses = tools(setup)[::4]
    rng = np.random.default_rng(0)
    poses += [
        pose @ frames.perturb(np.eye(4), np.append(rng.normal(0, 60, 3), rng.normal(0, 0.3, 3))) for pose in poses
    ]
    looking = (setup.rig.left, setup.rig.right)[:cameras]
    whole = []
    for pose in poses:
        seen = frames.inverse(setup.mounting) @ (pose if held else frames.inverse(pose)) @ setup.rest
        corners = frames.apply(seen, setup.points_mm)
        px = np.array([camera.project(corners) for camera in looking])
        inside = (px >= 0.0) & (px < np.array(setup.rig.image_size))
        whole.append(bool(inside.all() and (corners[:, 2] > 0.0).all()))
    assert information(setup, poses)[1].tolist() == whole
    assert 0 < sum(whole) < len(whole)


@pytest.mark.parametrize("held", [False, True])
def test_of_a_board_with_few_corners_all_count_and_a_pose_adds_exactly_what_the_solver_takes(held: bool) -> None:
    setup = replace(setup_with(held), points_mm=np.ascontiguousarray(BOARD.points_mm()[::6]))
    assert len(setup.points_mm) == FEW
    for pose in tools(setup)[::40]:
        adds = information(setup, [pose])[0][0]
        np.testing.assert_allclose(adds, by_equations(setup, pose), rtol=1e-3, atol=1e-3 * np.abs(adds).max())
