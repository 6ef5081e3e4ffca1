"""Grasps by suction: where there is room for the lip, off holes and edges, under the mass centre, within the load."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.pick.grippers.suction import (
    CupGrasp,
    SuctionCup,
    clearances_on,
    rotations_about_normal,
    upward_facets,
    weight_and_centroid,
)
from daemon.vision.geometry import Hole, exact
from tests.fakes.drawn import prism
from tests.fakes.fake_cell import shape_of

CUP = SuctionCup(cup_radius_mm=10.0, density_g_cm3=2.7)
ERROR_MM = 1.0
NEEDED_MM = CUP.cup_radius_mm + ERROR_MM + CUP.edge_mm


def plate(outline=((0, 0), (80, 0), (80, 60), (0, 60)), high_mm=20.0):
    """A plate of which the facet that looks along z is given with it."""
    corners, rings = prism(list(outline), high_mm)
    solid = exact(corners, rings)
    return solid, int(solid.normals[:, 2].argmax())


def bored(solid, facet, at, radius_mm):
    turn = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    height = solid.corners_mm[solid.rings[facet][0], 2]
    ring = np.column_stack([at[0] + radius_mm * np.cos(turn), at[1] + radius_mm * np.sin(turn), np.full(48, height)])
    return replace(solid, holes=(*solid.holes, Hole(facet, ring)))


def lying(solid, lean_rad=0.0, turn_rad=0.3):
    tilted = frames.rotation_from_vector(np.array([0.0, lean_rad, 0.0]))
    return frames.rigid(
        frames.rotation_from_vector(np.array([0.0, 0.0, turn_rad])) @ tilted, np.array([520.0, 30.0, -300.0])
    )


def taken(solid, world_from_part, cup=CUP, **how):
    return cup.grasps(solid, world_from_part, -300.0, ERROR_MM, **how)


@pytest.mark.parametrize(
    ("key", "most"), [("vacuum_bar", 1.0), ("friction", 5.0), ("safety", 10.0), ("density_g_cm3", 25.0)]
)
def test_what_no_cup_and_no_material_has_is_refused(key, most):
    """A figure in another unit (kPa, percent, kg/m3) would make any part light enough."""
    assert getattr(msgspec.convert({key: most}, SuctionCup), key) == most
    for wrong in (1.01 * most, 0.0):
        with pytest.raises(msgspec.ValidationError):
            msgspec.convert({key: wrong}, SuctionCup)


def test_room_is_the_distance_to_the_nearest_edge_or_hole_and_none_is_in_a_hole():
    solid, top = plate()
    points, rooms = clearances_on(bored(solid, top, (20.0, 30.0), 8.0), top)
    x, y = points[:, 0], points[:, 1]
    sides = np.minimum.reduce([x, 80 - x, y, 60 - y])
    rim = np.hypot(x - 20.0, y - 30.0) - 8.0
    assert rim.min() > -0.1
    assert rooms == pytest.approx(np.minimum(sides, rim), abs=0.1)


def test_under_what_overhangs_a_facet_is_no_room_and_beside_it_only_up_to_it():
    """A part like a C, lying on its back: of its lower inner side, 50 mm long, 20 mm are under its upper leg."""
    corners, rings = prism([(0, 0), (60, 0), (60, 10), (10, 10), (10, 40), (30, 40), (30, 50), (0, 50)], 30.0)
    solid = exact(corners, rings)
    inner = next(
        k for k, ring in enumerate(solid.rings) if solid.normals[k][1] > 0.9 and np.allclose(corners[ring][:, 1], 10.0)
    )
    points, rooms = clearances_on(solid, inner)
    x, z = points[:, 0], points[:, 2] - corners[:, 2].min()
    assert x.min() > 30.0 - 1e-9
    assert rooms == pytest.approx(np.minimum.reduce([x - 30.0, 60.0 - x, z, 30.0 - z]), abs=1e-6)


@settings(max_examples=30, deadline=None)
@given(
    at=st.tuples(st.floats(10, 70), st.floats(10, 50)),
    radius=st.floats(2, 9),
    lean=st.floats(-0.6, 0.6),
    turn=st.floats(-3, 3),
)
def test_every_grasp_has_room_for_lip_and_error_looks_along_the_normal_and_holds_the_part(at, radius, lean, turn):
    solid, top = plate()
    solid, pose = bored(solid, top, at, radius), lying(solid, lean, turn)
    found, _ = taken(solid, pose)
    for grasp in found:
        normal = (solid.normals @ pose[:3, :3].T)[grasp.facet - 1]
        assert grasp.world_from_tool[:3, 2] == pytest.approx(-normal)
        here = frames.apply(frames.inverse(pose), grasp.world_from_tool[:3, 3])
        above = (here - solid.corners_mm[solid.rings[grasp.facet - 1][0]]) @ solid.normals[grasp.facet - 1]
        assert above == pytest.approx(-CUP.lip_mm / 2), "pressed on by half of the lip's travel"
        if grasp.facet - 1 == top:
            x, y, _ = here
            assert min(x, 80 - x, y, 60 - y, np.hypot(x - at[0], y - at[1]) - radius) > NEEDED_MM - 0.1
        assert grasp.load <= 1.0
        assert np.degrees(np.arccos(normal[2])) <= CUP.lean_deg + 1e-6


def test_the_cup_sits_under_the_mass_centre_where_no_hole_is_and_beside_the_hole_where_one_is():
    solid, top = plate()
    pose = lying(solid)
    over = frames.apply(pose, np.array([40.0, 30.0, 20.0]))
    found, why = taken(solid, pose)
    assert not why
    assert np.linalg.norm((found[0].world_from_tool[:3, 3] - over)[:2]) < 1.0
    light = msgspec.structs.replace(CUP, density_g_cm3=1.2)
    found, _ = taken(bored(solid, top, (40.0, 30.0), 6.0), pose, light)
    off = min(np.linalg.norm((g.world_from_tool[:3, 3] - over)[:2]) for g in found)
    assert 6.0 + NEEDED_MM - 0.1 < off < 6.0 + NEEDED_MM + 1.5


def test_a_facet_without_room_is_told_with_the_room_there_is():
    solid, _ = plate(((0, 0), (80, 0), (80, 20), (0, 20)))
    found, why = taken(solid, lying(solid))
    assert not found
    top = int(solid.normals[:, 2].argmax()) + 1
    assert f"facet {top}: room for a lip of 9.5 mm radius, {NEEDED_MM:.1f} are needed" in why or "10.0 mm" in why


def test_a_part_that_is_too_heavy_or_too_long_for_the_cup_is_told_before_anything_moves():
    solid, _ = plate()
    found, why = taken(solid, lying(solid), msgspec.structs.replace(CUP, density_g_cm3=20.0))
    assert not found
    assert "times what the cup can hold there" in why
    weight_n, middle = weight_and_centroid(solid, 2.7)
    assert weight_n == pytest.approx(80 * 60 * 20 * 2.7e-6 * 9.81)
    assert middle == pytest.approx([40.0, 30.0, 10.0])


def test_the_facets_that_it_can_take_are_told_whichever_is_up_and_why_none_where_none():
    solid, _ = plate()
    flat = [str(k) for k, normal in enumerate(solid.normals, start=1) if abs(normal[2]) > 0.9]
    assert CUP.takes(solid, ERROR_MM) == f"suction takes facets {', '.join(flat)}", "the others are 20 mm high"
    assert "suction takes no facet: facet 1: room for a lip of" in msgspec.structs.replace(
        CUP, cup_radius_mm=40.0
    ).takes(solid, 1.0)
    heavy = msgspec.structs.replace(CUP, vacuum_bar=0.01).takes(solid, ERROR_MM)
    assert "times what the cup can hold there" in heavy


def test_the_moment_counts_the_lever_and_the_lean_it_is_carried_with():
    level = CUP.load(1.0, 0.0, 0.0, 0.0)
    assert CUP.load(1.0, 20.0, 0.0, 0.0) > level
    assert CUP.load(1.0, 0.0, 40.0, 0.0) > level, "a part that hangs low turns the cup off as the hand leans"
    steady = msgspec.structs.replace(CUP, carried_deg=0.0)
    assert steady.load(1.0, 0.0, 40.0, 0.0) == pytest.approx(CUP.safety / CUP.force_n)
    lever = steady.load(1.0, 20.0, 0.0, 0.0)
    assert lever == pytest.approx(CUP.safety * 20.0 / (CUP.force_n * CUP.cup_radius_mm / 2))


def test_what_rises_beside_a_step_is_kept_clear_of():
    corners, rings = prism([(0, 0), (90, 0), (90, 20), (45, 20), (45, 60), (0, 60)], 50.0)
    upright = frames.rotation_from_vector(np.array([np.pi / 2, 0.0, 0.0]))
    solid = exact(corners @ upright.T, rings)
    step = [k for k, _ in upward_facets(solid, np.eye(4), 5.0) if solid.centres_mm[k][2] < 30.0]
    points, rooms = clearances_on(solid, step[0])
    assert rooms == pytest.approx(
        np.minimum.reduce([points[:, 0] - 45, 90 - points[:, 0], -points[:, 1], points[:, 1] + 50]), abs=0.1
    )


def test_a_facet_that_looks_aside_or_down_is_not_taken_and_the_reason_is_told():
    solid = shape_of("pyramid")
    apex_up = frames.rigid(np.eye(3), np.array([520.0, 0.0, -280.0]))
    steep = msgspec.structs.replace(CUP, lean_deg=5.0)
    found, why = taken(solid, apex_up, steep)
    assert not found
    assert "no flat facet of it faces up to within 5 degrees" in why


def test_a_neighbour_in_the_cups_way_blocks_and_one_beside_it_does_not():
    solid, _ = plate()
    pose = lying(solid)
    (best, *_), _ = taken(solid, pose)
    x, y, z = best.world_from_tool[:3, 3]
    post = np.array([[x + a, y + b, z + c] for a in (3.0, 8.0) for b in (-3.0, 3.0) for c in (5.0, 40.0)])
    assert CUP.sweeps(best.world_from_tool, post)
    assert not CUP.sweeps(best.world_from_tool, post + np.array([60.0, 0.0, 0.0]))
    found, _ = taken(solid, pose, neighbours=[post])
    assert all(grasp.blocked for grasp in found if np.linalg.norm(grasp.world_from_tool[:2, 3] - [x, y]) < 1.0)


def test_the_same_grasp_is_found_again_after_the_part_turned_a_little():
    solid, _ = plate()
    before = taken(solid, lying(solid, turn_rad=0.3))[0][0]
    again, _ = taken(solid, lying(solid, turn_rad=0.35), near=before.world_from_tool[:3, :3])
    assert again
    nearest = min(frames.angle_between(grasp.world_from_tool, before.world_from_tool) for grasp in again)
    assert nearest == pytest.approx(0.05, abs=1e-6)


def test_its_body_is_guarded_down_to_the_lip():
    low = [point for point in CUP.body.points_mm if point[2] == 0.0]
    assert {round(float(np.hypot(x, y)), 6) for x, y, _ in low} == {10.0}
    for capsule in CUP.body.capsules:
        assert max(capsule.from_mm[2], capsule.to_mm[2]) + capsule.radius_mm <= 1e-9


def test_an_angle_offers_the_spot_nearest_below_its_mass_centre_and_the_one_with_most_room():
    """Its mass centre is 1.8 mm from its inner corner; the largest circle on it touches both outer sides and that."""
    solid, top = plate(((0, 0), (100, 0), (100, 40), (40, 40), (40, 100), (0, 100)))
    mass = np.array([(4000 * 50 + 2400 * 20) / 6400] * 2 + [10.0])
    spots, why = CUP.spots(solid, top, mass, ERROR_MM)
    assert not why
    nearest, roomiest = spots
    kept_off = 40.0 - NEEDED_MM / np.sqrt(2)
    assert nearest.at_mm == pytest.approx([kept_off, kept_off, 20.0], abs=2.0)
    assert NEEDED_MM <= nearest.room_mm < NEEDED_MM + 2.0
    radius = 40 * np.sqrt(2) / (1 + np.sqrt(2))
    assert roomiest.at_mm == pytest.approx([radius, radius, 20.0], abs=2.0)
    assert roomiest.room_mm == pytest.approx(radius, abs=1.0)


@given(side=st.floats(26.0, 48.0))
def test_where_both_are_one_place_there_is_one_spot_and_its_room_is_half_the_side(side):
    solid, top = plate(((0, 0), (side, 0), (side, side), (0, side)))
    (spot,), why = CUP.spots(solid, top, np.array([side / 2, side / 2, 10.0]), 0.0)
    assert not why
    assert spot.at_mm == pytest.approx([side / 2, side / 2, 20.0], abs=1.0)
    assert side / 2 - 1.0 < spot.room_mm <= side / 2


@given(cup=st.floats(4.0, 20.0), edge=st.floats(0.0, 4.0), error=st.floats(0.0, 4.0))
def test_a_facet_serves_from_the_room_on_that_lip_edge_and_error_need_together(cup, edge, error):
    solid, top = plate(((0, 0), (50, 0), (50, 50), (0, 50)))
    _, rooms = clearances_on(solid, top)
    gripper = SuctionCup(cup_radius_mm=cup, edge_mm=edge)
    spots, why = gripper.spots(solid, top, np.array([25.0, 25.0, 10.0]), error)
    assert bool(spots) == (cup + edge + error <= rooms.max())
    assert why == (
        "" if spots else f"room for a lip of {rooms.max():.1f} mm radius, {cup + edge + error:.1f} are needed"
    )


def stepped(wide_mm, deep_mm):
    """A block with a step 30 mm below its top, so wide from the wall on: solid, the step's facet."""
    corners, rings = prism([(0, 0), (45 + wide_mm, 0), (45 + wide_mm, 20), (45, 20), (45, 50), (0, 50)], deep_mm)
    upright = frames.rotation_from_vector(np.array([np.pi / 2, 0.0, 0.0]))
    solid = exact(corners @ upright.T, rings)
    return solid, next(k for k, _ in upward_facets(solid, np.eye(4), 5.0) if solid.centres_mm[k][2] < 30.0)


