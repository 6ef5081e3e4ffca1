"""Plans: reached all the way or told why not; the same grasp found again on a better estimate."""

from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest

from daemon import frames
from daemon.events.codes import CauseCode
from daemon.pick.grippers.two_fingers import TwoFingers, sweeps
from daemon.pick.planning import plan as planning
from daemon.pick.planning import viewpoints
from daemon.pick.planning.place_plan import plan_to_place
from daemon.pick.planning.plan import (
    Destination,
    NoPlan,
    Plan,
    final_approach,
    held_part_visibility,
    plan_part,
    same_grasp,
    stable_sides,
)
from daemon.pick.settings import Settings
from daemon.store import folders
from daemon.store.library import load_facets
from daemon.teaching.solid_from_mesh import read_drawing
from daemon.vision.geometry import exact
from drivers.simcell.parts import part_shape
from tests.fakes.fake_cell import ON_HAND, TOOL_FROM_CYCLOPEAN, shape_of
from tests.fakes.regrasps import goal_on
from tests.fakes.rigs import rig


def everywhere(poses):
    return np.ones(len(poses), bool)


def lying(label, rest, turn=0.3, x=520.0, y=0.0):
    spin = frames.rotation_from_vector(np.array([0.0, 0.0, turn]))
    return frames.rigid(spin, np.array([x, y, -300.0])) @ part_shape(label).rests[rest]


def test_a_plan_is_reachable_all_the_way_or_says_why_not():
    shape, pose = shape_of("cube"), lying("cube", 0)
    plan = plan_part(shape, pose, [], Settings(), ON_HAND, everywhere)
    assert not isinstance(plan, NoPlan)
    none = plan_part(shape, pose, [], Settings(), ON_HAND, lambda p: p[:, 2, 3] < -200)
    assert isinstance(none, NoPlan)
    assert none.code == "out_of_reach"
    assert "reached" in none.why


def test_the_same_grasp_is_found_again_on_a_better_estimate_and_not_on_another_pose():
    shape, pose = shape_of("cube"), lying("cube", 0)
    plan = plan_part(shape, pose, [], Settings(), ON_HAND, everywhere)
    assert not isinstance(plan, NoPlan)
    nearby = frames.perturb(pose, np.array([2.0, -1.0, 0.0, 0.0, 0.0, 0.03]))
    again = same_grasp(shape, nearby, plan, Settings())
    assert again is not None
    gap = again.grasp.world_from_tool[:3, 3] - plan.grasp.world_from_tool[:3, 3]
    assert np.allclose(gap[:2], [2.0, -1.0], atol=0.5)
    assert same_grasp(shape, lying("cube", 0, 0.3, 560.0), plan, Settings()) is None


def test_a_grasp_moved_by_a_better_estimate_keeps_clear_of_what_lies_beside():
    """The refined grasp asked for no room: a finger went down on the neighbour."""
    rng, shape, pose, settings = np.random.default_rng(2), shape_of("cube"), lying("cube", 0), Settings()
    corners, would_strike = part_shape("pyramid").hull.vertices, 0
    assert isinstance(settings.gripper, TwoFingers)
    for _ in range(60):
        away = frames.rotation_from_vector(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))[:, 0]
        beside = frames.apply(lying("pyramid", 0, rng.uniform(0.0, 1.5)), corners) + away * rng.uniform(60.0, 85.0)
        plan = plan_part(shape, pose, [beside], settings, ON_HAND, everywhere)
        if isinstance(plan, NoPlan):
            continue
        nearer = frames.perturb(pose, np.array([*rng.uniform(-4.0, 4.0, 2), 0.0, 0.0, 0.0, rng.normal(0.0, 0.04)]))
        alone = same_grasp(shape, nearer, replace(plan, neighbours=()), settings)
        again = same_grasp(shape, nearer, plan, settings)
        if alone is not None and sweeps(alone.grasp.world_from_tool, beside, settings.gripper):
            would_strike += 1
        assert again is None or not sweeps(again.grasp.world_from_tool, beside, settings.gripper)
    assert would_strike


def test_what_is_gone_through_without_a_look_is_what_was_checked():
    shape, pose, settings = shape_of("cube"), lying("cube", 0), Settings()
    asked = []
    plan = plan_part(shape, pose, [], settings, ON_HAND, lambda p: asked.extend(p) or everywhere(p))
    centre = frames.apply(pose, shape.corners_mm).mean(axis=0)
    assert isinstance(plan, Plan)
    stretch = final_approach(plan.grasp, centre, settings, ON_HAND)
    for driven in stretch:
        assert any(np.allclose(driven, checked) for checked in asked)
    back = frames.apply(frames.inverse(stretch.at), stretch.before[:3, 3])
    np.testing.assert_allclose(back, [0, 0, -settings.pregrasp_mm], atol=1e-9)
    np.testing.assert_allclose(stretch.lifted[:3, 3] - stretch.at[:3, 3], [0, 0, settings.lift_mm])
    np.testing.assert_allclose(
        frames.apply(frames.inverse(stretch.back @ TOOL_FROM_CYCLOPEAN), centre), [0, 0, settings.verify_mm], atol=1e-9
    )


