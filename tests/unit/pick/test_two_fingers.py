"""Grasps from corners alone: they hold, clear the table, fit the opening, look down, and mind neighbours."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.pick.grippers import two_fingers
from daemon.pick.grippers.two_fingers import (
    FingerGrasp,
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
from tests.bench import machined
from tests.fakes.chosen import few
from tests.fakes.drawn import prism
from tests.fakes.fake_cell import shape_of
from tests.fakes.machined import shown_shape

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
    label, rest = case
    corners = part_shape(label).hull.vertices
    world_from_part = lying(label, rest, turn)
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
    found = grasps(known(plate), frames.rigid(np.eye(3), np.array([520.0, 0.0, -288.0])), -300.0, GRIPPER)
    assert {grasp.tilt_deg for grasp in found} == set(GRIPPER.tilts_deg)
    for grasp in found:
        half, tip = GRIPPER.finger_width_mm / 2, GRIPPER.tip_mm
        tips = frames.apply(grasp.world_from_tool, np.array([[half, 0, tip], [-half, 0, tip]]))
        assert tips[:, 2].min() == pytest.approx(-300.0 + GRIPPER.tip_clearance_mm, abs=1e-6)


@pytest.mark.parametrize(("high_mm", "held"), [(13.0, True), (9.0, True), (8.0, False)])
def test_a_plate_is_taken_as_long_as_the_tips_reach_deep_enough_beside_it(high_mm, held):
    plate = np.array([[x, y, z] for x in (-35.0, 35.0) for y in (-25.0, 25.0) for z in (0.0, high_mm)])
    found = grasps(known(plate), frames.rigid(np.eye(3), np.array([520.0, 0.0, -300.0])), -300.0, GRIPPER)
    assert bool(found) == held


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


@pytest.mark.parametrize("label", few(["clevis", "filleted_block", "bracket", "pillow_block"], 2))
def test_a_drawn_part_is_taken_by_its_flat_sides_and_not_where_it_is_hollow_or_round(label):
    drawn = machined.drawn(label)
    shape = shown_shape(label, drawn)
    shift = shape.hull.vertices.min(axis=0) - drawn.solid.corners_mm.min(axis=0)
    solid = replace(drawn.solid, corners_mm=drawn.solid.corners_mm + shift, covers=drawn.solid.covers + shift)
    for rest, down in enumerate(shape.rests):
        world_from_part = frames.rigid(frames.rotation_from_vector(np.array([0, 0, 0.7 * rest])), MIDDLE) @ down
        for grasp in grasps(solid, world_from_part, -300.0, GRIPPER)[:10]:
            tool_from_world = frames.inverse(grasp.world_from_tool)
            grip = close_on(shape, tool_from_world @ world_from_part, tool_from_world[:3, 2], TRUTH)
            assert grip.held, (rest, grip.why)
            assert abs(grip.turn_deg) < 4.0, "it turns no more than two directions are apart"


def test_a_part_is_taken_where_it_is_round_only_if_no_flat_side_will_do():
    solid = machined.drawn("lever").solid
    lying = frames.rigid(np.eye(3), MIDDLE - [0.0, 0.0, solid.corners_mm[:, 2].min()])
    rounded = [grasp.rounded for grasp in grasps(solid, lying, -300.0, GRIPPER)]
    assert any(rounded)
    assert not all(rounded)
    assert sorted(rounded) == rounded
    assert {grasp.risk for grasp in grasps(solid, lying, -300.0, GRIPPER) if grasp.rounded} == {1.0}


@pytest.mark.parametrize(("opposite", "held"), [("round", True), ("edge", False), ("flat", True)])
def test_a_part_that_is_round_for_one_finger_is_held_by_a_round_or_flat_side_for_the_other_and_not_by_an_edge(
    opposite, held
):
    turns = np.radians(np.arange(0.0, 181.0, 5.0))
    outline = [(15.0 * np.cos(turn), 15.0 * np.sin(turn)) for turn in turns]
    lower = {"round": [(x, -y) for x, y in outline[-2:0:-1]], "edge": [(0.0, -15.0)], "flat": [(-15, -15), (15, -15)]}
    corners, rings = prism([*outline, *lower[opposite]], 40.0)
    strips = [ring for ring in rings if len(ring) == 4 and np.ptp(corners[list(ring)], axis=0)[:2].max() < 2.0]
    flat = [ring for ring in rings if ring not in strips]
    solid = exact(corners - [0.0, 0.0, 20.0], [*flat, *strips])
    contact = two_fingers.contacts(two_fingers.sides_of(solid, len(flat)), np.array([0.0, 0.0, -1.0]), GRIPPER)
    assert (contact is not None) is held
    if contact is not None:
        assert contact.rounded is (opposite == "round")


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
    found = np.array(closing_directions(solid, len(solid.facets)))
    for wanted in (longest, np.cross([0.0, 0.0, 1.0], longest)):
        assert np.abs(found @ wanted).max() > np.cos(np.radians(4.0))


def box(long_mm, wide_mm, high_mm):
    """On its middle."""
    corners, rings = prism([(0, 0), (long_mm, 0), (long_mm, wide_mm), (0, wide_mm)], high_mm)
    return exact(corners - [long_mm / 2, wide_mm / 2, 0.0], rings)


def standing(turn):
    return frames.rigid(frames.rotation_from_vector(np.array([0.0, 0.0, turn])), np.array([520.0, 0.0, -300.0]))


@settings(max_examples=30, deadline=None)
@given(st.floats(15.0, 110.0), st.floats(15.0, 110.0), st.floats(20.0, 45.0), st.floats(-3.0, 3.0))
def test_a_box_is_taken_square_across_each_of_its_sides_that_the_fingers_have_room_beside(
    long_mm, wide_mm, high_mm, turn
):
    most_mm = GRIPPER.opening_mm - 2 * GRIPPER.side_clearance_mm
    sides = [side for side in (long_mm, wide_mm) if side < most_mm - 0.5]
    assume(all(abs(side - most_mm) > 0.6 for side in (long_mm, wide_mm)))
    pose = standing(turn)
    square = [g for g in grasps(box(long_mm, wide_mm, high_mm), pose, -300.0, GRIPPER) if g.slip_deg < 1.0]
    for side in sides:
        assert any(abs(grasp.width_mm - side) < 0.1 for grasp in square), (side, [g.width_mm for g in square])
    for grasp in square:
        assert min(abs(grasp.width_mm - side) for side in sides) < 0.1
        across = abs(pose[:3, :3].T @ grasp.world_from_tool[:3, 1])
        axis = 0 if abs(grasp.width_mm - long_mm) < 0.1 and across[0] > 0.5 else 1
        assert across[axis] == pytest.approx(1.0, abs=1e-3)
        middle = frames.apply(frames.inverse(pose), grasp.world_from_tool[:3, 3])
        assert middle[axis] == pytest.approx(0.0, abs=0.1), "the fingers close about its middle"
        lean = np.degrees(np.arccos(-grasp.world_from_tool[2, 2]))
        assert lean == pytest.approx(grasp.tilt_deg, abs=1e-4)
        assert grasp.tilt_deg in GRIPPER.tilts_deg


def test_grasps_come_unblocked_before_blocked_then_firm_before_slipping_then_upright_before_leaning():
    for label, rest in RESTS:
        corners = part_shape(label).hull.vertices
        beside = frames.apply(lying(label, rest, 0.3, 520.0, 62.0), corners)
        found = grasps(known(corners), lying(label, rest), -300.0, GRIPPER, [beside])
        order = [(grasp.blocked, round(grasp.slip_deg / 5.0), grasp.tilt_deg) for grasp in found]
        assert order == sorted(order)
        for grasp in found:
            assert grasp.blocked == GRIPPER.sweeps(grasp.world_from_tool, beside)
            assert grasp.slip_deg <= np.degrees(np.arctan(GRIPPER.friction))
            assert grasp.risk == pytest.approx(grasp.slip_deg / 45.0)
            assert grasp.figures == {"slip_deg": grasp.slip_deg}


def test_a_grasp_says_how_wide_how_tilted_and_how_square_it_is():
    grasp = FingerGrasp(np.eye(4), 20.0, width_mm=34.6, slip_deg=7.4)
    assert grasp.description == "35 mm wide, tilted 20 degrees, contacts 7 degrees off perpendicular"


def test_a_grasp_is_found_again_only_among_those_turned_nearly_as_before():
    """Within 0.25 rad of it."""
    corners, pose = part_shape("cube").hull.vertices, lying("cube", 0)
    every = grasps(known(corners), pose, -300.0, GRIPPER)
    before = every[0].world_from_tool
    again = grasps(known(corners), pose, -300.0, GRIPPER, near=before[:3, :3])
    apart = [frames.angle_between(grasp.world_from_tool, before) for grasp in every]
    assert len(again) == sum(angle <= 0.25 for angle in apart)
    assert 0 < len(again) < len(every)
    assert all(frames.angle_between(grasp.world_from_tool, before) <= 0.25 for grasp in again)


@given(st.floats(-40.0, 40.0), st.floats(-90.0, 90.0), st.floats(-120.0, 60.0), st.floats(1.0, 20.0))
def test_what_is_in_the_room_that_the_open_fingers_sweep_is_in_their_way(x, y, z, size):
    """A cube of that size, its lowest corner there in the tool's frame; the tool lies anyhow."""
    tool = frames.rigid(frames.rotation_from_vector(np.array([0.3, 2.0, -1.0])), np.array([500.0, 20.0, -100.0]))
    local = np.array([x, y, z]) + size * np.array([[a, b, c] for a in (0, 1) for b in (0, 1) for c in (0, 1)])
    half, wide = GRIPPER.finger_width_mm / 2, GRIPPER.opening_mm / 2 + GRIPPER.finger_thick_mm
    borders = [(x, half), (x, -half - size), (y, wide), (y, -wide - size), (z, GRIPPER.tip_mm), (z, -80.0 - size)]
    assume(all(abs(at - border) > 1e-6 for at, border in borders))
    meets = -half - size < x < half and -wide - size < y < wide and -80.0 - size < z < GRIPPER.tip_mm
    assert GRIPPER.sweeps(tool, frames.apply(tool, local)) == meets


