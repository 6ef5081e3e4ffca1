"""The guard: each rule refuses on its own, and no byte leaves while one is broken."""

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from daemon import frames
from daemon.arm import guard, motion, plausible, sweep
from daemon.arm.belief import BeliefSource
from daemon.arm.body import LINK_FRAME, CarriedCapsule, KeepOut, above_mm, body_of
from daemon.arm.guard import ArmState, Limits, MoveCommand, refuse
from daemon.arm.motion import Arrival, Mover, MoveRefusedError
from daemon.arm.permission import Fault, Grant, Refusal
from daemon.config import load_config
from daemon.pick.grippers.two_fingers import tool_rotation
from drivers import puma560
from drivers.pumas import PUBLISHED
from drivers.simcell.truth import load_truth
from tests.fakes.fake_cell import ARM, HEAD_DOWN, World, build, permitted

POST = KeepOut("post", (560.0, 120.0, -300.0), (620.0, 180.0, 300.0))
LIMITS = Limits(keep_out=(POST,), room_low_mm=(-2000.0, -400.0, -2000.0))
AT = HEAD_DOWN
DOWN = np.diag([1.0, -1.0, -1.0])
STANDING = ArmState(not_permitted=None, at=AT, now_s=100.0)


def moved(x=0.0, y=0.0, z=0.0, turn=0.0):
    return frames.perturb(AT, np.array([x, y, z, 0.0, 0.0, turn]))


def command(pose=None, speed=50.0, look=99.0):
    return MoveCommand(moved(10.0) if pose is None else pose, True, speed, "test", look)


def met(rule):
    return ArmState(None, AT, 100.0, (Refusal(rule, "on the way"),))


BROKEN = [
    ("fault_active", command(), ArmState(Refusal("fault_active", "stopped"), AT, 100.0)),
    ("not_enabled", command(), ArmState(Refusal("not_enabled", "disabled"), AT, 100.0)),
    ("not_a_location", command(np.full((4, 4), np.nan)), STANDING),
    ("not_a_location", command(np.diag([1.0, 1.0, -1.0, 1.0])), STANDING),
    ("not_a_location", command(np.eye(3)), STANDING),
    ("not_a_location", command(frames.rigid(1.00001 * AT[:3, :3], AT[:3, 3])), STANDING),
    ("arm_lost", command(), ArmState(None, None, 100.0)),
    ("outside_workspace", command(moved(x=600.0)), STANDING),
    ("outside_workspace", command(moved(z=-400.0)), STANDING),
    ("below_table", command(moved(z=-352.0)), STANDING),
    ("outside_workspace", command(), met("outside_workspace")),
    ("below_table", command(), met("below_table")),
    ("outside_room", command(), met("outside_room")),
    ("kept_out", command(), met("kept_out")),
    ("no_way", command(), met("no_way")),
    ("step_too_long", command(moved(x=380.0, y=380.0)), STANDING),
    ("turn_too_far", command(moved(turn=2.0)), STANDING),
    ("too_fast", command(speed=100.1), STANDING),
    ("too_fast", command(speed=0.0), STANDING),
    ("stale_look", command(look=79.0), STANDING),
    ("stale_look", command(look=100.5), STANDING),
]


@pytest.mark.parametrize(("rule", "bad", "standing"), BROKEN)
def test_each_rule_refuses_by_its_name(rule, bad, standing):
    refusal = refuse(bad, standing, LIMITS)
    assert refusal is not None
    assert refusal.rule == rule
    assert refusal.text


def test_every_rule_of_the_table_is_shown_refusing():
    assert {name for name, *_ in BROKEN} == {name for name, _ in guard.RULES}


def test_a_reason_that_no_rule_is_named_for_refuses_as_well():
    unheard_of = Refusal("unheard_of", "a rule of a later release")
    assert refuse(command(), replace(STANDING, not_permitted=unheard_of), LIMITS) == unheard_of
    assert refuse(command(), replace(STANDING, violations=(unheard_of,)), LIMITS) == unheard_of


def test_without_permission_nothing_else_is_named():
    withheld = Refusal("not_enabled", "disabled")
    assert refuse(command(speed=0.0), ArmState(withheld, None, 100.0), LIMITS) == withheld


def test_a_sound_command_goes():
    assert refuse(command(), STANDING, LIMITS) is None
    assert refuse(command(look=None), STANDING, LIMITS) is None
    assert refuse(command(look=STANDING.now_s), STANDING, LIMITS) is None
    assert refuse(command(look=STANDING.now_s - LIMITS.max_look_age_s), STANDING, LIMITS) is None


