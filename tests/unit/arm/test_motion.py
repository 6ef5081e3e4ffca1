"""The gate between a decision and the arm: asked after every wait, the place forgotten while the arm may move; how long
the answer to a move is waited for."""

import asyncio
import contextlib
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.arm.belief import BeliefSource, Reading, VoidingEvent
from daemon.arm.body import Capsule, KeepOut
from daemon.arm.guard import Limits, MoveCommand, hand_above_mm
from daemon.arm.motion import (
    Arrival,
    MovedByOthersError,
    Mover,
    MoveRefusedError,
    NotAtTargetError,
    OutOfReachError,
    Reach,
)
from daemon.arm.permission import Fault
from daemon.arm.robot import HeldBackError
from daemon.arm.route import OUT_MM
from daemon.arm.sweep import places_clear
from drivers import puma560
from drivers.simcell.arm import SingularWristError, plan_joints, plan_straight
from tests.fakes.fake_cell import ARM, HEAD_DOWN, World, build, joints, permitted

START = np.radians([10.0, -120.0, 30.0, 5.0, 60.0, 20.0])


def command(pose, straight, speed):
    return MoveCommand(pose, straight, speed, "a test")


@given(
    turns=st.lists(st.floats(-0.6, 0.6), min_size=6, max_size=6), speed=st.floats(10.0, 100.0), straight=st.booleans()
)
def test_every_move_of_the_simulated_arm_ends_before_it_is_given_up(turns, speed, straight):
    geometry = puma560.ArmGeometry()
    end = START + np.array(turns)
    start = Reading(puma560.forward(START, geometry), START)
    target = puma560.forward(end, geometry)
    try:
        way = (plan_straight if straight else plan_joints)(START, target if straight else end, speed / 100.0, geometry)
    except (puma560.UnreachableError, SingularWristError):
        return
    longest_s = Arrival().longest_s(start, command(target, straight, speed), end)
    assert way[1].duration_s < longest_s


@pytest.mark.parametrize(("above_mm", "low"), [(OUT_MM, False), (OUT_MM - 0.01, True)])
def test_the_hand_is_low_where_it_is_amid_what_may_lie_on_the_table(above_mm, low):
    mover = Mover(build(World(np.random.default_rng(0))), Limits(), Arrival())
    down = frames.rigid(HEAD_DOWN[:3, :3], np.zeros(3))
    height_mm = Limits().table_z_mm + above_mm - hand_above_mm(down, replace(Limits(), table_z_mm=0.0))
    at = frames.rigid(HEAD_DOWN[:3, :3], np.array([420.0, 0.0, height_mm + 1e-9]))
    mover.beliefs.learn(BeliefSource.REPORTED, position=Reading(at, START))
    assert mover.low is low


def test_a_dead_controller_is_told_within_seconds_even_after_the_longest_move():
    start = Reading(np.eye(4), START)
    limits = Limits()
    farthest = frames.perturb(np.eye(4), np.array([limits.max_step_mm, 0, 0, 0, 0, np.radians(limits.max_turn_deg)]))
    assert Arrival().longest_s(start, command(farthest, True, 100.0), None) < 8.0


def test_half_as_fast_is_waited_for_twice_as_long():
    start, arrival = Reading(np.eye(4), START), Arrival(slack_s=0.0)
    there = frames.perturb(np.eye(4), np.array([250.0, 0, 0, 0, 0, 0]))
    assert arrival.longest_s(start, command(there, True, 100.0), None) == pytest.approx(1.0)
    assert arrival.longest_s(start, command(there, True, 50.0), None) == pytest.approx(2.0)
    assert arrival.longest_s(start, command(there, True, 0.1), None) == arrival.timeout_s


NEAR = frames.perturb(HEAD_DOWN, np.array([30.0, 0, 0, 0, 0, 0]))


CARRIED = Capsule("a part", "tool", (0.0, 0.0, 0.0), (0.0, 0.0, 30.0), 20.0)


def mover_in(world: World, gate=None, **limits) -> Mover:
    mover = permitted(Mover(build(world), Limits(**limits), Arrival(), *([gate] if gate else [])))
    asyncio.run(mover.wait_until_at_rest())
    return mover


def disable(mover: Mover, world: World) -> None:
    mover.permission.withdraw()


def stop(mover: Mover, world: World) -> None:
    mover.permission.fault = Fault("stopped")