unit_vectors = (
    st.tuples(*[st.floats(-1.0, 1.0)] * 3)
    .filter(lambda v: np.linalg.norm(v) > 0.1)
    .map(lambda v: np.array(v) / np.linalg.norm(v))
)


@given(unit_vectors, unit_vectors, unit_vectors)
def test_a_direction_is_off_two_normals_by_its_angle_to_the_nearest_between_them(direction, one, other):
    between = np.linspace(one, other, 2001)
    lengths = np.linalg.norm(between, axis=1)
    cosines = between[lengths > 1e-6] @ direction / lengths[lengths > 1e-6]
    nearest = np.degrees(np.arccos(np.clip(cosines.max(), -1.0, 1.0)))
    found = two_fingers.off_cone_deg(direction, np.array([one, other]))
    if np.linalg.norm(one + other) > 0.1:
        assert found == pytest.approx(nearest, abs=0.2)
    alone = two_fingers.off_cone_deg(direction, np.array([one]))
    assert alone == pytest.approx(np.degrees(np.arccos(np.clip(direction @ one, -1.0, 1.0))))


@pytest.mark.parametrize("count", [0, 1, 3])
def test_fewer_than_four_corners_span_no_solid(count):
    with pytest.raises(ValueError, match=f"{count} corners span no solid"):
        hull(np.eye(3)[:count] * 50.0)


