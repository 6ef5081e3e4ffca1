"""Grasps from corners alone: they hold, clear the table, fit the opening, look down, and mind neighbours."""

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.pick.two_fingers import (
    TwoFingers,
    centre_of_mass,
    closed_fingers,
    closing_directions,
    grasps,
    hull,
    tool_rotation,
)
from daemon.store import folders
from daemon.vision.geometry import exact
from drivers.simcell.drawn import drawn_shape
from drivers.simcell.gripper import close_on
from drivers.simcell.parts import TAUGHT, part_shape
from drivers.simcell.truth import load_truth
from tests.fakes.drawn import prism

GRIPPER = TwoFingers()
MIDDLE = np.array([520.0, 0.0, -300.0])
TRUTH = load_truth(folders.HOUSE / "etc" / "simcell.yaml").gripper
RESTS = [(label, rest) for label in TAUGHT for rest in range(len(part_shape(label).rests))]


def lying(label, rest, turn=0.3, x=520.0, y=0.0):
    spin = frames.rotation_from_vector(np.array([0.0, 0.0, turn]))
    return frames.rigid(spin, np.array([x, y, -300.0])) @ part_shape(label).rests[rest]


def known(corners):
    """By its corners alone, as a part is of which some sides were never shown."""
    return exact(corners, [])


@pytest.mark.parametrize(("label", "rest"), RESTS)
def test_the_first_grasp_of_a_part_taught_a_little_wrong_holds_it_in_the_simulated_gripper(label, rest):
    rng = np.random.default_rng(rest)
    corners = part_shape(label).hull.vertices
    world_from_part = lying(label, rest)
    found = grasps(known(corners + rng.normal(0, 0.2, corners.shape)), world_from_part, -300.0, GRIPPER)
    tool_from_world = frames.inverse(found[0].world_from_tool)
    grip = close_on(part_shape(label), tool_from_world @ world_from_part, tool_from_world[:3, 2], TRUTH)
    assert grip.held, grip.why


@settings(max_examples=40, deadline=None)
@given(case=st.sampled_from(RESTS), turn=st.floats(0, 6.28))
def test_every_grasp_keeps_its_promises(case, turn):
    corners = part_shape(case[0]).hull.vertices
    world_from_part = lying(*case, turn)
    for grasp in grasps(known(corners), world_from_part, -300.0, GRIPPER):
        x, y, z = grasp.world_from_tool[:3, 0], grasp.world_from_tool[:3, 1], grasp.world_from_tool[:3, 2]
        assert abs(y[2]) < 1e-9, "the fingers close level"
        assert z[2] < -np.cos(np.radians(41)), "the hand leans no more than it may"
        assert x[2] < 1e-9, "the cameras are on the upper side"
        tips = frames.apply(grasp.world_from_tool, np.array([[7.5, 0, 10.0], [-7.5, 0, 10.0]]))
        assert tips[:, 2].min() > -300.0 + GRIPPER.tip_clearance_mm - 1e-6
        assert grasp.width_mm <= GRIPPER.opening_mm - 2 * GRIPPER.side_clearance_mm
        reach = (frames.apply(world_from_part, corners) - grasp.world_from_tool[:3, 3]) @ y
        assert reach.max() > 0 > reach.min(), "the part is between the fingers"


def test_a_low_part_is_grasped_as_low_as_the_tips_may_go_over_the_table():
    plate = np.array([[x, y, z] for x in (-30.0, 30.0) for y in (-20.0, 20.0) for z in (-12.0, 12.0)])
    found = grasps(known(plate), frames.rigid(np.eye(3), [520.0, 0.0, -288.0]), -300.0, GRIPPER)
    assert {grasp.tilt_deg for grasp in found} == set(GRIPPER.tilts_deg)
    for grasp in found:
        half, tip = GRIPPER.finger_width_mm / 2, GRIPPER.tip_mm
        tips = frames.apply(grasp.world_from_tool, np.array([[half, 0, tip], [-half, 0, tip]]))
        assert tips[:, 2].min() == pytest.approx(-300.0 + GRIPPER.tip_clearance_mm, abs=1e-6)


def test_a_part_too_wide_for_the_hand_has_no_grasp():
    corners = part_shape("cube").hull.vertices * 2.0
    assert not grasps(known(corners), frames.rigid(np.eye(3), np.array([520.0, 0, -250.0])), -300.0, GRIPPER)


def test_a_steeper_pyramid_than_the_pads_hold_has_no_grasp_on_its_sides():
    slippery = TwoFingers(friction=0.2)
    corners = part_shape("pyramid").hull.vertices
    assert all(g.slip_deg < 12 for g in grasps(known(corners), lying("pyramid", 0), -300.0, slippery))


def test_the_faces_of_a_hull_come_out_whole_from_noisy_corners():
    rng = np.random.default_rng(0)
    for label, faces in (("cube", 6), ("pyramid", 5), ("triangular_prism", 5), ("pentagonal_prism", 7)):
        corners = part_shape(label).hull.vertices
        assert len(hull(corners + rng.normal(0, 0.2, corners.shape)).facets) == faces


def test_seven_corners_of_a_cube_are_enough_to_grasp_it():
    corners = part_shape("cube").hull.vertices[:7]
    assert grasps(known(corners), lying("cube", 0), -300.0, GRIPPER)


