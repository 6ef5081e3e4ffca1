"""What random operators found, each as the shortest script that showed it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Generator, Iterator
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import yaml

from daemon.console.context import CommandContext
from drivers.puma560 import READY_RAD, ArmGeometry, configuration_of
from drivers.simcell.controller import Mishap
from drivers.simcell.controller.commands import Ask
from drivers.simcell.controller.faults import LineFault
from drivers.simcell.controller.machine import Machine
from drivers.simcell.controller.monitor import MONITOR_COMMANDS
from drivers.simcell.world import PartPlace
from drivers.val2.conversation import Conversation
from drivers.val2.wire import LineEvent, Prompt
from tests.fakes.first_day import arm_yaml
from tests.fakes.whole_daemon import SerialOperator, SocketOperator, Story
from tests.unit.val2.test_stop import refuses_where_without_a_zero

pytestmark = pytest.mark.slow
NO_LONGER = "The arm is disabled: pick.limits changed."


@pytest.fixture
def story() -> Iterator[Story]:
    story = Story()
    story.sockets[0].say("enable")
    story.wait(0.5)
    yield story
    story.close()


def test_a_fault_that_was_aborted_meanwhile_is_cleared_by_a_resume_that_says_so(story: Story) -> None:
    for text in ("stop", "abort", "resume"):
        story.sockets[2].say(text)
        story.wait(1.0)
    assert "Fault cleared" in story.texts[-1]
    assert story.violations() == ()


def test_what_the_cameras_see_in_the_hand_is_not_gone_round() -> None:
    """`look around` took the part in its own hand for one that lies there, and went round it, up beside the column: the
    elbow 29 mm through where a wall was. What the arm may go through there is test_sweep's: the elbow stays in the
    room."""
    story = Story(holds=True)
    for text in ("enable", "look around"):
        story.sockets[0].say(text)
        story.wait(0.7)
    before = story.cell.world_from_tool()
    story.wait(8.0)
    assert any("a part is in the gripper: `hand open` drops it where the arm is" in text for text in story.texts)
    assert (story.cell.world_from_tool() == before).all()
    assert story.close() == ()


def test_a_calibration_that_is_refused_while_a_part_is_let_go_puts_no_part_back_into_the_hand() -> None:
    """What may be in the hand was guarded before it was known whether the arm was free: the hand was open by then, and
    every pick after it was told to be out of reach with what it did not hold."""
    story = Story(holds=True)
    story.write_config(hand_s=1.0)
    for text in ("reload", "enable", "pick"):
        story.sockets[0].say(text)
        story.wait(0.5)
    while story.cell.controller.machine.hand_closed:
        story.wait(0.1)
    story.wait(0.3)
    story.sockets[1].say("calibrate verify")
    story.wait(3.0)
    context = story.context
    assert "busy: pick" in story.texts
    assert context.cycle.belief.holds_part is False
    assert context.cycle.supervisor.mover.belief.capsules == ()
    assert story.close() == ()


def test_a_job_that_was_ended_before_it_began_leaves_nothing_behind(story: Story) -> None:
    story.sockets[0].say("hand close")
    story.sockets[1].say("stop")
    story.wait(1.0)
    assert story.violations() == ()


@pytest.mark.parametrize("text", ["stop '", "stop \\", 'stop "now'])
def test_a_stop_with_a_quote_left_open_stops_the_arm(story: Story, text: str) -> None:
    story.sockets[0].say("go bin")
    story.wait(0.3)
    story.sockets[1].say(text)
    story.wait(3.0)
    assert story.violations() == ()


def test_control_c_after_the_line_was_lost_on_the_way_does_not_say_that_nothing_moves(story: Story) -> None:
    story.sockets[0].say("go bin")
    story.wait(0.5)
    story.harm(story.line.unplug)
    story.wait(0.1)
    assert not story.cell.controller.machine.at_rest()
    story.sockets[1].interrupt()
    story.wait(0.02)
    assert "Nothing moves." not in story.texts


@pytest.mark.parametrize("frontend", [0, 3])
def test_a_move_typed_ahead_behind_an_enable_goes_once_the_stop_was_tried(frontend: int) -> None:
    story = Story()
    for text in ("enable", "go home"):
        story.frontends[frontend].say(text)
    story.wait(0.9)
    assert not story.cell.controller.machine.at_rest()
    assert story.close() == ()


def test_a_resume_said_while_the_arm_is_being_stopped_asks_nothing_and_clears_nothing_later(story: Story) -> None:
    """Its question was answered once the arm was at rest: the stop of somebody else was cleared by a word before it."""
    for text, seconds in (("hand close", 1.0), ("go bin", 0.5)):
        story.sockets[0].say(text)
        story.wait(seconds)
    story.sockets[1].say("stop")
    story.sockets[0].say("resume")
    story.wait(0.02)
    assert any("still stopping the arm" in text for text in story.texts)
    assert story.sockets[0].question is None
    story.wait(2.0)
    assert story.violations() == ()


def test_control_c_stops_what_somebody_else_begins_while_it_asks_whether_anything_moves(story: Story) -> None:
    """It said that nothing moves, and the arm set out a tenth of a second later."""
    story.sockets[1].interrupt()
    story.wait(0.01)
    story.sockets[0].say("go bin")
    story.wait(5.0)
    assert "Nothing moves." not in story.texts
    assert story.violations() == ()


def test_a_resume_whose_auto_cannot_go_on_says_that_the_fault_is_cleared(story: Story) -> None:
    """It said `busy`, as if nothing had been done: the fault was gone, and the hand opened."""
    for text in ("auto on 2", "stop"):
        story.sockets[0].say(text)
        story.wait(1.0)
    story.sockets[0].say("resume")
    story.wait(0.1)
    story.sockets[0].answer("y")
    story.sockets[1].say("hand open")
    story.wait(2.0)
    assert any("Fault cleared" in text for text in story.texts)
    assert story.violations() == ()


def test_a_hand_word_that_left_before_the_stop_is_carried_out_by_a_controller_whose_line_was_pulled() -> None:
    story = Story(holds=True, prompt_at_end=True)
    story.sockets[0].say("enable")
    story.wait(0.1)
    story.sockets[0].say("hand open")
    story.wait(0.1)
    story.harm(story.line.unplug)
    story.sockets[0].say("abort")
    story.wait(1.0)
    assert not story.cell.controller.machine.hand_closed, "nobody could tell it not to"
    assert story.close() == ()


def test_whether_a_hand_that_was_stopped_as_it_let_go_holds_its_part_still_is_asked() -> None:
    """It was said to hold it, which lay on the floor by then; the next pick told that it had put it into the bin."""
    story = Story(holds=True)
    story.sockets[0].say("enable")
    story.wait(1.0)
    story.sockets[0].say("hand open")
    story.wait(0.31)
    story.sockets[1].say("stop")
    story.wait(2.0)
    assert not story.cell.controller.machine.hand_closed
    story.sockets[0].say("resume")
    story.wait(0.3)
    assert story.sockets[0].question is not None
    assert "Is a part in the gripper?" in story.sockets[0].question[1]
    assert story.close() == ()


def test_a_hand_that_holds_a_part_and_is_said_to_hold_none_opens_over_the_bin() -> None:
    """Nobody had looked, and the next pick opened it where it looked from: the part fell 250 mm."""
    story = Story(parts=True)
    for text in ("enable", "pick"):
        story.sockets[0].say(text)
        story.wait(0.3)
    while not story.cell.controller.machine.hand_closed:
        story.wait(0.2)
    story.wait(2.0)
    for text in ("disable", "holding no", "enable", "pick"):
        story.sockets[1].say(text)
        story.wait(2.0)
    assert story.texts.count("The gripper is assumed empty; the next pick opens it above the bin anyway.") == 1
    story.wait(45.0)
    assert sum(part.where is PartPlace.BIN for part in story.cell.world.parts) == 2
    assert story.close() == ()


def test_a_hand_told_to_open_before_something_else_was_typed_may_drop_what_it_holds() -> None:
    story = Story(holds=True)
    story.sockets[0].say("enable")
    story.wait(2.0)
    for text in ("hand open", "enable"):
        story.sockets[0].say(text)
    story.wait(2.0)
    assert story.close() == ()


@pytest.mark.parametrize("prompt_at_end", [False, True])
def test_an_arm_whose_controller_was_switched_off_in_a_stop_is_not_called_stopped_before_its_brakes_hold_it(
    prompt_at_end: bool,
) -> None:
    story = Story(prompt_at_end=prompt_at_end)
    for text, seconds in (("enable", 0.5), ("go bin", 0.5)):
        story.sockets[0].say(text)
        story.wait(seconds)
    story.sockets[0].interrupt()
    story.wait(0.02)
    story.mishap(Mishap.POWER_CYCLED)
    story.wait(3.0)
    assert "Stopped. Nothing moves until `resume`." in story.texts
    assert story.close() == ()


def without_hand_eye(story: Story) -> None:
    """From the next reload on nobody knows how the cameras sit on the hand."""
    file = story.folder / "calibration.yaml"
    content = yaml.safe_load(file.read_bytes())
    del content["hand_eye"]
    file.write_bytes(yaml.safe_dump(content).encode())


@pytest.mark.parametrize("reloaded", ["before it was asked", "while it was asked"])
def test_a_resume_that_would_go_on_lets_no_arm_move_whose_calibration_has_no_hand_eye(
    story: Story, reloaded: str
) -> None:
    """`enable` refused the same calibration; the yes to `go on?` let the arm move by the unit matrix."""
    for text in ("auto on 2", "stop", "disable"):
        story.sockets[0].say(text)
        story.wait(1.0)
    without_hand_eye(story)
    words = [(1, "reload"), (0, "resume")]
    for frontend, text in words if reloaded == "before it was asked" else words[::-1]:
        story.sockets[frontend].say(text)
        story.wait(0.5)
    if story.sockets[0].question is not None:
        story.sockets[0].answer("y")
    story.wait(2.0)
    assert story.cell.controller.machine.at_rest()
    assert not any("Going on" in text for text in story.texts)
    assert story.violations() == ()


def test_a_reload_that_is_refused_after_it_had_disabled_the_arm_takes_nothing_over(story: Story) -> None:
    """Half of it was: the guard's old limits stood beside the new file."""
    story.write_config(limits={"box_low_mm": [0, -600, -300], "max_speed_pct": 40})
    story.sockets[0].say("reload")
    story.wait(0.01)
    story.sockets[1].say("where")
    story.wait(1.0)
    refused = "busy: where; settings are changed only when that has ended: wait, or `abort`"
    disabled = f"The arm is disabled; nothing else has changed, as the reload was refused: {refused}"
    assert {refused, disabled} <= set(story.texts)
    assert NO_LONGER not in story.texts
    context = story.context
    guarded, read = context.cycle.settings.limits, context.config.values.pick.limits
    assert guarded.box_low_mm == read.box_low_mm == (0, -650, -300)
    assert story.violations() == ()


