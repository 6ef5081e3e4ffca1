"""The search for grasps that bring a part onto another side: shortest, held against brute force, and cached."""

import re
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.arm import Reach
from daemon.events.codes import CauseCode
from daemon.pick.grippers.suction import SuctionCup
from daemon.pick.planning import regrasp
from daemon.pick.planning.place_goals import TABLE, goes_through, looks_round
from daemon.pick.planning.plan import Destination, NoPlan, approach_poses, held_part_visibility, stable_sides
from daemon.pick.planning.regrasp import MOST_GRASPS, Regrasping, grasp_table, resting_poses
from daemon.pick.planning.viewpoints import view_worth
from daemon.pick.settings import Settings
from daemon.vision.geometry import exact
from tests.bench import machined
from tests.fakes.chosen import few
from tests.fakes.fake_cell import HEAD_DOWN, ON_HAND, TOOL_FROM_CYCLOPEAN, World, build, joints, rig, shape_of
from tests.fakes.regrasps import START, goal_on, pairs_by_brute_force, start_on
from tests.unit.pick.test_plan import everywhere

SETTINGS = Settings()


@pytest.fixture(scope="module")
def reach():
    from daemon.arm.belief import Reading

    robot = build(World(np.random.default_rng(0))).robot.kinematics
    return Reach(robot, Reading(HEAD_DOWN, joints(HEAD_DOWN)), SETTINGS.limits, SETTINGS.arrival)


def regrasping(label, side, allowed, **more):
    shape = shape_of(label)
    goal = goal_on(label, shape, side)
    return Regrasping(shape, Destination([goal]), SETTINGS, ON_HAND, allowed, rig(), **more)


@pytest.fixture(scope="module")
def over_plan(reach):
    """A pair of sides of the pentagonal prism that takes two grasps, and its plan."""
    shape = shape_of("pentagonal_prism")
    for a in stable_sides(shape):
        for b in stable_sides(shape):
            asked = regrasping("pentagonal_prism", b, reach.allows_each)
            steps = asked.plan(start_on(shape, a))
            if not isinstance(steps, NoPlan) and len(steps) > 1:
                return a, b, asked, steps
    raise AssertionError("no pair takes two grasps")


@pytest.mark.parametrize("label", ["cube", "pyramid", "pentagonal_prism"])
def test_a_part_rests_level_on_each_face_below_its_mass(label):
    shape = shape_of(label)
    lying = resting_poses(shape)
    assert len(lying) == len(stable_sides(shape))
    for pose in lying:
        heights = frames.apply(pose, shape.corners_mm)[:, 2]
        assert heights.min() == pytest.approx(0.0, abs=0.01)
        assert (heights < 0.1).sum() >= 3


@pytest.mark.parametrize(("label", "sides"), [("knob", 2), ("flange", 2), ("clevis", 5), ("bracket", 5)])
def test_a_drawn_part_rests_on_nothing_round(label, sides):
    assert len(resting_poses(machined.drawn(label).solid)) == sides


@pytest.mark.parametrize("label", few(["cube", "triangular_prism", "pentagonal_prism"], 1))
def test_every_pair_of_sides_that_brute_force_finds_a_way_between_is_planned(label, reach):
    shape = shape_of(label)
    brute = pairs_by_brute_force(label, shape, SETTINGS, ON_HAND, reach, 1, 5)
    assert len(brute) > len(stable_sides(shape)) - 1
    for a, b in brute:
        steps = regrasping(label, b, reach.allows_each).plan(start_on(shape, a))
        assert not isinstance(steps, NoPlan), (a, b)
        assert 1 <= len(steps) <= MOST_GRASPS


def test_each_step_of_a_plan_is_reached_all_the_way_and_takes_the_part_where_the_one_before_laid_it(over_plan, reach):
    a, b, asked, steps = over_plan
    shape, pose = asked.shape, start_on(asked.shape, a)
    for number, step in enumerate(steps, start=1):
        centre = frames.apply(pose, shape.corners_mm).mean(axis=0)
        assert goes_through(approach_poses(step.grasp, centre, SETTINGS, ON_HAND), reach.allows_each)
        assert goes_through(step.way.ways[:3], reach.allows_each)
        held = frames.inverse(step.grasp.world_from_tool) @ pose
        laid = step.way.at @ held
        assert laid[:3, 3] - step.way.pose[:3, 3] == pytest.approx([0.0, 0.0, 0.5], abs=1e-6)
        assert laid[:3, :3] == pytest.approx(step.way.pose[:3, :3], abs=1e-9)
        heights = frames.apply(step.way.pose, shape.corners_mm)[:, 2]
        assert heights.min() == pytest.approx(SETTINGS.limits.table_z_mm, abs=0.01)
        assert (step.way.goal.place.name == TABLE) == (number < len(steps)) == step.way.goal.between
        pose = step.way.pose
    assert any(np.allclose(pose, each) for each in goal_on("pentagonal_prism", shape, b).poses)