@pytest.mark.parametrize(("long_mm", "nearest_mm"), [(29.0, 36.0), (31.0, NEEDED_MM)])
@pytest.mark.parametrize("deep_mm", [50.0, 200.0])
def test_a_cup_shorter_than_the_wall_beside_it_is_high_sits_where_the_palm_clears_all_of_the_wall(
    deep_mm, long_mm, nearest_mm
):
    """The palm was kept off the corners of a wall alone: it would have come down on the edge of a long one."""
    solid, step = stepped(100.0, deep_mm)
    cup = msgspec.structs.replace(CUP, cup_length_mm=long_mm)
    spots, why = cup.spots(solid, step, np.array([0.0, -deep_mm / 2, 10.0]), ERROR_MM)
    assert not why
    assert spots[0].at_mm[0] - 45.0 == pytest.approx(nearest_mm, abs=3.0)
    assert all(spot.at_mm[0] - 45.0 >= nearest_mm for spot in spots)


@pytest.mark.parametrize(("long_mm", "serves"), [(29.0, False), (31.0, True)])
def test_on_a_narrow_step_only_a_cup_that_is_longer_than_the_wall_is_high_can_sit(long_mm, serves):
    solid, step = stepped(30.0, 50.0)
    cup = msgspec.structs.replace(CUP, cup_length_mm=long_mm)
    spots, why = cup.spots(solid, step, solid.corners_mm.mean(axis=0), ERROR_MM)
    assert (bool(spots), why) == (serves, "" if serves else "the part is higher beside it than the cup is long")