def lose(mover: Mover, world: World) -> None:
    mover.beliefs.learn(BeliefSource.REPORTED, position=None)


def age(mover: Mover, world: World) -> None:
    world.now_s += 60.0


@pytest.mark.parametrize(
    ("meanwhile", "rule"),
    [(disable, "not_enabled"), (stop, "fault_active"), (lose, "arm_lost"), (age, "stale_look")],
)
def test_what_came_while_a_move_was_held_back_closes_the_gate(meanwhile, rule):
    world = World(np.random.default_rng(0))

    async def held(*_) -> None:
        meanwhile(mover, world)

    mover = mover_in(world, held)
    with pytest.raises(MoveRefusedError) as refused:
        asyncio.run(mover.go(MoveCommand(NEAR, False, 50.0, "a test", look_taken_s=world.clock())))
    assert refused.value.refusal.rule == rule
    assert not world.wire
    assert [r["rule"] for r in world.said("refusal")] == [rule]
    assert not world.said("move")


def test_a_move_that_is_refused_before_is_not_held_back_first():
    world, asked = World(np.random.default_rng(0)), []

    async def gate(told: str, *_) -> None:
        asked.append(told)

    mover = mover_in(world, gate)
    mover.permission.withdraw()
    with pytest.raises(MoveRefusedError):
        asyncio.run(mover.go(command(NEAR, False, 50.0)))
    assert not asked


def test_while_the_arm_may_move_nobody_knows_where_it_is_and_after_a_failure_neither():
    world = World(np.random.default_rng(0))
    mover, known = mover_in(world), []
    world.before = lambda name: known.append((name, mover.belief.resting_reading))
    asyncio.run(mover.go(command(NEAR, False, 50.0)))
    assert known == [("move", None), ("moving", None), ("moved", None)]
    assert mover.belief.resting_reading is not None

    def fail(name: str) -> None:
        if name == "moving":
            raise OSError("no answer")

    world.before = fail
    with pytest.raises(OSError, match="no answer"):
        asyncio.run(mover.go(command(HEAD_DOWN, False, 50.0)))
    with pytest.raises(MoveRefusedError, match="arm_lost"):
        asyncio.run(mover.go(command(HEAD_DOWN, False, 50.0)))


def test_the_hands_state_is_not_known_while_it_moves_and_after_a_failure():
    world = World(np.random.default_rng(0))
    mover = mover_in(world)
    asyncio.run(mover.set_gripper(closed=False))
    assert mover.belief.closed.value is False

    def fail(name: str) -> None:
        if name == "hand":
            raise OSError("no answer")

    world.before = fail
    with pytest.raises(OSError, match="no answer"):
        asyncio.run(mover.set_gripper(closed=True))
    assert mover.belief.closed is None


def test_a_way_is_cut_into_steps_and_its_speed_to_the_limit():
    world = World(np.random.default_rng(0))
    mover = mover_in(world, max_step_mm=50.0, max_speed_pct=40.0)
    far = frames.perturb(HEAD_DOWN, np.array([120.0, 0, 0, 0, 0, 0]))
    asyncio.run(mover.travel(far, "far", lambda _: 100.0, straight=True))
    sent = world.said("move")
    assert len(sent) == 3
    assert {r["speed_pct"] for r in sent} == {40.0}
    np.testing.assert_allclose(sent[-1]["target"], far)


def test_a_limit_of_more_digits_than_a_speed_has_is_kept_and_refuses_nothing():
    """33.35 % was rounded to 33.4, and each move refused as too fast."""
    world = World(np.random.default_rng(0))
    mover = mover_in(world, max_speed_pct=33.35)
    asyncio.run(mover.travel(NEAR, "near", lambda _: 100.0))
    assert [r["speed_pct"] for r in world.said("move")] == [33.35]


@pytest.mark.parametrize("straight", [True, False])
def test_where_the_arm_has_no_way_nothing_is_sent_and_the_place_is_told(straight):
    world = World(np.random.default_rng(0))
    mover = mover_in(world)
    world.unreached = NEAR[:3, 3]
    with pytest.raises(OutOfReachError, match=f"cannot reach {NEAR[0, 3]:.0f}, "):
        asyncio.run(mover.travel(NEAR, "a test", lambda _: 50.0, straight))
    assert not world.wire
    assert not mover.reach.allows(NEAR)
    world.unreached = None
    assert mover.reach.allows(NEAR)
    assert not mover.reach.allows(frames.perturb(NEAR, np.array([0, 0, -400.0, 0, 0, 0]))), "below the table"


