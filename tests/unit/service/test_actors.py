"""Who acts behind the daemon's back is noticed: with the guard that notices it taken away, the story is found out.

Each story is lived twice: as it is, in which nothing may be found, and with its guards taken away, in which the motion
monitor, or an invariant of the story, must find something. So a story that proves nothing fails, too.
"""

from __future__ import annotations

import asyncio
import errno
import json
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from daemon.arm import belief, motion
from daemon.arm.belief import CellBelief, VoidingEvent, voided
from daemon.arm.motion import Mover
from daemon.arm.supervisor import Supervisor
from daemon.cell import val2_arm
from daemon.events.outcomes import Outcome
from daemon.maintenance.watchdog import Watchdog
from daemon.pick import approach, take
from daemon.pick.cycle import PickCycle
from daemon.pick.gripper_sensor import gripper_pair
from daemon.pick.outcome import PickResult
from daemon.pick.recogniser import PartRecogniser
from daemon.pick.transitions import PickState
from daemon.pick.world import PickContext, WorldModel, travel
from daemon.store.named_positions import NamedPositions
from daemon.store.runlog import RunLog
from drivers.puma560 import ArmGeometry
from drivers.rigid import rigid
from drivers.simcell.world import PartPlace
from drivers.val2 import commands, conversation
from drivers.val2.conversation import ControllerAnswer
from drivers.val2.link import Link
from drivers.val2.location import location_from_matrix
from drivers.val2.session import LineSession
from drivers.val2.wire import LineEvent, WhereTable
from tests.fakes.chosen import few
from tests.fakes.whole_daemon import Story, failing_writes

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

ON_THE_WAY_S = 12.0
"""After `pick`, seconds of the cell: a look is being worked out, or the arm is on its way to one."""
Act = Callable[[Story], str | None]
Guard = tuple[object, str, Any]
"""What is taken away, and what is there instead."""


def nothing(*_: object) -> None:
    """In place of a guard."""


async def none_of_it(*_: object) -> None:
    """In place of a guard that waits."""


def remembered_speed() -> Callable[[float], str]:
    """SPEED typed only where it is another than was typed last, as if nobody else could set it."""
    last = list[float]()

    def speed(percent: float) -> str:
        known = last[-1:] == [percent]
        last.append(percent)
        return "WHERE" if known else f"SPEED {percent:g}"

    return speed


HEARS_OTHERS: Guard = (LineSession, "_refuse_others", nothing)
LONGER = rigid(np.eye(3), [0.0, 0.0, -100.0])
"""A tool that reaches 100 mm less far than ours does."""
COUNTS_RELEASED: Guard = (take, "released", lambda label, *_: PickResult(Outcome.PICKED, label, None))
COMPARES_WHERE: Guard = (Mover, "_check_not_moved", nothing)


def still_empty(before: CellBelief, change: VoidingEvent) -> CellBelief:
    """As if nobody could have closed a gripper that facetd has opened."""
    after = voided(before, change)
    return after if after.holding is None else replace(after, holding=before.holding)


async def opened_here(context: PickContext, world: WorldModel, *about: Any, **how: Any) -> None:
    """As if what is taken for empty could be opened anywhere."""
    closed = context.mover.belief.closed
    if closed is None or closed.value:
        await context.mover.set_gripper(closed=False)
    await travel(context, world, *about, **how)


OPENS_OVER_THE_BIN: tuple[Guard, ...] = ((belief, "voided", still_empty), (approach, "travel", opened_here))


async def no_events(*_: object) -> list[object]:
    """In place of what is heard as the prompt is found."""
    return []


def of_the_first_table(
    command: str, events: Sequence[LineEvent], *about: Any, answer: Callable[..., Any] = conversation.answer_from
) -> ControllerAnswer:
    """An answer in which the first table counts, as if nothing of before could come ahead of it."""
    tables = [event.where for event in events if isinstance(event, WhereTable)]
    return replace(answer(command, events, *about), where=tables[0] if tables else None)


TAKES_ANSWERS_IN_TURN: tuple[Guard, ...] = (
    (LineSession, "recover", no_events),
    (conversation, "answer_from", of_the_first_table),
    HEARS_OTHERS,
)
"""The answer that comes first is taken for that of the question asked last, and what comes behind it for nothing."""