@pytest.mark.parametrize("side", [20.0, 50.0, 300.0])
def test_the_grid_is_as_fine_as_a_millimetre_and_has_no_more_points_than_it_may(side):
    solid, top = plate(((0, 0), (side, 0), (side, side), (0, side)))
    points, rooms = clearances_on(solid, top)
    assert len(points) == len(rooms) == pytest.approx(min(side * side, 2500.0), rel=0.05)
    assert points[:, 2] == pytest.approx(20.0)
    assert [points[:, :2].min(), points[:, :2].max()] == pytest.approx([0.0, side], abs=side / 50 + 0.5)


@given(lean=st.floats(-0.5, 0.5), turn=st.floats(-3.0, 3.0), most=st.floats(1.0, 80.0))
def test_the_facets_that_look_up_are_those_that_lean_no_more_than_they_may_the_most_level_first(lean, turn, most):
    solid = shape_of("pentagonal_prism")
    pose = lying(solid, lean, turn)
    up = np.degrees(np.arccos(np.clip(solid.normals @ pose[2, :3], -1.0, 1.0)))
    found = upward_facets(solid, pose, most)
    assert [round(leans, 9) for _, leans in found] == sorted(round(float(each), 9) for each in up if each <= most)
    assert all(leans == pytest.approx(up[facet], abs=1e-6) for facet, leans in found)