@pytest.mark.parametrize("turned", [False, True])
def test_who_held_a_move_back_may_have_moved_the_arm_and_then_it_is_not_sent(turned):
    """Its way was planned from where the arm stood: straight up out of what lies there first, straight down into it
    last."""
    world = World(np.random.default_rng(0))
    by = np.array([0, 0, 0, 0, 0, 0.1]) if turned else np.array([-30.0, 0, 0, 0, 0, 0])

    async def gate(_, seen, __) -> None:
        world.at = frames.perturb(HEAD_DOWN, by)
        await seen()

    mover = mover_in(world, gate)
    with pytest.raises(NotAtTargetError, match="somebody else moved the arm"):
        asyncio.run(mover.go(command(NEAR, False, 50.0)))
    assert not world.wire


@pytest.mark.parametrize("joint", [None, 3])
def test_an_arm_that_its_pendant_moved_between_two_moves_is_not_sent_on(joint):
    """The way was looked along from where the first one ended; about a straight wrist the tool stays where it was."""
    world, moved = World(np.random.default_rng(0)), []
    mover = mover_in(world)
    asyncio.run(mover.go(command(NEAR, False, 50.0)))

    def by_pendant(name: str) -> None:
        if name == "move" and not moved:
            moved.append(name)
            if joint is None:
                world.at = frames.perturb(world.at, np.array([0, 0.6, 0, 0, 0, 0]))
            else:
                robot: Any = mover.cell.robot
                there, turned = robot._joints, np.radians(0.3) * np.eye(6)[joint]
                robot._joints = lambda pose: there(pose) + turned

    world.before = by_pendant
    del world.wire[:]
    with pytest.raises(MovedByOthersError, match="somebody else moved the arm"):
        asyncio.run(mover.go(command(HEAD_DOWN, True, 50.0)))
    assert not world.wire
    assert world.said("refusal")[-1]["rule"] == "moved_by_others"
    assert [record["kind"] for record in world.records][-3:] == ["move", "refusal", "held_back"]
    assert mover.belief.resting_reading is None


@pytest.mark.parametrize("why", ["dry", "unknown"])
def test_whether_the_arm_is_still_there_is_asked_only_of_one_that_came_to_rest_and_is_no_dry_run(why):
    world = World(np.random.default_rng(0))
    mover = mover_in(world)
    if why == "dry":
        asyncio.run(mover.wait_until_at_rest())
        mover.dry = True
    else:
        mover.beliefs.void(VoidingEvent.STOPPED)

    async def nobody_asks():
        raise AssertionError("nothing is believed of where it is")

    mover.cell.robot.where = nobody_asks
    asyncio.run(mover.still_there("a look"))


def test_an_arm_that_crept_as_it_settled_is_sent_on():
    world = World(np.random.default_rng(0))
    mover = mover_in(world)
    asyncio.run(mover.go(command(NEAR, False, 50.0)))
    world.at = frames.perturb(NEAR, np.array([0, 0.4, 0, 0, 0, 0]))
    asyncio.run(mover.go(command(HEAD_DOWN, True, 50.0)))
    assert [name for name, _ in world.wire] == ["move", "move"]


def test_dry_a_move_leaves_from_where_the_one_before_would_have_ended_and_no_arm_is_asked():
    world, asked = World(np.random.default_rng(0)), []

    async def gate(_, seen, __) -> None:
        await seen()

    mover = mover_in(world, gate, max_step_mm=40.0)
    world.before = asked.append
    mover.dry = True
    farther = frames.perturb(NEAR, np.array([30.0, 0, 0, 0, 0, 0]))
    for pose in (NEAR, farther):
        asyncio.run(mover.go(command(pose, False, 50.0)))
    np.testing.assert_allclose(mover.next_start.world_from_tool, farther)
    there = mover.cell.robot.kinematics.reachable(farther, mover.belief.resting_reading.joints_rad)
    np.testing.assert_allclose(mover.next_start.joints_rad, there)
    assert np.abs(there - mover.belief.resting_reading.joints_rad).max() > 0.01, "or it shows nothing"
    asyncio.run(mover.set_gripper(closed=True))
    assert not asked
    assert not world.wire
    assert [record["sent"] for kind in ("move", "hand") for record in world.said(kind)] == [False] * 3


