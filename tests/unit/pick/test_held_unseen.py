"""What may be in the gripper, and nobody saw how it got there, is guarded as the longest part that is known."""

import asyncio
from collections.abc import Callable

import numpy as np
import pytest

from daemon import frames
from daemon.arm.belief import BeliefSource, HeldPart, VoidingEvent
from daemon.arm.body import PERHAPS_HELD, carried_part
from daemon.arm.operators import RefusedError
from daemon.events.pick_order import PickOrder
from daemon.pick.cycle import PickCycle
from tests.fakes.fake_cell import TruthRecogniser, World, cycle_of, one_part, shape_of

UNSEEN = [PERHAPS_HELD]
SMALL, LARGE = "pyramid", "cube"


def longest_mm(label: str) -> float:
    corners = shape_of(label).corners_mm
    return float(np.linalg.norm(corners[:, None] - corners, axis=-1).max())


def moves(world: World) -> int:
    return sum(name == "move" for name, _ in world.wire)


def guarded(cycle: PickCycle) -> list[str]:
    return [capsule.name for capsule in cycle.belief.capsules]


def radius_mm(cycle: PickCycle) -> float:
    (capsule,) = cycle.belief.capsules
    return capsule.radius_mm


@pytest.mark.parametrize("labels", [None, ()])
def test_with_a_part_in_the_gripper_perhaps_and_none_taught_the_arm_does_not_set_out(labels: tuple[str, ...] | None):
    """Nothing was guarded then, and the arm went wherever it was sent."""
    world = one_part()
    cycle = cycle_of(world)
    cycle.holding(False)
    cycle.use(None if labels is None else TruthRecogniser(world, labels))
    asyncio.run(cycle.set_gripper(closed=True))
    for act in (lambda: cycle.go("home"), lambda: cycle.jog(lambda at: at, "jog")):
        with pytest.raises(RefusedError, match=r"holding no.*hand open"):
            asyncio.run(act())
    assert moves(world) == 0
    asyncio.run(cycle.set_gripper(closed=False))
    asyncio.run(cycle.go("home"))
    assert moves(world) > 0


def test_a_word_that_it_is_empty_lets_an_arm_go_without_a_model():
    world = one_part()
    cycle = cycle_of(world)
    cycle.use(None)
    asyncio.run(cycle.set_gripper(closed=True))
    cycle.holding(False)
    asyncio.run(cycle.go("home"))
    assert moves(world) > 0


def test_a_look_that_moves_nothing_needs_no_word_about_the_gripper():
    world = one_part()
    cycle = cycle_of(world)
    cycle.use(TruthRecogniser(world, ()))
    asyncio.run(cycle.set_gripper(closed=True))
    asyncio.run(cycle.look())
    assert moves(world) == 0


def test_a_look_of_one_camera_moves_the_arm_and_so_needs_a_word_about_the_gripper():
    world = one_part()
    cycle = cycle_of(world)
    object.__setattr__(cycle.cell, "alone", "left")
    cycle.holding(False)
    cycle.use(TruthRecogniser(world, ()))
    asyncio.run(cycle.set_gripper(closed=True))
    with pytest.raises(RefusedError, match="hand open"):
        asyncio.run(cycle.look())
    assert moves(world) == 0


@pytest.mark.parametrize("after", [None, (SMALL,), ()])
def test_what_was_gripped_before_the_model_was_exchanged_is_a_part_of_the_one_before(after: tuple[str, ...] | None):
    world = one_part()
    cycle = cycle_of(world)
    cycle.use(TruthRecogniser(world, (LARGE,)))
    asyncio.run(cycle.set_gripper(closed=True))
    cycle.use(None if after is None else TruthRecogniser(world, after))
    asyncio.run(cycle.go("home"))
    assert guarded(cycle) == UNSEEN
    assert radius_mm(cycle) > longest_mm(LARGE) > longest_mm(SMALL) + 10.0


def test_what_was_taught_since_may_be_in_the_gripper_too():
    world = one_part()
    cycle = cycle_of(world)
    cycle.holding(False)
    cycle.use(TruthRecogniser(world, (SMALL,)))
    asyncio.run(cycle.set_gripper(closed=True))
    asyncio.run(cycle.go("home"))
    assert longest_mm(SMALL) < radius_mm(cycle) < longest_mm(LARGE)
    cycle.use(TruthRecogniser(world, (SMALL, LARGE)))
    asyncio.run(cycle.go("home"))
    assert radius_mm(cycle) > longest_mm(LARGE)


def closed_again(cycle: PickCycle) -> None:
    asyncio.run(cycle.set_gripper(closed=True))


def moved_by_others(cycle: PickCycle) -> None:
    cycle.beliefs.void(VoidingEvent.MOVED_BY_OTHERS)


@pytest.mark.parametrize("happens", [closed_again, moved_by_others])
def test_a_part_that_facetd_grasped_stands_for_no_other_that_came_into_the_gripper(
    happens: Callable[[PickCycle], None],
):
    """The part of the last grasp was guarded, small as it was, for whatever the gripper had closed on since."""
    world = one_part()
    cycle = cycle_of(world)
    known = carried_part(frames.apply(np.eye(4), 0.1 * shape_of("cube").corners_mm), "cube in the gripper")
    cycle.beliefs.learn(BeliefSource.COMMANDED, closed=True, holding=True, held_shape=known)
    asyncio.run(cycle.go("home"))
    assert cycle.belief.capsules == known
    happens(cycle)
    asyncio.run(cycle.go("home"))
    assert guarded(cycle) == UNSEEN