def test_the_hand_is_turned_evenly_round_the_normal_from_along_the_longest_side():
    solid, top = plate()
    rotations = rotations_about_normal(solid, top)
    assert len(rotations) == 12
    for number, rotation in enumerate(rotations):
        angle = np.radians(30.0 * number)
        assert rotation[:, 2] == pytest.approx([0.0, 0.0, -1.0])
        assert abs(rotation[0, 0]) == pytest.approx(abs(np.cos(angle)))
        assert rotation @ rotation.T == pytest.approx(np.eye(3))
        assert np.linalg.det(rotation) == pytest.approx(1.0)
    ways = {tuple(np.round(rotation[:, 0], 6) + 0.0) for rotation in rotations}
    assert len(ways) == 12


@given(lean=st.floats(0.0, 0.6), error=st.floats(0.0, 3.0))
def test_a_grasp_is_described_as_it_is_and_the_best_come_first(lean, error):
    solid, _ = plate(high_mm=30.0)
    pose = lying(solid, lean)
    post = frames.apply(pose, np.array([[5.0, 5.0, 45.0], [12.0, 12.0, 45.0], [5.0, 12.0, 90.0]]))
    found, _ = CUP.grasps(solid, pose, -300.0, error, [post])
    order = [(g.blocked, round(g.load, 1), g.tilt_deg) for g in found if isinstance(g, CupGrasp)]
    assert len(order) == len(found)
    assert order == sorted(order)
    weight_n, mass = weight_and_centroid(solid, CUP.density_g_cm3)
    for grasp in found:
        assert isinstance(grasp, CupGrasp)
        part_from_tool = frames.inverse(pose) @ grasp.world_from_tool
        normal = solid.normals[grasp.facet - 1]
        assert part_from_tool[:3, 2] == pytest.approx(-normal, abs=1e-9)
        assert grasp.tilt_deg == pytest.approx(np.degrees(np.arccos(-grasp.world_from_tool[2, 2])), abs=1e-4)
        lip = part_from_tool[:3, 3] - part_from_tool[:3, 2] * CUP.lip_mm / 2
        assert (lip - solid.centres_mm[grasp.facet - 1]) @ normal == pytest.approx(0.0, abs=1e-9)
        off = mass - lip
        across_mm = float(np.linalg.norm(off - (off @ normal) * normal))
        assert grasp.load == pytest.approx(CUP.load(weight_n, across_mm, -float(off @ normal), grasp.tilt_deg))
        assert grasp.blocked == CUP.sweeps(grasp.world_from_tool, post)


