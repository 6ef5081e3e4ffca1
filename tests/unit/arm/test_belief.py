"""What is believed of arm and gripper: what each change leaves unknown, how it was learnt, and who voids it when."""

import asyncio
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.arm.belief import VOIDS, Belief, Beliefs, BeliefSource, CellBelief, HeldPart, Reading, VoidingEvent, voided
from daemon.arm.body import Capsule
from daemon.arm.guard import Limits, MoveCommand
from daemon.arm.motion import Arrival, MovedByOthersError, Mover
from daemon.arm.robot import HeldBackError
from daemon.arm.supervisor import Supervisor
from daemon.events.codes import CauseCode, FaultCause
from tests.fakes.fake_cell import HEAD_DOWN, World, build, permitted

FACTS = [field.name for field in fields(CellBelief)]
LOAD = (Capsule("a part", "tool", (0.0, 0.0, 0.0), (0.0, 0.0, 30.0), 20.0),)
HELD = HeldPart("cube", np.eye(4), np.eye(6))
READING = Reading(np.eye(4), np.zeros(6))
NEAR = frames.perturb(HEAD_DOWN, np.array([30.0, 0, 0, 0, 0, 0]))


def everything(holding: bool = True) -> CellBelief:
    """All of it known, as facetd's own acts left it."""
    values: dict[str, Any] = {
        "position": READING,
        "planned": READING,
        "last_joint_move_end": READING,
        "tool": np.eye(4),
        "closed": holding,
        "holding": holding,
        "grasped_part": HELD,
        "held_shape": LOAD,
    }
    return CellBelief(**{name: Belief(value, BeliefSource.COMMANDED, 1.0) for name, value in values.items()})


def unknown(belief: CellBelief) -> set[str]:
    return {name for name in FACTS if getattr(belief, name) is None}


PLACE, CONTROLLER = {"position", "planned"}, {"position", "planned", "tool", "closed"}


@pytest.mark.parametrize(
    ("change", "lost"),
    [
        (VoidingEvent.MOVE_BEGUN, PLACE),
        (VoidingEvent.GRIPPER_CLOSES, {"closed", "holding", "grasped_part", "held_shape"}),
        (VoidingEvent.GRIPPER_OPENS, {"closed", "holding", "grasped_part"}),
        (VoidingEvent.STOPPED, CONTROLLER),
        (VoidingEvent.FAULT_CLEARED, CONTROLLER),
        (VoidingEvent.RECONNECTED, CONTROLLER | {"last_joint_move_end"}),
        (VoidingEvent.RESTARTED, set(FACTS)),
        (VoidingEvent.OPERATOR_TYPED, CONTROLLER),
        (VoidingEvent.TURN_TYPED, {"last_joint_move_end"}),
        (VoidingEvent.GRIPPER_TYPED, {"closed", "holding", "grasped_part", "held_shape"}),
        (VoidingEvent.MOVED_BY_OTHERS, PLACE | {"closed", "held_shape"}),
        (VoidingEvent.OTHERS_TYPED, set(FACTS) - {"last_joint_move_end"}),
        (VoidingEvent.GRIPPER_CHANGED, set(FACTS)),
    ],
)
def test_each_change_leaves_unknown_what_it_may_have_changed_and_nothing_else(change, lost):
    assert unknown(voided(everything(), change)) == lost


@pytest.mark.parametrize("change", list(VoidingEvent))
def test_what_is_guarded_as_the_largest_that_may_be_held_stays_as_long_as_the_gripper_does(change):
    assumed = replace(everything(), held_shape=Belief(LOAD, BeliefSource.ASSUMED, 1.0))
    assert voided(assumed, change).capsules == (() if change is VoidingEvent.GRIPPER_CHANGED else LOAD)


def test_every_change_has_its_row():
    assert set(VOIDS) == set(VoidingEvent)


@given(st.lists(st.sampled_from(list(VoidingEvent)), min_size=1, max_size=6), st.booleans())
def test_whatever_changes_follow_one_another_nothing_becomes_known_by_them(changes, holding):
    belief = everything(holding)
    for change in changes:
        before, belief = unknown(belief), voided(belief, change)
        assert before <= unknown(belief)
        assert not (unknown(belief) - before - VOIDS[change] - {"holding", "grasped_part"})