@pytest.mark.parametrize(("reached", "found"), [(0, True), (2, True), (3, False)])
def test_of_the_free_places_the_first_three_are_tried_in_their_order(monkeypatch, reached, found):
    monkeypatch.setattr(planning, "ways_to", lambda goal, *_: iter([f"to {goal}"] if goal >= reached else []))
    goals: Any = range(5)
    destination = planning.Destination(goals=goals)
    way: Any = planning.first_set_down(destination, np.eye(4), Settings(), ON_HAND, everywhere)
    assert way == (f"to {reached}" if found else None)


@pytest.mark.parametrize("label", ["cube", "pyramid", "triangular_prism", "pentagonal_prism"])
def test_the_sides_that_a_part_can_lie_on_are_those_below_its_mass(label):
    assert len(stable_sides(shape_of(label))) == len(part_shape(label).rests)


def test_a_part_does_not_lie_on_the_inside_of_a_corner():
    bracket = read_drawing("bracket.obj", (folders.HOUSE / "docs" / "bracket.obj").read_bytes(), "mm", load_facets())
    sides, solid = stable_sides(bracket.solid), bracket.solid
    inner = [
        k for k, laid in enumerate(solid.flat_from_solid) if frames.apply(laid, solid.corners_mm)[:, 2].max() > 1.0
    ]
    assert len(inner) == 2
    assert sides
    assert not set(sides) & set(inner)


def test_a_part_whose_corners_span_no_volume_has_no_grasp():
    flat = shape_of("cube").corners_mm * [1.0, 1.0, 0.0]
    none = plan_part(exact(flat, []), lying("cube", 0), [], Settings(), ON_HAND, everywhere)
    assert isinstance(none, NoPlan)
    assert (none.code, none.why.partition(":")[0]) == ("no_grasp", "taught corners give no solid to grasp")


def test_a_part_wider_than_the_gripper_opens_has_no_grasp_and_the_gripper_says_why():
    narrow = msgspec.structs.replace(Settings().gripper, opening_mm=20.0)
    settings = replace(Settings(), gripper=narrow)
    none = plan_part(shape_of("cube"), lying("cube", 0), [], settings, ON_HAND, everywhere)
    assert isinstance(none, NoPlan)
    assert none.code == CauseCode.NO_GRASP
    assert none.why.startswith("no grasp holds it as it lies")


def test_a_part_that_was_looked_for_from_every_side_is_looked_for_no_more():
    around = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    away = [
        300.0 * np.array([np.cos(turn) * np.cos(up), np.sin(turn) * np.cos(up), np.sin(up)])
        for turn in around
        for up in np.radians([15.0, 30.0, 45.0, 60.0, 75.0, 90.0])
    ]
    shape, pose = shape_of("cube"), lying("cube", 0)
    none = plan_part(shape, pose, [], Settings(), ON_HAND, everywhere, unseen_from=away)
    assert none == NoPlan(CauseCode.MOVE_REFUSED, "it was looked for from every side that a grasp leaves")
    one = plan_part(shape, pose, [], Settings(), ON_HAND, everywhere, unseen_from=away[:1])
    assert not isinstance(one, NoPlan)


def test_of_grasps_that_no_neighbour_bars_the_one_seen_best_and_risking_least_is_taken():
    """Reckoned from all grasps there are: none that is reached all the way is better than the one that is planned."""
    shape, settings = shape_of("pentagonal_prism"), Settings()
    for turn in (0.0, 0.4, 1.1):
        pose = lying("pentagonal_prism", 0, turn)
        centre = frames.apply(pose, shape.corners_mm).mean(axis=0)
        plan = plan_part(shape, pose, [], settings, ON_HAND, lambda p: p[:, 1, 3] < 60.0)
        assert not isinstance(plan, NoPlan)
        every, _ = settings.gripper.grasps(shape, pose, settings.limits.table_z_mm, settings.stops.enough_mm)
        figures = []
        for grasp in every:
            poses = planning.approach_poses(grasp, centre, settings, ON_HAND)
            look = ON_HAND.look_pose(grasp.world_from_tool[:3, :3], centre, settings.stops.stand_offs_mm[1])
            worth = viewpoints.view_worth(shape, pose, ON_HAND.world_from_cyclopean_at(look)[:3, 3])
            if all(p[1, 3] < 60.0 for p in poses):
                figures.append(grasp.risk - worth)
        assert plan.grasp.risk - plan.worth == pytest.approx(min(figures))
        assert plan.way is None