def test_a_grasp_says_by_which_facet_with_how_much_room_and_of_what_load():
    grasp = CupGrasp(np.eye(4), 12.4, facet=3, room_mm=11.26, load=0.424)
    assert (
        grasp.description
        == "by facet 3, tilted 12 degrees, room for a lip of 11.3 mm radius, 42 % of what the cup holds"
    )
    assert grasp.figures == {"facet": 3, "room_mm": 11.26, "load": 0.424}
    assert grasp.risk == 0.424


@given(
    tilt=st.floats(0.0, 60.0), across=st.floats(0.0, 60.0), deep=st.floats(-20.0, 60.0), carried=st.floats(0.0, 30.0)
)
def test_what_a_part_asks_is_the_larger_of_pulling_it_off_and_turning_it_off(tilt, across, deep, carried):
    """The hand leans by what the grasp or its way to the bin needs, whichever is more."""
    cup = msgspec.structs.replace(CUP, carried_deg=carried, friction=0.4, safety=3.0)
    force_n = cup.vacuum_bar * 0.1 * np.pi * 100.0
    lean = np.radians(max(tilt, carried))
    off = 3.0 * 2.0 * (np.cos(lean) + np.sin(lean) / 0.4) / force_n
    lever = (across * np.cos(lean) + max(deep, 0.0) * np.sin(lean)) / (cup.cup_radius_mm / 2)
    assert cup.force_n == pytest.approx(force_n)
    assert cup.load(2.0, across, deep, tilt) == pytest.approx(max(off, 6.0 * lever / force_n))


def test_a_cup_works_as_long_as_its_vacuum_needs_and_looks_the_same_with_a_part_as_without():
    cup = SuctionCup(dwell_s=0.7, blow_off_s=0.4, cup_radius_mm=6.0)
    assert (cup.work_time_s(True), cup.work_time_s(False)) == (0.7, 0.4)
    assert (cup.empty, cup.widest_mm, cup.tip_mm) == (None, None, 0.0)
    assert cup.holding_volume == (0.0, 0.0, 12.0)
    assert cup.outside == ("cup_radius_mm", 6.0)


@given(near=st.floats(-80.0, 80.0), high=st.floats(-30.0, 120.0))
def test_what_lies_beside_is_in_the_way_of_the_cup_and_above_it_of_the_palm(near, high):
    """A small post at one side."""
    post = np.array([[near, 0.0, high], [near + 1.0, 1.0, high + 1.0]])
    beside = max(near, -near - 1.0)
    of_cup = beside < CUP.cup_radius_mm and -1.0 < high < 80.0
    of_palm = beside < 36.0 and high + 1.0 > CUP.cup_length_mm
    assert CUP.sweeps(np.diag([1.0, -1.0, -1.0, 1.0]), post) == (of_cup or of_palm)