def test_a_part_that_was_laid_down_is_taken_by_a_grasp_that_was_found_for_the_side_it_lies_on(over_plan):
    _, _, asked, steps = over_plan
    for before, step in pairwise(steps):
        pose = before.way.pose
        side = int(np.argmax([pose[2, :3] @ lying[2, :3] for lying in asked.table.lying]))
        part_from_tool = frames.inverse(pose) @ step.grasp.world_from_tool
        (same,) = np.nonzero(np.isclose(asked.table.part_from_tool, part_from_tool, atol=1e-6).all(axis=(1, 2)))
        assert side in asked.table.side[same]


def test_a_part_laid_down_is_looked_at_from_where_it_shows_best_of_what_the_arm_gets_to(over_plan, reach):
    _, _, asked, steps = over_plan
    way, shape = steps[0].way, asked.shape
    looks = np.stack([*looks_round(way.goal.centre, SETTINGS, ON_HAND)])
    allowed = reach.allows_each(looks)
    assert 0 < allowed.sum() < len(looks)
    camera = ON_HAND.world_from_cyclopean_at(way.look)[:3, 3]
    assert reach.allows(way.look)
    for look in looks[allowed]:
        other = ON_HAND.world_from_cyclopean_at(look)[:3, 3]
        assert view_worth(shape, way.pose, camera) >= view_worth(shape, way.pose, other)


def shown(shape, x_mm, z_mm, turned=(0.0, 0.0, 0.0)):
    """Which share of a part shows in the gripper where it lies so in front of the cameras."""
    cyclopean_from_part = frames.rigid(frames.rotation_from_vector(np.array(turned)), np.array([x_mm, 0.0, z_mm]))
    return held_part_visibility(shape, TOOL_FROM_CYCLOPEAN @ cyclopean_from_part, ON_HAND, rig())


def test_of_a_part_in_the_gripper_as_much_shows_as_both_cameras_have_of_the_edges_that_face_them():
    cube = shape_of("cube")
    assert shown(cube, 0.0, 400.0, (0.4, 0.3, 0.0)) == 1.0
    assert shown(cube, 2000.0, 400.0) == 0.0
    assert 0.4 < shown(cube, 130.0, 400.0) < 0.7, "it lies over the rim of a picture"
    needle = exact(
        np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0, 0, -50]]),
        [(0, 1, 2, 3), (1, 0, 4), (2, 1, 4), (3, 2, 4), (0, 3, 4)],
    )
    assert shown(needle, 0.0, 400.0) == 0.0, "its point faces them, and no side of it"
    assert shown(needle, 0.0, 400.0, (np.pi / 2, 0.0, 0.0)) == 1.0


def test_a_plan_of_fewer_grasps_is_asked_for_and_none_longer_is_given(over_plan):
    a, _, asked, steps = over_plan
    fewer = asked.plan(start_on(asked.shape, a), len(steps) - 1)
    assert isinstance(fewer, NoPlan)
    assert fewer.code == "no_way_to_place"
    assert re.fullmatch(r"none of its \d+ grasps in reach can set it down at nest as it is to lie there", fewer.why)


def test_a_place_that_the_arm_does_not_get_to_is_told_as_one_where_no_grasp_sets_the_part_down(over_plan, reach):
    a, b, asked, _ = over_plan
    nest = asked.destination.goals[0].centre

    def not_there(poses):
        return reach.allows_each(poses) & (np.linalg.norm(poses[:, :2, 3] - nest[:2], axis=1) > 150.0)

    why = regrasping("pentagonal_prism", b, not_there).plan(start_on(asked.shape, a)).why
    assert why.startswith("no grasp, on whichever side it lies, can set it down at nest")