def test_a_reload_guards_no_other_arm_than_the_one_that_stands_there(story: Story) -> None:
    """An arm.yaml of a smaller arm, for the next start: its body was guarded at once, and the larger arm moved on."""
    context = story.context
    before = context.cycle.settings.limits.capsules
    small = yaml.safe_dump(arm_yaml(ArmGeometry(203.2, 0.0, 127.0, 203.2)))
    (story.folder / "arm.yaml").write_text(small)
    with (story.folder / "facetd.yaml").open("a") as file:
        file.write("arm: {file: arm.yaml}\n")
    story.sockets[0].say("reload")
    story.wait(1.0)
    assert any("Takes effect after a restart: arm" in text for text in story.texts)
    assert context.cycle.settings.limits.capsules == before
    assert story.violations() == ()


def test_whoever_asked_for_a_reload_is_told_once_that_it_has_disabled_the_arm(story: Story) -> None:
    """By the answer: the notice to all frontends said the same above it. (All sockets here are one operator's.)"""
    story.write_config(limits={"box_low_mm": [0, -600, -300], "max_speed_pct": 40})
    story.sockets[0].say("reload")
    story.wait(1.0)
    told = [text for text in story.texts if NO_LONGER in text]
    assert told == [f"The configuration is reloaded. {NO_LONGER}"]


def test_of_two_reloads_the_later_one_counts(story: Story) -> None:
    """The first one waited for the arm's stop, and then took over what it had read before the second one, whose limits
    were said to be taken over and held no more."""
    for frontend, most_mm in ((0, 400.0), (1, 300.0)):
        story.write_config(limits={"max_step_mm": most_mm})
        story.sockets[frontend].say("reload")
        story.wait(0.01)
    story.wait(2.0)
    context = story.context
    assert context.cycle.settings.limits.max_step_mm == context.config.values.pick.limits.max_step_mm == 300.0
    assert story.violations() == ()


