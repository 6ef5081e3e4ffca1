"""The taking, state by state: round to a side approach, what a look afterwards says against success."""

import asyncio
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.arm import capsule_around
from daemon.arm.belief import BeliefSource
from daemon.arm.motion import MovedByOthersError
from daemon.events.codes import CauseCode, DecisionCode
from daemon.pick import take
from daemon.pick.transitions import PickEvent, PickState
from drivers.simcell import parts
from tests.fakes.fake_cell import TruthRecogniser, World, cameras_of, cycle_of, one_part, shape_of
from tests.fakes.pick_steps import begun, brought_to, step


def purposes(fake):
    return [r["purpose"] for r in fake.said("move")]


def test_the_blind_stretch_is_two_straight_moves_slower_the_nearer():
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.FINAL, context, world)
    before = len(fake.said("move"))
    assert step(context, world, PickState.FINAL) is PickEvent.THERE
    moves = fake.said("move")[before:]
    assert {r["purpose"] for r in moves} == {"before the grasp", "grasp"}
    assert {r["how"] for r in moves} == {"straight"}
    assert moves[-1]["speed_pct"] == context.settings.near_pct


def test_a_part_looked_at_from_the_side_is_gone_round_to_before_and_after():
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.FINAL, context, world)
    target = world.the_target()
    target.side_view = target.look_rotation
    step(context, world, PickState.FINAL)
    assert "round to the approach" in purposes(fake)
    step(context, world, PickState.CLOSING)
    step(context, world, PickState.RETREAT)
    assert purposes(fake)[-1] == "where it was seen from"


def test_a_grasp_that_turns_out_of_reach_is_planned_again_with_the_hand_open_but_not_for_ever():
    fake = one_part()
    context, world = begun(fake)
    for _ in range(context.settings.tries):
        brought_to(PickState.FINAL, context, world)
        fake.unreached = world.the_target().plan.grasp.world_from_tool[:3, 3]
        assert step(context, world, PickState.FINAL) is PickEvent.UNREACHABLE
        assert not world.skipped
        assert [part.label for part in world.found] == ["cube"]
        fake.unreached = None
    brought_to(PickState.FINAL, context, world)
    fake.unreached = world.the_target().plan.grasp.world_from_tool[:3, 3]
    assert step(context, world, PickState.FINAL) is PickEvent.UNREACHABLE
    assert [s.outcome for s in world.skipped] == ["unreachable"]
    assert not fake.closed


def test_a_grasp_out_of_which_the_arm_could_not_be_lifted_is_not_gone_into():
    """It was planned before the last look moved it; a lift that was refused left the hand closed around the part."""
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.FINAL, context, world)
    target, sent = world.the_target(), len(fake.said("move"))
    fake.unreached = target.plan.grasp.world_from_tool[:3, 3] + [0.0, 0.0, context.settings.lift_mm + 10.0]
    assert step(context, world, PickState.FINAL) is PickEvent.UNREACHABLE
    assert len(fake.said("move")) == sent
    assert not fake.closed


def test_a_look_on_an_old_estimate_is_not_driven_on_blindly():
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.FINAL, context, world)
    fake.now_s += context.settings.limits.max_look_age_s + 1
    sent = len(fake.wire)
    assert step(context, world, PickState.FINAL) is PickEvent.UNREACHABLE
    assert "stale_look" in fake.said("decision")[-1]["why"]
    assert len(fake.wire) == sent
    assert step(context, world, PickState.CHOOSE) is PickEvent.STALE


@pytest.mark.parametrize(("side", "gone"), [(False, ["before the grasp"]), (True, ["round to the approach"])])
def test_a_look_that_gets_old_on_the_way_is_driven_on_no_farther(side, gone):
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.FINAL, context, world)
    target, sent = world.the_target(), len(purposes(fake))
    target.side_view = target.look_rotation if side else None

    def gets_old(_):
        if purposes(fake)[sent:] == gone:
            fake.now_s = target.look.taken_s + context.settings.limits.max_look_age_s + 1

    fake.before = gets_old
    assert step(context, world, PickState.FINAL) is PickEvent.UNREACHABLE
    assert "stale_look" in fake.said("decision")[-1]["why"]
    assert purposes(fake)[sent:] == gone


@pytest.mark.parametrize("empty", [True, False])
def test_a_hand_seen_empty_is_a_miss_though_the_part_is_gone(monkeypatch, empty):
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.VERIFY, context, world)
    monkeypatch.setattr(take, "shows_empty_gripper", lambda *_: empty)
    monkeypatch.setattr(take, "shows_in_gripper", lambda *_: False)
    event = step(context, world, PickState.VERIFY)
    assert event is (PickEvent.MISSED if empty else PickEvent.GONE)
    assert world.result.outcome == ("missed" if empty else "released"), "nobody has seen it above the bin yet"
    assert fake.closed is not empty, "a hand that missed is opened"
    assert ("is gone" in world.result.why, "shows in" in world.result.why) == (True, False)
    if empty:
        assert np.allclose(fake.at, context.settings.bin.pose(), atol=0.1), "over the bin, as a look may err"