def test_the_cameras_may_not_dip_into_the_table_even_when_the_fingers_are_clear():
    tilted = frames.rigid(tool_rotation(np.array([1.0, 0, 0]), np.radians(-75.0)), np.array([420.0, 0.0, -270.0]))
    standing = ArmState(None, tilted, 100.0)
    refusal = refuse(MoveCommand(tilted, True, 10.0, "test"), standing, LIMITS)
    assert refusal is not None
    assert refusal.rule == "below_table"


class GuardedMotion(RuleBasedStateMachine):
    """Random operators, looks, clocks, faults and commands against a Mover. An oracle of its own judges each byte."""

    @initialize()
    def build(self):
        self.loop = asyncio.new_event_loop()
        self.world = World(np.random.default_rng(1))
        self.mover = permitted(Mover(build(self.world), LIMITS, Arrival()))
        self.look_s = 0.0
        self.judged = 0
        self.wrong: list[str] = []
        self.loop.run_until_complete(self.mover.wait_until_at_rest())

    @rule(on=st.sampled_from([True, True, True, False]))
    def enable(self, on):
        self.mover.permission.grant(Grant.ALL if on else Grant.NOTHING)

    @rule(fault=st.sampled_from([None, None, None, Fault("stopped")]))
    def fault(self, fault):
        self.mover.permission.fault = fault

    @rule()
    def look(self):
        self.look_s = self.world.clock()

    @rule(seconds=st.sampled_from([0.1, 15.0, 21.0, 21.0]))
    def wait(self, seconds):
        self.world.now_s += seconds

    @rule()
    def lose_the_arm(self):
        self.mover.beliefs.learn(BeliefSource.REPORTED, position=None)

    @rule()
    def ask_where(self):
        self.loop.run_until_complete(self.mover.wait_until_at_rest())

    @rule(
        xyz=st.tuples(st.floats(-300, 1200), st.floats(-900, 900), st.floats(-420, 1400)),
        tilt=st.floats(-3.2, 3.2),
        heading=st.floats(-3.2, 3.2),
        speed=st.sampled_from([10.0, 100.0, 0.0, -5.0, 101.0, 50.0, 50.0]),
        from_look=st.booleans(),
        near=st.booleans(),
        bent=st.sampled_from([False, False, False, True]),
    )
    def go(self, xyz, tilt, heading, speed, from_look, near, bent):
        pose = frames.rigid(tool_rotation(np.array([np.cos(heading), np.sin(heading), 0.0]), tilt), np.array(xyz))
        if near and self.mover.belief.resting_reading is not None:
            pose = frames.perturb(
                self.mover.belief.resting_reading.world_from_tool,
                np.array([*(v / 3 for v in xyz), 0.0, 0.0, tilt / 10]),
            )
        if bent:
            pose = pose.copy()
            pose[0, 0] += 0.01
        self.go_to(pose, speed, from_look)

    def go_to(self, pose, speed, from_look):
        before = self.mover.belief.resting_reading
        told = MoveCommand(pose, True, speed, "random", self.look_s if from_look else None)
        state = (self.mover.permission.enabled, self.mover.permission.blocked, self.world.now_s)
        try:
            self.loop.run_until_complete(self.mover.go(told))
        except MoveRefusedError:
            return
        self.wrong += oracle(told, before, state)
        self.wrong += [] if before is None else oracle_of_the_way(told, before)

    @rule(height=st.floats(0.5, 40.0))
    def dip(self, height):
        if self.mover.belief.resting_reading is not None:
            pose = self.mover.belief.resting_reading.world_from_tool.copy()
            pose[2, 3] = -300.0 + height
            self.go_to(pose, 50.0, False)

    @rule(beyond=st.floats(0.5, 40.0))
    def stray(self, beyond):
        """Out of the box by its side, as far as a step goes."""
        if self.mover.belief.resting_reading is not None:
            pose = self.mover.belief.resting_reading.world_from_tool.copy()
            pose[1, 3] = min(pose[1, 3] + 440.0, 650.0 + beyond)
            self.go_to(pose, 50.0, False)

    @rule(xyz=st.tuples(*[st.floats(-250, 250)] * 3), turn=st.floats(-2.5, 2.5), from_look=st.booleans())
    def go_on(self, xyz, turn, from_look):
        if self.mover.belief.resting_reading is not None:
            self.go_to(
                frames.perturb(self.mover.belief.resting_reading.world_from_tool, np.array([*xyz, 0.0, 0.0, turn])),
                50.0,
                from_look,
            )

    @rule(
        mm=st.floats(-20.0, 20.0),
        turn=st.sampled_from([0.0, 0.5, 1.85, -1.85]),
        speed=st.sampled_from([50.0, 50.0, 0.0, 101.0]),
        from_look=st.booleans(),
        waited_s=st.sampled_from([0.0, 0.0, 25.0]),
    )
    def stir(self, mm, turn, speed, from_look, waited_s):
        """Hardly from its place, so that nothing but the one rule that is broken is in its way."""
        self.world.now_s += waited_s
        if self.mover.belief.resting_reading is not None:
            here = self.mover.belief.resting_reading.world_from_tool
            self.go_to(frames.perturb(here, np.array([mm, 0.0, 0.0, 0.0, 0.0, turn])), speed, from_look)

    @rule(mm=st.sampled_from([-480.0, -440.0, 440.0, 480.0]))
    def go_aside(self, mm):
        if self.mover.belief.resting_reading is not None:
            pose = self.mover.belief.resting_reading.world_from_tool.copy()
            pose[1, 3] += mm
            self.go_to(pose, 50.0, False)

    @rule(closed=st.booleans())
    def hand(self, closed):
        may = self.mover.permission.enabled and not self.mover.permission.blocked
        sent = len(self.world.wire)
        try:
            self.loop.run_until_complete(self.mover.set_gripper(closed))
        except MoveRefusedError:
            assert not may
        if not may and len(self.world.wire) != sent:
            self.wrong.append("the hand moved")

    def teardown(self):
        self.loop.close()

    @invariant()
    def nothing_left_while_a_rule_was_broken(self):
        assert not getattr(self, "wrong", [])


