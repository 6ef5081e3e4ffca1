"""Ways round: over what is in the way, every leg swept; or the reason why there is none."""

import asyncio
import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.arm import route
from daemon.arm.belief import Beliefs, BeliefSource, Reading
from daemon.arm.body import Capsule, KeepOut
from daemon.arm.guard import ArmState, Limits, MoveCommand
from daemon.arm.motion import Arrival, Mover, MoveRefusedError, OutOfReachError
from daemon.arm.mounting import OnHand
from daemon.arm.permission import MotionPermission, Refusal
from daemon.arm.route import plan_path
from daemon.arm.workcell import Workcell
from daemon.pick.grippers.two_fingers import tool_rotation
from drivers import puma560
from tests.fakes.fake_cell import permitted
from tests.fakes.swept import ARM, ROBOT, Travel, truth_of

POST = KeepOut("post", (540.0, -30.0, -300.0), (580.0, 30.0, -120.0))
LIMITS = Limits(keep_out=(POST,))


def hand(x, y, z):
    return frames.rigid(tool_rotation(np.array([1.0, 0.0, 0.0]), 0.0), np.array([x, y, z], float))


def reading(pose):
    return Reading(pose, puma560.inverse(pose, puma560.Configuration(), ARM))


LEFT, RIGHT = hand(560, -200, -180), hand(560, 200, -180)


def planned(start, target, straight=False, limits=LIMITS):
    standing = ArmState(None, start, 0.0)
    return plan_path(MoveCommand(target, straight, 50.0, "test"), standing, reading(start), ROBOT, limits)


def test_a_free_way_is_gone_directly():
    (leg,) = planned(hand(560, -200, 100), hand(560, 200, 100))
    assert not leg.straight
    assert np.array_equal(leg.world_from_tool, hand(560, 200, 100))


@pytest.mark.parametrize(("tip_mm", "low"), [(10.0, False), (60.0, True)])
def test_a_hand_amid_what_lies_on_the_table_goes_straight_up_out_of_it_first(tip_mm, low):
    """Stopped around a part, it went sideways through those beside it, with the part: 40 mm mostly, 320 at most. What
    is held reaches lower than the tips."""
    held = Capsule("part", "tool", (0.0, 0.0, 0.0), (0.0, 0.0, tip_mm), 5.0)
    limits = replace(Limits(), capsules=(*Limits().capsules, held))
    start, target = hand(560, -100, -220), hand(350, 250, -100)
    legs = planned(start, target, limits=limits)
    assert not isinstance(legs, Refusal)
    assert legs[0].straight is low
    if low:
        np.testing.assert_allclose(legs[0].world_from_tool[:2], start[:2])
        assert legs[0].world_from_tool[2, 3] == pytest.approx(-300.0 + route.OUT_MM + tip_mm + 5.0)
    assert np.array_equal(legs[-1].world_from_tool, target)


@pytest.mark.parametrize("start", [hand(350, 250, -100), hand(560, -100, -250)])
def test_a_hand_that_is_sent_amid_what_lies_on_the_table_comes_straight_down_into_it(start):
    """`go` came in sideways through the parts beside the place, low above the table: by 41 mm mostly, 158 at most."""
    target = hand(480, 60, -280)
    legs = planned(start, target, limits=Limits())
    assert not isinstance(legs, Refusal)
    *_, over, down = legs
    assert (over.straight, down.straight) == (False, True)
    np.testing.assert_allclose(over.world_from_tool[:2], target[:2])
    assert over.world_from_tool[2, 3] == pytest.approx(-300.0 + route.OUT_MM + 10.0)
    assert np.array_equal(down.world_from_tool, target)


def test_a_hand_that_cannot_go_straight_up_goes_as_it_can(monkeypatch):
    start, target = hand(560, -100, -270), hand(500, 0, -200)
    assert planned(start, target, limits=Limits())[0].straight
    monkeypatch.setattr(route, "OUT_MM", 2000.0)
    (leg,) = planned(start, target, limits=Limits())
    assert not leg.straight


def test_a_way_through_a_post_is_planned_over_it_up_across_down_and_each_leg_is_clear():
    legs = planned(LEFT, RIGHT)
    assert not isinstance(legs, Refusal)
    assert [leg.straight for leg in legs] == [True, False, True]
    assert np.array_equal(legs[-1].world_from_tool, RIGHT)
    assert legs[0].world_from_tool[:2, 3] == pytest.approx(LEFT[:2, 3])
    assert legs[0].world_from_tool[2, 3] == pytest.approx(legs[1].world_from_tool[2, 3])
    at = reading(LEFT)
    for leg in legs:
        truth = truth_of(Travel(at, MoveCommand(leg.world_from_tool, leg.straight, 50.0, ""), LIMITS))
        assert truth.reached
        assert truth.touch_mm >= LIMITS.clearance_mm - 0.5
        at = Reading(leg.world_from_tool, ROBOT.reachable(leg.world_from_tool, at.joints_rad))