@pytest.mark.parametrize(
    ("held", "between", "barred", "event", "code"),
    [
        (np.eye(4), False, True, PickEvent.MEASURED, DecisionCode.IN_GRIPPER),
        (np.eye(4), True, False, PickEvent.MEASURED, DecisionCode.IN_GRIPPER),
        (np.eye(4), True, True, PickEvent.GONE, CauseCode.NO_WAY_TO_PLACE),
        (None, False, False, PickEvent.GONE, DecisionCode.NOT_MEASURED),
    ],
    ids=["to its place", "to the table", "something lies there", "not measured"],
)
def test_a_part_that_has_a_place_goes_there_where_it_is_measured_and_the_table_is_free_and_the_log_says_why(
    held, between, barred, event, code, monkeypatch
):
    async def measure(*_):
        return held

    decided = []
    monkeypatch.setattr(take, "measure", measure)
    monkeypatch.setattr(take, "is_blocked", lambda *_: barred)
    context: Any = SimpleNamespace(decide=lambda text, why, code, **_: decided.append((text, code)))
    goal = SimpleNamespace(between=between, description="the place")
    target: Any = SimpleNamespace(label="cube", way=SimpleNamespace(goal=goal), held=None)
    seen: Any = SimpleNamespace(taken=None)
    assert asyncio.run(take.where_to(context, target, seen, "it shows")) is event
    (decision,) = decided
    assert decision[1] is code
    assert ("the place" in decision[0]) is (event is PickEvent.MEASURED)


def test_a_part_that_is_seen_in_the_hand_is_not_still_where_it_lay(monkeypatch):
    """Edges of the table's weave had passed for those of the part."""
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.VERIFY, context, world)
    for denial in ("is_still_there", "knocked_away", "shows_empty_gripper"):
        monkeypatch.setattr(take, denial, lambda *_: True)
    monkeypatch.setattr(take, "shows_in_gripper", lambda *_: True)
    assert step(context, world, PickState.VERIFY) is PickEvent.GONE
    assert world.result.outcome == "released", "nobody has seen it above the bin yet"
    assert fake.closed


@pytest.mark.parametrize(
    ("hand_off_mm", "barred"), [(take.HAND_REACH_MM - 1.0, False), (take.HAND_REACH_MM + 1.0, True)]
)
def test_what_lies_where_a_part_is_to_be_laid_down_bars_it_and_what_is_in_the_hand_does_not(
    monkeypatch, hand_off_mm, barred
):
    corners = np.array([[x, y, z] for x in (400.0, 440.0) for y in (-20.0, 20.0) for z in (-290.0, -250.0)])
    middle = corners.mean(axis=0)
    hand = frames.rigid(np.eye(3), middle + np.array([0.0, 0.0, hand_off_mm]))
    monkeypatch.setattr(take, "seen_parts", lambda _: [SimpleNamespace(centre=middle, corners=corners)])
    look: Any = SimpleNamespace(reading=SimpleNamespace(world_from_tool=hand))
    goal: Any = SimpleNamespace(corners=corners)
    assert take.is_blocked(goal, look) is barred


def test_a_part_in_the_hand_is_guarded_as_the_hand_is_until_it_is_let_go():
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.CLOSING, context, world)
    step(context, world, PickState.CLOSING)
    carried = context.mover.belief.capsules
    assert {one.name for one in carried} == {f"{world.the_target().label} in the gripper"}
    step(context, world, PickState.RETREAT)
    low = world.the_target().plan.grasp.world_from_tool
    assert not context.mover.reach.allows(low), "what is held would touch the table again"
    asyncio.run(context.mover.set_gripper(closed=False))
    assert context.mover.belief.capsules == ()
    assert context.mover.reach.allows(low)


@pytest.mark.parametrize("held", [True, None])
def test_a_part_that_may_be_in_the_hand_and_nobody_saw_how_is_guarded_any_way_round(held):
    """After a restart, or a hand closed by a word: what hung below the fingers was not guarded at all."""
    cycle = cycle_of(one_part())
    cycle.beliefs.learn(BeliefSource.COMMANDED, holding=held)
    asyncio.run(cycle.go("home"))
    mover = cycle.supervisor.mover
    (carried,) = mover.belief.capsules
    corners = np.concatenate([cycle.recogniser.shape(label).corners_mm for label in cycle.recogniser.labels])
    assert carried.link == "tool"
    assert carried.radius_mm <= np.linalg.norm(np.ptp(corners, axis=0))
    low = mover.belief.resting_reading.world_from_tool.copy()
    low[2, 3] = mover.limits.table_z_mm + carried.radius_mm
    assert not mover.reach.allows(low)
    cycle.holding(False)
    asyncio.run(cycle.go("home"))
    assert mover.belief.capsules == ()
    assert mover.reach.allows(low)


