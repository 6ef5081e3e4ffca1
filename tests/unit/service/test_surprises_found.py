"""What random operators found, each as the shortest script that showed it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import yaml

from drivers.puma560 import READY_RAD
from drivers.simcell.controller import Mishap
from drivers.simcell.controller.commands import Ask
from drivers.simcell.controller.machine import Machine
from drivers.simcell.controller.monitor import MONITOR_COMMANDS
from tests.worlds.whole_daemon import Story

pytestmark = pytest.mark.slow
NO_LONGER = "The arm is no longer enabled: pick.limits changed."


@pytest.fixture
def story() -> Iterator[Story]:
    story = Story()
    story.sockets[0].say("enable")
    story.wait(0.1)
    yield story
    story.close()


def test_a_fault_that_was_aborted_meanwhile_is_cleared_by_a_resume_that_says_so(story: Story) -> None:
    for text in ("stop", "abort", "resume"):
        story.sockets[2].say(text)
        story.wait(1.0)
    assert "The fault is cleared" in story.texts[-1]
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
    assert any("a part is in the gripper: put it down first" in text for text in story.texts)
    assert (story.cell.world_from_tool() == before).all()
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
    story.harm(story.cell.server.unplug)  # type: ignore[union-attr]
    story.wait(0.1)
    assert not story.cell.controller.machine.at_rest()
    story.sockets[1].interrupt()
    story.wait(0.02)
    assert "Nothing moves." not in story.texts


@pytest.mark.parametrize("door", [0, 3])
def test_a_move_typed_ahead_behind_an_enable_goes_once_the_stop_was_tried(door: int) -> None:
    story = Story()
    for text in ("enable", "go home"):
        story.doors[door].say(text)
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
    assert any("still being stopped" in text for text in story.texts)
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
    assert any("The fault is cleared" in text for text in story.texts)
    assert story.violations() == ()


def test_a_hand_word_that_left_before_the_stop_is_carried_out_by_a_controller_whose_line_was_pulled() -> None:
    story = Story(holds=True, prompt_at_end=True)
    story.sockets[0].say("enable")
    story.wait(0.1)
    story.sockets[0].say("hand open")
    story.wait(0.1)
    story.harm(story.cell.server.unplug)  # type: ignore[union-attr]
    story.sockets[0].say("abort")
    story.wait(1.0)
    assert not story.cell.controller.machine.hand_closed, "nobody could tell it not to"
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
    for text, seconds in (("enable", 0.1), ("go bin", 0.5)):
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
    for door, text in words if reloaded == "before it was asked" else words[::-1]:
        story.sockets[door].say(text)
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
    assert {"busy: where; settings are changed in between", NO_LONGER} <= set(story.texts)
    context = story._service.context
    assert context is not None
    guarded, read = context.cycle.settings.limits, context.config.values.pick.limits
    assert guarded.box_low_mm == read.box_low_mm == (0, -650, -300)
    assert story.violations() == ()


def test_whoever_asked_for_a_reload_is_told_once_that_it_has_disabled_the_arm(story: Story) -> None:
    """By the answer: the notice to all doors said the same above it. (All sockets here are one operator's.)"""
    story.write_config(limits={"box_low_mm": [0, -600, -300], "max_speed_pct": 40})
    story.sockets[0].say("reload")
    story.wait(1.0)
    told = [text for text in story.texts if NO_LONGER in text]
    assert told == [f"The configuration is taken over. {NO_LONGER}"]


def test_a_yes_to_walk_round_a_part_is_void_where_the_arm_was_stopped_since_it_was_asked_for(story: Story) -> None:
    """`abort` leaves no fault: who had said it was told that the arm is stopped, and it set out."""
    story.sockets[0].say("teach cube --around 6")
    story.wait(1.0)
    story.sockets[1].say("abort")
    story.wait(1.0)
    assert "May it?" in (story.sockets[0].question or (0, ""))[1]
    story.sockets[0].answer("y")
    story.wait(2.0)
    assert any("meanwhile it was stopped" in text for text in story.texts)
    assert story.cell.controller.machine.at_rest()
    assert story.violations() == ()


@pytest.mark.parametrize("key", ["", "W"])
def test_a_line_that_is_lost_while_a_person_has_the_controllers_terminal_is_told_and_the_arm_is_stopped(
    story: Story, key: str
) -> None:
    """The daemon stood aside: nothing was said of it at any door, and the next key hung up whoever pressed it."""
    story.cell.judge.by_hand(story.stamp_s(), "DO READY")
    story.sockets[0].say("robot monitor")
    story.wait(0.5)
    for keys in ("SPEED 4\r", "DO READY\r", "y"):
        story.sockets[0].send({"keys": keys})
        story.wait(0.5)
    assert not story.cell.controller.machine.at_rest()
    story.harm(story.cell.server.unplug)  # type: ignore[union-attr]
    story.sockets[0].send({"keys": key})
    story.wait(6.0)
    assert story.sockets[0].line is not None
    assert any("the port is gone; NOT CONFIRMED" in text for text in story.texts)
    assert story.violations() == ()


def test_a_question_that_somebody_left_before_the_start_is_answered_by_nobody_as_if_it_were_power_ups(
    story: Story, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`robot power-up` said yes to it: the program went on, with an arm that was not enabled."""

    def asking(machine: Machine, _: str) -> Iterator[Ask]:
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
    assert any("no question after power-up that facetd knows" in text for text in story.texts)
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
    assert "Let the arm move and go on?" in (story.sockets[0].question or (0, ""))[1]
    story.sockets[1].say("pause")
    story.wait(0.3)
    story.sockets[0].answer("y")
    story.wait(4.0)
    assert story.violations() == ()
    assert any("Moves are held since" in text for text in story.texts)


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
    assert not any("the question stands" in text for text in story.texts)