def oracle(told, before, state):
    """What was wrong with letting this command go; written without the guard's own code."""
    enabled, blocked, now_s = state
    wrong = []
    if not enabled or blocked:
        wrong.append("moved while disabled or in fault")
    if before is None:
        return [*wrong, "moved from an unknown place"]
    rotation, (x, y, z) = told.world_from_tool[:3, :3], told.world_from_tool[:3, 3]
    if np.abs(rotation.T @ rotation - np.eye(3)).max() > 1e-5:
        wrong.append("a bent orientation")
    if not (0 <= x <= 900 and -650 <= y <= 650 and -300 <= z <= 1100):
        wrong.append("outside the box")
    lowest = min((rotation @ np.array(p))[2] + z for p in LIMITS.body_mm)
    if lowest < -298.01:
        wrong.append("into the table")
    if (
        np.hypot(
            np.hypot(x - before.world_from_tool[0, 3], y - before.world_from_tool[1, 3]),
            z - before.world_from_tool[2, 3],
        )
        > 450.01
    ):
        wrong.append("too long a step")
    cosine = (np.trace(before.world_from_tool[:3, :3].T @ rotation) - 1) / 2
    if cosine < np.cos(np.radians(100.01)):
        wrong.append("too far a turn")
    if not 0 < told.speed_pct <= 100:
        wrong.append("too fast")
    if told.look_taken_s is not None and now_s - told.look_taken_s > 20.01:
        wrong.append("an old look")
    return wrong


def oracle_of_the_way(told, before):
    """What was wrong with the way of a straight command, looked along in 30 places with the arm's scalar kinematics."""
    motion = frames.difference(told.world_from_tool, before.world_from_tool)
    configuration = puma560.configuration_of(before.joints_rad)
    gaps = {"into the post": [], "out of the room": []}
    for share in np.linspace(0, 1, 31):
        pose = frames.perturb(before.world_from_tool, share * motion)
        try:
            joints = puma560.inverse(pose, configuration, ARM, before.joints_rad)
        except puma560.UnreachableError:
            return ["to where the arm cannot follow"]
        links = puma560.link_frames(joints[None], ARM)[0]
        gaps["into the post"].append(min(far_from_post(links)))
        gaps["out of the room"].append(min(y - LIMITS.room_low_mm[1] for y in lowest_y(links)))
    return [what for what, some in gaps.items() if min(some) < min(0.0, some[0]) - 1.0]


def lowest_y(links):
    for capsule in LIMITS.capsules:
        ends = frames.apply(links[LINK_FRAME[capsule.link]], np.array([capsule.from_mm, capsule.to_mm]))
        yield float(ends[:, 1].min()) - capsule.radius_mm