@pytest.mark.parametrize("straight", [False, True])
def test_an_arm_that_gets_there_turned_over_has_not_gone_the_way_that_was_looked_along(straight):
    """A person's FLIP at the controller counts for the next motion: of 400 low ways that were clear, 20 would have
    struck the table so. It was told to be there."""
    world = World(np.random.default_rng(0))
    mover = mover_in(world)
    honest = mover.cell.robot.move

    async def flipped(told, starts, timeout_s, then=None):
        reading = await honest(told, starts, timeout_s, then)
        over = puma560.inverse(told.world_from_tool, puma560.Configuration(flip=True), ARM, reading.joints_rad)
        return Reading(reading.world_from_tool, over)

    asyncio.run(mover.go(command(NEAR, False, 50.0)))
    mover.cell.robot.move = flipped
    asyncio.run(mover.wait_until_at_rest())
    with pytest.raises(NotAtTargetError, match="FLIP, LEFTY or BELOW"):
        asyncio.run(mover.go(command(NEAR, straight, 50.0)))


@pytest.mark.parametrize(
    "void",
    [
        None,
        VoidingEvent.STOPPED,
        VoidingEvent.FAULT_CLEARED,
        VoidingEvent.OTHERS_TYPED,
        VoidingEvent.TURN_TYPED,
    ],
)
def test_an_arm_that_a_pendant_turned_over_is_sent_on_by_no_move_of_its_joints(void):
    """The controller turned the wrist back, and the camera bar went through a post. A word that an operator types to
    the controller may have turned it as well: then nobody knows. Whatever somebody else types, the pendant did it."""
    world = World(np.random.default_rng(0))
    mover = mover_in(world)
    asyncio.run(mover.go(command(NEAR, False, 50.0)))
    over = puma560.inverse(NEAR, puma560.Configuration(flip=True), ARM, mover.belief.resting_reading.joints_rad)
    robot: Any = mover.cell.robot
    honest, joints = robot._joints, {"over": True}
    robot._joints = lambda pose: over if joints["over"] else honest(pose)
    if void is not None:
        mover.beliefs.void(void)
    asyncio.run(mover.wait_until_at_rest())
    mover.check(command(HEAD_DOWN, True, 50.0))
    if void is VoidingEvent.TURN_TYPED:
        mover.check(command(NEAR, False, 50.0))
    else:
        with pytest.raises(MoveRefusedError, match="turned_over"):
            mover.check(command(NEAR, False, 50.0))
    joints["over"] = False
    asyncio.run(mover.wait_until_at_rest())
    mover.check(command(NEAR, False, 50.0))


def test_a_place_that_the_arm_reaches_in_one_configuration_only_is_refused_once_it_was_turned_over(monkeypatch):
    mover = mover_in(World(np.random.default_rng(0)))
    asyncio.run(mover.go(command(NEAR, False, 50.0)))
    over = puma560.inverse(NEAR, puma560.Configuration(flip=True), ARM, mover.belief.resting_reading.joints_rad)
    monkeypatch.setattr(mover.cell.robot, "_joints", lambda _: over)
    asyncio.run(mover.wait_until_at_rest())
    kinematics, honest = mover.cell.robot.kinematics, mover.cell.robot.kinematics.reachable

    def only_flipped(world_from_tool, joints_rad):
        return honest(world_from_tool, joints_rad) if puma560.configuration_of(joints_rad).flip else None

    monkeypatch.setattr(kinematics, "reachable", only_flipped)
    with pytest.raises(MoveRefusedError, match="turned_over"):
        mover.check(command(NEAR, False, 50.0))


@pytest.mark.parametrize("straight", [False, True])
def test_on_a_line_alone_a_joint_may_have_gone_once_round(straight):
    world = World(np.random.default_rng(0))
    mover = mover_in(world)
    asyncio.run(mover.go(command(NEAR, straight, 50.0)))
    honest = mover.cell.robot.move

    async def once_round(told, starts, timeout_s, then=None):
        reading = await honest(told, starts, timeout_s, then)
        return Reading(reading.world_from_tool, reading.joints_rad + np.eye(6)[5] * 2 * np.pi)

    mover.cell.robot.move = once_round
    with contextlib.nullcontext() if straight else pytest.raises(NotAtTargetError, match="360 degrees"):
        asyncio.run(mover.go(command(NEAR, straight, 50.0)))