def test_nothing_is_laid_where_no_look_has_shown_the_table(over_plan, reach, monkeypatch):
    a, _, asked, steps = over_plan
    laid = steps[0].way.goal.centre[:2]
    cameras = (np.array([300.0, -30.0, 200.0]), np.array([300.0, 30.0, 200.0]))
    shown = {"none": lambda point: False, "the other half": lambda point: point[1] > laid[1] + 40.0}
    for name, in_view in shown.items():
        monkeypatch.setattr(regrasp, "in_both_images", lambda look, point, view=in_view: view(point))
        look: Any = SimpleNamespace(viewpoints=cameras)
        other = Regrasping(asked.shape, asked.destination, SETTINGS, ON_HAND, reach.allows_each, rig(), (), (look,))
        found = other.plan(start_on(asked.shape, a))
        if name == "none":
            assert isinstance(found, NoPlan)
        else:
            assert not isinstance(found, NoPlan)
            corners = found[0].way.goal.corners
            assert corners[:, 1].min() > laid[1] + 40.0


def test_what_lies_on_the_table_is_laid_on_by_no_part_and_struck_by_no_hand(over_plan, reach):
    a, _, asked, steps = over_plan
    there = steps[0].way.goal.corners
    again = Regrasping(asked.shape, asked.destination, SETTINGS, ON_HAND, reach.allows_each, rig(), (there,))
    found = again.plan(start_on(asked.shape, a))
    if not isinstance(found, NoPlan):
        middle, radius = there.mean(axis=0)[:2], np.linalg.norm(there - there.mean(axis=0), axis=1).max()
        for step in found[:-1]:
            gap = np.linalg.norm(step.way.goal.corners[:, :2] - middle, axis=1).min()
            assert gap > radius
        assert again.beside.clear(np.stack([step.way.at for step in found]), SETTINGS.limits).all()


def test_no_place_of_the_cell_is_laid_on(over_plan, reach):
    a, _, asked, steps = over_plan
    reserved = Destination(asked.destination.goals, (), [steps[0].way.goal.corners])
    again = Regrasping(asked.shape, reserved, SETTINGS, ON_HAND, reach.allows_each, rig())
    found = again.plan(start_on(asked.shape, a))
    assert isinstance(found, NoPlan) or not np.allclose(found[0].way.goal.centre[:2], steps[0].way.goal.centre[:2])


def test_a_part_that_no_grasp_reaches_is_said_to_be_out_of_reach():
    nowhere = regrasping("cube", 0, lambda poses: np.zeros(len(poses), bool)).plan(start_on(shape_of("cube"), 1))
    assert isinstance(nowhere, NoPlan)
    assert nowhere.code == "out_of_reach"


def test_a_suction_cup_turns_nothing_over():
    shape = shape_of("cube")
    cup = Settings(gripper=SuctionCup())
    asked = Regrasping(shape, Destination([goal_on("cube", shape, 0)]), cup, ON_HAND, everywhere, rig())
    assert asked.plan(start_on(shape, 1)) == NoPlan(CauseCode.NO_WAY_TO_PLACE, "this gripper turns no part over")


def test_what_hangs_on_part_and_gripper_alone_is_worked_out_once(monkeypatch):
    made, work = [], regrasp.work_out_grasps
    monkeypatch.setattr(regrasp, "work_out_grasps", lambda *given: made.append(given) or work(*given))
    regrasp._TABLES.clear()
    gripper = SETTINGS.gripper.turning
    first = grasp_table(shape_of("cube"), gripper, 1.0)
    assert grasp_table(shape_of("cube"), gripper, 1.0) is first
    assert len(made) == 1
    grasp_table(shape_of("pyramid"), gripper, 1.0)
    assert grasp_table(shape_of("cube"), SETTINGS.gripper, 1.0) is not first
    assert len(made) == 3
    for number in range(regrasp.MOST_TABLES + 3):
        monkeypatch.setattr(regrasp, "work_out_grasps", lambda *_: first)
        grasp_table(shape_of("cube"), gripper, 2.0 + number)
    assert len(regrasp._TABLES) == regrasp.MOST_TABLES
    regrasp._TABLES.clear()


def test_a_part_that_leans_against_something_is_grasped_as_it_lies(reach):
    shape = shape_of("cube")
    tip = frames.rotation_from_vector(np.array([0.3, 0.0, 0.0]))
    leaning = frames.rigid(tip, START - tip @ START + [0.0, 0.0, 12.0]) @ start_on(shape, 0)
    asked = regrasping("cube", 0, reach.allows_each)
    own = SETTINGS.gripper.turning.grasps(shape, leaning, SETTINGS.limits.table_z_mm, 1.0).found
    assert [g.tilt_deg for g in asked._grasps_of(leaning)] == [g.tilt_deg for g in own]