def far_from_post(links):
    for capsule in LIMITS.capsules:
        axis = np.linspace(capsule.from_mm, capsule.to_mm, 15)
        points = frames.apply(links[LINK_FRAME[capsule.link]], axis)
        beyond = np.maximum(np.array(POST.low_mm) - points, points - np.array(POST.high_mm))
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)
        yield float(outside.min()) - capsule.radius_mm


STATEFUL = settings(max_examples=40, stateful_step_count=30, deadline=None, suppress_health_check=list(HealthCheck))
SEARCHING = settings(STATEFUL, max_examples=400, phases=[Phase.generate], derandomize=True)


def test_no_byte_that_moves_the_arm_leaves_while_a_rule_is_broken():
    run_state_machine_as_test(GuardedMotion, settings=STATEFUL)


@pytest.mark.long
@pytest.mark.parametrize("left_out", [name for name, _ in guard.RULES if name != "not_a_location"])
def test_the_property_notices_when_a_rule_is_taken_away(left_out, monkeypatch):
    monkeypatch.setattr(sweep, "refuse", _all_but(left_out))
    monkeypatch.setattr(guard, "RULES", tuple(each for each in guard.RULES if each[0] != left_out))
    if left_out == "arm_lost":
        monkeypatch.setattr(motion.Mover, "go", _go_without_place)
    with pytest.raises((AssertionError, BaseExceptionGroup)):
        run_state_machine_as_test(GuardedMotion, settings=SEARCHING)


def _all_but(left_out):
    """The guard without a rule, whoever checks it."""

    def refuse_by_others(told, state, limits):
        permitted = state.not_permitted is None or state.not_permitted.rule == left_out
        others = tuple(broken for broken in state.violations if broken.rule != left_out)
        return refuse(
            told, replace(state, not_permitted=None if permitted else state.not_permitted, violations=others), limits
        )

    return refuse_by_others


async def _go_without_place(self, told):
    await self.cell.robot.move(told, print, timeout_s=1.0)


@pytest.mark.parametrize("point", [(x, y, 10.0) for x in (-7.5, 7.5) for y in (-45.0, 45.0)])
def test_each_corner_of_a_finger_tip_is_guarded(point):
    """The corners of the camera bar lie within its capsule, those of the tips do not."""
    down = np.array([0.6 * np.sign(point[0]), 0.05 * np.sign(point[1]), 0.8])
    down /= np.linalg.norm(down)
    beside = np.cross(down, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(down, [0.0, 0.0, 1.0]))
    rotation = np.array([beside, np.cross(beside, down), -down])
    pose = frames.rigid(rotation, np.array([420.0, 0.0, LIMITS.table_z_mm + down @ point + 1.0]))
    told, standing = MoveCommand(pose, True, 10.0, "tip down"), ArmState(None, pose, 100.0)
    refusal = refuse(told, standing, LIMITS)
    assert refusal is not None
    assert refusal.rule == "below_table"
    fewer = replace(LIMITS, body_mm=tuple(other for other in LIMITS.body_mm if other != point))
    assert refuse(told, standing, fewer) is None, "nothing else is that low"


def test_a_step_or_a_turn_of_just_what_is_allowed_goes_and_a_hair_more_does_not():
    target = moved(x=10.0, turn=0.2)
    step = float(np.linalg.norm(target[:3, 3] - AT[:3, 3]))
    turn = float(np.degrees(frames.angle_between(AT, target)))
    limits = replace(LIMITS, max_step_mm=step, max_turn_deg=turn)
    assert refuse(command(target), STANDING, limits) is None
    for broken, less in (("step_too_long", "max_step_mm"), ("turn_too_far", "max_turn_deg")):
        refusal = refuse(command(target), STANDING, replace(limits, **{less: np.nextafter(getattr(limits, less), 0.0)}))
        assert refusal is not None
        assert refusal.rule == broken


def rule_of(told, limits=LIMITS):
    refusal = refuse(told, STANDING, limits)
    return None if refusal is None else refusal.rule


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_on_the_sides_of_the_workspace_the_tool_may_be_and_a_hair_beyond_not(axis):
    point = AT[:3, 3]
    for side, beyond in (("box_low_mm", np.inf), ("box_high_mm", -np.inf)):
        sides = point.copy()
        within: Any = {side: tuple(sides)}
        limits = replace(LIMITS, **within)
        assert rule_of(command(AT), limits) is None
        sides[axis] = np.nextafter(sides[axis], beyond)
        assert rule_of(command(AT), replace(limits, **within | {side: tuple(sides)})) == "outside_workspace"