@pytest.mark.parametrize(("closed", "told"), [(True, [True]), (False, [])])
def test_a_hand_is_told_closed_before_it_closes_and_open_once_it_has_opened(closed, told):
    """A start after a crash believes what was told: one that was to be opened, and was not, let the part fall."""
    world = World(np.random.default_rng(0))
    mover = mover_in(world)

    def fail(name):
        if name == "hand":
            raise OSError("the cable came out")

    world.before = fail
    with pytest.raises(OSError, match="cable"):
        asyncio.run(mover.set_gripper(closed))
    assert [record["closed"] for record in world.said("hand")] == told
    world.before = lambda name: None
    asyncio.run(mover.set_gripper(closed))
    assert [record["closed"] for record in world.said("hand")] == [*told, closed]


def test_what_is_carried_is_guarded_until_the_hand_was_opened():
    world = World(np.random.default_rng(0))
    mover = mover_in(world)
    asyncio.run(mover.set_gripper(closed=True))
    assert [record["sent"] for record in world.said("hand")] == [True]
    mover.beliefs.learn(BeliefSource.COMMANDED, held_shape=(CARRIED,))
    asyncio.run(mover.go(MoveCommand(NEAR, False, 50.0, "a test", look_taken_s=world.clock())))
    assert CARRIED in mover.bounds.capsules
    asyncio.run(mover.set_gripper(closed=False))
    assert CARRIED not in mover.bounds.capsules


@pytest.mark.parametrize("off", [[0.6, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, np.radians(0.2)]])
def test_an_arm_at_rest_elsewhere_than_it_was_sent_is_told_with_how_far(off):
    world = World(np.random.default_rng(0))
    mover = mover_in(world)
    move = mover.cell.robot.move

    async def missing(told, starts, timeout_s, then=None):
        beside = frames.perturb(told.world_from_tool, np.array(off, float))
        return await move(replace(told, world_from_tool=beside), starts, timeout_s, then)

    mover.cell.robot.move = missing
    with pytest.raises(NotAtTargetError, match="the arm did not arrive: WHERE is"):
        asyncio.run(mover.go(command(NEAR, False, 50.0)))
    assert len(world.said("moved")) == 1


@pytest.mark.parametrize(("meanwhile", "rule"), [(disable, "not_enabled"), (stop, "fault_active")])
def test_the_hand_is_not_driven_while_nothing_may_move(meanwhile, rule):
    world = World(np.random.default_rng(0))
    mover = mover_in(world)
    meanwhile(mover, world)
    with pytest.raises(
        MoveRefusedError, match="the arm is not enabled" if rule == "not_enabled" else "stopped"
    ) as told:
        asyncio.run(mover.set_gripper(closed=True))
    assert told.value.refusal.rule == rule
    assert not world.wire


@pytest.mark.parametrize(("meanwhile", "rule"), [(disable, "not_enabled"), (stop, "fault_active")])
def test_what_came_while_the_hand_was_held_back_keeps_it_as_it_is(meanwhile, rule):
    world = World(np.random.default_rng(0))

    async def held(told: str, *_) -> None:
        assert told == "open the gripper"
        meanwhile(mover, world)

    mover = mover_in(world, held)
    with pytest.raises(MoveRefusedError) as refused:
        asyncio.run(mover.set_gripper(closed=False))
    assert refused.value.refusal.rule == rule
    assert not world.wire


@pytest.mark.parametrize("off_mm", [0.0, 5.0])
def test_a_hand_that_was_held_back_is_worked_only_where_it_was_to_be(off_mm):
    """Over the bin, for one: whoever had time may have moved the arm by its pendant."""
    world = World(np.random.default_rng(0))

    async def held(_, seen, __) -> None:
        world.at[0, 3] += off_mm
        await seen()

    mover = mover_in(world, held)
    asyncio.run(mover.wait_until_at_rest())
    if off_mm:
        with pytest.raises(NotAtTargetError, match="somebody else moved the arm"):
            asyncio.run(mover.set_gripper(closed=False))
    else:
        asyncio.run(mover.set_gripper(closed=False))
    assert world.wire == ([] if off_mm else [("hand", False)])