def context_of_the_cycle(cycle: PickCycle, recogniser: PartRecogniser | None = None) -> PickContext:
    """A pick's context that has whatever its cycle has at the moment."""

    class Present(PickContext):
        recogniser = property(lambda _: cycle.recogniser, nothing)
        settings = property(lambda _: cycle.settings, nothing)
        placing = property(lambda _: cycle.placing, nothing)

    own = recogniser or cycle.recogniser
    assert own is not None
    return Present(cycle.cell, cycle.supervisor.mover, own, cycle.settings, cycle.observer)


CONTEXT_OF_ITS_OWN: Guard = (PickCycle, "_context", context_of_the_cycle)
RELOADS_BETWEEN_JOBS: Guard = (Supervisor, "busy", property(lambda _: False))
REFITS_BETWEEN_JOBS: Guard = (Supervisor, "refuse_during_job", nothing)
SAYS_GAPS: Guard = (RunLog, "_write_gap", nothing)
TELLS_TROUBLE: Guard = (RunLog, "_tell", nothing)


@contextmanager
def without(*guards: Guard) -> Iterator[None]:
    """The guards taken away."""
    with ExitStack() as taken:
        for owner, name, instead in guards:
            taken.enter_context(patch.object(owner, name, instead))
        yield


def found(act: Act, **how: Any) -> str:
    """What is found in a story of an arm that is enabled: the rules that were broken, also such as the story itself
    names; nothing where none was."""
    story = Story(**how)
    try:
        typed(story, "enable", 0.7)
        wrong = act(story)
        rules = {violation.rule for violation in story.violations()} | ({wrong} if wrong else set())
    finally:
        at_the_end = {violation.rule for violation in story.close()}
    return ", ".join(sorted(rules | at_the_end))


def typed(story: Story, text: str, seconds: float) -> None:
    """At the first frontend, and what comes of it for a while."""
    story.sockets[0].say(text)
    story.wait(seconds)


def until(story: Story, so: Callable[[], bool], within_s: float = 120.0) -> None:
    """Wait for something in the cell."""
    deadline_s = story.now_s + within_s
    while not so():
        assert story.now_s < deadline_s, f"it never came to that: {story.texts[-3:]}"
        story.wait(0.1)


