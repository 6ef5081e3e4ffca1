"""The hand-eye from looks at a board whose truth is known, with an arm that errs once a pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.arm_error import ArmError, estimated_arm_error, motion_by_parameters, pose_equations
from daemon.calibration.hand_eye import (
    MIN_POSES,
    HandEyeError,
    HandEyeResult,
    Sample,
    calibrate_hand_eye,
    cyclopean_from_board,
    diversity_deg,
    hand_eye_problem,
    park_martin,
    shah,
)
from daemon.calibration.least_squares import pose_of, transform_of
from tests.fakes.boards import BOARD
from tests.fakes.chosen import few
from tests.fakes.rigs import unlike_rig

TRUE_HAND_EYE = frames.rigid(frames.rotation_from_vector(np.array([0.2, -0.1, 1.5])), np.array([-75.0, 3.0, -110.0]))
WORLD_FROM_BOARD = frames.rigid(frames.rotation_from_vector(np.array([3.1, 0.05, 0.1])), np.array([520.0, 0, -300.0]))


def looks(seed: int, count: int = 14, arm_mm: float = 0.05, noise_px: float = 0.1, tilt: float = 0.45) -> list[Sample]:
    """Looks at the board from around 300 mm, tilted about both axes and rolled."""
    rng, rig, samples = np.random.default_rng(seed), unlike_rig(), []
    centre = np.append(BOARD.points_mm()[:, :2].mean(axis=0), 0.0)
    for _ in range(count):
        turn = frames.rotation_from_vector(np.array([*rng.uniform(-tilt, tilt, 2), rng.uniform(-0.6, 0.6)]))
        camera_from_board = frames.rigid(
            turn, np.array([*rng.uniform(-10, 10, 2), rng.uniform(260, 360)]) - turn @ centre
        )
        points = frames.apply(camera_from_board, BOARD.points_mm())
        seen = [camera.project(points) + rng.normal(0, noise_px, (len(points), 2)) for camera in (rig.left, rig.right)]
        world_from_tool = WORLD_FROM_BOARD @ frames.inverse(camera_from_board) @ frames.inverse(TRUE_HAND_EYE)
        wobble = np.concatenate([rng.normal(0, arm_mm, 3), rng.normal(0, np.radians(0.02) * arm_mm / 0.05, 3)])
        samples.append(Sample(frames.perturb(world_from_tool, wobble), BOARD.points_mm(), seen[0], seen[1]))
    return samples


@cache
def calibrated(seed: int) -> HandEyeResult:
    return calibrate_hand_eye(looks(seed), unlike_rig())


@cache
def calibrated_held(seed: int) -> HandEyeResult:
    return calibrate_hand_eye(held_looks(seed), unlike_rig())


def off(found: Array) -> tuple[float, float]:
    motion = frames.difference(found, TRUE_HAND_EYE)
    return float(np.linalg.norm(motion[:3])), float(np.degrees(np.linalg.norm(motion[3:])))


def test_as_few_poses_as_are_needed_are_enough_and_one_less_is_refused() -> None:
    some = looks(3, MIN_POSES)
    assert off(calibrate_hand_eye(some, unlike_rig()).mounting)[0] < 2.0
    with pytest.raises(HandEyeError, match=f"{MIN_POSES - 1} poses, {MIN_POSES} are needed"):
        calibrate_hand_eye(some[1:], unlike_rig())


def test_both_closed_forms_are_exact_without_noise() -> None:
    samples = looks(0, arm_mm=0.0, noise_px=0.0)
    arm = [s.world_from_tool for s in samples]
    camera = [cyclopean_from_board(s, unlike_rig()) for s in samples]
    for solver in (park_martin, shah):
        mm, deg = off(solver(arm, camera))
        assert mm < 1e-3
        assert deg < 1e-4


@pytest.mark.parametrize("seed", range(3))
def test_the_refined_hand_eye_is_right_and_its_standard_deviation_covers_its_error(seed: int) -> None:
    result = calibrated(seed)
    mm, deg = off(result.mounting)
    assert mm < 0.3
    assert deg < 0.1
    assert mm < 3 * result.sigma_mm
    assert deg < 3 * result.sigma_deg
    assert result.warning is None
    assert len(result.left_out_mm) == 14


def assert_jacobian_is_the_slope(problem: Callable[[Any], Any], x: Any) -> None:
    jacobian = problem(x)[1]
    for k in range(len(x)):
        step = np.zeros(len(x))
        step[k] = 1e-5 * max(1.0, abs(x[k]))
        slope = (problem(x + step)[0] - problem(x - step)[0]) / (2 * step[k])
        np.testing.assert_allclose(jacobian[:, k], slope, rtol=1e-4, atol=1e-4 * np.abs(slope).max())


def test_the_jacobian_is_the_slope_of_the_residuals() -> None:
    samples = looks(1, count=2)
    problem = hand_eye_problem(samples, unlike_rig(), ArmError())
    arm_errors = [0.001, 0.002, -0.001, 0.1, -0.2, 0.1] * 2
    x = np.array([0.2, -0.1, 1.4, -74.0, 2, -108, 3.0, 0.1, 0.1, 515, 4, -305, *arm_errors])
    assert_jacobian_is_the_slope(problem, x)


TOOL_FROM_BOARD = frames.rigid(frames.rotation_from_vector(np.array([0.1, -0.05, 1.6])), np.array([-60.0, 70.0, 4.0]))
OVER_THE_TABLE = frames.rigid(frames.rotation_from_vector(np.array([2.2, 2.2, 0.0])), np.array([520.0, 60.0, 300.0]))


def held_looks(seed: int, count: int = 18, arm_mm: float = 0.1, noise_px: float = 0.1) -> list[Sample]:
    """Looks of fixed cameras at the board in the gripper, about 400 mm from them."""
    rng, rig, samples = np.random.default_rng(seed), unlike_rig(), []
    centre = BOARD.points_mm().mean(axis=0)
    for _ in range(count):
        turn = frames.rotation_from_vector(np.array([*rng.uniform(-0.45, 0.45, 2), rng.uniform(-0.6, 0.6)]))
        middle = np.array([*rng.uniform(-40, 40, 2), rng.uniform(360, 440)])
        camera_from_board = frames.rigid(turn, middle - turn @ centre)
        points = frames.apply(camera_from_board, BOARD.points_mm())
        seen = [camera.project(points) + rng.normal(0, noise_px, (len(points), 2)) for camera in (rig.left, rig.right)]
        true = OVER_THE_TABLE @ camera_from_board @ frames.inverse(TOOL_FROM_BOARD)
        wobble = np.concatenate([rng.normal(0, arm_mm, 3), rng.normal(0, np.radians(0.02) * arm_mm / 0.1, 3)])
        samples.append(Sample(frames.perturb(true, wobble), BOARD.points_mm(), seen[0], seen[1], board_in_gripper=True))
    return samples


def test_fixed_cameras_are_found_exactly_without_noise() -> None:
    result = calibrate_hand_eye(held_looks(0, count=9, arm_mm=0.0, noise_px=0.0), unlike_rig())
    np.testing.assert_allclose(result.mounting, OVER_THE_TABLE, atol=1e-3)
    assert max(result.left_out_mm) < 1e-3


@pytest.mark.parametrize("seed", few(range(3), 1))
def test_where_fixed_cameras_are_is_right_about_where_the_board_was_and_so_is_the_arm(seed: int) -> None:
    result = calibrated_held(seed)
    motion = frames.difference(result.mounting, OVER_THE_TABLE)
    assert result.about_mm is not None
    assert np.linalg.norm(result.about_mm - OVER_THE_TABLE[:3, 3]) == pytest.approx(400.0, abs=30.0)
    there = motion[:3] + np.cross(motion[3:], result.about_mm - OVER_THE_TABLE[:3, 3])
    assert np.linalg.norm(there) < 3 * result.sigma_mm < 1.0
    assert np.degrees(np.linalg.norm(motion[3:])) < 3 * result.sigma_deg < 0.5
    assert 0.05 < result.arm.mm < 0.2
    assert result.warning is None


def test_a_turn_of_fixed_cameras_far_from_the_board_counts_at_the_board() -> None:
    """Their rotation and their place err together: what that leaves at the board is less than at the cameras."""
    result = calibrated_held(0)
    assert result.about_mm is not None
    at_cameras = frames.point_motion((OVER_THE_TABLE[:3, 3] - result.about_mm)[None])[0]
    there = at_cameras @ result.covariance @ at_cameras.T
    assert np.array_equal(np.round(result.covariance, 12), np.round(result.covariance.T, 12))
    assert result.sigma_mm < 0.7 * np.sqrt(np.trace(there[:3, :3]))
    assert result.sigma_mm < 0.5


def test_the_motion_by_parameters_is_the_slope_of_the_motion() -> None:
    pose, slope = pose_of(OVER_THE_TABLE), motion_by_parameters(pose_of(OVER_THE_TABLE))
    step = np.array([1e-4, -2e-4, 1e-4, 0.1, 0.2, -0.3])
    moved = frames.difference(transform_of(pose + step), OVER_THE_TABLE)
    np.testing.assert_allclose(slope @ step, moved, rtol=1e-2, atol=1e-6)


def test_the_jacobian_of_a_held_board_is_the_slope_of_the_residuals() -> None:
    samples = held_looks(1, count=2)
    problem = hand_eye_problem(samples, unlike_rig(), ArmError())
    arm_errors = [0.001, 0.002, -0.001, 0.1, -0.2, 0.1] * 2
    pose = [*pose_of(OVER_THE_TABLE) + 0.003, *pose_of(TOOL_FROM_BOARD) - 0.002]
    x = np.array([*pose, *arm_errors])
    assert_jacobian_is_the_slope(problem, x)


def test_turning_about_one_axis_alone_is_refused_with_the_remedy() -> None:
    samples = looks(2)
    roll_only = [
        Sample(
            samples[0].world_from_tool
            @ frames.rigid(frames.rotation_from_vector(np.array([0, 0, 0.1 * k])), np.zeros(3)),
            s.points_mm,
            s.left_px,
            s.right_px,
        )
        for k, s in enumerate(samples)
    ]
    assert diversity_deg([s.world_from_tool for s in roll_only]) < 1e-3
    with pytest.raises(HandEyeError, match="tilt the gripper about two directions"):
        calibrate_hand_eye(roll_only, unlike_rig())


def test_too_few_poses_are_refused() -> None:
    with pytest.raises(HandEyeError, match="4 poses, 5 are needed"):
        calibrate_hand_eye(looks(3)[:4], unlike_rig())


def test_a_mistaken_pose_shows_in_the_left_out_errors() -> None:
    samples = looks(4)
    typo = samples[3].world_from_tool.copy()
    typo[0, 3] += 10.0
    samples[3] = Sample(typo, samples[3].points_mm, samples[3].left_px, samples[3].right_px)
    left_out = calibrate_hand_eye(samples, unlike_rig()).left_out_mm
    assert int(np.argmax(left_out)) == 3
    assert left_out[3] > 3 * float(np.median(left_out))


@pytest.mark.parametrize("arm_mm", [0.04, 0.25])
def test_how_far_the_arm_errs_is_found_from_its_looks_whatever_was_thought_of_it(arm_mm: float) -> None:
    found = [calibrate_hand_eye(looks(seed, count=20, arm_mm=arm_mm), unlike_rig()).arm for seed in (0, 1)]
    assert np.mean([arm.mm for arm in found]) == pytest.approx(arm_mm, rel=0.25)
    assert np.mean([arm.deg for arm in found]) == pytest.approx(0.02 * arm_mm / 0.05, rel=0.35)


def test_how_far_the_arm_errs_is_the_same_from_whatever_the_estimate_starts() -> None:
    """Where the corners hardly show the error of a single pose, most iterations are needed."""
    rng, arm = np.random.default_rng(0), ArmError(0.1, 0.03)
    sigma, count = np.sqrt(arm.variances()), 20
    jacobian, rows = rng.normal(size=(24 * count, 12 + 6 * count)), [slice(24 * k, 24 * k + 24) for k in range(count)]
    residuals = rng.normal(size=24 * count)
    for k, there in enumerate(rows):
        own = slice(12 + 6 * k, 18 + 6 * k)
        jacobian[there, own] /= 3.0 * sigma
        residuals[there] += jacobian[there, own] @ (sigma * rng.normal(size=6))
    poses = pose_equations(jacobian, residuals, np.zeros(jacobian.shape[1]), rows)
    found = [estimated_arm_error(poses, start) for start in (arm, ArmError(0.01, 0.003))]
    for one in found:
        assert (one.mm, one.deg) == pytest.approx((found[0].mm, found[0].deg), rel=0.01)
        assert (one.mm, one.deg) == pytest.approx((arm.mm, arm.deg), rel=0.25)


def test_an_error_that_all_poses_share_is_in_the_covariance_with_its_lever() -> None:
    """It leaves no residual: an arm that errs by 0.2 mm and 0.08 degrees may be off by that in all poses alike."""
    result = calibrate_hand_eye(looks(0, count=20, arm_mm=0.2), unlike_rig())
    lever = np.abs(TRUE_HAND_EYE[:3, 3])
    turn = np.radians(result.arm.deg)
    least = np.sqrt(result.arm.mm**2 + turn**2 * (lever @ lever - lever**2))
    assert (np.sqrt(np.diag(result.covariance))[:3] > least).all()
    assert (np.sqrt(np.diag(result.covariance))[3:] > turn).all()
    assert result.sigma_mm == pytest.approx(np.sqrt(np.trace(result.covariance[:3, :3])))


def test_what_is_left_out_is_predicted_as_if_it_had_been_solved_without_it() -> None:
    """By one linear step; solving again from the start takes twenty times as long and gives the same."""
    samples, rig = looks(6, count=12, arm_mm=0.2), unlike_rig()
    result = calibrate_hand_eye(samples, rig)
    for k in (0, 5):
        rest = calibrate_hand_eye([*samples[:k], *samples[k + 1 :]], rig).mounting
        again = samples[k].world_from_tool @ rest @ cyclopean_from_board(samples[k], rig)
        others = [s.world_from_tool @ rest @ cyclopean_from_board(s, rig) for s in samples[:k] + samples[k + 1 :]]
        middle, _ = frames.fuse(others, [np.eye(6)] * len(others))
        gaps = frames.apply(again, BOARD.points_mm()) - frames.apply(middle, BOARD.points_mm())
        assert result.left_out_mm[k] == pytest.approx(np.sqrt((gaps**2).sum(axis=1).mean()), rel=0.3)


def test_two_solvers_that_disagree_by_more_than_chance_are_told() -> None:
    result = calibrated(0)
    assert result.warning is None
    assert result.solvers_mm > 0.0 < result.solvers_deg
    limit_mm, limit_deg = max(2.0, 8 * result.sigma_mm), max(0.3, 8 * result.sigma_deg)
    for found, told in (
        (replace(result, solvers_mm=limit_mm, solvers_deg=limit_deg), False),
        (replace(result, solvers_mm=1.01 * limit_mm, solvers_deg=0.0), True),
        (replace(result, solvers_mm=0.0, solvers_deg=1.01 * limit_deg), True),
    ):
        assert (found.warning is not None) is told