@pytest.mark.parametrize("what", ["move", "hand"])
def test_what_is_held_back_as_it_is_typed_is_told_to_be_before_it_is_told_again(what):
    """Two moves stood in the log, and one arrival: nobody could tell whether the first had left."""
    method = {"move": "move", "hand": "set_gripper"}[what]
    world, times = World(np.random.default_rng(0)), []
    mover = mover_in(world)
    asyncio.run(mover.wait_until_at_rest())
    sent = getattr(mover.cell.robot, method)

    async def once_held_back(*args, **kwargs):
        times.append(what)
        if len(times) == 1:
            raise HeldBackError("somebody said pause")
        return await sent(*args, **kwargs)

    setattr(mover.cell.robot, method, once_held_back)
    asyncio.run(mover.go(command(NEAR, True, 20.0)) if what == "move" else mover.set_gripper(closed=True))
    told = [(kind, fields.get("what")) for fields in world.records for kind in [fields["kind"]]]
    assert told == [(what, None), ("held_back", what), (what, None), *([("moved", None)] * (what == "move"))]


def test_an_arm_that_is_exactly_where_it_was_sent_is_there_however_little_it_may_be_off():
    world = World(np.random.default_rng(0))
    mover = permitted(Mover(build(world), Limits(), Arrival(within_mm=0.0, within_deg=0.0)))

    here = asyncio.run(mover.wait_until_at_rest())

    async def exactly(told, starts, timeout_s, then=None):
        return Reading(told.world_from_tool, here.joints_rad)

    mover.cell.robot.move = exactly
    asyncio.run(mover.go(command(HEAD_DOWN, True, 20.0)))
    assert world.said("moved")[0]["error_mm"] == 0.0


def test_a_move_before_the_first_pick_is_of_no_pick():
    world = World(np.random.default_rng(0))
    asyncio.run(mover_in(world).travel(NEAR, "by hand", lambda _: 20.0))
    assert {record["cycle"] for record in world.said("move") + world.said("moved")} == {0}


def test_a_speed_is_told_to_a_tenth_of_a_percent():
    world = World(np.random.default_rng(0))
    asyncio.run(mover_in(world).travel(NEAR, "by hand", lambda _: 33.333))
    assert [record["speed_pct"] for record in world.said("move")] == [33.3]


def test_a_way_usually_takes_half_of_what_it_is_waited_for_and_more_at_less_speed():
    """By its length, its turn, and how far its joints go, as one after the other."""
    start, arrival = Reading(np.eye(4), np.zeros(6)), Arrival()
    there = frames.perturb(np.eye(4), np.array([0.0, 300.0, 400.0, 0, 0, np.radians(25.0)]))
    assert arrival.usual_s(start, there, None, 100.0) == pytest.approx((2.0 + 0.5) / 2)
    assert arrival.usual_s(start, there, None, 20.0) == pytest.approx(5 * (2.0 + 0.5) / 2)
    joints = np.radians([0.0, -100.0, 0.0, 0.0, 0.0, 50.0])
    assert arrival.usual_s(start, there, joints, 100.0) == pytest.approx((2.0 + 2.0) / 2)


def test_an_arm_that_does_not_come_to_rest_is_nowhere_known():
    world = World(np.random.default_rng(0))
    mover = mover_in(world)
    assert asyncio.run(mover.wait_until_at_rest()) is mover.belief.resting_reading

    async def moves_on():
        raise OSError("not at rest")

    mover.cell.robot.wait_until_at_rest = moves_on
    with pytest.raises(OSError, match="not at rest"):
        asyncio.run(mover.wait_until_at_rest())
    assert mover.next_start is None


def test_a_move_gives_where_the_arm_is_then():
    mover = mover_in(World(np.random.default_rng(0)))
    assert asyncio.run(mover.go(command(NEAR, False, 50.0))) is mover.belief.resting_reading


def test_who_must_come_out_again_asks_for_the_whole_way_before_he_goes_in():
    world = World(np.random.default_rng(0))
    mover = mover_in(world)
    deep, out = (frames.perturb(NEAR, np.array([0, 0, by_mm, 0, 0, 0.0])) for by_mm in (-30.0, 60.0))
    mover.check_through([NEAR, deep, out])
    world.unreached = out[:3, 3]
    mover.check_through([NEAR, deep])
    with pytest.raises(OutOfReachError, match="cannot reach"):
        mover.check_through([NEAR, deep, out])
    assert not world.wire


