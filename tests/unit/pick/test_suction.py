"""Grasps by suction: where there is room for the lip, off holes and edges, under the mass centre, within the load."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.pick.suction import SuctionCup, rooms_on, upward, weight_and_middle
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
    return frames.rigid(frames.rotation_from_vector(np.array([0.0, 0.0, turn_rad])) @ tilted, [520.0, 30.0, -300.0])


def taken(solid, world_from_part, cup=CUP, **how):
    return cup.grasps(solid, world_from_part, -300.0, ERROR_MM, **how)


def test_room_is_the_distance_to_the_nearest_edge_or_hole_and_none_is_in_a_hole():
    solid, top = plate()
    points, rooms = rooms_on(bored(solid, top, (20.0, 30.0), 8.0), top)
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
    points, rooms = rooms_on(solid, inner)
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
    assert "times what the cup holds there" in why
    weight_n, middle = weight_and_middle(solid, 2.7)
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
    assert "times what the cup holds there" in heavy


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
    step = [k for k, _ in upward(solid, np.eye(4), 5.0) if solid.centres_mm[k][2] < 30.0]
    points, rooms = rooms_on(solid, step[0])
    assert rooms == pytest.approx(
        np.minimum.reduce([points[:, 0] - 45, 90 - points[:, 0], -points[:, 1], points[:, 1] + 50]), abs=0.1
    )


def test_a_facet_that_looks_aside_or_down_is_not_taken_and_the_reason_is_told():
    solid = shape_of("pyramid")
    apex_up = frames.rigid(np.eye(3), [520.0, 0.0, -280.0])
    steep = msgspec.structs.replace(CUP, lean_deg=5.0)
    found, why = taken(solid, apex_up, steep)
    assert not found
    assert "no flat facet of it leans by less than 5 degrees" in why


def test_a_neighbour_in_the_cups_way_blocks_and_one_beside_it_does_not():
    solid, _ = plate()
    pose = lying(solid)
    (best, *_), _ = taken(solid, pose)
    x, y, z = best.world_from_tool[:3, 3]
    post = np.array([[x + a, y + b, z + c] for a in (3.0, 8.0) for b in (-3.0, 3.0) for c in (5.0, 40.0)])
    assert CUP.in_the_way(best.world_from_tool, post)
    assert not CUP.in_the_way(best.world_from_tool, post + np.array([60.0, 0.0, 0.0]))
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