def test_an_opening_gripper_that_is_believed_empty_stays_empty():
    assert voided(everything(holding=False), VoidingEvent.GRIPPER_OPENS).holds_part is False


@given(st.lists(st.sampled_from(list(VoidingEvent)), min_size=1, max_size=6))
def test_a_gripper_that_is_no_longer_known_to_be_open_is_at_most_assumed_to_be_empty(changes):
    """A pendant may have closed it on a part: it is opened over the bin before the next pick."""
    belief = everything(holding=False)
    belief = replace(belief, closed=Belief(False, BeliefSource.COMMANDED, 1.0))
    assert not belief.empty_unproven
    for change in changes:
        belief = voided(belief, change)
    known_open = belief.closed is not None and not belief.closed.value
    assert known_open == (belief.holds_part is False and not belief.empty_unproven)


@pytest.mark.parametrize("change", list(VoidingEvent))
def test_no_change_makes_a_gripper_that_held_a_part_count_as_empty(change):
    assert voided(everything(holding=True), change).holds_part in (True, None)


def test_each_fact_says_how_and_when_it_was_learnt():
    now = [10.0]
    beliefs = Beliefs(lambda: now[0], lambda *_, **__: None)
    assert beliefs.now.empty_unproven, "nobody has seen it open yet"
    now[0] = 12.0
    beliefs.learn(BeliefSource.REPORTED, position=READING)
    beliefs.learn(BeliefSource.COMMANDED, closed=False, held_shape=LOAD, tool=np.eye(4))
    beliefs.learn(BeliefSource.OBSERVED, holding=True)
    told = beliefs.now.json(15.5)
    assert told["position"] == {"value": [0.0, 0.0, 0.0], "how": "reported by the controller", "age_s": 3.5}
    assert told["holding"] == {"value": True, "how": "observed by the cameras", "age_s": 3.5}
    assert told["load"]["value"] == ["a part"]
    assert told["tool"]["value"] == [0.0, 0.0, 0.0]
    assert told["closed"]["value"] is False
    assert "planned" not in told


@pytest.mark.parametrize("change", list(VoidingEvent))
def test_that_a_part_may_be_in_the_gripper_again_is_recorded_where_others_worked_it(change):
    records = []
    beliefs = Beliefs(lambda: 0.0, lambda kind, **fields: records.append((kind, fields)))
    beliefs.void(change)
    others = change in (VoidingEvent.GRIPPER_TYPED, VoidingEvent.OTHERS_TYPED, VoidingEvent.GRIPPER_CHANGED)
    assert records == [("holding", {"held": None})] * others


def test_what_did_not_begin_is_undone_but_nothing_that_was_learnt_or_voided_meanwhile():
    beliefs = Beliefs(lambda: 0.0, lambda *_, **__: None)
    beliefs.learn(BeliefSource.REPORTED, position=READING)
    beliefs.void(VoidingEvent.MOVE_BEGUN)()
    assert beliefs.now.resting_reading is READING
    undo = beliefs.void(VoidingEvent.MOVE_BEGUN)
    beliefs.void(VoidingEvent.STOPPED)
    undo()
    assert beliefs.now.resting_reading is None


# Who voids it.


def mover_in(world: World) -> Mover:
    mover = permitted(Mover(build(world), Limits(), Arrival()))
    asyncio.run(mover.wait_until_at_rest())
    mover.beliefs.learn(
        BeliefSource.COMMANDED, tool=np.eye(4), closed=True, holding=True, grasped_part=HELD, held_shape=LOAD
    )
    return mover


@pytest.mark.parametrize(
    ("closes", "lost"),
    [(True, {"closed", "holding", "grasped_part", "held_shape"}), (False, {"closed", "holding", "grasped_part"})],
)
def test_while_the_gripper_works_and_after_it_failed_nobody_knows_what_it_holds(closes, lost):
    world = World(np.random.default_rng(0))
    mover, during = mover_in(world), []
    planned = unknown(mover.belief)

    def fail(name: str) -> None:
        if name == "hand":
            during.append(unknown(mover.belief) - planned)
            raise OSError("no answer")

    world.before = fail
    with pytest.raises(OSError, match="no answer"):
        asyncio.run(mover.set_gripper(closes))
    assert during == [lost]
    assert unknown(mover.belief) - planned == lost