def test_a_way_through_several_places_is_checked_from_each_to_the_next():
    """Over a post and down behind it: straight from here the last place lies behind the post."""
    x, y, z = HEAD_DOWN[:3, 3]
    post = KeepOut("post", (x - 20.0, y + 130.0, -300.0), (x + 20.0, y + 170.0, z + 20.0))
    mover = mover_in(World(np.random.default_rng(0)), keep_out=(post,))
    up, over, down = (
        frames.rigid(HEAD_DOWN[:3, :3], np.array([x, y + by, z + up])) for by, up in ((0, 250), (300, 250), (300, 0))
    )
    mover.check_through([up, over, down])
    with pytest.raises(MoveRefusedError, match="post"):
        mover.check_through([down])


def test_how_long_a_way_takes_from_here_is_told_at_no_more_than_the_greatest_speed():
    mover = mover_in(World(np.random.default_rng(0)), max_speed_pct=40.0)
    joints = mover.cell.robot.kinematics.reachable(NEAR, mover.next_start.joints_rad)
    for asked_pct, pct in ((20.0, 20.0), (90.0, 40.0)):
        assert mover.reach.takes_s(NEAR, asked_pct) == mover.arrival.usual_s(mover.next_start, NEAR, joints, pct) > 0.0


@pytest.mark.parametrize("wrist_deg", [0.0, 200.0, -250.0])
def test_where_the_arm_can_be_is_judged_for_many_poses_as_for_each_alone(wrist_deg):
    rng, robot = np.random.default_rng(5), build(World(np.random.default_rng(0))).robot.kinematics
    here = Reading(HEAD_DOWN, joints(HEAD_DOWN) + np.radians([0.0, 0.0, 0.0, wrist_deg, 0.0, -wrist_deg]))
    reach = Reach(robot, here, Limits(), Arrival())
    turns = [frames.rotation_from_vector(rng.normal(0.0, 1.2, 3)) @ HEAD_DOWN[:3, :3] for _ in range(400)]
    places = rng.uniform([150.0, -500.0, -320.0], [900.0, 500.0, 300.0], (400, 3))
    poses = frames.rigid(np.array(turns), places)
    there = [robot.reachable(pose, here.joints_rad) for pose in poses]
    alone = [each is not None and bool(places_clear(each[None], robot, Limits())[0]) for each in there]
    assert reach.allows_each(poses).tolist() == alone
    assert reach.allows_each(poses[:0]).tolist() == []
    assert 20 < sum(alone) < sum(each is not None for each in there) < 400


def test_from_an_unknown_place_no_way_is_planned_and_nothing_sent():
    world = World(np.random.default_rng(0))
    mover = mover_in(world)
    mover.beliefs.void(VoidingEvent.STOPPED)
    with pytest.raises(MoveRefusedError, match="arm_lost"):
        asyncio.run(mover.travel(NEAR, "a test", lambda _: 50.0))
    assert not world.wire


def test_a_held_move_says_how_far_it_goes_from_here_and_how_long_its_look_is_valid():
    told, world = [], World(np.random.default_rng(0))

    async def gate(text: str, _, valid_s: float) -> None:
        told.append((text, round(valid_s)))

    mover = mover_in(world, gate)
    asyncio.run(mover.go(MoveCommand(NEAR, False, 50.0, "near", look_taken_s=world.clock() - 5.0)))
    assert told == [("near: joint move to x 450 y 0 z 60 mm at 50 %, from here x +30 y +0 z +0 mm and 0 degrees", 15)]


def test_each_move_of_a_way_announces_the_next_and_the_last_announces_none(monkeypatch):
    """So that the reading which ends one may begin the next."""
    world = World(np.random.default_rng(0))
    mover = mover_in(world, max_step_mm=20.0)
    told, move = [], mover.cell.robot.move

    async def listening(going, starts, timeout_s, then=None):
        told.append((going.world_from_tool, then))
        return await move(going, starts, timeout_s)

    monkeypatch.setattr(mover.cell.robot, "move", listening)
    asyncio.run(mover.travel(NEAR, "a test", lambda pose: 20.0 + pose[0, 3] / 100.0, straight=True))
    assert len(told) > 1
    for (_, then), (pose, _) in pairwise(told):
        np.testing.assert_array_equal(then.world_from_tool, pose)
        assert (then.straight, then.speed_pct) == (True, round(20.0 + pose[0, 3] / 100.0, 1))
    assert told[-1][1] is None