@pytest.fixture(autouse=True, params=few([False, True], 1), ids=["with guards", "and without"])
def without_guards(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether each story is lived without its guards as well, in `make test-long`: that shows that it proves a rule."""
    monkeypatch.setattr(sys.modules[__name__], "WITHOUT_GUARDS", request.param)


WITHOUT_GUARDS = False


def proven(act: Act, rule: str, *guards: Guard, **how: Any) -> None:
    """Nothing is found as it is, and the rule is seen broken without the guards."""
    assert found(act, **how) == ""
    if WITHOUT_GUARDS:
        with without(*guards):
            assert rule in found(act, **how)


def picking(story: Story) -> None:
    """Home, and on the way to a part."""
    typed(story, "go home", 20.0)
    typed(story, "pick", ON_THE_WAY_S)


def test_an_arm_that_the_pendant_moves_amid_a_pick_begins_no_way_from_where_it_is_not():
    def act(story: Story) -> None:
        picking(story)
        story.by_pendant(0, 90.0, at_rest=True)
        story.wait(50.0)

    proven(act, "step too long", COMPARES_WHERE, parts=True)


def test_a_speed_that_another_terminal_sets_is_no_moves_speed():
    def act(story: Story) -> None:
        typed(story, "go home", 20.0)
        story.type_beside("SPEED 100")
        for text in ("resume", "enable", "go survey"):
            typed(story, text, 5.0)
        story.wait(20.0)

    proven(act, "too fast", HEARS_OTHERS, (commands, "speed", remembered_speed()))


@pytest.mark.parametrize("frontend", [0, 3])
def test_a_line_that_another_terminal_typed_is_noticed_by_the_next_exchange_and_reported_to_all(frontend: int):
    def act(story: Story) -> None:
        story.type_beside("SPEED 50")
        story.wait(0.1)
        story.frontends[frontend].say("where")
        story.wait(20.0)

    proven(act, "not noticed", HEARS_OTHERS)
    if frontend == 3:
        proven(act, "not reported", (Supervisor, "stop_arm", none_of_it))


def test_a_speed_of_programs_that_another_terminal_sets_multiplies_no_moves_speed():
    def act(story: Story) -> None:
        typed(story, "go home", 20.0)
        story.type_beside("DO SPEED 300 ALWAYS")
        for text in ("resume", "enable", "go survey"):
            typed(story, text, 5.0)
        story.wait(20.0)

    proven(act, "too fast", HEARS_OTHERS, (commands, "PROGRAM_SPEED", "WHERE"))


def test_a_tool_that_another_terminal_sets_moves_no_arm():
    def act(story: Story) -> None:
        typed(story, "go home", 20.0)
        story.type_beside(commands.tool(location_from_matrix(ArmGeometry().tool_for_controller @ LONGER)))
        for text in ("go home", *["jog z -60"] * 4):
            typed(story, text, 8.0)

    unseen: Guard = (val2_arm, "belongs_together", lambda *_: True)
    proven(act, "below the table", HEARS_OTHERS, unseen, (motion, "_check_configuration", nothing))


def test_a_motion_that_another_terminal_typed_is_noticed_before_the_next_move():
    def act(story: Story) -> None:
        picking(story)
        until(story, story.cell.controller.machine.at_rest)
        story.type_beside("DO DRIVE 1,85,100")
        story.wait(50.0)

    proven(act, "step too long", HEARS_OTHERS, COMPARES_WHERE, parts=True)


def test_a_controller_that_repeats_an_old_place_begins_no_way_from_there():
    def act(story: Story) -> None:
        typed(story, "go home", 20.0)
        story.by_pendant(0, 90.0)
        story.wait(8.0)
        story.harm(lambda: setattr(story.cell.controller.faults, "repeated_places", 2))
        typed(story, "go home", 20.0)

    proven(act, "step too long", COMPARES_WHERE)


def pick_up_to(story: Story, state: PickState) -> None:
    """A pick has come so far."""
    typed(story, "pick cube", 1.0)
    context = story.context
    until(story, lambda: context.cycle.state is state)


def picked_or(story: Story, wrong: str) -> str | None:
    """Wait for the end of a pick: nothing where a cube was picked, else what is wrong."""
    story.wait_for(story.sockets[0], 60.0)
    return None if any(text.startswith("picked") for text in story.texts) else wrong


def test_a_part_that_slips_on_the_way_to_the_bin_is_not_counted_as_picked():
    def act(story: Story) -> None:
        pick_up_to(story, PickState.BIN)
        story.move_part("slips")
        story.wait(40.0)

    proven(act, "not in the bin", COUNTS_RELEASED, parts=True)


def test_a_part_that_somebody_takes_amid_a_pick_is_not_counted_as_picked():
    def act(story: Story) -> None:
        pick_up_to(story, PickState.CLOSING)
        while any(part.where is PartPlace.TABLE for part in story.cell.world.parts):
            story.move_part("is taken")
        story.wait(40.0)

    proven(
        act, "not in the bin", (take, "_judged", lambda *_: ("shows in the gripper", None)), COUNTS_RELEASED, parts=True
    )


@pytest.mark.parametrize("how", few(["stop", "abort", "disable"], 1))
def test_a_part_that_the_pendant_closed_the_gripper_on_falls_nowhere_but_into_the_bin(how: str):
    def act(story: Story) -> None:
        pick_up_to(story, PickState.BIN)
        story.wait_for(story.sockets[0], 60.0)
        typed(story, "scatter cube", 3.0)
        typed(story, how, 3.0)
        story.close_by_pendant()
        for text in ("resume", "enable"):
            typed(story, text, 1.0)
        typed(story, "pick cube", 60.0)

    proven(act, "dropped", *OPENS_OVER_THE_BIN, parts=True)


def test_another_arm_behind_the_adapter_moves_by_nobodys_leave_but_a_new_one():
    def act(story: Story) -> None:
        typed(story, "go home", 20.0)
        story.exchange_arm(0, 20.0)
        story.repair()
        story.wait(20.0)
        for text in ("robot power-up", "resume", "robot cal", "go home"):
            typed(story, text, 3.0)
            story.sockets[0].answer("y")
            story.wait(15.0)

    proven(act, "not permitted", (Supervisor, "line_opened_anew", nothing), (Link, "_void_stop_test", nothing))


@pytest.mark.parametrize("text", ["auto on", "pick cube"])
def test_what_was_held_still_goes_on_by_nobodys_leave_but_a_new_one(text: str):
    def act(story: Story) -> None:
        typed(story, text, 2.0)
        story.hang(30.0)
        story.wait(20.0)

    proven(act, "motion after stop", (Watchdog, "_check_sleep", none_of_it), parts=True)


def test_another_cell_that_is_read_disables_the_arm():
    def act(story: Story) -> None:
        typed(story, "go home", 20.0)
        story.write_config(limits={"box_low_mm": [0, -600, -300]})
        story.frontends[1].say("reload")
        story.wait(2.0)
        typed(story, "go survey", 10.0)

    proven(act, "not permitted", (Supervisor, "disable", none_of_it))


def test_a_gripper_that_the_pendant_moves_from_above_the_bin_does_not_open():
    def act(story: Story) -> None:
        pick_up_to(story, PickState.BIN)
        pair = gripper_pair

        async def as_it_looks(*about: Any) -> Any:
            taken = await pair(*about)
            story.by_pendant(0, 40.0)
            await asyncio.sleep(10.0)
            return taken

        with patch.object(take, "gripper_pair", as_it_looks):
            story.wait(60.0)

    proven(act, "dropped", COMPARES_WHERE, parts=True)


def test_a_program_that_another_terminal_starts_amid_a_pick_is_noticed_before_the_next_move():
    def act(story: Story) -> None:
        machine = story.cell.controller.machine
        machine.memory.programs["SWEEP"] = ("DRIVE 1,45,100", "DRIVE 1,40,100")
        picking(story)
        until(story, machine.at_rest)
        story.type_beside("EXECUTE SWEEP")
        story.wait(50.0)

    proven(act, "step too long", HEARS_OTHERS, COMPARES_WHERE, parts=True)


def test_an_answer_that_comes_with_the_next_is_taken_for_no_answer_to_that():
    def act(story: Story) -> str | None:
        typed(story, "go home", 20.0)
        story.harm(lambda: setattr(story.cell.controller.faults, "late_answers", 1))
        typed(story, "where", 0.1)
        story.by_pendant(0, 5.0)
        until(story, lambda: not story.sockets[0].waits)
        told = [float(number) for number in re.findall(r"[xyz] +(-?[0-9.]+)", story.texts[-1])[:3]]
        true = story.cell.world_from_tool()[:3, 3]
        return None if told == pytest.approx(true, abs=5.0) else "an old answer"

    proven(act, "an old answer", *TAKES_ANSWERS_IN_TURN)


def test_a_model_that_is_taken_into_use_amid_a_pick_is_the_next_picks():
    def act(story: Story) -> str | None:
        typed(story, "pick cube", 0.1)
        story.replace_model(empty=True)
        return picked_or(story, "another model")

    proven(act, "another model", CONTEXT_OF_ITS_OWN, parts=True)


def test_a_bin_that_is_moved_amid_a_pick_is_the_next_picks():
    def act(story: Story) -> str | None:
        pick_up_to(story, PickState.LOOKING)
        story.write_config(bin={"point_mm": [250, 300, -150], "heading_deg": 58, "tilt_deg": 10})
        story.frontends[1].say("reload")
        return picked_or(story, "another bin")

    proven(act, "another bin", RELOADS_BETWEEN_JOBS, REFITS_BETWEEN_JOBS, CONTEXT_OF_ITS_OWN, parts=True)


def test_a_home_that_is_moved_amid_a_pick_is_the_next_picks():
    def act(story: Story) -> str | None:
        context = story.context
        before = context.cycle.positions()["home"]
        pick_up_to(story, PickState.LOOKING)
        story.write_config(home={"point_mm": [400, 60, 80], "heading_deg": 90, "tilt_deg": 20})
        story.frontends[1].say("reload")
        wrong = picked_or(story, "not picked")
        there = story.cell.world_from_tool()
        return wrong or (None if np.allclose(there, before, atol=1.0) else "another home")

    proven(act, "another home", RELOADS_BETWEEN_JOBS, REFITS_BETWEEN_JOBS, CONTEXT_OF_ITS_OWN, parts=True)


def test_a_place_that_is_written_amid_a_pick_is_the_next_picks():
    """No grasp of this cube can set it down there: a pick that heard of it would leave it alone."""

    def act(story: Story) -> str | None:
        typed(story, "pick cube", 0.1)
        story.write_places(nest=[850.0, -600.0, -300.0])
        story.frontends[1].say("reload")
        return picked_or(story, "another place")

    proven(act, "another place", RELOADS_BETWEEN_JOBS, REFITS_BETWEEN_JOBS, CONTEXT_OF_ITS_OWN, parts=True)


async def place_on_the_way(cycle: PickCycle) -> Any:
    """Where the arm is, whether it rests there or not."""
    return (await cycle.cell.robot.where()).world_from_tool


def test_a_position_that_is_named_amid_a_pick_is_no_place_on_the_way():
    def act(story: Story) -> str | None:
        machine = story.cell.controller.machine
        picking(story)
        until(story, lambda: not machine.at_rest())
        story.frontends[1].say("here spot")
        story.wait(1.0)
        story.wait_for(story.sockets[0], 60.0)
        typed(story, "positions", 0.5)
        return "on the way" if "spot" in story.texts[-1] else None

    proven(act, "on the way", (PickCycle, "wait_until_at_rest", place_on_the_way), parts=True)


def remembered_positions(now: Callable[[NamedPositions], dict[str, Any]] = NamedPositions.now) -> Any:
    """Positions that are read where a name is new, as if nobody could drop one."""
    known: dict[str, Any] = {}

    def remembered(positions: NamedPositions) -> dict[str, Any]:
        known.update(now(positions))
        return known

    return remembered


def test_a_position_that_is_dropped_while_the_arm_goes_there_is_gone_to_no_more():
    def act(story: Story) -> str | None:
        machine = story.cell.controller.machine
        for text in ("go home", "here spot", "go bin"):
            typed(story, text, 20.0)
        typed(story, "go spot", 0.5)
        until(story, lambda: not machine.at_rest())
        story.frontends[1].say("positions drop spot")
        story.wait(20.0)
        spot = story.cell.world_from_tool()
        for text in ("go bin", "go spot"):
            typed(story, text, 20.0)
        return "to where no position is" if np.allclose(story.cell.world_from_tool(), spot, atol=1.0) else None

    proven(act, "to where no position is", (NamedPositions, "now", remembered_positions()))


EVERY = 3
"""Of the writes of a pick one in so many fails; of as many picks every write fails once."""
UNSAID = ((SAYS_GAPS, "lost unsaid"), (TELLS_TROUBLE, "untold"))


@pytest.mark.parametrize(
    ("failing", "code", "proofs"),
    few([("all", errno.ENOSPC, UNSAID), *((k, errno.ENOSPC, ()) for k in range(EVERY)), ("all", errno.EROFS, ())], 2),
)
def test_of_a_pick_on_a_disk_that_fails_at_any_write_nothing_is_lost_unsaid(
    failing: int | str, code: int, proofs: Sequence[tuple[Guard, str]]
):
    def act(story: Story) -> str | None:
        with failing_writes(lambda n: failing in (n % EVERY, "all"), code) as lost:
            typed(story, "pick cube", 1.0)
            told = any("TROUBLE" in text for text in story.texts)
            wrong = picked_or(story, "not picked")
        typed(story, "scatter", 3.0)
        context = story.context
        records = [json.loads(line) for line in (context.run_log.folder / "run.jsonl").read_bytes().splitlines()]
        gaps = sum(record["lost"] for record in records if record["kind"] == "gap")
        return wrong or ("lost unsaid" if gaps < len(lost) else None if told else "untold")

    assert found(act, parts=True) == ""
    for guard, rule in proofs if WITHOUT_GUARDS else ():
        with without(guard):
            assert found(act, parts=True) == rule


@pytest.mark.parametrize("seconds", few([-1e5, 1e5], 1))
def test_a_clock_that_is_set_amid_a_pick_changes_nothing_of_it(seconds: float):
    def act(story: Story) -> str | None:
        typed(story, "pick cube", 3.0)
        story.set_by_s += seconds
        until(story, lambda: not story.sockets[0].waits)
        return None if story.texts[-1].startswith("picked") else "not picked"

    wall: Guard = (Story, "cell_clock", lambda story: story.loop.time() + story.set_by_s)
    proven(act, "not picked", wall, parts=True)


def test_a_hand_amid_the_parts_goes_aside_for_no_look_of_one_camera():
    def act(story: Story) -> str | None:
        for text in ("go survey", "cameras left", *["jog z -100"] * 3, *["jog z -40"] * 6):
            typed(story, text, 5.0)
        before = story.cell.world_from_tool()
        typed(story, "look", 1.0)
        return None if (story.cell.world_from_tool() == before).all() else "aside among the parts"

    proven(act, "aside among the parts", (Mover, "low", False))


def test_a_part_in_the_gripper_that_the_model_in_use_does_not_know_is_pressed_into_nothing():
    """The gripper was closed by hand, and then the model was emptied: nothing of what it held was guarded."""

    def act(story: Story) -> None:
        story.replace_model(empty=True)
        for text in ("hand close", "go home", "jog ry 20", *["jog z -100"] * 3, "jog z -45"):
            typed(story, text, 5.0)

    unguarded: tuple[Guard, ...] = ((PickCycle, "guard_the_hand", nothing), (PickCycle, "_assume_the_longest", nothing))
    proven(act, "pressed", *unguarded, holds=True)
