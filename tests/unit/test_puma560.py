"""The PUMA's kinematics: against an independent model, all eight configurations, limits, the straight wrist."""

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.arrays import Array
from drivers.puma560 import (
    CONFIGURATIONS,
    NEST_RAD,
    PUMA560,
    READY_RAD,
    ArmGeometry,
    Configuration,
    UnreachableError,
    configuration_of,
    forward,
    inverse,
    joint_out_of_limits,
    link_frames,
    solutions,
    wrist_is_singular,
)
from drivers.pumas import PUBLISHED, PublishedArm

UNLIMITED = ArmGeometry(limits_rad=np.radians([[-360.0, 360.0]] * 6))
LOW, HIGH = PUMA560.limits_rad.T

some_joints = st.tuples(*(st.floats(low, high) for low, high in PUMA560.limits_rad)).map(np.array)


@pytest.fixture(scope="module")
def oracle() -> Iterator[Any]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import roboticstoolbox

        yield roboticstoolbox.models.DH.Puma560()


def in_shoulder_frame(oracle: Any, joints_rad: Array) -> Array:
    pose: Array = oracle.fkine(joints_rad).A.copy()
    pose[:3, 3] = (pose[:3, 3] - [0, 0, oracle.links[0].d]) * 1000.0
    return pose


def in_toolbox_frame(oracle: Any, pose: Array) -> Array:
    pose = pose.copy()
    pose[:3, 3] = pose[:3, 3] / 1000.0 + [0, 0, oracle.links[0].d]
    return pose


def any_joints(count: int) -> Array:
    return np.random.default_rng(560).uniform(LOW, HIGH, (count, 6))


def test_forward_kinematics_equal_the_toolbox_s_to_a_billionth(oracle: Any) -> None:
    worst = max(np.abs(forward(q) - in_shoulder_frame(oracle, q)).max() for q in any_joints(300))
    assert worst < 1e-9


def test_all_eight_inverse_solutions_equal_the_toolbox_s_to_a_billionth(oracle: Any) -> None:
    worst = 0.0
    for q in any_joints(40):
        pose = forward(q)
        for way in CONFIGURATIONS:
            letters = ("l" if way.lefty else "r") + ("u" if way.above else "d") + ("f" if way.flip else "n")
            theirs = oracle.ikine_a(in_toolbox_frame(oracle, pose), letters).q
            apart = (inverse(pose, way, UNLIMITED) - theirs + np.pi) % (2 * np.pi) - np.pi
            worst = max(worst, np.abs(apart).max())
    assert worst < 1e-9


@given(some_joints)
def test_every_solution_reaches_the_pose_in_the_configuration_it_names(q: Array) -> None:
    pose = forward(q)
    for way, found in solutions(pose):
        assert np.abs(forward(found) - pose).max() < 1e-5
        assert joint_out_of_limits(found) is None
        if not wrist_is_singular(found, 1e-4) and not on_a_boundary(found):
            assert configuration_of(found) == way


@given(some_joints)
def test_the_arm_s_own_joints_are_found_again_in_its_own_configuration(q: Array) -> None:
    if wrist_is_singular(q, 1e-3) or on_a_boundary(q):
        return
    np.testing.assert_allclose(inverse(forward(q), configuration_of(q), near_rad=q), q, atol=1e-7)


def on_a_boundary(q: Array) -> bool:
    """Whether the arm is (nearly) stretched, folded or over the column, where two configurations meet."""
    outward = 431.8 * np.cos(q[1]) + 20.3 * np.cos(q[1] + q[2]) - 431.8 * np.sin(q[1] + q[2])
    return abs(outward) < 1.0 or abs(np.sin(q[2] + np.arctan2(431.8, 20.3))) < 1e-3


@pytest.mark.parametrize("published", PUBLISHED, ids=lambda published: published.name)
@pytest.mark.parametrize("side", [1.0, -1.0], ids=["right", "left"])
def test_an_arm_of_other_lengths_is_found_again_by_every_way_it_reaches_a_pose(
    published: PublishedArm, side: float
) -> None:
    a2, a3, d3, d4 = published.lengths_mm
    arm = ArmGeometry(a2, a3, side * d3, d4, limits_rad=UNLIMITED.limits_rad)
    for q in any_joints(20):
        pose = forward(q, arm)
        ways = list(solutions(pose, arm, q))
        assert len(ways) == 8
        assert min(np.abs(found - q).max() for _, found in ways) < 1e-6
        for way, found in ways:
            assert np.abs(forward(found, arm) - pose).max() < 1e-5
            assert configuration_of(found, arm) == way
        np.testing.assert_allclose(link_frames(q[None], arm)[0, 6, :3, 3], pose[:3, 3], atol=1e-9)


