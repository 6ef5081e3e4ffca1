"""The gripper's sensor against the looks: where they agree the pick goes on, where they differ a person is asked."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.events.pick_order import PickOrder
from daemon.pick.cycle import PickCycle
from daemon.pick.gripper_sensor import MORE_DWELLS, contradiction
from daemon.pick.grippers.suction import SuctionCup
from daemon.pick.grippers.two_fingers import TwoFingers
from daemon.pick.settings import Settings
from daemon.store.place_status import PlaceStatus
from tests.fakes.fake_cell import World, cycle_of, one_part
from tests.unit.pick.test_set_down import Story, measured  # noqa: F401

Says = Callable[[], bool | None]


def wired(cycle: PickCycle, says: Says) -> PickCycle:
    """A cycle whose gripper has this sensor."""

    async def part_held() -> bool | None:
        return says()

    cycle.production_line.part_held = part_held
    return cycle


def picked(fake: World, says: Says, settings: Settings | None = None) -> tuple[Any, PickCycle]:
    cycle = wired(cycle_of(fake, settings), says)
    return asyncio.run(cycle.pick()), cycle


def asked(end: Any, cycle: PickCycle, fake: World) -> bool:
    """Whether the arm stopped and a person is asked what the gripper holds, which was left as it is."""
    assert fake.said("cycle_end")[-1]["code"] == "sensor_disagrees", end.why
    return end.outcome == "fault" and cycle.belief.holds_part is None and cycle.supervisor.fault_text is not None


def test_a_sensor_that_is_right_is_read_when_taken_hold_of_lifted_and_let_go() -> None:
    fake = one_part()
    end, _ = picked(fake, lambda: fake.held is not None)
    assert end.outcome == "picked", end.why
    read = [(record["when"], record["held"]) for record in fake.said("sensor")]
    assert read == [("closed", True), ("lifted", True), ("over the bin", True), ("let go", False)]


def test_without_a_sensor_nothing_is_read() -> None:
    fake = one_part()
    end, _ = picked(fake, lambda: None)
    assert end.outcome == "picked"
    assert not fake.said("sensor")


def test_a_sensor_that_denies_what_a_look_shows_is_not_believed_and_the_part_is_not_let_go() -> None:
    fake = one_part()
    end, cycle = picked(fake, lambda: False)
    assert asked(end, cycle, fake)
    assert fake.held == "cube"
    assert "shows in the gripper" in end.why
    assert "`holding yes` or `holding no`" in end.why


def test_a_sensor_that_is_stuck_on_over_a_part_that_still_lies_there_is_not_believed() -> None:
    fake = one_part()
    fake.slippery = 1
    end, cycle = picked(fake, lambda: True)
    assert asked(end, cycle, fake)
    assert "still lies there" in end.why


def test_a_miss_that_sensor_and_look_agree_on_is_tried_again() -> None:
    fake = one_part()
    fake.slippery = 1
    end, _ = picked(fake, lambda: fake.held is not None)
    assert end.outcome == "picked", end.why
    assert any(record["code"] == "still_there" for record in fake.said("decision"))


def test_a_sensor_that_still_holds_after_the_gripper_let_go_is_not_believed() -> None:
    fake = one_part()
    end, cycle = picked(fake, lambda: True)
    assert asked(end, cycle, fake)
    assert "is in it no longer" in end.why


@pytest.mark.parametrize("stuck", [False, True])
def test_of_a_part_that_nobody_saw_grasped_the_sensor_is_asked_whether_it_was_let_go(stuck: bool) -> None:
    fake = one_part()
    fake.held = "pyramid"
    cycle = wired(cycle_of(fake), lambda: stuck or fake.held is not None)
    cycle.holding(True)
    end = asyncio.run(cycle.pick())
    if stuck:
        assert (
            "the gripper's sensor says that it holds a part, and the look shows that what it held was let go" in end.why
        )
    else:
        assert (end.outcome, cycle.belief.holds_part) == ("emptied", False)


def test_a_part_that_is_lost_on_the_way_to_the_bin_is_told_by_the_sensor() -> None:
    fake = one_part()

    def lost(act: str) -> None:
        if act == "move" and [r["purpose"] for r in fake.said("move")][-1] == "bin":
            fake.held = None

    fake.before = lost
    end, cycle = picked(fake, lambda: fake.held is not None)
    assert (end.outcome, end.brought) == ("released", False)
    assert "came to the bin empty" in end.why
    assert cycle.belief.holds_part is False


def test_the_line_hears_of_parts_that_were_brought_and_of_none_that_fell_on_the_way() -> None:
    fake = one_part()
    cycle = wired(cycle_of(fake), lambda: fake.held is not None)
    told: list[str] = []

    async def brought() -> None:
        told.append(cycle.ends[-1].why)

    cycle.production_line.brought = brought

    def lost(act: str) -> None:
        if act == "move" and [r["purpose"] for r in fake.said("move")][-1] == "bin":
            fake.held = None

    fake.before = lost
    asyncio.run(cycle.auto(PickOrder(1)))
    assert [end.why for end in cycle.ends if "fell on the way" in end.why]
    assert told == [end.why for end in cycle.ends if end.brought] == []


def test_a_part_that_is_lost_on_the_way_to_its_place_is_told_and_the_place_is_free(tmp_path: Path) -> None:
    story = Story(tmp_path)

    def lost(act: str) -> None:
        if act == "move" and [r["purpose"] for r in story.fake.said("move")][-1] == "over place nest":
            story.fake.held = None

    story.fake.before = lost
    wired(story.cycle, lambda: story.fake.held is not None)
    end = story.pick()
    assert (end.outcome, story.status()) == ("released", PlaceStatus.FREE)
    assert any("was lost on the way" in record["text"] for record in story.fake.said("decision"))
    assert not any("down to" in record["purpose"] for record in story.fake.said("move"))


@pytest.mark.parametrize(("when", "moved"), [("over its place", "over place nest"), ("let go", "down to place nest")])
def test_a_sensor_that_lies_at_the_place_stops_the_arm_there(tmp_path: Path, when: str, moved: str) -> None:
    story = Story(tmp_path)

    def says() -> bool:
        last = [record["purpose"] for record in story.fake.said("move")][-1]
        return (story.fake.held is not None) is not (last == moved and (when == "let go") is (not story.fake.held))

    wired(story.cycle, says)
    end = story.pick()
    assert asked(end, story.cycle, story.fake)
    assert story.fake.said("sensor")[-1]["when"] == when
    assert [record["purpose"] for record in story.fake.said("move")][-1] == moved


def test_a_vacuum_that_is_slow_to_come_is_waited_for_before_the_lift_but_not_for_ever() -> None:
    for late in (1, 9):
        fake = one_part()
        count = 0

        def says(fake: World = fake, late: int = late) -> bool:
            nonlocal count
            count += 1
            return count > late and fake.held is not None

        picked(fake, says)
        closed = [record["held"] for record in fake.said("sensor") if record["when"] == "closed"]
        assert closed == ([False, True] if late == 1 else [False] * MORE_DWELLS)


@given(sensor=st.sampled_from([None, True, False]), holds=st.booleans())
def test_they_contradict_each_other_where_the_sensor_says_the_other_thing(sensor: bool | None, holds: bool) -> None:
    told = contradiction("cube", sensor, "shows", holds)
    assert (told is not None) is (sensor is not None and sensor is not holds)


def test_a_cup_dwells_before_the_lift_and_blows_off_before_the_next_move() -> None:
    cup = Settings(gripper=SuctionCup(dwell_s=0.4, blow_off_s=0.2), hand_s=0.3)
    assert (cup.hand_time_s(closed=True), cup.hand_time_s(closed=False)) == (0.4, 0.3)


@pytest.mark.parametrize(("gripper", "wired"), [("suction", True), ("suction", False), ("fingers", True)])
def test_a_cup_is_worked_by_outputs_where_its_valves_are_there_and_no_other_gripper_is(
    gripper: str, wired: bool
) -> None:
    fake, worked = one_part(), []
    kind = SuctionCup(dwell_s=0.4, blow_off_s=0.2) if gripper == "suction" else TwoFingers()
    cycle = cycle_of(fake, Settings(gripper=kind))

    async def work_cup(closed: bool, work_time_s: float) -> None:
        worked.append((closed, work_time_s))

    cycle.production_line.work_cup = work_cup
    cycle.production_line._by_role = {"vacuum": "valve"} if wired else {}

    async def story() -> None:
        cycle.supervisor.enable()
        await cycle.set_gripper(closed=True)
        await cycle.set_gripper(closed=False)

    asyncio.run(story())
    at_outputs = (gripper, wired) == ("suction", True)
    assert worked == ([(True, 0.4), (False, 0.2)] if at_outputs else [])
    assert [closed for act, closed in fake.wire if act == "hand"] == ([] if at_outputs else [True, False])


def test_a_stop_with_a_part_in_the_gripper_leaves_the_vacuum_on() -> None:
    fake = one_part()

    async def story() -> list[Any]:
        cycle = wired(cycle_of(fake), lambda: fake.held is not None)
        stops: list[Any] = []

        def stop(act: str) -> None:
            if act == "moving" and fake.held and not stops:
                stops.append(asyncio.get_running_loop().create_task(cycle.supervisor.stop()))

        fake.before = stop
        end = await cycle.pick()
        await asyncio.gather(*stops)
        return [end, *stops]

    end, *stops = asyncio.run(story())
    assert stops
    assert end.outcome in ("aborted", "fault"), end.why
    assert fake.held == "cube"
    assert [closed for act, closed in fake.wire if act == "hand"][-1] is True, "nothing was typed that lets it go"