@given(st.sampled_from(TAUGHT))
def test_closing_directions_are_level_of_length_one_and_no_two_alike(label):
    solid = hull(part_shape(label).hull.vertices)
    found = np.array(closing_directions(solid, len(solid.facets)))
    assert (found[:, 2] == 0.0).all()
    assert np.linalg.norm(found, axis=1) == pytest.approx(1.0)
    alike = np.abs(found @ found.T) - np.eye(len(found))
    assert alike.max() <= np.cos(np.radians(4.0))


@given(st.sampled_from(["cube", "triangular_prism"]), st.integers(0, 2**32 - 1))
def test_a_part_that_looks_lean_a_little_is_closed_on_along_the_same_directions(label, seed):
    """What stands upright in it leans anywhere then, and says nothing of where the fingers should close."""
    rng, flat = np.random.default_rng(seed), hull(part_shape(label).hull.vertices)
    leant = frames.rotation_from_vector(np.radians(0.2) * rng.normal(size=3) * (1.0, 1.0, 0.0))
    rest = part_shape(label).rests[int(rng.integers(len(part_shape(label).rests)))]
    lies, leans = (
        np.array(
            closing_directions(replace(flat, corners_mm=flat.corners_mm @ (turn @ rest[:3, :3]).T), len(flat.facets))
        )
        for turn in (np.eye(3), leant)
    )
    assert (np.abs(leans @ lies.T).max(axis=1) > np.cos(np.radians(1.0))).all()