@pytest.mark.parametrize(("beside_y", "code"), [(62.0, CauseCode.OUT_OF_REACH), (None, CauseCode.OUT_OF_REACH)])
def test_why_there_is_no_plan_counts_the_grasps_and_those_that_a_neighbour_bars(beside_y, code):
    shape, pose, settings = shape_of("cube"), lying("cube", 0), Settings()
    beside = [] if beside_y is None else [frames.apply(lying("cube", 0, 0.3, 520.0, beside_y), shape.corners_mm)]
    every, _ = settings.gripper.grasps(shape, pose, settings.limits.table_z_mm, settings.stops.enough_mm, beside)
    blocked = sum(grasp.blocked for grasp in every)
    none = plan_part(shape, pose, beside, settings, ON_HAND, lambda p: ~everywhere(p))
    expected = CauseCode.BLOCKED if 2 * blocked >= len(every) else code
    assert none == NoPlan(
        expected, f"none of its {len(every)} grasps can be reached all the way ({blocked} blocked by a neighbour)"
    )


def test_a_part_taken_to_a_place_is_grasped_so_that_it_shows_in_the_gripper():
    """It is measured there before it is set down: a cover whose grasp hid it from both cameras went to the bin."""
    shape, pose = shape_of("pyramid"), lying("pyramid", 0)
    arm = Settings(), ON_HAND, everywhere, rig()
    to_bin, _ = plan_to_place(shape, pose, (), *arm, None)
    to_place, _ = plan_to_place(shape, pose, (), *arm, Destination([goal_on("pyramid", shape, 0)]))
    assert isinstance(to_bin, Plan)
    assert isinstance(to_place, Plan)
    shows = [
        held_part_visibility(shape, frames.inverse(plan.grasp.world_from_tool) @ pose, ON_HAND, rig())
        for plan in (to_bin, to_place)
    ]
    assert shows[1] > shows[0] + 0.1


def test_where_no_grasp_is_reached_the_place_that_a_part_belongs_at_is_not_to_blame():
    shape, goals = shape_of("cube"), Destination([goal_on("cube", shape_of("cube"), 0)])
    none = plan_part(shape, lying("cube", 0), [], Settings(), ON_HAND, lambda p: ~everywhere(p), destination=goals)
    assert isinstance(none, NoPlan)
    assert none.code is CauseCode.OUT_OF_REACH


def test_a_part_amid_neighbours_that_bar_most_of_its_grasps_is_said_to_be_blocked():
    shape, pose, settings = shape_of("cube"), lying("cube", 0), Settings()
    ring = [
        frames.apply(lying("cube", 0, 0.3, 520.0 + 62.0 * np.cos(a + 0.3), 62.0 * np.sin(a + 0.3)), shape.corners_mm)
        for a in (0.0, np.pi / 2, np.pi, 3 * np.pi / 2)
    ]
    none = plan_part(shape, pose, ring, settings, ON_HAND, everywhere)
    assert isinstance(none, NoPlan)
    assert none.code is CauseCode.BLOCKED


def test_a_grasp_is_found_again_as_near_as_can_be_and_no_farther_off_than_25_mm_with_its_turn():
    """A radian counts as 50 mm."""
    shape, pose, settings = shape_of("pyramid"), lying("pyramid", 0), Settings()
    plan = plan_part(shape, pose, [], settings, ON_HAND, everywhere)
    assert isinstance(plan, Plan)
    old = plan.grasp.world_from_tool
    for off_mm in (0.0, 8.0, 20.0, 24.0, 30.0):
        for turn in (0.0, 0.05, 0.2):
            moved = frames.perturb(pose, np.array([off_mm, 0.0, 0.0, 0.0, 0.0, turn]))
            every, _ = settings.gripper.grasps(shape, moved, -300.0, settings.stops.enough_mm, near=old[:3, :3])
            away = [
                np.linalg.norm(g.world_from_tool[:3, 3] - old[:3, 3])
                + 50.0 * frames.angle_between(g.world_from_tool, old)
                for g in every
            ]
            again = same_grasp(shape, moved, plan, settings)
            assert (again is not None) == bool(away and min(away) <= 25.0)
            if again is not None:
                found = again.grasp.world_from_tool
                gap = np.linalg.norm(found[:3, 3] - old[:3, 3]) + 50.0 * frames.angle_between(found, old)
                assert gap == pytest.approx(min(away))
                assert again.worth == plan.worth