def test_a_yes_to_go_on_counts_only_in_the_cell_that_it_was_asked_in(story: Story) -> None:
    """Limits and gripper were others by then, and the arm set out; an arm that was enabled had been disabled."""
    for text in ("auto on 2", "stop", "disable", "resume"):
        story.sockets[0].say(text)
        story.wait(1.0)
    assert "Enable the arm and continue?" in (story.sockets[0].question or (0, ""))[1]
    story.write_config(limits={"max_step_mm": 300.0})
    story.sockets[1].say("reload")
    story.wait(0.5)
    story.sockets[0].answer("y")
    story.wait(2.0)
    assert story.cell.controller.machine.at_rest()
    assert any("type `resume` again" in text for text in story.texts)
    assert story.violations() == ()


def test_a_yes_to_walk_round_a_part_is_void_where_the_arm_was_stopped_since_it_was_asked_for(story: Story) -> None:
    """`abort` leaves no fault: who had said it was told that the arm is stopped, and it set out."""
    story.sockets[0].say("teach cube --around 6")
    story.wait(1.0)
    story.sockets[1].say("abort")
    story.wait(1.0)
    assert "Move the arm?" in (story.sockets[0].question or (0, ""))[1]
    story.sockets[0].answer("y")
    story.wait(2.0)
    assert any("somebody stopped the arm meanwhile" in text for text in story.texts)
    assert story.cell.controller.machine.at_rest()
    assert story.violations() == ()


def test_who_let_the_arm_go_round_a_part_is_not_told_that_it_would_have_gone(story: Story) -> None:
    """Whether `dry` was on was asked before the question, and somebody else switched it off before the yes."""
    story.cell.place_for_teaching("cube", 0)
    for frontend, text in ((1, "dry on"), (0, "teach cube --around 6"), (1, "dry off")):
        story.sockets[frontend].say(text)
        story.wait(1.0)
    assert "Move the arm?" in (story.sockets[0].question or (0, ""))[1]
    story.sockets[0].answer("y")
    before = story.cell.world_from_tool()
    story.wait(60.0)
    assert (story.cell.world_from_tool() != before).any()
    assert not any("a dry run learns nothing" in text for text in story.texts)
    assert story.violations() == ()


@pytest.mark.parametrize("key", ["", "W"])
def test_a_line_that_is_lost_while_a_person_has_the_controllers_terminal_is_told_and_the_arm_is_stopped(
    story: Story, key: str
) -> None:
    """The daemon stood aside: nothing was said of it at any frontend, and the next key hung up whoever pressed it."""
    story.cell.motion_monitor.typed_by_person(story.stamp_s(), "DO READY")
    story.sockets[0].say("robot monitor")
    story.wait(0.5)
    for keys in ("SPEED 4\r", "DO READY\r", "y"):
        story.sockets[0].send({"keys": keys})
        story.wait(0.5)
    assert not story.cell.controller.machine.at_rest()
    story.harm(story.line.unplug)
    story.sockets[0].send({"keys": key})
    story.wait(6.0)
    assert story.sockets[0].line is not None
    assert any("the port is gone; NOT CONFIRMED" in text for text in story.texts)
    assert story.violations() == ()