def test_what_two_fingers_are_asked_is_what_their_settings_say():
    gripper = TwoFingers(opening_mm=60.0, finger_thick_mm=7.0, finger_width_mm=11.0, pad_back_mm=40.0, tip_mm=9.0)
    assert gripper.outside == ("opening_mm", 37.0)
    assert gripper.holding_volume == (40.0, 9.0, 11.0)
    assert (gripper.widest_mm, gripper.tip_mm) == (60.0, 9.0)
    assert (gripper.work_time_s(True), gripper.work_time_s(False)) == (0.0, 0.0)
    assert gripper.takes(shape_of("cube"), 1.0) == ""
    assert GRIPPER.grasps(shape_of("cube"), lying("cube", 0), -300.0, 1.0).why == ""
    small = TwoFingers(opening_mm=20.0, side_clearance_mm=5.0, tip_clearance_mm=3.0)
    why = small.grasps(shape_of("cube"), lying("cube", 0), -300.0, 1.0).why
    assert "tips 3 mm over the table and 10 mm between the fingers" in why
    assert "lay it on another side, or mount another gripper" in why


@pytest.mark.parametrize(("tips_mm", "held"), [(4.0, True), (5.0, False)])
def test_a_plate_is_held_where_it_reaches_just_as_deep_between_the_fingers_as_it_must(
    tips_mm: float, held: bool
) -> None:
    """Between lines 2 mm apart, 3 mm counted as 2: a cover, 7 mm thick at its rim, was picked where its height erred
    upwards, and had no grasp where it did not."""
    cover = machined.drawn("cover").solid
    plate = int(np.where(cover.normals[:, 2] < -0.99, -cover.centres_mm[:, 2], -np.inf).argmax())
    lies = frames.rigid(np.diag([1.0, -1.0, -1.0]), np.array([450.0, 0.0, -300.0])) @ cover.flat_from_solid[plate]
    gripper = msgspec.structs.replace(GRIPPER, tip_clearance_mm=tips_mm)
    assert {round(grasp.width_mm) for grasp in two_fingers.grasps(cover, lies, -300.0, gripper)} == (
        {50, 70} if held else set()
    )


def test_what_each_finger_rests_on_reaches_deep_enough_between_them_for_a_part_seen_too_high():
    """A leg 10 mm high was to be met by the very tip of one finger, which passed over it and pushed the part away."""
    drawn = machined.drawn("bracket")
    shape, solid = shown_shape("bracket", drawn), drawn.solid
    shift = shape.hull.vertices.min(axis=0) - solid.corners_mm.min(axis=0)
    solid = replace(solid, corners_mm=solid.corners_mm + shift)
    lying = [frames.rigid(np.eye(3), MIDDLE) @ down for down in shape.rests]
    for rest, pose in enumerate(lying):
        seen = frames.rigid(np.eye(3), np.array([0.0, 0.0, 1.0])) @ pose
        for grasp in grasps(solid, seen, -300.0, GRIPPER)[::3]:
            tool_from_world = frames.inverse(grasp.world_from_tool)
            grip = close_on(shape, tool_from_world @ pose, tool_from_world[:3, 2], TRUTH)
            assert grip.held, (rest, grip.why, grasp.description)