def test_the_way_over_is_no_higher_than_it_must_be():
    low = replace(LIMITS, keep_out=(replace(POST, high_mm=(580.0, 30.0, -170.0)),))
    tops = [max(leg.world_from_tool[2, 3] for leg in planned(LEFT, RIGHT, limits=some)) for some in (low, LIMITS)]
    assert tops[0] < tops[1]


def test_a_straight_way_is_refused_where_it_strikes_and_says_what():
    refusal = planned(LEFT, RIGHT, straight=True)
    assert isinstance(refusal, Refusal)
    assert (refusal.rule, "post" in refusal.text) == ("kept_out", True)


def test_where_nothing_leads_over_it_the_reason_is_that_of_the_direct_way():
    wall = replace(LIMITS, keep_out=(KeepOut("wall", (-900.0, -20.0, -300.0), (1500.0, 20.0, 1500.0)),))
    refusal = planned(LEFT, RIGHT, limits=wall)
    assert isinstance(refusal, Refusal)
    assert refusal.rule == "kept_out"
    assert "wall" in refusal.text
    assert refusal.text.endswith("a path higher up is not clear either")


def test_where_the_direct_way_leaves_the_room_a_way_over_is_looked_for_too():
    narrow = replace(LIMITS, keep_out=(), room_high_mm=(650.0, 2000.0, 2000.0))
    refusal = planned(hand(500, -300, -180), hand(500, 300, -180), limits=narrow)
    assert isinstance(refusal, Refusal)
    assert refusal.rule == "outside_room"
    assert refusal.text.endswith("a path higher up is not clear either")


def test_long_ways_are_parted_in_steps_within_the_limits():
    short = Limits(max_step_mm=150.0)
    legs = planned(hand(560, -200, 100), hand(560, 200, 100), limits=short)
    places = [hand(560, -200, 100), *(leg.world_from_tool for leg in legs)]
    assert len(legs) >= 3
    assert max(np.linalg.norm(b[:3, 3] - a[:3, 3]) for a, b in itertools.pairwise(places)) <= 150.0


class Log:
    def __init__(self):
        self.said = []

    def record(self, kind, /, **fields):
        self.said.append((kind, fields))


class Jumping:
    """The PUMA's geometry; goes at once to where it is sent."""

    def __init__(self, at):
        self.at, self.sent = at, []
        self.kinematics, self.beliefs = ROBOT, Beliefs(lambda: 0.0, Log().record)
        self.permission = MotionPermission()
        self.permission.stop_tests = 1

    async def wait_until_at_rest(self):
        return self.at

    async def move(self, command, starts, timeout_s, then=None):
        starts(self.at)
        target = command.world_from_tool
        self.sent.append((command.straight, target))
        self.at = Reading(target, ROBOT.reachable(target, self.at.joints_rad))
        return self.at


def mover_at(pose, limits=LIMITS):
    robot: Any = Jumping(reading(pose))
    cell = Workcell(robot, None, Log(), lambda: 0.0, None, OnHand(np.eye(4)), asyncio.to_thread)
    mover = permitted(Mover(cell, limits, Arrival()))
    mover.beliefs.learn(BeliefSource.REPORTED, position=robot.at)
    return mover, robot


def test_the_mover_travels_over_a_post():
    mover, robot = mover_at(LEFT)
    asyncio.run(mover.travel(RIGHT, "test", lambda _: 50.0))
    assert [straight for straight, _ in robot.sent] == [True, False, True]
    assert np.array_equal(robot.at.world_from_tool, RIGHT)


def test_the_mover_sends_nothing_where_there_is_no_way():
    mover, robot = mover_at(LEFT)
    with pytest.raises(MoveRefusedError, match="kept_out"):
        asyncio.run(mover.travel(RIGHT, "test", lambda _: 50.0, straight=True))
    with pytest.raises(OutOfReachError):
        asyncio.run(mover.travel(hand(899, 640, 1000), "test", lambda _: 50.0))
    assert robot.sent == []
    assert [kind for kind, _ in mover.cell.log.said] == ["refusal"]