def test_base_and_tool_are_part_of_the_way_from_world_to_tool() -> None:
    base, tool = np.eye(4), np.eye(4)
    base[:3, 3], tool[:3, 3] = [10.0, 20.0, 30.0], [0.0, 0.0, 160.0]
    arm = ArmGeometry(world_from_base=base, flange_from_tool=tool)
    q = np.radians([10.0, 40.0, -190.0, 5.0, -25.0, 15.0])
    np.testing.assert_allclose(forward(q, arm), base @ forward(q) @ tool, atol=1e-12)
    np.testing.assert_allclose(inverse(forward(q, arm), configuration_of(q), arm, q), q, atol=1e-9)


def test_a_straight_wrist_keeps_joint_four_where_it_is_and_lets_joint_six_turn() -> None:
    q = np.radians([20.0, 60.0, -150.0, 35.0, 0.0, 10.0])
    now = np.radians([0.0, 60.0, -150.0, -50.0, 0.0, 0.0])
    found = inverse(forward(q), Configuration(), near_rad=now)
    assert found[3] == pytest.approx(now[3])
    assert found[3] + found[5] == pytest.approx(q[3] + q[5])
    np.testing.assert_allclose(forward(found), forward(q), atol=1e-9)


def test_the_ready_pose_is_straight_up_and_its_wrist_straight() -> None:
    assert forward(READY_RAD)[2, 3] == pytest.approx(863.6)
    assert wrist_is_singular(READY_RAD)


@pytest.mark.parametrize("pose", [READY_RAD, NEST_RAD])
def test_the_poses_it_knows_by_name_are_within_its_limits(pose: Array) -> None:
    assert joint_out_of_limits(pose) is None


@pytest.mark.parametrize(
    ("place", "why"),
    [
        ([1500.0, 0.0, 0.0], "too far from the shoulder"),
        ([0.0, 0.0, 900.0], "too close to the column"),
        ([100.0, 0.0, 0.0], "too close to the column"),
        ([0.0, 150.0501, 0.1], "too close to the shoulder"),
    ],
)
def test_a_place_out_of_reach_is_called_so(place: list[float], why: str) -> None:
    pose = np.eye(4)
    pose[:3, 3] = place
    assert not list(solutions(pose))
    with pytest.raises(UnreachableError, match=why) as refusal:
        inverse(pose, Configuration(), UNLIMITED)
    assert refusal.value.joint is None


@pytest.mark.parametrize(
    ("joints_deg", "joint"),
    [
        ([170, 60, -150, 0, -30, 0], 1),
        ([0, -30, -60, 0, -30, 0], 2),
        ([0, 60, 60, 0, -30, 0], 3),
        ([0, 60, -150, 0, -120, 0], 5),
    ],
)
def test_the_joint_whose_limit_is_in_the_way_is_named(joints_deg: list[float], joint: int) -> None:
    q = np.radians(np.array(joints_deg, dtype=float))
    assert joint_out_of_limits(q) == joint
    with pytest.raises(UnreachableError, match=f"joint {joint}") as refusal:
        inverse(forward(q), configuration_of(q), near_rad=q)
    assert refusal.value.joint == joint


def test_the_limits_are_those_of_the_data_sheet() -> None:
    np.testing.assert_allclose(
        np.degrees(PUMA560.limits_rad),
        [[-160, 160], [-20, 200], [-225, 45], [-266, 266], [-100, 100], [-266, 266]],
    )


def test_a_wrist_joint_takes_the_turn_nearest_to_where_it_is() -> None:
    q = np.radians([0.0, 40.0, -190.0, 0.0, -25.0, 200.0])
    assert inverse(forward(q), configuration_of(q), near_rad=q)[5] == pytest.approx(q[5])
    assert inverse(forward(q), configuration_of(q))[5] == pytest.approx(q[5] - 2 * np.pi)