def test_corners_in_one_plane_span_no_solid():
    with pytest.raises(ValueError, match="no solid"):
        hull(np.array([[0.0, 0, 0], [50, 0, 0], [50, 50, 0], [0, 50, 0]]))


def test_a_neighbour_in_the_fingers_way_blocks_those_grasps_only():
    corners = part_shape("cube").hull.vertices
    beside = frames.apply(lying("cube", 0, 0.3, 520.0, 62.0), corners)
    found = grasps(known(corners), lying("cube", 0), -300.0, GRIPPER, [beside])
    assert {g.blocked for g in found} == {True, False}
    assert not found[0].blocked


def test_the_cameras_look_up_from_the_side_the_hand_leans_away_from():
    rotation = tool_rotation(np.array([1.0, 0.0, 0.0]), 0.5)
    assert np.isclose(np.linalg.det(rotation), 1.0)
    assert rotation[2, 0] < 0
    assert rotation[0, 2] > 0


def test_the_met_fingers_are_a_box_whose_faces_look_outwards():
    gripper = TwoFingers()
    shape = closed_fingers(gripper)
    outwards = shape.centres_mm - shape.corners_mm.mean(axis=0)
    assert (np.einsum("fi,fi->f", shape.normals, outwards) > 0).all()
    size = np.ptp(shape.corners_mm, axis=0)
    thick = 2 * gripper.finger_thick_mm
    np.testing.assert_allclose(size, [gripper.finger_width_mm, thick, gripper.pad_back_mm + gripper.tip_mm])


OUTLINES = {
    "bracket": [(0, 0), (60, 0), (60, 12), (12, 12), (12, 50), (0, 50)],
    "sheet": [(0, 0), (60, 0), (60, 8), (12, 8), (8, 12), (8, 60), (0, 60)],
    "channel": [(0, 0), (60, 0), (60, 40), (45, 40), (45, 15), (15, 15), (15, 40), (0, 40)],
    "tee": [(0, 0), (60, 0), (60, 15), (40, 15), (40, 50), (20, 50), (20, 15), (0, 15)],
}


@pytest.mark.parametrize("name", OUTLINES)
def test_a_part_with_hollows_is_taken_by_a_leg_and_not_by_its_hull(name):
    corners, rings = prism(OUTLINES[name], 40.0)
    shape = drawn_shape(name, corners, rings)
    solid = exact(corners + shape.hull.vertices.min(axis=0) - corners.min(axis=0), rings)
    for rest, down in enumerate(shape.rests):
        world_from_part = frames.rigid(frames.rotation_from_vector(np.array([0, 0, 0.7 * rest])), MIDDLE) @ down
        tool_from_world = frames.inverse(grasps(solid, world_from_part, -300.0, GRIPPER)[0].world_from_tool)
        grip = close_on(shape, tool_from_world @ world_from_part, tool_from_world[:3, 2], TRUTH)
        assert grip.held, (rest, grip.why)


def test_the_centre_of_mass_of_two_joined_blocks_is_where_their_weights_say():
    corners, rings = prism([(0, 0), (60, 0), (60, 20), (20, 20), (20, 60), (0, 60)], 30.0)
    expected = (np.array([30, 10, 15]) * 60 * 20 + np.array([10, 40, 15]) * 20 * 40) / (60 * 20 + 20 * 40)
    np.testing.assert_allclose(centre_of_mass(exact(corners, rings)), expected, atol=1e-9)


def test_no_grasp_brings_the_palm_down_on_a_part_higher_than_the_fingers_are_long():
    corners, rings = prism([(0, 0), (40, 0), (40, 40), (0, 40)], 110.0)
    post, low = exact(corners, rings), exact(corners * [1.0, 1.0, 0.5], rings)
    long = msgspec.structs.replace(GRIPPER, swing_mm=100.0)
    assert grasps(low, frames.rigid(np.eye(3), MIDDLE), -300.0, long)
    assert not grasps(post, frames.rigid(np.eye(3), MIDDLE), -300.0, long)
    assert grasps(post, frames.rigid(np.eye(3), MIDDLE), -300.0, msgspec.structs.replace(long, pad_back_mm=70.0))


def test_no_grasp_takes_a_part_so_far_from_its_middle_that_it_would_swing():
    """A large angle can be held by its legs alone, and hangs from either on a long lever."""
    angle = exact(*prism([(0, 0), (200, 0), (200, 20), (20, 20), (20, 200), (0, 200)], 30.0))
    world_from_part = frames.rigid(np.eye(3), MIDDLE)
    assert not grasps(angle, world_from_part, -300.0, GRIPPER)
    assert grasps(angle, world_from_part, -300.0, msgspec.structs.replace(GRIPPER, swing_mm=150.0))


def test_the_fingers_may_close_along_and_across_the_longest_edge():
    solid = hull(np.array([[0.0, 0.0, 0.0], [60.0, 10.0, 0.0], [10.0, 40.0, 0.0], [20.0, 15.0, 30.0]]))
    longest = np.array([60.0, 10.0, 0.0]) / np.hypot(60.0, 10.0)
    found = np.array(closing_directions(solid))
    for wanted in (longest, np.cross([0.0, 0.0, 1.0], longest)):
        assert np.abs(found @ wanted).max() > np.cos(np.radians(4.0))
