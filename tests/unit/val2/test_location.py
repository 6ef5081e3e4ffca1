"""VAL II's O, A, T: against the vendor's description, round trips, and the straight-down hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.val2 import commands
from drivers.val2.location import Location, apart, location_from_matrix, matrix_from_location

angles = st.floats(-179.999, 179.999)
lengths = st.floats(-900, 900)


def test_a_zero_orientation_points_the_hand_along_minus_y_with_the_fingers_along_x() -> None:
    pose = matrix_from_location(Location(0, 0, 0, 0, 0, 0))
    np.testing.assert_allclose(pose[:3, 2], [0, -1, 0], atol=1e-15)
    np.testing.assert_allclose(pose[:3, 1], [1, 0, 0], atol=1e-15)


def test_o_of_ninety_degrees_points_the_hand_along_plus_x() -> None:
    pose = matrix_from_location(Location(0, 0, 0, 90, 0, 0))
    np.testing.assert_allclose(pose[:3, 2], [1, 0, 0], atol=1e-15)


@given(lengths, lengths, lengths, angles, st.floats(-90, 90), angles)
def test_a_location_s_matrix_is_rigid_and_right_handed(
    x: float, y: float, z: float, o: float, a: float, t: float
) -> None:
    pose = matrix_from_location(Location(x, y, z, o, a, t))
    np.testing.assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), atol=1e-14)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)


@given(angles, st.floats(-90, 90), angles, angles)
def test_a_matrix_becomes_a_location_that_means_the_same_matrix(o: float, a: float, t: float, current_o: float) -> None:
    pose = matrix_from_location(Location(1, 2, 3, o, a, t))
    again = matrix_from_location(location_from_matrix(pose, current_o))
    np.testing.assert_allclose(again, pose, atol=1e-9)


@given(angles, st.floats(-89, 89), angles)
def test_away_from_the_vertical_the_angles_come_back_as_they_were(o: float, a: float, t: float) -> None:
    found = location_from_matrix(matrix_from_location(Location(0, 0, 0, o, a, t)))
    np.testing.assert_allclose([found.o_deg, found.a_deg, found.t_deg], [o, a, t], atol=1e-9)


@pytest.mark.parametrize("a_deg", [90.0, -90.0])
@pytest.mark.parametrize("current_o_deg", [0.0, 37.0, -120.0])
def test_a_hand_straight_down_or_up_keeps_the_o_the_arm_has_now(a_deg: float, current_o_deg: float) -> None:
    pose = matrix_from_location(Location(0, 0, 0, 10.0, a_deg, 25.0))
    found = location_from_matrix(pose, current_o_deg)
    assert found.o_deg == pytest.approx(current_o_deg, abs=1e-9)
    np.testing.assert_allclose(matrix_from_location(found), pose, atol=1e-12)


def test_the_hand_straight_down_is_a_of_ninety_degrees() -> None:
    pose = np.diag([-1.0, 1.0, -1.0, 1.0])
    assert location_from_matrix(pose).a_deg == pytest.approx(90.0)


def test_two_ways_to_write_one_vertical_orientation_are_no_way_apart() -> None:
    assert apart(Location(1, 2, 3, 20, 90, 50), Location(1, 2, 3, 0, 90, 30)) == pytest.approx((0.0, 0.0), abs=1e-6)


def test_a_known_turn_and_shift_are_measured_in_mm_and_degrees() -> None:
    assert apart(Location(0, 0, 0, 0, 0, 0), Location(3, 4, 0, 30, 0, 0)) == pytest.approx((5.0, 30.0))


@given(angles, st.floats(-90, 90), angles)
def test_what_is_sent_to_the_controller_loses_less_than_a_hundredth(o: float, a: float, t: float) -> None:
    sent = commands.trans(Location(-512.344, 99.996, 0.004, o, a, t))
    received = Location(*(float(number) for number in sent.removeprefix("TRANS(").removesuffix(")").split(",")))
    off_mm, off_deg = apart(received, Location(-512.344, 99.996, 0.004, o, a, t))
    assert off_mm < 0.01
    assert off_deg < 0.002


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_location_that_is_not_a_number_is_never_written(value: float) -> None:
    with pytest.raises(ValueError, match="not a location"):
        commands.move(Location(0, 0, value, 0, 0, 0))


def test_half_a_turn_is_measured_too() -> None:
    assert apart(Location(0, 0, 0, 0, 0, 0), Location(0, 0, 0, 180, 0, 0))[1] == pytest.approx(180.0)
