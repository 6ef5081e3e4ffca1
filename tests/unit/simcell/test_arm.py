"""The simulated arm's motion: where it is when, how fast, along which path, and what is true of it."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.arrays import Array
from drivers.puma560 import READY_RAD, ArmGeometry, Configuration, UnreachableError, configuration_of, forward
from drivers.simcell.arm import (
    JOINT_SPEED_RAD_S,
    LINE_SPEED_MM_S,
    SimulatedArm,
    SingularWristError,
    Trapezoid,
)
from drivers.val2.location import Location, matrix_from_location

START = np.radians([16.8, 42.7, -195.3, 0.0, -27.4, 106.8])
TARGET = np.radians([40.0, 60.0, -180.0, 20.0, -50.0, 60.0])

profiles = st.builds(Trapezoid, st.floats(0.05, 50), st.floats(0.05, 500))


@given(profiles)
def test_a_way_goes_from_nothing_to_all_and_never_back(profile: Trapezoid) -> None:
    ways = [profile.way(t) for t in np.linspace(0, profile.duration_s, 50)]
    assert ways[0] == 0.0
    assert ways[-1] == pytest.approx(1.0)
    assert all(b >= a - 1e-12 for a, b in pairwise(ways))


@given(profiles)
def test_neither_speed_nor_acceleration_is_exceeded(profile: Trapezoid) -> None:
    times = np.linspace(0, profile.duration_s, 400)
    ways = np.array([profile.way(t) for t in times])
    speeds = np.diff(ways) / np.diff(times)
    assert np.max(speeds) <= profile.speed * (1 + 1e-6)
    assert np.max(np.abs(np.diff(speeds))) / (times[1] - times[0]) <= profile.acceleration * 1.01


@given(profiles, st.floats(0, 1), st.floats(1, 4))
def test_a_motion_cut_short_stops_between_here_and_its_end(profile: Trapezoid, share: float, braking: float) -> None:
    cut_s = share * profile.duration_s
    cut = profile.cut(cut_s, braking)
    assert cut.duration_s <= profile.duration_s + 1e-9
    assert profile.way(cut_s) - 1e-9 <= cut.way(cut.duration_s) <= 1.0 + 1e-9
    assert cut.way(cut.duration_s + 5) == cut.way(cut.duration_s)
    assert cut.way(cut_s / 2) == profile.way(cut_s / 2)


def sampled(arm: SimulatedArm, count: int = 200) -> tuple[Array, Array]:
    times = np.linspace(0.0, arm.rests_s, count)
    return times, np.array([arm.joints_at(t) for t in times])


def test_joints_start_and_end_together_and_the_slowest_sets_the_pace() -> None:
    arm = SimulatedArm(joints_rad=START)
    arm.move_joints(TARGET, 1.0, 0.0)
    times, joints = sampled(arm)
    shares = (joints - START) / (TARGET - START)
    np.testing.assert_allclose(shares, np.repeat(shares[:, :1], 6, axis=1), atol=1e-9)
    speeds = np.abs(np.diff(joints, axis=0)) / np.diff(times)[:, None]
    assert np.max(speeds / JOINT_SPEED_RAD_S) <= 1 + 1e-6
    np.testing.assert_allclose(joints[-1], TARGET, atol=1e-12)


def test_half_the_speed_takes_longer_and_ends_at_the_same_place() -> None:
    fast, slow = SimulatedArm(joints_rad=START), SimulatedArm(joints_rad=START)
    fast.move_joints(TARGET, 1.0, 0.0)
    slow.move_joints(TARGET, 0.5, 0.0)
    assert slow.rests_s > 1.4 * fast.rests_s
    np.testing.assert_allclose(slow.joints_at(slow.rests_s), fast.joints_at(fast.rests_s))


def test_a_straight_move_stays_on_its_line_and_below_half_a_metre_a_second() -> None:
    arm = SimulatedArm(joints_rad=START)
    start = arm.reported_pose_at(0.0)
    goal = matrix_from_location(Location(560.0, 60.0, -150.0, 10.0, 75.0, 15.0))
    arm.move_straight(goal, 1.0, 0.0)
    times, _ = sampled(arm)
    points = np.array([arm.reported_pose_at(t)[:3, 3] for t in times])
    along = goal[:3, 3] - start[:3, 3]
    unit = along / np.linalg.norm(along)
    beside = (points - start[:3, 3]) - np.outer((points - start[:3, 3]) @ unit, unit)
    assert np.abs(beside).max() < 1e-6
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() / (times[1] - times[0]) <= LINE_SPEED_MM_S * 1.001
    np.testing.assert_allclose(arm.reported_pose_at(arm.rests_s), goal, atol=1e-6)


def test_a_straight_move_keeps_the_arm_s_configuration() -> None:
    arm = SimulatedArm(joints_rad=START)
    before = configuration_of(START)
    arm.move_straight(matrix_from_location(Location(560.0, 60.0, -150.0, 10.0, 75.0, 15.0)), 1.0, 0.0)
    assert all(configuration_of(q) == before for q in sampled(arm)[1])


def test_a_line_out_of_reach_is_refused_and_nothing_moves() -> None:
    arm = SimulatedArm(joints_rad=START)
    goal = arm.reported_pose_at(0.0)
    goal[0, 3] += 900.0
    with pytest.raises(UnreachableError):
        arm.move_straight(goal, 1.0, 0.0)
    assert arm.at_rest(0.0)
    np.testing.assert_array_equal(arm.joints_at(1.0), START)


def test_a_line_through_a_straight_wrist_is_refused() -> None:
    bent = np.radians([0.0, 60.0, -150.0, 0.0, -20.0, 0.0])
    goal = forward(np.radians([0.0, 60.0, -150.0, 0.0, 20.0, 0.0]))
    with pytest.raises(SingularWristError):
        SimulatedArm(joints_rad=bent).move_straight(goal, 1.0, 0.0)


def test_a_joint_past_its_limit_is_refused() -> None:
    with pytest.raises(UnreachableError, match="joint 1"):
        SimulatedArm(joints_rad=START).move_joints(TARGET + np.radians([150, 0, 0, 0, 0, 0]), 1.0, 0.0)


def test_a_halted_arm_brakes_along_its_path_and_stays() -> None:
    arm = SimulatedArm(joints_rad=START)
    arm.move_joints(TARGET, 0.3, 0.0)
    natural_s = arm.rests_s
    halted_s = natural_s / 2
    arm.halt(halted_s)
    assert halted_s < arm.rests_s < natural_s
    stopped = arm.joints_at(arm.rests_s)
    shares = (stopped - START) / (TARGET - START)
    np.testing.assert_allclose(shares, shares[0], atol=1e-9)
    assert 0.45 < shares[0] < 1.0
    np.testing.assert_array_equal(arm.joints_at(arm.rests_s + 10), stopped)


def test_an_emergency_stop_brakes_harder_than_an_abort() -> None:
    rests = []
    for braking in (1.0, 4.0):
        arm = SimulatedArm(joints_rad=START)
        arm.move_joints(TARGET, 1.0, 0.0)
        arm.halt(arm.rests_s / 2, braking)
        rests.append(arm.rests_s)
    assert rests[1] < rests[0]


def test_halting_an_arm_at_rest_changes_nothing() -> None:
    arm = SimulatedArm(joints_rad=START)
    arm.halt(5.0)
    assert arm.at_rest(5.0)
    np.testing.assert_array_equal(arm.joints_at(6.0), START)


def test_the_true_tool_differs_from_the_believed_by_the_joint_offsets() -> None:
    offsets = np.radians([0.02, -0.01, 0.03, 0, 0, 0])
    arm = SimulatedArm(joints_rad=START, joint_offsets_rad=offsets)
    np.testing.assert_allclose(arm.pose_at(0.0), forward(START + offsets))
    np.testing.assert_allclose(arm.reported_pose_at(0.0), forward(START))


def test_stops_scatter_by_the_repeatability_and_no_stop_moves_once_made() -> None:
    arm = SimulatedArm(joints_rad=START, repeatability_mm=0.05, rng=np.random.default_rng(3))
    off, now_s = [], 0.0
    for k in range(200):
        arm.move_joints(TARGET if k % 2 else START, 1.0, now_s)
        now_s = arm.rests_s + 1.0
        off.append(arm.pose_at(now_s)[:3, 3] - arm.reported_pose_at(now_s)[:3, 3])
        np.testing.assert_array_equal(arm.pose_at(now_s), arm.pose_at(now_s + 1))
    assert np.std(off) == pytest.approx(0.05, rel=0.15)


def test_where_the_tool_truly_is_never_jumps() -> None:
    arm = SimulatedArm(joints_rad=START, repeatability_mm=5.0)
    arm.move_joints(TARGET, 1.0, 0.0)
    arm.move_joints(START, 1.0, arm.rests_s + 0.1)
    times = np.linspace(0.0, arm.rests_s, 4000)
    points = np.array([arm.pose_at(t)[:3, 3] for t in times])
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() < 3.0


def test_telling_the_controller_of_another_tool_does_not_move_the_true_one() -> None:
    held = np.eye(4)
    held[2, 3] = 160.0
    arm = SimulatedArm(ArmGeometry(flange_from_tool=held), START)
    truly, believed = arm.pose_at(0.0), arm.reported_pose_at(0.0)
    arm.tool = np.eye(4)
    np.testing.assert_array_equal(arm.pose_at(0.0), truly)
    assert np.linalg.norm(arm.reported_pose_at(0.0)[:3, 3] - believed[:3, 3]) == pytest.approx(160.0)


def test_a_pose_is_reached_in_the_configuration_asked_for() -> None:
    arm = SimulatedArm(joints_rad=READY_RAD)
    goal = matrix_from_location(Location(520.0, 0.0, -100.0, 0.0, 80.0, 0.0))
    arm.move_joints(arm.joints_for(goal, Configuration(), 0.0), 1.0, 0.0)
    np.testing.assert_allclose(arm.reported_pose_at(arm.rests_s), goal, atol=1e-9)
    assert configuration_of(arm.joints_at(arm.rests_s)) == Configuration()
