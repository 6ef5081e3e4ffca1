"""The approach, state by state: what is skipped, what is planned again, what closes all motion, who is blamed."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.arm import InWorld
from daemon.arm.belief import BeliefSource
from daemon.arm.motion import MovedByOthersError, MoveRefusedError
from daemon.pick import approach, following, pose_fusion, take
from daemon.pick.grippers.two_fingers import FingerGrasp
from daemon.pick.planning import next_stand_off
from daemon.pick.transitions import PickEvent, PickState
from daemon.pick.world import SuspectError
from daemon.vision.model import Axis
from tests.fakes.fake_cell import one_part
from tests.fakes.pick_steps import begun, brought_to, step


def shifted(fake, label, *by_mm):
    fake.lying[label] = frames.perturb(fake.lying[label], np.array([*by_mm, 0, 0, 0], float))


def test_a_part_whose_stop_turns_out_of_reach_is_skipped():
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.STOP_N, context, world)
    fake.reach_mm = 100.0
    assert step(context, world, PickState.STOP_N) is PickEvent.UNREACHABLE
    (skipped,) = world.skipped
    assert (skipped.label, skipped.outcome) == ("cube", "unreachable")
    assert "cannot reach" in skipped.why
    assert world.result.outcome == "unreachable"


def test_a_stop_out_of_reach_once_the_part_was_seen_nearer_is_planned_again_from_that_look():
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.ESTIMATING, context, world)
    assert step(context, world, PickState.ESTIMATING) is PickEvent.UNSURE
    reach_mm, fake.reach_mm = fake.reach_mm, 100.0
    assert step(context, world, PickState.STOP_N) is PickEvent.UNREACHABLE
    assert not world.skipped
    assert [part.look for part in world.found] == [world.the_target().look]
    fake.reach_mm = reach_mm
    assert step(context, world, PickState.CHOOSE) is PickEvent.CHOSEN


def test_a_stand_off_that_the_wrist_cannot_reach_on_a_line_is_reached_by_joints():
    """Through joint 5 at 0 no line goes; the part was skipped as unreachable, though the arm could stand there."""
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.ESTIMATING, context, world)
    assert step(context, world, PickState.ESTIMATING) is PickEvent.UNSURE
    target, settings = world.the_target(), context.settings
    distance = next_stand_off(target.sightings, settings.doubt, settings.stops)
    next_pose = context.cell.mounting.look_pose(target.look_rotation, target.centre, distance)
    fake.unreached = (fake.at[:3, 3] + next_pose[:3, 3]) / 2
    before = len(fake.said("move"))
    assert step(context, world, PickState.STOP_N) is PickEvent.THERE
    assert "joint" in [r["how"] for r in fake.said("move")[before:]]
    assert np.linalg.norm(fake.at[:3, 3] - next_pose[:3, 3]) < 1.0


@pytest.mark.parametrize("known", [None, True, False])
def test_on_its_way_to_a_part_no_gripper_is_worked_whatever_is_believed_of_it(known):
    """It was opened there where it was not known to be open, and dropped what a pendant had closed it on."""
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.STOP_N, context, world)
    context.mover.beliefs.learn(BeliefSource.COMMANDED, closed=known)
    sent = len(fake.wire)
    assert step(context, world, PickState.STOP_N) is PickEvent.THERE
    assert {name for name, _ in fake.wire[sent:]} == {"move"}


def test_once_seen_a_part_is_come_nearer_to_on_a_straight_line():
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.FINAL, context, world)
    stops = [r["how"] for r in fake.said("move") if r["purpose"].startswith("stand-off")]
    assert set(stops) == {"joint", "straight"}
    assert stops == sorted(stops)


@pytest.mark.parametrize("state", [PickState.STOP_N, PickState.FINAL])
def test_where_all_motion_is_closed_no_part_is_blamed(state):
    context, world = begun(one_part())
    brought_to(state, context, world)
    context.mover.permission.withdraw()
    with pytest.raises(MoveRefusedError, match="not_enabled"):
        step(context, world, state)
    assert not world.skipped


def test_a_part_that_was_turned_over_near_its_place_is_planned_again_but_not_for_ever():
    fake = one_part()
    context, world = begun(fake)
    for _ in range(context.settings.tries):
        brought_to(PickState.LOOKING, context, world)
        shifted(fake, "cube", 28, 0, 0)
        assert step(context, world, PickState.LOOKING) is PickEvent.ELSEWHERE
        assert [part.label for part in world.found] == ["cube"]
        assert not world.skipped
    brought_to(PickState.LOOKING, context, world)
    shifted(fake, "cube", -28, 0, 0)
    assert step(context, world, PickState.LOOKING) is PickEvent.LOST
    assert [s.outcome for s in world.skipped] == ["lost"]


def test_a_look_that_does_not_find_a_part_counts_as_a_try_at_it(monkeypatch):
    """Settings.tries is how often one part is tried: lost once and missed once are two."""
    fake = one_part()
    context, world = begun(fake)
    assert context.settings.tries == 2
    brought_to(PickState.LOOKING, context, world)
    lying = dict(fake.lying)
    fake.lying.clear()
    assert step(context, world, PickState.LOOKING) is PickEvent.ELSEWHERE
    fake.lying.update(lying)
    brought_to(PickState.VERIFY, context, world)
    monkeypatch.setattr(take, "shows_empty_gripper", lambda *_: True)
    monkeypatch.setattr(take, "shows_in_gripper", lambda *_: False)
    assert step(context, world, PickState.VERIFY) is PickEvent.MISSED
    assert [(one.outcome, one.why.split(" after ")[-1]) for one in world.skipped] == [("missed", "2 tries")]


def test_a_part_not_seen_from_one_side_is_approached_from_another_and_lost_after_the_last():
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.LOOKING, context, world)
    fake.lying.clear()
    for _ in range(context.settings.views_of_doubtful):
        assert step(context, world, PickState.LOOKING) is PickEvent.ELSEWHERE
    assert len(world.unseen_directions_of(world.the_target().centre)) == context.settings.views_of_doubtful
    assert step(context, world, PickState.LOOKING) is PickEvent.LOST
    assert "not seen where it was" in world.result.why
    assert world.disagreements == {"not found at the expected position": context.settings.views_of_doubtful + 1}


def test_an_estimate_that_the_planned_grasp_does_not_hold_leads_to_another_plan(monkeypatch):
    context, world = begun(one_part())
    brought_to(PickState.ESTIMATING, context, world)
    monkeypatch.setattr(approach, "same_grasp", lambda *_: None)
    assert step(context, world, PickState.ESTIMATING) is PickEvent.ELSEWHERE
    assert world.replans == 1


UPRIGHT, LEVEL = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("rounded", "at_place", "about", "event"),
    [
        (True, False, None, PickEvent.SURE),
        (False, False, None, PickEvent.UNSURE),
        (True, True, None, PickEvent.UNSURE),
        (True, True, UPRIGHT, PickEvent.SURE),
        (False, True, UPRIGHT, PickEvent.UNSURE),
        (True, True, LEVEL, PickEvent.UNSURE),
    ],
)
def test_a_round_part_of_unknown_turn_is_taken_where_its_turn_does_not_matter(
    monkeypatch, rounded, at_place, about, event
):
    """about: the axis, world, about which its place allows any turn."""
    context, world = begun(one_part())
    brought_to(PickState.ESTIMATING, context, world)
    plan, fused = world.the_target().plan, pose_fusion.fuse

    def unturned(sightings, doubt):
        estimate = fused([replace(one, covariance=1e-4 * np.eye(6)) for one in sightings], doubt)
        return replace(estimate, at_grasp=1e-6 * np.eye(6) + np.diag([0, 0, 0, 0, 0, 1.0]))

    turn = world.the_target().world_from_part[:3, :3]
    axis = None if about is None else Axis(np.zeros(3), turn.T @ about)
    way: Any = SimpleNamespace(goal=SimpleNamespace(axis=axis)) if at_place else None
    assert isinstance(plan.grasp, FingerGrasp)
    found = replace(plan, grasp=replace(plan.grasp, rounded=rounded), way=way)
    monkeypatch.setattr(pose_fusion, "fuse", unturned)
    monkeypatch.setattr(approach, "same_grasp", lambda *_: found)
    assert step(context, world, PickState.ESTIMATING) is event


def test_a_part_whose_turn_does_not_show_along_the_approach_is_looked_at_from_a_side(monkeypatch):
    context, world = begun(one_part())
    brought_to(PickState.ESTIMATING, context, world)
    side = context.cell.mounting.look_pose(world.the_target().look_rotation, np.zeros(3), 1.0)[:3, :3]
    side = frames.rotation_from_vector(np.array([0.0, 0.6, 0.0])) @ side
    monkeypatch.setattr(approach, "side_that_shows_turn", lambda *_: side)
    assert step(context, world, PickState.ESTIMATING) is PickEvent.UNSURE
    assert step(context, world, PickState.STOP_N) is PickEvent.THERE
    assert context.mover.belief.resting_reading.world_from_tool[:3, :3] == pytest.approx(side, abs=1e-3)


def test_a_look_on_the_approach_is_made_for_every_turn_that_the_looks_before_left_open(monkeypatch):
    context, world = begun(one_part())
    brought_to(PickState.LOOKING, context, world)
    asked, expected = [], following.expected_at
    known = pose_fusion.Estimate(world.the_target().world_from_part, 1e-6 * np.eye(6), 1e-6 * np.eye(6))
    world.the_target().estimate = known
    monkeypatch.setattr(approach, "expected_at", lambda *known: asked.append(known[-1]) or expected(*known[:-1]))
    assert step(context, world, PickState.LOOKING) is PickEvent.LOOKED
    assert asked == [known]


@pytest.mark.parametrize(
    ("place", "cameras", "side", "said"),
    [
        ("nest", {}, None, "from any side in reach"),
        ("tray.3", {}, None, "from any side in reach"),
        ("nest", {"mounting": InWorld(np.eye(4), np.eye(4), np.zeros(3))}, None, "with the fixed cameras"),
        ("nest", {"alone": "left"}, None, "along the approach, and with one camera it looks from no other side"),
        ("nest", {}, np.eye(3), "well enough, not even from a side"),
    ],
)
def test_a_part_whose_turn_shows_from_nowhere_is_left_alone_and_what_to_do_is_said(
    monkeypatch, place, cameras, side, said
):
    context, world = begun(one_part())
    brought_to(PickState.ESTIMATING, context, world)
    target, fused = world.the_target(), pose_fusion.fuse
    target.looks = context.settings.stops.most_looks

    def unturned(sightings, doubt):
        estimate = fused([replace(one, covariance=1e-4 * np.eye(6)) for one in sightings], doubt)
        return replace(estimate, at_grasp=1e-6 * np.eye(6) + np.diag([0, 0, 0, 0, 0, 1.0]))

    way = SimpleNamespace(goal=SimpleNamespace(axis=None, place=SimpleNamespace(name=place)))
    monkeypatch.setattr(pose_fusion, "fuse", unturned)
    monkeypatch.setattr(approach, "same_grasp", lambda *_, plan=target.plan: replace(plan, way=way))
    target.side_view = side
    context = replace(context, cell=replace(context.cell, **cameras))
    assert step(context, world, PickState.ESTIMATING) is PickEvent.GAVE_UP
    why = world.skipped[-1].why
    assert f"facetd cannot see its turn about the vertical {said}" in why
    assert f"set `any_turn: true` for place {place.partition('.')[0]} " in why


def twice_looked(fake, moved):
    """Two looks at the cube between which `moved` acted on the world."""
    context, world = begun(fake)
    brought_to(PickState.LOOKING, context, world)
    assert step(context, world, PickState.LOOKING) is PickEvent.LOOKED
    step(context, world, PickState.ESTIMATING)
    step(context, world, PickState.STOP_N)
    moved()
    assert step(context, world, PickState.LOOKING) is PickEvent.LOOKED
    assert len(world.the_target().sightings) == 2
    return context, world


def test_where_only_the_part_moved_the_newest_look_alone_counts_and_the_approach_goes_on():
    fake = one_part()
    fake.put("pyramid", 560, -70, 0.4)
    context, world = twice_looked(fake, lambda: shifted(fake, "cube", 5, 0, 0))
    event = step(context, world, PickState.ESTIMATING)
    assert event in (PickEvent.UNSURE, PickEvent.SURE)
    assert len(world.the_target().sightings) == 1
    assert [r["text"] for r in fake.said("decision")][-1] == "suspect: part"


def test_where_nothing_else_is_in_view_the_table_is_looked_at_again_and_the_doubt_is_kept():
    fake = one_part()
    fake.put("pyramid", 430, -200, 0.4)
    context, world = twice_looked(fake, lambda: shifted(fake, "cube", 5, 0, 0))
    assert step(context, world, PickState.ESTIMATING) is PickEvent.DOUBT
    assert world.before_disagreement is not None
    assert [part.label for part in world.before_disagreement[1]] == ["cube"]
    assert "cube" not in [part.label for part in world.before_disagreement[0]]


def test_a_knocked_camera_and_a_second_disagreement_are_the_cells_fault():
    fake = one_part()

    def knocked():
        fake.epipolar = 3.0
        shifted(fake, "cube", 5, 0, 0)

    context, world = twice_looked(fake, knocked)
    with pytest.raises(SuspectError, match="likely cause: camera"):
        step(context, world, PickState.ESTIMATING)
    fake = one_part()
    context, world = twice_looked(fake, lambda: shifted(fake, "cube", 5, 0, 0))
    world.the_target().restarts = 1
    with pytest.raises(SuspectError, match="disagree"):
        step(context, world, PickState.ESTIMATING)


def test_looks_that_disagree_approach_after_approach_while_nothing_else_moves_are_the_hand_eye_s_fault():
    """Else a pick with a wrong hand-eye would go from doubt to survey for ever."""
    fake = one_part()
    fake.put("pyramid", 430, -200, 0.4)
    context, world = twice_looked(fake, lambda: shifted(fake, "cube", 5, 0, 0))
    world.disagreement_count = context.settings.tries
    with pytest.raises(SuspectError, match=r"3 approaches in one pick.*likely cause: hand-eye"):
        step(context, world, PickState.ESTIMATING)


@pytest.mark.parametrize("doubts", [0, 9])
def test_an_arm_that_somebody_nudged_before_the_last_look_is_told_and_nobody_calibrates_for_it(doubts):
    """Looks that disagree were blamed on hand-eye: what may explain it is asked first."""
    fake = one_part()
    fake.put("pyramid", 430, -200, 0.4)

    def nudged():
        fake.at = frames.perturb(fake.at, np.array([8.0, 0, 0, 0, 0, 0]))

    context, world = twice_looked(fake, nudged)
    world.disagreement_count = doubts
    with pytest.raises(MovedByOthersError, match=r"somebody else moved the arm after it came to rest, by 8\.0"):
        step(context, world, PickState.ESTIMATING)