def test_what_was_taught_since_may_be_in_the_hand_as_well():
    """The ball was made once, of what was known by then: a longer part hung out of it, though it had a name by now."""
    cycle = cycle_of(one_part())
    by_length = sorted(parts.TAUGHT, key=lambda label: np.linalg.norm(np.ptp(shape_of(label).corners_mm, axis=0)))
    radii = []
    cycle.holding(False)
    cycle.use(None)
    cycle.beliefs.learn(BeliefSource.COMMANDED, holding=None)
    for labels in (by_length[:1], by_length, by_length[:1]):
        cycle.use(TruthRecogniser(World(np.random.default_rng(0)), tuple(labels)))
        asyncio.run(cycle.go("home"))
        (carried,) = cycle.supervisor.mover.belief.capsules
        radii.append(carried.radius_mm)
    assert radii[0] < radii[1] == radii[2], "what was known may still be in it"


def test_what_an_operator_sees_to_be_empty_carries_nothing():
    cycle = cycle_of(one_part())
    cycle.supervisor.mover.beliefs.learn(BeliefSource.COMMANDED, held_shape=(capsule_around(np.eye(3), "a part"),))
    cycle.holding(True)
    assert cycle.supervisor.mover.belief.capsules
    cycle.holding(False)
    assert cycle.supervisor.mover.belief.capsules == ()


def released_as(fake):
    return [(r["label"], r["above"], r["opened"]) for r in fake.said("release")]


def test_a_part_that_shows_in_the_gripper_above_the_bin_and_no_longer_once_it_opened_is_picked():
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.BIN, context, world)
    assert step(context, world, PickState.BIN) is PickEvent.BINNED
    assert (world.result.outcome, fake.binned) == ("picked", ["cube"])
    assert "no longer once it had opened" in world.result.why
    assert released_as(fake) == [("cube", "part", "unclear")]


def test_a_part_that_was_lost_behind_the_verifying_look_is_released_and_not_picked():
    """It had counted as picked, and lay on the floor."""
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.BIN, context, world)
    fake.held = None
    assert step(context, world, PickState.BIN) is PickEvent.BINNED
    assert world.result.outcome == "released"
    assert "it is not proven that the part fell into the bin" in world.result.why
    assert released_as(fake) == [("cube", "unclear", "unclear")]
    assert not fake.binned


def test_fingers_that_show_met_above_the_bin_say_that_the_part_fell_on_the_way(monkeypatch):
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.BIN, context, world)
    fake.held = None
    monkeypatch.setattr(take, "shows_empty_gripper", lambda *_: True)
    assert step(context, world, PickState.BIN) is PickEvent.DROPPED
    assert world.result.outcome == "released"
    assert "fell on the way" in world.result.why


def test_an_arm_that_somebody_moved_from_above_the_bin_opens_no_gripper():
    """It opened wherever the pendant had brought it, and its part counted as picked."""
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.BIN, context, world)
    grab = context.cell.cameras.grab

    async def moved_as_it_looks(*how):
        if np.allclose(fake.at, context.settings.bin.pose(), atol=0.1):
            fake.at = frames.perturb(fake.at, np.array([0.0, 30.0, 0.0, 0.0, 0.0, 0.0]))
        return await grab(*how)

    context.cell.cameras.grab = moved_as_it_looks
    with pytest.raises(MovedByOthersError, match="the gripper is to open above the bin"):
        step(context, world, PickState.BIN)
    assert fake.closed
    assert not fake.binned


def test_a_part_that_still_shows_in_the_opened_gripper_is_believed_to_be_there():
    """It went along to the next part, guarded by nobody."""
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.BIN, context, world)
    honest = context.cell.robot.set_gripper

    async def sticky(closed):
        held = fake.held
        await honest(closed)
        fake.held = held

    context.cell.robot.set_gripper = sticky
    assert step(context, world, PickState.BIN) is PickEvent.STILL_HELD
    assert world.result.outcome == "released"
    assert context.mover.belief.holds_part is True


def test_pictures_that_do_not_come_to_rest_above_the_bin_prove_nothing_and_are_no_fault():
    """A conveyor below it moves on and on."""
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.BIN, context, world)
    cameras_of(context.cell).shaking = 10_000
    assert step(context, world, PickState.BIN) is PickEvent.BINNED
    assert released_as(fake) == [("cube", "unclear", "unclear")]
    assert world.result.outcome == "released"


def test_what_was_in_the_gripper_before_the_pick_is_put_down_without_a_look():
    fake = one_part()
    context, world = begun(fake)
    grabs = cameras_of(context.cell).grabs
    assert step(context, world, PickState.BIN) is PickEvent.BINNED
    assert cameras_of(context.cell).grabs == grabs
    assert not fake.said("release")


@pytest.mark.parametrize(
    ("label", "lies_mm", "knocked"),
    [("cube", 200.0, False), ("cube", 400.0, True), ("pyramid", 400.0, False)],
    ids=["where one lay before", "where nothing lay", "another part"],
)
def test_a_part_was_knocked_away_where_its_like_lies_now_and_nothing_lay_before(
    label: str, lies_mm: float, knocked: bool
) -> None:
    def lies(name: str, x_mm: float) -> Any:
        return SimpleNamespace(label=name, centre=np.array([x_mm, 0.0, 0.0]))

    target, other = lies("cube", 0.0), lies("cube", 200.0)
    assert take.knocked_away([target, other], target, [lies(label, lies_mm)]) is knocked