@pytest.mark.parametrize("straight", [True, False])
def test_one_move_through_a_post_is_not_sent_even_when_it_was_not_planned(straight):
    mover, robot = mover_at(LEFT)
    with pytest.raises(MoveRefusedError, match="kept_out"):
        asyncio.run(mover.go(MoveCommand(RIGHT, straight, 50.0, "test")))
    assert robot.sent == []


def test_the_whole_way_is_asked_about_again_after_the_gate_and_from_where_the_arm_is_then():
    mover, robot = mover_at(hand(560, 100, -180))

    async def moved_meanwhile(*_):
        mover.beliefs.learn(BeliefSource.REPORTED, position=reading(LEFT))

    mover.gate = moved_meanwhile
    with pytest.raises(MoveRefusedError, match="kept_out"):
        asyncio.run(mover.go(MoveCommand(RIGHT, True, 50.0, "test")))
    assert robot.sent == []


def test_a_straight_way_out_of_reach_in_between_is_told_as_that():
    found = planned(hand(250, -300, 0), hand(60, 0, 0), straight=True)
    assert isinstance(found, Refusal)
    assert found.rule == "out_of_reach"


def test_a_step_that_was_swept_and_is_out_of_reach_for_the_next_is_refused(monkeypatch):
    monkeypatch.setattr(route, "path_refusal", lambda *_: None)
    monkeypatch.setattr(route, "_steps", lambda leg, *_: [leg.world_from_tool])
    monkeypatch.setattr(ROBOT, "reachable", lambda *_: None, raising=False)
    refusal = planned(hand(560, -200, 100), hand(560, -190, 100), straight=True)
    assert isinstance(refusal, Refusal)
    assert refusal.rule == "out_of_reach"


@pytest.mark.parametrize(("top_mm", "lifted_mm"), [(-100.0, 60.0), (-40.0, 120.0), (80.0, 240.0), (240.0, 400.0)])
def test_what_is_in_the_way_is_gone_over_a_little_first_and_higher_where_it_must(top_mm, lifted_mm):
    high = replace(LIMITS, keep_out=(replace(POST, high_mm=(580.0, 30.0, top_mm)),))
    up, over, down = planned(LEFT, RIGHT, limits=high)
    assert up.world_from_tool[2, 3] == over.world_from_tool[2, 3] == pytest.approx(-180 + lifted_mm)
    assert np.array_equal(down.world_from_tool, RIGHT)


def test_the_way_over_is_measured_from_the_higher_of_start_and_target():
    lower = hand(560, 200, -230)
    for ends in ((LEFT, lower), (lower, LEFT)):
        up, over, _ = planned(*ends)
        assert up.world_from_tool[2, 3] == over.world_from_tool[2, 3] == pytest.approx(-180 + 60)


def test_where_the_arm_may_not_be_at_the_target_itself_no_way_over_is_looked_for(monkeypatch):
    asked = []
    monkeypatch.setattr(
        route, "_checked", lambda legs, *rest, checked=route._checked: asked.append(legs) or checked(legs, *rest)
    )
    refusal = planned(LEFT, hand(560, 200, -305))
    assert isinstance(refusal, Refusal)
    assert len(asked) == 1
    assert not refusal.text.endswith("a path higher up is not clear either")


def test_a_straight_way_is_parted_on_its_line():
    start, target = hand(560, -200, 100), hand(560, 200, 100)
    legs = planned(start, target, straight=True, limits=Limits(max_step_mm=150.0))
    assert len(legs) >= 3
    for leg in legs:
        assert leg.straight
        assert leg.world_from_tool[[0, 2], 3] == pytest.approx([560.0, 100.0])


@pytest.mark.parametrize("straight", [True, False])
def test_a_way_of_more_steps_than_anybody_waits_for_is_refused_as_too_long_a_step(straight):
    """A line is parted in as many as it takes."""
    found = planned(hand(560, -200, 100), hand(560, 200, 100), straight, Limits(max_step_mm=5.0))
    if straight:
        assert len(found) >= 80
    else:
        assert isinstance(found, Refusal)
        assert found.rule == "step_too_long"


def test_a_way_is_parted_in_no_more_steps_than_the_limits_ask_for():
    for limits, count in (
        (Limits(), 1),
        (Limits(max_step_mm=300.0), 2),
        (Limits(max_step_mm=200.0), 3),
        (Limits(max_step_mm=15.0), 28),
    ):
        assert len(planned(hand(560, -200, 100), hand(560, 200, 100), limits=limits)) == count