def test_just_the_clearance_above_the_table_is_enough_and_a_hair_less_is_not():
    body = body_of(tuple(c for c in LIMITS.capsules if c.link == "tool"), LIMITS.body_mm)
    lowest = float(above_mm(frames.apply(AT, body.ends_mm), body.radius_mm, LIMITS.table_z_mm).min())
    assert rule_of(command(AT), replace(LIMITS, clearance_mm=lowest)) is None
    assert rule_of(command(AT), replace(LIMITS, clearance_mm=np.nextafter(lowest, np.inf))) == "below_table"


def test_a_part_may_come_down_to_just_its_support_and_below_it_the_support_is_named_and_not_the_table():
    support_mm = LIMITS.table_z_mm + 1.0
    for off_mm, told in ((0.0, None), (-0.5, "the cube would be 0.5 mm below the surface that it is to rest on")):
        tip = CarriedCapsule("cube", "tool", (0.0, 0.0, 30.0), (0.0, 0.0, 30.0), 0.0, level_mm=support_mm)
        bare = replace(LIMITS, capsules=(tip,), body_mm=())
        pose = frames.rigid(DOWN, np.array([*AT[:2, 3], support_mm + 30.0 + off_mm]))
        assert guard.below_table(command(pose), STANDING, bare) == told
    bare = replace(LIMITS, capsules=(), body_mm=(), clearance_mm=0.5)
    for z_mm, told in (
        (0.5, None),
        (0.25, "the tool would come to 0.2 mm above the table; at least 0.5 mm are needed"),
    ):
        pose = frames.rigid(DOWN, np.array([*AT[:2, 3], LIMITS.table_z_mm + z_mm]))
        assert guard.below_table(command(pose), STANDING, bare) == told


def test_who_configures_no_room_has_one_that_no_arm_known_reaches_the_sides_of():
    reach_mm = max(a2 + float(np.hypot(a3, d4)) for a2, a3, _, d4 in (arm.lengths_mm for arm in PUBLISHED))
    least_mm = reach_mm + plausible.LONGEST_HAND_MM + Limits().clearance_mm
    assert min(*Limits().room_high_mm, *(-side for side in Limits().room_low_mm)) > least_mm


def test_the_greatest_speed_is_allowed_and_so_is_an_orientation_a_millionth_off():
    assert rule_of(command(speed=LIMITS.max_speed_pct)) is None
    assert rule_of(command(speed=0.1)) is None
    for off, broken in ((1e-6, None), (np.nextafter(1e-6, 1.0), "not_a_location")):
        sheared = np.eye(4)
        sheared[0, 1] = off
        here = sheared.copy()
        here[:3, 3] = AT[:3, 3]
        refusal = refuse(command(here), replace(STANDING, at=here), LIMITS)
        assert (None if refusal is None else refusal.rule) == broken


def test_who_configures_nothing_has_the_limits_that_the_configuration_of_etc_shows_but_for_that_cell_s_room():
    shipped = load_config(Path(__file__).parents[3] / "etc/facetd.yaml").values.pick.limits
    assert replace(shipped, room_low_mm=Limits().room_low_mm, room_high_mm=Limits().room_high_mm) == Limits()


def test_the_room_that_is_shipped_is_within_the_simulated_cell_s_walls():
    shipped = load_config(Path(__file__).parents[3] / "etc/facetd.yaml").values.pick.limits
    room = load_truth(Path(__file__).parents[3] / "etc/simcell.yaml").safety.room
    assert (np.array(shipped.room_low_mm) - room.low_mm).min() >= 5.0
    assert (np.array(room.high_mm) - shipped.room_high_mm).min() >= 5.0


def test_two_millimetres_above_the_table_and_a_hundred_degrees_at_once_are_the_limits_of_who_says_none():
    body = body_of(tuple(c for c in LIMITS.capsules if c.link == "tool"), LIMITS.body_mm)
    lowest = float(above_mm(frames.apply(AT, body.ends_mm), body.radius_mm, LIMITS.table_z_mm).min())
    for above, broken in ((2.01, None), (1.99, "below_table")):
        low = moved(z=above - lowest)
        refusal = refuse(command(low), replace(STANDING, at=low), Limits())
        assert (None if refusal is None else refusal.rule) == broken
    for turn_deg, broken in ((99.9, None), (100.1, "turn_too_far")):
        assert rule_of(command(moved(turn=np.radians(turn_deg))), Limits(table_z_mm=-900.0)) == broken