def test_a_gripper_that_facetd_opened_is_open_and_empty_by_its_own_act():
    mover = mover_in(World(np.random.default_rng(0)))
    asyncio.run(mover.set_gripper(closed=False))
    assert mover.belief.closed.value is False
    assert (mover.belief.holds_part, mover.belief.empty_unproven, mover.belief.capsules) == (False, False, ())


def test_a_gripper_that_was_held_back_is_tried_again_and_unknown_as_long_as_it_may_work():
    world = World(np.random.default_rng(0))
    mover, tries = mover_in(world), []
    honest = mover.cell.robot.set_gripper

    async def once_held_back(closed: bool) -> None:
        tries.append(unknown(mover.belief))
        if len(tries) == 1:
            raise HeldBackError("somebody paused")
        assert mover.belief.holds_part is None
        await honest(closed)

    seen = []
    record = world.record
    mover.cell.robot.set_gripper = once_held_back

    def recorded(kind: str, /, **fields: object) -> None:
        seen.append((kind, mover.belief.holds_part))
        record(kind, **fields)

    mover.cell.log.record = recorded
    asyncio.run(mover.set_gripper(closed=True))
    assert seen == [("hand", None), ("held_back", None), ("hand", None)]
    assert mover.belief.closed.value is True


def test_an_arm_that_was_moved_by_others_is_nowhere_and_its_gripper_in_doubt():
    world = World(np.random.default_rng(0))
    mover = mover_in(world)
    mover.beliefs.learn(BeliefSource.COMMANDED, closed=False, holding=False)
    world.before = lambda name: world.at.__setitem__((1, 3), 5.0) if name == "move" else None
    with pytest.raises(MovedByOthersError):
        asyncio.run(mover.go(MoveCommand(NEAR, False, 50.0, "a test")))
    assert {"position", "closed"} <= unknown(mover.belief)
    assert mover.belief.empty_unproven


def supervised() -> Supervisor:
    supervisor = Supervisor(build(World(np.random.default_rng(0))), Limits(), Arrival(), lambda _: None)
    supervisor.enable()
    supervisor.mover.beliefs.learn(
        BeliefSource.COMMANDED,
        position=READING,
        last_joint_move_end=READING,
        tool=np.eye(4),
        closed=False,
        holding=True,
        grasped_part=HELD,
        held_shape=LOAD,
    )
    return supervisor


async def stopped(supervisor: Supervisor) -> None:
    await supervisor.stop()


async def found_faulty(supervisor: Supervisor) -> None:
    await supervisor.fail("cameras", "no frame", FaultCause(CauseCode.CAMERA_LOST))


async def reconnected(supervisor: Supervisor) -> None:
    supervisor.line_opened_anew()


async def typed_to(supervisor: Supervisor) -> None:
    await supervisor.converse("monitor", lambda: asyncio.sleep(0), moves=False)


async def cleared(supervisor: Supervisor) -> None:
    supervisor.latch("a fault")
    supervisor.resume()


@pytest.mark.parametrize("event", [stopped, found_faulty, reconnected, typed_to, cleared])
def test_what_the_supervisor_hears_of_voids_all_that_the_controller_may_have_otherwise_now(event):
    supervisor = supervised()
    asyncio.run(event(supervisor))
    assert unknown(supervisor.mover.belief) == CONTROLLER | ({"last_joint_move_end"} if event is reconnected else set())


@pytest.mark.parametrize(
    ("holding", "source", "may"),
    [
        (False, BeliefSource.ASSUMED, True),
        (False, BeliefSource.OPERATOR, False),
        (False, BeliefSource.COMMANDED, False),
        (True, BeliefSource.OBSERVED, True),
        (None, BeliefSource.OPERATOR, True),
    ],
)
def test_a_gripper_may_hold_a_part_where_it_only_counts_as_empty(
    holding: bool | None, source: BeliefSource, may: bool
) -> None:
    beliefs = Beliefs(lambda: 0.0, lambda *_, **__: None)
    beliefs.learn(source, holding=holding)
    assert beliefs.now.may_hold is may