def stopped(cycle: PickCycle) -> None:
    asyncio.run(cycle.supervisor.stop())
    cycle.supervisor.resume()


def aborted(cycle: PickCycle) -> None:
    asyncio.run(cycle.supervisor.abort())


def disabled(cycle: PickCycle) -> None:
    asyncio.run(cycle.supervisor.disable())


def opened_anew(cycle: PickCycle) -> None:
    cycle.supervisor.line_opened_anew()


def typed_to_the_controller(cycle: PickCycle) -> None:
    asyncio.run(cycle.supervisor.converse("robot monitor", lambda: asyncio.sleep(0), moves=False))


def said_to_be_empty(cycle: PickCycle) -> None:
    cycle.beliefs.void(VoidingEvent.OTHERS_TYPED)
    cycle.holding(False)


def restarted(cycle: PickCycle) -> None:
    cycle.recover("retreat", closed=True)
    cycle.supervisor.resume()
    cycle.holding(False)


AMID = (stopped, aborted, disabled, opened_anew, typed_to_the_controller, moved_by_others, said_to_be_empty, restarted)


@pytest.mark.parametrize("happens", AMID)
def test_a_part_that_a_pendant_closed_the_gripper_on_falls_into_the_bin_and_nowhere_else(
    happens: Callable[[PickCycle], None],
):
    """facetd had opened the gripper itself, took it for empty, and opened it again where the next approach began."""
    world = one_part(LARGE)
    cycle = cycle_of(world)
    assert asyncio.run(cycle.pick()).outcome == "picked"
    happens(cycle)
    cycle.supervisor.enable()
    world.held, world.closed = SMALL, True
    world.put(LARGE, 520, 0, 0.4)
    opened: list[np.ndarray] = []

    def note(name: str) -> None:
        if name == "handed" and not world.closed:
            opened.append(world.at[:3, 3].copy())

    world.before = note
    assert asyncio.run(cycle.pick()).outcome == "picked"
    assert world.binned == [LARGE, SMALL, LARGE]
    over_bin = cycle.positions()["bin"][:3, 3]
    assert [float(np.linalg.norm(at - over_bin)) for at in opened] == pytest.approx([0.0, 0.0], abs=1.0)


@pytest.mark.parametrize("happens", [*AMID[:-2], lambda cycle: None])
def test_until_it_opens_over_the_bin_what_a_pendant_may_have_closed_the_gripper_on_is_guarded(
    happens: Callable[[PickCycle], None],
):
    """The way to the bin took a part that nobody knew of 4 to 7 mm into a keep-out box."""
    world = one_part()
    cycle = cycle_of(world)
    guarded_at: dict[str, list[str]] = {}

    def note(name: str) -> None:
        if name == "moving":
            guarded_at.setdefault(world.said("move")[-1]["purpose"], guarded(cycle))

    world.before = note
    assert asyncio.run(cycle.pick()).outcome == "picked"
    assert guarded_at["bin, to open the gripper first"] == UNSEEN, "as the daemon starts"
    assert guarded_at["grasp"] == [], "it opened it over the bin"
    happens(cycle)
    cycle.supervisor.enable()
    asyncio.run(cycle.go("home"))
    assert guarded(cycle) == (UNSEEN if happens in AMID else [])
    cycle.holding(False)
    asyncio.run(cycle.go("survey"))
    assert guarded(cycle) == [], "an operator looked at it since"


def test_a_gripper_that_only_counts_as_empty_keeps_no_arm_where_no_part_is_taught():
    world = one_part()
    cycle = cycle_of(world)
    cycle.holding(False)
    cycle.use(None)
    stopped(cycle)
    cycle.supervisor.enable()
    asyncio.run(cycle.go("home"))
    assert moves(world) > 0


def test_a_gripper_that_facetd_opened_and_nothing_happened_to_is_not_opened_again():
    world = one_part()
    cycle = cycle_of(world)
    assert asyncio.run(cycle.pick()).outcome == "picked"
    world.put(LARGE, 520, 0, 0.4)
    sent = len(world.wire)
    assert asyncio.run(cycle.pick()).outcome == "picked"
    assert [closed for name, closed in world.wire[sent:] if name == "hand"] == [True, False]


@pytest.mark.parametrize("closed", [False, None, True])
def test_after_a_crash_a_gripper_that_was_not_open_may_hold_anything_and_nothing_moves_until_resume(
    closed: bool | None,
):
    world = one_part()
    cycle = cycle_of(world)
    order = PickOrder(3)
    cycle.recover("retreat", closed, order)
    assert (cycle.state, cycle.supervisor.fault_text, cycle.pick_order) == (
        "fault", "restarted: the daemon ended in retreat", order
    )  # fmt: skip
    assert cycle.belief.holds_part is (False if closed is False else None)
    assert cycle.belief.empty_unproven is (closed is False)


def test_only_both_cameras_on_the_gripper_see_how_it_holds_a_part():
    world = one_part()
    cycle = cycle_of(world)
    held = HeldPart(LARGE, np.eye(4), np.eye(6))
    cycle.beliefs.learn(BeliefSource.COMMANDED, holding=True, grasped_part=held)
    object.__setattr__(cycle.cell, "alone", "left")
    with pytest.raises(RefusedError, match="only both cameras on the gripper see how it holds a part: lay it where"):
        asyncio.run(cycle.held_here())
    assert moves(world) == 0