def test_a_question_that_somebody_left_before_the_start_is_answered_by_nobody_as_if_it_were_power_ups(
    story: Story, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`robot power-up` said yes to it: the program went on, with an arm that was not enabled."""

    def asking(machine: Machine, _: str) -> Generator[Ask, str]:
        if (yield Ask("Another part (Y/N)?")).startswith("Y"):
            machine.move_joints(READY_RAD)

    monkeypatch.setitem(MONITOR_COMMANDS, "EXECUTE", asking)
    story.terminate()
    story.cell.controller.receive(b"EXEC PROG\r", story.now_s)
    story.start()
    story.wait(30.0)
    assert any("asks `Another part (Y/N)?`: `stop` answers N" in text for text in story.texts)
    story.sockets[0].say("robot power-up")
    story.wait(2.0)
    assert any("not a known power-up question" in text for text in story.texts)
    story.sockets[0].say("stop")
    story.wait(3.0)
    assert story.cell.controller.question is None
    assert story.violations() == ()


def test_a_pause_said_after_a_resume_was_asked_for_holds_what_its_yes_sets_going(story: Story) -> None:
    """The yes to a question from before let go what somebody else had held since."""
    story.sockets[0].say("auto on")
    story.wait(0.3)
    story.sockets[1].say("stop")
    story.wait(1.0)
    story.sockets[0].say("resume")
    story.wait(0.3)
    assert "Enable the arm and continue?" in (story.sockets[0].question or (0, ""))[1]
    story.sockets[1].say("pause")
    story.wait(0.3)
    story.sockets[0].answer("y")
    story.wait(4.0)
    assert story.violations() == ()
    assert any("Motion is paused:" in text for text in story.texts)


def test_a_resume_that_was_typed_before_the_pause_of_somebody_else_could_be_read_lets_nothing_go(story: Story) -> None:
    """It was for a pause of before: the arm set out before the cameras of whoever had just had it held."""
    for text in ("pause", "go bin"):
        story.sockets[0].say(text)
        story.wait(2.0)
    before = story.cell.world_from_tool()
    story.terminal.say("pause")
    story.wait(0.3)
    story.sockets[0].say("resume")
    story.wait(3.0)
    assert any("paused less than 1 s ago; `resume` again" in text for text in story.texts)
    assert (story.cell.world_from_tool() == before).all()
    story.sockets[0].say("resume")
    story.wait(3.0)
    assert (story.cell.world_from_tool() != before).any()
    assert story.violations() == ()


def test_what_is_in_the_hand_is_not_said_to_be_gone_under_an_arm_that_carries_it() -> None:
    """The rest of its way was guarded as if nothing were in the hand."""
    story = Story(holds=True)
    for text in ("enable", "go bin"):
        story.sockets[0].say(text)
        story.wait(0.5)
    story.sockets[1].say("holding no")
    story.wait(0.1)
    assert any("busy: bin" in text for text in story.texts)
    assert story.close() == ()


@pytest.mark.parametrize("meanwhile", [("resume", "holding yes", "go bin"), ("holding yes",)])
def test_an_answer_to_what_is_in_the_hand_counts_only_as_long_as_things_are_as_it_was_asked(
    meanwhile: tuple[str, ...],
) -> None:
    """Somebody else had said it meanwhile, and the arm was on its way with the part: it was guarded no more."""
    story = Story(holds=True)
    context = story.context
    story.sockets[0].say("enable")
    story.wait(0.5)
    closed_by_a_word(story)
    for text in ("stop", "resume"):
        story.sockets[0].say(text)
        story.wait(0.7)
    assert story.sockets[0].question is not None
    for text in meanwhile:
        story.sockets[2].say(text)
        story.wait(0.5)
    carried = context.cycle.supervisor.mover.belief.capsules
    story.sockets[0].answer("n")
    story.wait(0.2)
    assert context.cycle.status()["holding"] is True
    assert context.cycle.supervisor.mover.belief.capsules == carried
    assert any("another operator resumed meanwhile" in text for text in story.texts)
    assert story.close() == ()


def test_what_was_left_of_an_auto_and_was_given_up_meanwhile_is_not_taken_up_by_a_yes_from_before(
    story: Story,
) -> None:
    for text, seconds in (("auto on 2", 0.3), ("stop", 1.0), ("resume", 0.3)):
        story.sockets[0].say(text)
        story.wait(seconds)
    assert "Enable the arm and continue?" in (story.sockets[0].question or (0, ""))[1]
    story.sockets[1].say("auto off")
    story.wait(0.3)
    story.sockets[0].answer("y")
    story.wait(2.0)
    assert story.cell.controller.machine.at_rest()
    assert any("cancelled the interrupted auto" in text for text in story.texts)
    assert story.violations() == ()


@pytest.mark.parametrize("told", ["at the monitor", "otherwise"])
def test_no_arm_that_was_told_to_turn_its_wrist_over_goes_a_way_that_nobody_looked_along_and_is_told_to_be_there(
    story: Story, told: str
) -> None:
    """FLIP at the controller's monitor turned joints 4 and 6 by half a turn each on the next way."""
    story.sockets[0].say("go home")
    story.wait(4.0)
    machine = story.cell.controller.machine
    before = configuration_of(machine.joints())
    if told == "otherwise":
        machine.wanted = replace(machine.wanted, flip=True)
    for text in ("robot monitor DO FLIP", "go bin"):
        story.sockets[0].say(text)
        story.wait(0.3)
        if story.sockets[0].question is not None:
            story.sockets[0].answer("y")
        story.wait(8.0)
    turned_over = configuration_of(machine.joints()) != before
    assert turned_over is (told == "otherwise")
    assert ("At bin." in story.texts) is not turned_over
    assert any("against the planned path" in text for text in story.texts) is turned_over
    assert story.violations() == ()


def test_an_arm_that_a_pendant_turned_over_waits_also_where_somebody_else_has_typed_since(story: Story) -> None:
    """What was known of the wrist was dropped with all else, and a move turned it back, the camera bar into a post."""
    story.sockets[0].say("go bin")
    story.wait(8.0)
    there = story.cell.controller.machine.joints()
    story.by_pendant(4, -2.0 * float(np.degrees(there[4])))
    story.wait(8.0)
    story.type_beside("WHERE")
    for text in ("go survey", "resume", "enable", "go survey"):
        story.sockets[0].say(text)
        story.wait(8.0)
        if story.sockets[0].question is not None:
            story.sockets[0].answer("y")
            story.wait(8.0)
    assert any("turned shoulder, elbow or wrist over" in text for text in story.texts), story.texts
    assert configuration_of(story.cell.controller.machine.joints()) != configuration_of(there)
    assert story.violations() == ()


def test_a_hand_amid_the_parts_goes_aside_for_no_look_of_one_camera(story: Story) -> None:
    """Asked to look where it had been stopped, 6 mm above the table, it went 40 mm aside through them, and back."""
    story.sockets[0].say("go survey")
    story.wait(6.0)
    story.sockets[0].say("cameras left")
    story.wait(3.0)
    for text in ["jog z -100"] * 3 + ["jog z -40"] * 6:
        story.sockets[0].say(text)
        story.wait(3.0)
    story.sockets[0].say("look")
    before = story.cell.world_from_tool()
    story.wait(0.5)
    assert story.cell.controller.machine.at_rest()
    assert (story.cell.world_from_tool() == before).all()
    assert any("raise it first, for example `jog z 50`" in text for text in story.texts)
    assert story.violations() == ()


def test_an_arm_whose_controller_was_switched_off_is_enabled_by_nothing_but_enable(story: Story) -> None:
    """`resume` said so; whoever came back from the controller's terminal, nothing typed there, had the stop seen to
    work again, and the arm might move."""
    story.sockets[0].say("go bin")
    story.wait(0.5)
    story.sockets[0].interrupt()
    story.wait(0.02)
    story.mishap(Mishap.POWER_CYCLED)
    story.wait(1.2)
    for text in ("robot power-up", "resume", "robot monitor"):
        story.sockets[0].say(text)
        story.wait(0.4)
    assert any("The arm is disabled: `enable`" in text for text in story.texts)
    story.sockets[0].send({"leave": True})
    story.wait(2.0)
    context = story.context
    assert context.hardware.robot.permission.stop_tests
    assert not context.cycle.status()["enabled"]
    assert story.violations() == ()


def answered_at_its_own_terminal(story: Story) -> None:
    story.sockets[0].say("robot monitor")
    story.wait(0.5)
    for keys in ("Y\r", "Y\r"):
        story.sockets[0].send({"keys": keys})
        story.wait(0.5)
    story.sockets[0].send({"leave": True})


def answered_by_us(story: Story) -> None:
    for text in ("where", "robot power-up"):
        story.sockets[0].say(text)
        story.wait(1.0)


@pytest.mark.parametrize("answered", [answered_at_its_own_terminal, answered_by_us])
def test_an_arm_whose_controller_was_switched_off_as_it_stood_there_is_not_enabled_any_more(
    story: Story, answered: Callable[[Story], None]
) -> None:
    """It stayed so: the stop was taken for seen to work until a stop met the questions. CAL went by no `enable`."""
    story.mishap(Mishap.POWER_CYCLED)
    story.repair()
    answered(story)
    story.wait(2.0)
    assert story.cell.controller.question is None
    story.sockets[0].say("robot cal")
    story.wait(1.0)
    if story.sockets[0].question is not None:
        story.sockets[0].answer("y")
    story.wait(3.0)
    assert "the arm is not enabled: `enable` first" in story.texts
    assert not story.cell.controller.machine.calibrated
    assert story.violations() == ()


def test_a_move_that_dry_keeps_back_is_not_said_to_be_sent(story: Story) -> None:
    for text in ("dry on", "step on", "go bin"):
        story.sockets[2].say(text)
        story.wait(1.2)
    story.sockets[0].say("confirm")
    story.wait(1.0)
    assert "Move confirmed." in story.texts
    assert not any(text.startswith("Sent") for text in story.texts)
    assert story.cell.controller.machine.at_rest()
    assert story.violations() == ()


def test_a_move_that_is_held_is_not_said_to_be_sent(story: Story) -> None:
    """It was, and set out at the `resume` of somebody else."""
    for text in ("step on", "go bin"):
        story.sockets[2].say(text)
        story.wait(0.5)
    for text in ("pause", "confirm"):
        story.sockets[0].say(text)
        story.wait(0.7)
    assert "Move confirmed." not in story.texts
    assert any("Motion is paused: `resume` sends the move" in text for text in story.texts)
    assert story.cell.controller.machine.at_rest()
    assert story.violations() == ()


def test_an_arm_that_its_pendant_moved_while_a_way_down_was_held_goes_aslant_to_no_place_amid_the_parts(
    story: Story,
) -> None:
    """The way to a low place ends straight down, for the parts that lie there. Held before that, and moved aside, the
    hand went aslant through them."""
    for text, seconds in (("holding no", 0.5), ("go survey", 6.0)):
        story.sockets[0].say(text)
        story.wait(seconds)
    for text in ["jog z -100"] * 3 + ["jog z -40", "here low", "jog z 40", "jog z 100", "step on", "go low"]:
        story.sockets[2].say(text)
        story.wait(3.0)
    above = story.cell.world_from_tool()
    story.sockets[0].say("confirm")
    story.wait(3.0)
    machine = story.cell.controller.machine
    aside = machine.pose()
    aside[1, 3] += 150.0
    machine.arm.move_joints(machine.joints_for(aside), 0.3, machine.now_s)
    story.wait(3.0)
    before = story.cell.world_from_tool()
    assert before[2, 3] < above[2, 3]
    story.sockets[0].say("confirm")
    story.wait(3.0)
    assert (story.cell.world_from_tool() == before).all()
    assert any("somebody else moved the arm" in text for text in story.texts)
    assert story.violations() == ()


@pytest.mark.parametrize("going", [False, True])
def test_whoever_else_types_on_the_arms_line_is_told_of_everywhere_and_nothing_is_believed_any_more(
    story: Story, going: bool
) -> None:
    """It was heard and thrown away; the next move, asked at 10, ran at the speed that they had typed."""
    if going:
        story.sockets[0].say("go survey")
        story.wait(0.7)
    with story.cell.server.controller() as controller:
        controller.receive(b"SPEED 100\r", controller.now_s)
    story.wait(20.0)
    cycle = story.context.cycle
    assert not cycle.supervisor.permission.enabled
    assert cycle.supervisor.mover.belief.closed is None
    assert cycle.belief.holds_part is None
    assert "another terminal or program types on the controller's line (received" in str(cycle.supervisor.fault_text)
    before = story.cell.world_from_tool()
    story.sockets[1].say("go home")
    story.wait(5.0)
    assert (story.cell.world_from_tool() == before).all()
    assert any("another terminal or program types on the controller's line" in text for text in story.texts)
    assert story.violations() == ()


def test_a_line_of_others_is_told_of_though_a_stop_cut_off_who_had_found_it() -> None:
    """He was just taking back what they had half typed."""
    story = Story("all", holds=True, prompt_at_end=True)
    story.sockets[0].say("enable")
    story.wait(0.5)
    story.type_beside("DO OPENI")
    story.sockets[0].say("hand open")
    story.wait(0.3)
    story.sockets[1].say("stop")
    story.wait(20.0)
    told = any("another terminal or program types on the controller's line" in text for text in story.texts)
    assert not story.close()
    assert told


def second_move_waits(
    story: Story, mover: SocketOperator | SerialOperator, sender: SocketOperator
) -> tuple[CommandContext, str]:
    """One operator goes to the bin step by step, another has sent the first of its moves; and the next one, which has
    just come up, in words."""
    for text in ("step on", "go bin"):
        mover.say(text)
        story.wait(0.5)
    context = story.context
    first = context.cycle.status()["pending"]
    story.wait(1.0)
    sender.say("confirm")
    while (second := context.cycle.status()["pending"]) in (None, first):
        story.wait(0.1)
    return context, second


def test_of_two_who_say_yes_to_one_move_the_slower_does_not_send_the_next(story: Story) -> None:
    context, second = second_move_waits(story, story.sockets[2], story.sockets[0])
    before = story.cell.world_from_tool()
    story.sockets[1].say("confirm")
    story.wait(3.0)
    assert any(f"less than 1 s ago: {second}; `confirm` sends it" in text for text in story.texts)
    assert context.cycle.status()["pending"] == second
    assert (story.cell.world_from_tool() == before).all()
    story.sockets[1].say("confirm")
    story.wait(3.0)
    assert (story.cell.world_from_tool() != before).any()
    assert story.violations() == ()


@pytest.mark.parametrize("frontend", [0, 3])
def test_a_yes_to_a_move_that_somebody_else_has_sent_meanwhile_is_none_to_the_next(story: Story, frontend: int) -> None:
    """The question about the one had gone, and that about the next had come, as the key was pressed."""
    context, second = second_move_waits(story, story.frontends[frontend], story.sockets[1])
    story.wait(0.2)
    before = story.cell.world_from_tool()
    story.frontends[frontend].answer("y")
    story.wait(3.0)
    assert context.cycle.status()["pending"] == second
    assert (story.cell.world_from_tool() == before).all()
    story.frontends[frontend].answer("y")
    story.wait(3.0)
    assert (story.cell.world_from_tool() != before).any()
    assert story.violations() == ()


@pytest.mark.parametrize("word", ["step on", "pause"])
def test_no_move_sets_out_after_a_hold_that_was_said_while_its_speed_was_being_told(story: Story, word: str) -> None:
    """The controller's answer to SPEED was lost: it was told again after five seconds, and then the move."""
    story.sockets[0].say("go survey")
    story.wait(0.12)
    faults = story.cell.controller.faults
    story.harm(lambda: setattr(faults, "mute_answers", 1))
    story.wait(1.0)
    story.sockets[2].say(word)
    story.wait(0.5)
    before = story.cell.world_from_tool()
    story.wait(15.0)
    assert any(text.startswith(("Pausing before", "Step mode is on")) for text in story.texts)
    assert (story.cell.world_from_tool() == before).all()
    assert story.violations() == ()


def kill(story: Story) -> None:
    """SIGKILL: what it would have done at its end is not done; what is in its files is."""
    context = story.context
    context.run_log.close = lambda *_, **__: None
    story.terminate()
    story.start()
    story.wait(1.0)


def closed_by_a_word(story: Story) -> None:
    story.sockets[0].say("robot monitor DO CLOSEI")
    story.wait(0.3)
    story.sockets[0].answer("y")
    story.wait(1.0)


def told_to_open_on_a_line_that_was_pulled(story: Story) -> None:
    story.sockets[0].say("hand close")
    story.wait(1.0)
    story.harm(story.line.unplug)
    story.sockets[0].say("hand open")
    story.wait(1.0)
    story.repair()


@pytest.mark.parametrize("closed", [closed_by_a_word, told_to_open_on_a_line_that_was_pulled])
def test_a_hand_that_was_closed_when_the_daemon_was_killed_is_not_taken_for_empty(
    story: Story, closed: Callable[[Story], None]
) -> None:
    """The next pick would have let the part fall where it opens its hand, a stand-off above the table."""
    closed(story)
    assert story.cell.controller.machine.hand_closed
    kill(story)
    story.sockets[0].say("status")
    story.wait(0.5)
    context = story.context
    assert context.cycle.status()["holding"] is None
    assert story.violations() == ()


def test_an_arm_found_at_work_is_asked_about_at_that_start_and_not_at_the_next(story: Story) -> None:
    """Where no pick had been cut off no fault stood, `resume` found nothing to clear, and every later start said that
    the daemon had ended with that fault."""
    story.terminate()
    controller = story.cell.controller
    controller.receive(b"DO DRIVE 1,20,2\r", story.now_s)
    story.start()
    story.wait(1.0)
    assert controller.machine.at_rest()
    context = story.context
    assert "at work: the controller was still carrying out" in str(context.cycle.status()["fault"])
    story.sockets[0].say("resume")
    story.wait(1.0)
    assert "Fault cleared" in story.texts[-1]
    story.terminate()
    story.start()
    context = story.context
    assert context.cycle.status()["fault"] is None
    assert context.troubles.active == {}


@pytest.mark.parametrize("word", ["DISABLE", "abort"])
def test_who_takes_the_leave_to_move_while_asked_whether_a_line_may_be_sent_is_not_told_to_say_y_or_n(
    story: Story, word: str
) -> None:
    """A second operator's yes sent it, and the first one's `disable` was never done: the arm went all its way."""
    story.sockets[0].say("robot monitor DO READY")
    story.wait(0.3)
    story.sockets[0].answer(word)
    story.sockets[1].say("confirm")
    story.wait(4.0)
    assert story.violations() == ()
    assert story.cell.controller.machine.at_rest()
    assert not any("Ignored: " in text for text in story.texts)


def test_a_move_about_which_somebody_is_asked_is_sent_by_no_step_off_of_somebody_else(story: Story) -> None:
    """It set out before the cameras of whoever was reading the question whether it may."""
    story.sockets[0].say("step on")
    story.wait(0.3)
    story.sockets[0].say("go bin")
    story.wait(1.0)
    assert story.sockets[0].question is not None
    story.sockets[1].say("step off")
    story.wait(2.0)
    assert story.cell.controller.machine.at_rest()
    assert "This move still waits: bin: " in story.texts[-1]
    story.sockets[0].answer("y")
    story.wait(10.0)
    assert "At bin." in story.texts, "nor is anything further asked"
    assert story.violations() == ()


def test_who_begins_an_auto_that_a_pause_of_before_holds_is_told_so(story: Story) -> None:
    """It was said to be picking, and nothing moved: only `status` told why."""
    for text in ("pause", "auto on 2"):
        story.sockets[0].say(text)
        story.wait(0.5)
    assert "Picking, at most 2 parts" in story.texts[-1]
    assert "Motion is paused: `resume` continues." in story.texts[-1]


@pytest.mark.parametrize("word", ["abort", "disable", "stop"])
def test_a_fault_is_told_and_outlives_the_daemon_also_where_somebody_stops_the_arm_as_it_is_being_stopped(
    story: Story, word: str
) -> None:
    """Its report was ended with the job: no frontend heard of it, no log had it, and after a restart nothing stood."""
    story.sockets[0].say("go bin")
    story.wait(0.3)
    story.cell.controller.faults.refusals.append("*Location out of range*")
    context = story.context
    while not context.cycle.supervisor.permission.stopping:
        story.wait(0.01)
    story.sockets[1].say(word)
    story.wait(2.0)
    assert any(text.startswith("FAULT *Location out of range*") for text in story.texts)
    kill(story)
    context = story.context
    assert context.cycle.supervisor.fault_text == "restarted: the daemon ended in fault"
    assert story.violations() == ()


@pytest.mark.parametrize("frontend", [0, 1])
def test_an_auto_off_that_is_heard_right_behind_an_auto_on_ends_it(story: Story, frontend: int) -> None:
    """It was told that no auto is on, and the arm picked on until the table was empty."""
    story.sockets[0].say("auto on")
    story.sockets[frontend].say("auto off")
    story.wait(1.0)
    assert any(text.startswith("Picking, until") for text in story.texts)
    assert "Auto is not running." not in story.texts
    context = story.context
    state = context.cycle.status()
    assert (state["auto"], state["doing"], state["left"]) == (False, None, None)
    assert story.cell.controller.machine.at_rest()
    assert story.violations() == ()


def test_an_auto_that_was_stopped_before_it_began_is_not_on(story: Story) -> None:
    for text in ("auto on 2", "stop"):
        story.sockets[0].say(text)
    story.wait(1.0)
    context = story.context
    state = context.cycle.status()
    assert (state["auto"], state["doing"], state["left"]["count"]) == (False, None, 2)
    assert story.violations() == ()


def reads_nothing(story: Story, frontend: SocketOperator) -> None:
    """Whoever sits there has frozen the terminal, with more on its way to it than is taken on the way."""
    assert frontend.line is not None
    story.loop.remove_reader(frontend.line)
    for _ in range(60):
        for _ in range(40):
            frontend.send({"complete": ""})
        story.wait(0.001)


def test_a_stop_is_heard_of_one_who_reads_nothing_and_was_told_before_that_a_line_is_no_message(story: Story) -> None:
    """Until that was read nothing more of theirs was: the arm went all its way."""
    story.sockets[0].say("go bin")
    story.wait(0.2)
    reads_nothing(story, story.sockets[0])
    assert not story.cell.controller.machine.at_rest()
    story.sockets[0].send({"complete": 1})
    story.wait(0.05)
    story.sockets[0].say("stop")
    story.wait(0.3)
    assert story.cell.controller.machine.at_rest()
    assert story.violations() == ()


def test_a_stop_is_answered_though_whoever_has_the_controllers_terminal_reads_nothing(story: Story) -> None:
    """For ten minutes nobody was told that the arm had stopped, and no `resume` was heard."""
    story.sockets[0].say("robot monitor")
    story.wait(0.5)
    reads_nothing(story, story.sockets[0])
    story.sockets[1].say("stop")
    story.wait(3.0)
    assert "Stopped. Nothing moves until `resume`." in story.texts
    context = story.context
    assert not context.cycle.supervisor.permission.stopping
    assert story.violations() == ()


def test_a_move_right_behind_a_hand_that_opens_waits_until_its_fingers_have_opened() -> None:
    """A pick waited that long. After `hand open` the gripper was said to be open at once, and the arm set out with the
    part between its fingers."""
    story = Story(holds=True)
    story.write_config(hand_s=1.0)
    for text in ("reload", "enable"):
        story.sockets[0].say(text)
        story.wait(0.5)
    for text in ("hand open", "go home"):
        story.sockets[0].say(text)
    while story.cell.controller.machine.hand_closed:
        story.wait(0.05)
    story.wait(0.8)
    context = story.context
    assert "The gripper is open." not in story.texts
    assert story.cell.controller.machine.at_rest()
    assert context.cycle.status()["doing"] == "open the gripper"
    story.wait(1.0)
    assert "The gripper is open." in story.texts
    assert not story.cell.controller.machine.at_rest()
    assert story.close() == ()


@pytest.mark.parametrize("frontend", [0, 3])
def test_a_stop_behind_a_word_whose_ends_cannot_be_read_is_heard(story: Story, frontend: int) -> None:
    """Tab after `go` hung up whoever pressed it where the named places could not be read; at the terminal what had been
    typed behind it was lost, a control-C, too."""
    story.sockets[1].say("go bin")
    story.wait(0.3)
    (story.folder / "state" / "places.jsonl").mkdir()
    if frontend == 3:
        story.terminal.send_bytes(b"go \t\x03")
    else:
        story.sockets[frontend].send({"complete": "go "})
        story.sockets[frontend].interrupt()
    story.wait(0.5)
    assert story.cell.controller.machine.at_rest()
    assert any(text.startswith("STOPPED by control-C") for text in story.texts)
    assert story.violations() == ()


def test_the_way_down_of_a_touch_test_follows_the_way_over_the_corner_and_nothing_else(story: Story) -> None:
    """It was a job of its own. Whoever had asked for it read nothing for a while, others moved the arm and aborted what
    it did; then it went straight down to the corner from where it stood."""
    opening = ((0, "holding no", 0.5), (0, "go survey", 6.0), (1, "pause", 0.1), (0, "calibrate touch", 0.02))
    for frontend, text, seconds in opening:
        story.sockets[frontend].say(text)
        story.wait(seconds)
    reads_nothing(story, story.sockets[0])
    for text, seconds in (("status", 5.0), ("resume", 20.0), ("go home", 0.9), ("abort", 2.0)):
        story.sockets[1].say(text)
        story.wait(seconds)
    context = story.context
    assert context.cycle.status()["doing"] is None
    before = story.cell.world_from_tool()
    assert story.sockets[0].line is not None
    story.loop.add_reader(story.sockets[0].line, story.sockets[0].hear)
    story.wait(3.0)
    assert "How far off are they" in (story.sockets[0].question or (0, ""))[1]
    assert (story.cell.world_from_tool() == before).all()
    assert story.violations() == ()


def test_an_arm_on_its_way_round_a_part_waits_for_nobodys_reading(story: Story) -> None:
    """Each place is told as it was looked from. Whoever had sent it off read nothing: the arm stood there for minutes,
    nobody had told it to, and set out again once they read on, or were hung up."""
    story.cell.place_for_teaching("cube", 0)
    story.sockets[0].say("teach cube --around 6")
    story.wait(1.0)
    story.sockets[0].answer("y")
    story.wait(2.0)
    reads_nothing(story, story.sockets[0])
    story.wait(60.0)
    context = story.context
    assert context.cycle.status()["doing"] is None
    before = story.cell.world_from_tool()
    assert story.sockets[0].line is not None
    story.loop.add_reader(story.sockets[0].line, story.sockets[0].hear)
    story.wait(3.0)
    assert "Is this the cube?" in (story.sockets[0].question or (0, ""))[1]
    assert (story.cell.world_from_tool() == before).all()
    assert story.violations() == ()


@pytest.mark.parametrize("answers", range(5))
def test_an_abort_in_the_moment_of_an_answer_ends_what_is_done_there_and_leaves_no_fault(
    story: Story, answers: int
) -> None:
    """The pick's end was lost where its answer came in the same breath: it went on as far as the guard, which refused
    it, and told a fault that nobody had seen, `Preempted` or `MoveRefused`, that stood until `resume`."""
    supervisor = story.context.cycle.supervisor
    aborted: list[asyncio.Future[str | None]] = []
    hear, left = Conversation.hear, [answers]

    def heard(talk: Conversation, event: LineEvent) -> None:
        hear(talk, event)
        if isinstance(event, Prompt) and supervisor.busy:
            left[0] -= 1
            if left[0] == -1:
                aborted.append(asyncio.ensure_future(supervisor.abort()))

    with patch.object(Conversation, "hear", heard):
        story.sockets[0].say("pick")
        story.wait(4.0)
    assert aborted[0].result() is None
    assert supervisor.fault_text is None
    assert any(text.startswith("aborted") for text in story.texts)
    assert story.violations() == ()


def test_an_auto_does_not_go_on_where_the_daemon_was_held_still_for_an_hour() -> None:
    """Control-Z, and an hour later somebody said `fg`: it looked again, and went on picking."""
    story = Story(parts=True)
    for text, seconds in (("enable", 0.5), ("auto on", 2.0)):
        story.sockets[0].say(text)
        story.wait(seconds)
    story.hang(3600.0)
    story.wait(0.5)
    before = story.cell.world_from_tool()
    story.wait(8.0)
    assert (story.cell.world_from_tool() == before).all()
    assert any("asleep: facetd was not running for 36" in text for text in story.texts)
    assert story.close() == ()


@pytest.mark.parametrize("word", ["pause", "step on"])
@pytest.mark.parametrize(("typed", "begins"), [("go survey", "DO MOVE"), ("hand close", "DO CLOSEI"),
                                               ("robot monitor DO DRIVE 1,5,30", "DO DRIVE")])  # fmt: skip
def test_nothing_that_moves_is_typed_once_more_after_a_hold_that_was_said_while_it_was_typed(
    story: Story, word: str, typed: str, begins: str
) -> None:
    """The echo of its line was lost: two seconds later the line was taken back, typed again and carried out."""
    machine, type_line, lost = story.cell.controller.machine, Conversation._type_line, list[str]()

    async def typing(talk: Conversation, text: str, *others: Any) -> None:
        if text.startswith(begins) and not lost:
            lost.append(text)
            drop = LineFault("to_host", "drop", count=len(text))
            story.harm(lambda: story.cell.controller.faults.line.append(drop))
        await type_line(talk, text, *others)

    with patch.object(Conversation, "_type_line", typing):
        story.sockets[0].say(typed)
        story.wait(0.3)
        story.sockets[0].answer("y")
        story.wait(0.5)
        story.sockets[2].say(word)
        before = story.cell.world_from_tool(), machine.hand_closed
        story.wait(6.0)
        assert lost
        assert ((story.cell.world_from_tool() == before[0]).all(), machine.hand_closed) == (True, before[1])
        for text in ("step off", "resume"):
            story.sockets[2].say(text)
        story.wait(1.0)
        story.sockets[0].answer("y")
        story.wait(3.0)
    assert ((story.cell.world_from_tool() == before[0]).all(), machine.hand_closed) != (True, before[1])
    assert story.violations() == ()


@pytest.mark.parametrize("answer", ["y", "n"])
def test_cal_where_the_pendant_left_the_arm_is_for_who_confirms_it_to_answer_for(story: Story, answer: str) -> None:
    """A controller without its zero does not know where the arm is: people are asked, and facetd cannot say more."""
    before = len(story.cell.controller.lines)
    for joint, degrees in ((1, 40.0), (2, 90.0)):
        story.sockets[0].say("robot cal")
        story.wait(2.0)
        assert story.sockets[0].question is not None
        assert "each joint turns a little" in story.sockets[0].question[1]
        story.by_pendant(joint, degrees)
        story.sockets[0].answer(answer)
        story.wait(20.0)
    story.sockets[0].say("robot cal")
    story.wait(2.0)
    story.sockets[0].answer(answer)
    story.wait(20.0)
    assert list(story.cell.controller.lines)[before:].count("CAL") == (3 if answer == "y" else 0)
    assert story.violations() == ()


def test_the_documented_way_back_leads_to_cal_also_where_the_controller_refuses_where_until_then(
    story: Story, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`enable` wanted WHERE to see the stop, CAL wanted `enable`, WHERE wanted CAL; and `resume` was refused for
    ever."""
    refuses_where_without_a_zero(monkeypatch)
    story.sockets[0].say("go bin")
    story.wait(0.5)
    story.mishap(Mishap.POWER_CYCLED)
    story.wait(10.0)
    story.repair()
    for restarts in (False, True):
        if restarts:
            story.terminate()
            story.start()
            story.wait(10.0)
        for text in ("robot power-up", "where", "resume", "enable", "go home"):
            story.sockets[0].say(text)
            story.wait(4.0)
        story.wait(20.0)
        assert any("the arm has not found its zero: `enable`, then `robot cal`" in text for text in story.texts)
    for text in ("resume", "enable", "robot cal"):
        story.sockets[0].say(text)
        story.wait(8.0)
    story.sockets[0].answer("y")
    story.wait(20.0)
    assert story.cell.controller.machine.calibrated
    before = story.cell.world_from_tool()
    story.sockets[0].say("go home")
    story.wait(10.0)
    assert (story.cell.world_from_tool() != before).any()
    assert story.violations() == ()


@pytest.mark.parametrize("typed", [b"SPE", b"SPEED 100\r", b"\r"])
def test_what_somebody_types_at_an_idle_arm_that_may_not_move_is_told_within_a_second(
    story: Story, typed: bytes
) -> None:
    """It was told at the next check, up to ten seconds later."""
    story.wait(3.0)
    with story.cell.server.controller() as controller:
        controller.receive(typed, controller.now_s)
    story.wait(1.0)
    assert "another terminal or program types on the controller's line" in story.texts[-1]
    story.wait(10.0)
    story.sockets[0].say("where")
    story.wait(1.0)
    assert "mm" in story.texts[-1]
    assert story.violations() == ()


def test_who_leaves_a_program_going_at_the_controllers_terminal_is_told_that_it_was_ended(
    story: Story, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It went on for a minute, and nobody was told; then brakes, encoders and load were blamed."""
    swinging: list[asyncio.TimerHandle] = []

    def swing(machine: Machine, _: str = "", there: bool = True) -> None:
        machine.now_s = story.loop.time()
        machine.move_joints(READY_RAD + 0.3 * there, 20.0)
        swinging.append(story.loop.call_later(machine.arm.rests_s - machine.now_s, swing, machine, "", not there))

    def stopped(machine: Machine, _: str) -> None:
        machine.stop("ABORT", by_others=False)
        for timer in swinging:
            timer.cancel()

    monkeypatch.setitem(MONITOR_COMMANDS, "EXECUTE", swing)
    monkeypatch.setitem(MONITOR_COMMANDS, "ABORT", stopped)
    story.cell.motion_monitor.typed_by_person(story.stamp_s(), "EX TEST")
    story.sockets[0].say("robot monitor")
    story.wait(0.5)
    for keys in ("EX TEST\r", "y"):
        story.sockets[0].send({"keys": keys})
        story.wait(0.5)
    assert not story.cell.controller.machine.at_rest()
    story.sockets[0].send({"leave": True})
    story.wait(8.0)
    assert any("facetd has stopped it (a program that went on is ended)" in text for text in story.texts)
    assert story.cell.controller.machine.at_rest()
    context = story.context
    assert context.cycle.status()["fault"] is None
    assert story.violations() == ()


def test_a_refused_move_is_an_answer_where_it_was_asked_for_and_a_notice_at_the_other_frontends(story: Story) -> None:
    story.sockets[0].say("disable")
    story.wait(3.0)
    story.texts.clear()
    story.sockets[0].say("go home")
    story.wait(1.0)
    refused = "not_enabled: the arm is not enabled: `enable` first"
    assert story.texts.count(refused) == 1
    assert story.texts.count(f"refused, {refused}") == len(story.sockets) - 1
