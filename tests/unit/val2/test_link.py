"""The link over a pseudo-terminal, and over a line on simulated time: connecting, asking, moving, aborting, and every
way the line can go wrong."""

import asyncio
import contextlib
import gc
import os
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import numpy as np
import pytest

from drivers.puma560 import READY_RAD, forward
from drivers.simcell.controller import LineFault, Manners, Mishap
from drivers.val2.dialect import Dialect
from drivers.val2.errors import ControllerError, Elsewhere, Garbled, LinkError, NoAnswer, PortError, Preempted
from drivers.val2.link import Link, mark_retrieved
from drivers.val2.location import Location, apart, location_from_matrix
from drivers.val2.wire import Where
from tests.fakes.arm_line import MakesLine, ready
from tests.fakes.in_time import lived
from tests.fakes.waiting import until_so

GOAL = Location(520.0, 0.0, -100.0, 0.0, 80.0, 0.0)
READY = location_from_matrix(forward(READY_RAD))
NEARBY = Location(540.0, 20.0, -150.0, 5.0, 75.0, 5.0)


def quick(**settings: Any) -> Dialect:
    return Dialect(**{"resync_s": 0.4, "typing_s": 0.4, "answer_s": 1.0, "stall_s": 0.3} | settings)


async def go(link: Link, location: Location, timeout_s: float | None = None) -> None:
    await link.move(location)
    await link.wait_until_at_rest(location, timeout_s)


def test_it_says_where_the_arm_is(arm_line: MakesLine) -> None:
    async def scene() -> None:
        async with arm_line().link() as link:
            where = await link.where()
            np.testing.assert_allclose(where.joints_deg, np.degrees(READY_RAD), atol=1e-3)
            assert where.location.z_mm == pytest.approx(863.6)

    asyncio.run(scene())


@pytest.mark.parametrize("prompt", ["start", "end"])
@pytest.mark.parametrize("break_after_move", [True, False])
def test_a_move_is_over_when_two_readings_agree_with_the_target(
    timed_line: MakesLine, prompt: Any, break_after_move: bool
) -> None:
    async def scene() -> None:
        cell = timed_line(Manners(prompt_after_move=prompt))
        async with cell.link(quick(break_after_move=break_after_move)) as link:
            await link.command("SPEED 50")
            await link.move(GOAL)
            there = await link.wait_until_at_rest(GOAL, 20.0)
            assert apart(there.location, GOAL) == pytest.approx((0, 0), abs=0.01)
            await link.move(NEARBY, straight=True)
            there = await link.wait_until_at_rest(NEARBY, 20.0)
            assert apart(there.location, NEARBY) == pytest.approx((0, 0), abs=0.01)
            assert cell.server.now_s() > 0
        with cell.server.controller() as controller:
            assert controller.arm.at_rest(controller.now_s)

    lived(scene())


def test_a_straight_move_can_be_one_line_or_two(timed_line: MakesLine) -> None:
    async def scene(through_variable: bool) -> str:
        cell = timed_line()
        async with cell.link(quick(straight_through_variable=through_variable)) as link:
            await link.move(GOAL)
            await link.wait_until_at_rest(GOAL)
            await link.move(NEARBY, straight=True)
            await link.wait_until_at_rest(NEARBY)
        return str(cell.sent())

    assert "DO SET GOAL=TRANS(" in lived(scene(True))
    assert "DO MOVES TRANS(" in lived(scene(False))


def test_ready_and_the_hand(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line()
        async with cell.link() as link:
            await link.set_hand(closed=True)
            await link.set_hand(closed=False)
            where = await ready(link)
            np.testing.assert_allclose(where.joints_deg, np.degrees(READY_RAD), atol=1e-3)
        assert cell.hand == [True, False]

    lived(scene())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("FOO", "*Illegal command*"),
        ("DO MOVE TRANS(2000,0,0,0,0,0)", "*Location out of range*"),
        ("DO MOVES TRANS(0,0,200,0,0,0)", "*Location out of range*"),
        ("DO MOVE TRANS(-700,0,0,-90,0,0)", "*Joint 1 out of range*"),
        ("DO MOVE P", "*Undefined value*"),
    ],
)
def test_a_refusal_is_raised_in_the_controller_s_own_words_and_the_link_goes_on(
    timed_line: MakesLine, text: str, words: str
) -> None:
    async def scene() -> None:
        async with timed_line().link() as link:
            with pytest.raises(ControllerError) as refusal:
                await link.command(text)
            assert refusal.value.message == words
            assert (await link.where()).location.z_mm == pytest.approx(863.6)

    lived(scene())


def test_an_answer_s_lines_are_kept_for_people(timed_line: MakesLine) -> None:
    async def scene() -> None:
        async with timed_line().link() as link:
            assert "Arm power on" in (await link.command("STATUS")).lines

    lived(scene())


@pytest.mark.parametrize("text", ["x" * 80, "WHERE\rDO READY", "WHERE\n", "caf\u00e9"])
def test_what_is_not_one_plain_line_is_never_typed(timed_line: MakesLine, text: str) -> None:
    async def scene() -> None:
        cell = timed_line()
        async with cell.link() as link:
            before = cell.sent()
            with pytest.raises(ValueError, match="cannot be typed"):
                await link.command(text)
            assert cell.sent() == before

    lived(scene())


# Power-up and calibration


def test_power_up_is_asked_and_answered_before_anything_else(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line(Manners(arm_power_after_s=1.0), cold=True)
        async with cell.link() as link:
            assert link.question == "Load VAL-II from floppy (Y/N)?"
            with pytest.raises(ControllerError, match="floppy"):
                await link.where()
            answer = await link.power_up(("Y", "Y"))
            assert "Initialize (Y/N)?" in answer.lines
            assert link.question is None
            with pytest.raises(ControllerError, match="Arm power off"):
                await link.calibrate()
            await asyncio.sleep(0.2)
            await link.calibrate()
            await ready(link)

    lived(scene())


def test_calibration_waits_for_a_slow_person_at_the_pendant(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line(time_scale=50.0)
        cell.faults.pendant_s = 100.0
        async with cell.link() as link:
            answer = await link.calibrate()
            assert answer.seconds > 2.0
            assert "Are you sure (Y/N)?" in answer.lines

    lived(scene())


def test_a_question_nobody_has_a_reply_for_is_kept_and_blocks_motion(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line()
        async with cell.link() as link:
            with pytest.raises(ControllerError, match="Are you sure"):
                await link.command("CAL")
            before = cell.sent()
            with pytest.raises(ControllerError, match="Are you sure"):
                await link.move(GOAL)
            assert cell.sent() == before, "nothing is typed at a question"
            await link.power_up(("N",))
            before = cell.sent()
            with pytest.raises(ControllerError, match="asks nothing"):
                await link.power_up()
            assert cell.sent() == before, "no Y is typed at a prompt"
            await link.move(GOAL)
            await link.wait_until_at_rest(GOAL)

    lived(scene())


# The port


def test_an_absent_port_is_named_with_what_to_do() -> None:
    async def scene() -> None:
        with pytest.raises(PortError, match="/dev/no-such-port: no such port"):
            await Link("/dev/no-such-port").open()

    asyncio.run(scene())


def test_a_busy_port_is_named_with_what_to_do(arm_line: MakesLine) -> None:
    async def scene() -> None:
        cell = arm_line()
        async with cell.link():
            with pytest.raises(PortError, match="in use by another program"):
                await Link(cell.server.port).open()

    asyncio.run(scene())


def test_a_port_with_nobody_behind_it_is_no_answer_in_time() -> None:
    async def scene() -> None:
        master, slave = os.openpty()
        link = Link(os.ttyname(slave), quick(resync_s=0.1))
        with pytest.raises(NoAnswer, match="gives no prompt"):
            await link.open()
        with pytest.raises(PortError, match="not open"):
            await link.where()
        os.close(master)
        os.close(slave)

    asyncio.run(scene())


def lines_of(cell: Any) -> list[str]:
    """What the controller has heard so far."""
    with cell.server.controller() as controller:
        return [*controller.lines]


def test_a_port_that_goes_away_is_told_to_whoever_waits(arm_line: MakesLine) -> None:
    async def scene() -> None:
        cell = arm_line()
        link = Link(cell.server.port, quick())
        await link.open()
        await link.command("DO DRIVE 1, 100, 1")
        breaking = asyncio.create_task(link.command("DO BREAK", timeout_s=30))
        await until_so(lambda: "DO BREAK" in lines_of(cell))
        cell.server.stop()
        with pytest.raises(PortError, match="gone"):
            await breaking
        assert not link.connected
        with pytest.raises(PortError):
            await link.where()
        await link.close()

    asyncio.run(scene())


def test_a_link_can_be_closed_and_opened_again(arm_line: MakesLine) -> None:
    async def scene() -> None:
        cell = arm_line()
        for _ in range(3):
            async with cell.link() as link:
                await link.where()

    asyncio.run(scene())


def test_a_line_half_typed_by_somebody_else_is_not_carried_out_on_opening(timed_line: MakesLine) -> None:
    async def scene(manners: Manners) -> None:
        cell = timed_line(manners)
        with cell.server.controller() as controller:
            controller.receive(b"DO NEST", controller.now_s)
        async with cell.link() as link:
            await asyncio.sleep(0.2)
            np.testing.assert_allclose((await link.where()).joints_deg, np.degrees(READY_RAD), atol=1e-3)

    lived(scene(Manners()))
    lived(scene(Manners(line_editing=False)))


def test_a_rest_that_opening_left_in_the_line_spoils_no_command(timed_line: MakesLine) -> None:
    """A prompt that happened to be printed just then makes a controller look as if it had cancelled the line."""

    async def scene() -> None:
        cell = timed_line(Manners(line_editing=False, prompt_after_move="end"))
        with cell.server.controller() as controller:
            controller.receive(b"DO DRIVE 1,10,5\r", controller.now_s)
            assert 0.05 < (controller.arm.rests_s - controller.now_s) / 20 < 0.3
        async with cell.link() as link:
            assert cell.sent().count("DO BREAK") == 2
            assert not link.stopped_on_opening
            await link.command("SPEED 10")
            with pytest.raises(ControllerError, match="Illegal command"):
                await link.command("NONSENSE")

    lived(scene())


@pytest.mark.parametrize("prompt", ["start", "end"])
@pytest.mark.parametrize("break_after_move", [True, False])
@pytest.mark.parametrize("line_editing", [True, False])
def test_an_arm_found_at_work_on_opening_is_stopped(
    timed_line: MakesLine, prompt: Any, break_after_move: bool, line_editing: bool
) -> None:
    """Whoever told it so was killed, and may have left the next line half typed."""

    async def scene() -> None:
        cell = timed_line(Manners(line_editing=line_editing, prompt_after_move=prompt), time_scale=5.0)
        with cell.server.controller() as controller:
            controller.receive(b"DO DRIVE 1,90,2\rDO NE", controller.now_s)
        async with cell.link(quick(break_after_move=break_after_move)) as link:
            assert link.stopped_on_opening
            place = await link.where()
            await asyncio.sleep(0.2)
            assert place == await link.where()
            assert place.joints_deg[0] < 89.0
            assert link.question is None

    lived(scene())


def test_a_dead_controller_without_echo_is_told_as_one_once_it_did_not_answer_the_stop(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line(Manners(echo=False))
        with cell.server.controller() as controller:
            controller.mishap(Mishap.DEAD)
            controller.output(float("inf"))
        with pytest.raises(NoAnswer):
            async with cell.link(quick(echo=False)):
                pass
        assert "ABORT" in cell.sent()

    lived(scene())


@pytest.mark.parametrize("line_editing", [True, False])
def test_a_calibration_somebody_else_began_and_did_not_confirm_is_declined_on_opening(
    timed_line: MakesLine, line_editing: bool
) -> None:
    async def scene() -> None:
        cell = timed_line(Manners(line_editing=line_editing))
        with cell.server.controller() as controller:
            controller.machine.calibrated = False
            controller.receive(b"CAL\r", controller.now_s)
        async with cell.link() as link:
            assert link.question is None
            await link.where()
            with cell.server.controller() as controller:
                assert not controller.machine.calibrated

    lived(scene())


# Turns and the abort


def test_commands_from_two_tasks_take_turns(timed_line: MakesLine) -> None:
    async def scene() -> None:
        async with timed_line().link() as link:
            places = await asyncio.gather(*(link.where() for _ in range(6)))
            assert len({place.location for place in places}) == 1

    lived(scene())


@pytest.mark.parametrize("line_editing", [True, False])
@pytest.mark.parametrize("prompt", ["start", "end"])
def test_an_abort_stops_the_arm_whoever_is_using_the_link(
    timed_line: MakesLine, prompt: Any, line_editing: bool
) -> None:
    async def scene() -> None:
        cell = timed_line(Manners(prompt_after_move=prompt, line_editing=line_editing), time_scale=5.0)
        async with cell.link() as link:
            await link.command("SPEED 10")

            async def mover() -> None:
                await link.move(GOAL)
                await link.wait_until_at_rest(GOAL)

            moving = asyncio.create_task(mover())
            waiting = asyncio.create_task(asyncio.sleep(0.05))
            await waiting
            queued = asyncio.create_task(link.move(NEARBY))
            await asyncio.sleep(0.3)
            stopped = await link.stop_motion()
            for task in (moving, queued):
                with pytest.raises(Preempted):
                    await task
            assert apart(stopped.location, GOAL)[0] > 10
            typed = cell.sent()
            await asyncio.sleep(0.3)
            np.testing.assert_allclose(np.degrees(cell.joints()), stopped.joints_deg, atol=1e-3)
            assert cell.sent() == typed

    lived(scene())


@pytest.mark.parametrize("after_ms", range(0, 200, 10))
def test_an_abort_at_any_moment_of_a_command_leaves_a_still_arm_and_a_working_link(
    timed_line: MakesLine, after_ms: int
) -> None:
    async def scene() -> None:
        cell = timed_line(Manners(line_editing=after_ms % 20 == 0), time_scale=4.0)
        async with cell.link() as link:
            moving = asyncio.create_task(link.move(NEARBY, straight=True))
            await asyncio.sleep(after_ms / 1000)
            stopped = await link.stop_motion()
            await asyncio.gather(moving, return_exceptions=True)
            await asyncio.sleep(0.1)
            np.testing.assert_allclose(np.degrees(cell.joints()), stopped.joints_deg, atol=1e-3)
            await link.move(GOAL)
            await link.wait_until_at_rest(GOAL)

    lived(scene())


def test_two_aborts_at_once_are_one(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line()
        async with cell.link() as link:
            await asyncio.gather(link.stop_motion(), link.stop_motion(), link.stop_motion())
            assert cell.sent().count("!!") == 1

    lived(scene())


def test_a_motion_asked_for_during_an_abort_is_not_carried_out(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line()
        async with cell.link() as link:
            aborting = asyncio.create_task(link.stop_motion())
            await asyncio.sleep(0)
            await asyncio.sleep(0)
            with pytest.raises(Preempted):
                await link.move(GOAL)
            await aborting
            assert "MOVE" not in cell.sent()

    lived(scene())


@pytest.mark.parametrize("text", ["CAL", "POINT #P"])
def test_an_abort_gets_past_a_question(timed_line: MakesLine, text: str) -> None:
    async def scene() -> None:
        cell = timed_line(time_scale=2.0)
        async with cell.link() as link:
            await link.command("SPEED 10")
            await link.move(GOAL)
            asking = asyncio.create_task(link.command(text))
            await asyncio.sleep(0.3)
            stopped = await link.stop_motion()
            await asyncio.gather(asking, return_exceptions=True)
            assert link.question is None
            assert apart(stopped.location, GOAL)[0] > 10
            await asyncio.sleep(0.2)
            np.testing.assert_allclose(np.degrees(cell.joints()), stopped.joints_deg, atol=1e-3)

    lived(scene())


def test_a_controller_that_was_switched_on_anew_moves_nothing_and_its_questions_are_the_operators(
    timed_line: MakesLine,
) -> None:
    async def scene() -> None:
        cell = timed_line()
        async with cell.link() as link:
            await link.test_stop()
            moving = asyncio.create_task(link.move(GOAL))
            await asyncio.sleep(0.05)
            with cell.server.controller() as controller:
                controller.mishap(Mishap.POWER_CYCLED)
            assert await link.stop_motion() is None
            await asyncio.gather(moving, return_exceptions=True)
            assert "Load VAL" in str(link.question)
            assert not link.permission.stop_tests
            assert "\rN\r" not in cell.sent()
            await link.power_up()
            await link.test_stop()

    lived(scene())


def test_an_abort_that_nobody_answers_is_tried_some_times_and_told(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line()
        async with cell.link(quick(resync_s=0.05)) as link:
            with cell.server.controller() as controller:
                controller.mishap(Mishap.DEAD)
            with pytest.raises(NoAnswer, match="no prompt"):
                await link.stop_motion()
            assert cell.sent().count("!!") > 1

    lived(scene())


def test_a_person_s_terminal_has_the_line_to_itself_but_for_the_abort(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line()
        seen = bytearray()
        async with cell.link() as link:
            async with link.terminal(seen.extend) as type_in:
                type_in(b"spe")
                type_in(b"ed 30\r")
                asking = asyncio.create_task(link.where())
                await asyncio.sleep(0.2)
                assert not asking.done()
                type_in(b"DO NE")
            await asking
            assert b"speed 30\r\n." in seen
            np.testing.assert_allclose(cell.joints(), READY_RAD, atol=1e-9)
            with cell.server.controller() as controller:
                assert controller.machine.speed_percent == 30

            async with link.terminal(seen.extend) as type_in:
                await link.stop_motion()
                with pytest.raises(Preempted):
                    type_in(b"DO NEST\r")

    lived(scene())


# Noise and silence


@pytest.mark.parametrize("way", ["to_controller", "to_host"])
@pytest.mark.parametrize("harm", ["drop", "double", "flip", "insert"])
@pytest.mark.parametrize("after", [0, 5, 20, 41])
def test_noise_in_a_typed_move_is_caught_before_it_is_ended_and_the_line_typed_again(
    timed_line: MakesLine, way: Any, harm: Any, after: int
) -> None:
    async def scene() -> None:
        cell = timed_line()
        async with cell.link() as link:
            await link.where()  # nothing of the opening is under way any more
            cell.faults.line.append(LineFault(way, harm, after=after))
            await link.move(GOAL)
            await link.wait_until_at_rest(GOAL)
            assert cell.faults.line == []
            assert cell.sent().count("\rDO MOVE") + cell.sent().count("\x15DO MOVE") >= 2

    lived(scene())


@pytest.mark.parametrize("line_editing", [True, False])
def test_a_line_that_stays_spoiled_is_given_up_and_nothing_moves(timed_line: MakesLine, line_editing: bool) -> None:
    async def scene() -> None:
        cell = timed_line(Manners(line_editing=line_editing))
        async with cell.link(quick(resync_s=0.1)) as link:
            cell.faults.line.append(LineFault("to_controller", "flip", after=15, count=100_000))
            with pytest.raises(NoAnswer, match=r"typed 'DO MOVE .*then the controller gives no prompt"):
                await link.move(GOAL)
        np.testing.assert_allclose(cell.joints(), READY_RAD, atol=1e-9)

    lived(scene())


@pytest.mark.parametrize("line_editing", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_on_a_noisy_line_the_arm_only_ever_goes_where_it_was_sent(
    timed_line: MakesLine, line_editing: bool, seed: int
) -> None:
    async def scene() -> None:
        cell = timed_line(Manners(line_editing=line_editing), time_scale=50.0)
        async with cell.link(quick(resync_s=0.1, answer_s=0.5, typing_s=0.1, stall_s=0.1, motion_s=1.0)) as link:
            cell.faults.seed_noise(seed, rate=0.004)
            for goal in (GOAL, NEARBY) * 2:
                with contextlib.suppress(LinkError):
                    await go(link, goal, 2.0)
                with contextlib.suppress(LinkError):
                    await link.still(1.0)
                await asyncio.sleep(0.1)
                with cell.server.controller() as controller:
                    place = location_from_matrix(controller.arm.reported_pose_at(controller.now_s))
                assert min(apart(place, allowed)[0] for allowed in (READY, GOAL, NEARBY)) < 0.02
            cell.faults.noise_rate = 0.0

    lived(scene())


def test_a_motion_whose_answer_is_lost_is_not_repeated_and_the_arm_s_place_is_told(
    timed_line: MakesLine,
) -> None:
    async def scene() -> None:
        cell = timed_line()
        async with cell.link(quick(prompt_after_move="start")) as link:
            cell.faults.mute_answers = 1
            with pytest.raises(NoAnswer, match="no answer to 'DO MOVE") as problem:
                await link.move(GOAL)
            assert problem.value.where is not None
            assert cell.sent().count("DO MOVE") == 1
            assert apart((await link.wait_until_at_rest(GOAL)).location, GOAL) == pytest.approx((0, 0), abs=0.01)

    lived(scene())


def test_a_question_whose_answer_is_lost_is_asked_again(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line()
        async with cell.link() as link:
            cell.faults.mute_answers = 1
            assert (await link.where()).location.z_mm == pytest.approx(863.6)

    lived(scene())


def test_a_spoiled_table_is_asked_for_again(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line()
        async with cell.link() as link:
            cell.faults.line.append(LineFault("to_host", "drop", after=70, count=5))
            assert (await link.where()).location.z_mm == pytest.approx(863.6)

    lived(scene())


def place_and_joints_agree(where: Where) -> bool:
    off_mm, off_deg = apart(location_from_matrix(forward(np.radians(where.joints_deg))), where.location)
    return off_mm < 0.2 and off_deg < 0.1


@pytest.mark.parametrize("after", [75, 93, 115, 198, 207])
def test_a_digit_spoiled_by_noise_is_never_given_out_as_a_place(timed_line: MakesLine, after: int) -> None:
    async def scene() -> None:
        cell = timed_line()
        link = cell.closed_link(quick())
        link.belongs_together = place_and_joints_agree
        await link.open()
        await go(link, GOAL)
        cell.faults.line.append(LineFault("to_host", "flip", after=after))
        assert apart((await link.where()).location, GOAL)[0] < 0.01
        assert cell.faults.line == []
        await link.close()

    lived(scene())


def test_another_tool_than_ours_is_noticed_and_an_abort_still_confirmed(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line()
        link = cell.closed_link(quick())
        link.belongs_together = place_and_joints_agree
        await link.open()
        await link.command("TOOL TRANS(0,0,100,0,-90,90)")
        with pytest.raises(Garbled, match="do not fit each other: noise on the line, or somebody set TOOL or BASE"):
            await link.where()
        assert (await link.stop_motion()).location.z_mm == pytest.approx(963.6)
        await link.close()

    lived(scene())


def test_a_system_that_counts_its_joints_otherwise_is_read_in_our_angles(timed_line: MakesLine) -> None:
    async def scene() -> None:
        dialect = quick(joint_signs=(1, -1, -1, 1, -1, 1), joint_zeros_deg=(180, 0, 0, 0, 0, 0))
        async with timed_line().link(dialect) as link:
            np.testing.assert_allclose((await link.where()).joints_deg, [180, -90, 90, 0, 0, 0], atol=1e-3)

    lived(scene())


def test_a_prompt_in_two_halves_is_waited_for(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line()
        async with cell.link() as link:
            cell.faults.split_prompt_s = 6.0
            await link.command("SPEED 40")
            assert (await link.where()).location.z_mm == pytest.approx(863.6)

    lived(scene())


def test_a_line_without_echo_is_served_by_its_setting(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line(Manners(echo=False))
        async with cell.link(quick(echo=False)) as link:
            await link.move(GOAL)
            await link.wait_until_at_rest(GOAL)

    lived(scene())


def test_characters_can_be_typed_slowly(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line()
        async with cell.link(quick(character_pause_s=0.002)) as link:
            await link.command("SPEED 40")
            await link.where()
        assert "WHERE" in cell.sent()
        assert not [record for record in cell.records if record["way"] == "out" and "WHERE" in record["bytes"]]

    lived(scene())


# Mishaps


def ended_moves(sent: str) -> list[str]:
    """The moves whose line end went out; what was typed and cancelled moves nothing."""
    return re.findall(r"DO MOVE[^\r\x15]*\r", sent)


@pytest.mark.parametrize("prompt", ["start", "end"])
@pytest.mark.parametrize(
    ("what", "words"),
    [
        (Mishap.POWER_LOST, "Arm power off"),
        (Mishap.EMERGENCY_STOP, "Emergency stop"),
        (Mishap.ENVELOPE_ERROR, "Envelope error. Joint 2"),
        (Mishap.POWER_CYCLED, "the controller asks"),
    ],
)
@pytest.mark.parametrize("share", [0.05, 0.5, 0.95])
def test_a_mishap_in_mid_move_is_told_in_the_controller_s_words_and_no_further_motion_is_typed(
    timed_line: MakesLine, what: Mishap, words: str, prompt: Any, share: float
) -> None:
    async def scene() -> None:
        cell = timed_line(Manners(prompt_after_move=prompt))
        async with cell.link() as link:
            cell.faults.in_move.append((share, what))
            with pytest.raises(ControllerError, match=words):
                await go(link, GOAL)
            typed = cell.sent()
            with pytest.raises(LinkError):
                await link.move(NEARBY)
            again = 1  # where the rest of a half-typed line stood before the first, which was refused for it
            assert len(ended_moves(cell.sent())) <= len(ended_moves(typed)) + 1 + again
            before = cell.joints()
            await asyncio.sleep(0.1)
            np.testing.assert_array_equal(cell.joints(), before)

    lived(scene())


def test_a_controller_that_dies_in_mid_move_is_no_answer(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line()
        async with cell.link(quick(resync_s=0.1)) as link:
            cell.faults.in_move.append((0.5, Mishap.DEAD))
            with pytest.raises(NoAnswer):
                await go(link, GOAL, 1.0)

    lived(scene())


def test_an_emergency_stop_while_idle_is_told_before_the_next_command_is_typed(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line()
        async with cell.link() as link:
            with cell.server.controller() as controller:
                controller.mishap(Mishap.EMERGENCY_STOP)
            await asyncio.sleep(0.1)
            typed = cell.sent()
            with pytest.raises(ControllerError, match="Emergency stop"):
                await link.move(GOAL)
            assert cell.sent() == typed

    lived(scene())


def test_an_arm_stopped_by_hand_is_at_rest_elsewhere(timed_line: MakesLine) -> None:
    async def scene() -> None:
        cell = timed_line(time_scale=5.0)
        async with cell.link() as link:
            await link.command("SPEED 20")
            await link.move(GOAL)
            with cell.server.controller() as controller:
                controller.arm.halt(controller.now_s)
            with pytest.raises(Elsewhere, match="from its target") as problem:
                await link.wait_until_at_rest(GOAL)
            assert problem.value.where is not None

    lived(scene())


def test_an_arm_that_only_lingers_elsewhere_is_waited_for_and_one_that_stays_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def scene(seconds: list[float]) -> Where:
        at, link = iter(seconds), Link("nowhere", quick(break_after_move=False), clock=lambda: now[0])

        async def still(timeout_s: float, before: Where | None) -> Where:
            now[0] = next(at)
            return Where(GOAL if now[0] == seconds[-1] else NEARBY, (0.0,) * 6)

        monkeypatch.setattr(link, "still", still)
        return await link.wait_until_at_rest(GOAL)

    now = [0.0]
    assert asyncio.run(scene([0.0, 0.1, 0.2])).location == GOAL
    now = [0.0]
    with pytest.raises(Elsewhere):
        asyncio.run(scene([0.0, 0.1, 0.3, 0.4]))


def test_a_stop_that_nobody_waits_for_any_more_is_nobodys_unhandled_error() -> None:
    async def scene() -> list[dict[str, Any]]:
        told: list[dict[str, Any]] = []
        asyncio.get_running_loop().set_exception_handler(lambda _, context: told.append(context))

        async def failing() -> None:
            raise NoAnswer("no answer to ABORT")

        for task, ended in ((asyncio.create_task(failing()), False), (asyncio.create_task(asyncio.sleep(9.0)), True)):
            task.add_done_callback(mark_retrieved)
            if ended:
                task.cancel()
            await asyncio.wait([task])
            await asyncio.sleep(0)
            del task
        gc.collect()
        return told

    assert asyncio.run(scene()) == []


def test_a_link_that_was_never_opened_has_seen_no_stop() -> None:
    assert not Link("nowhere").permission.stop_tests


@pytest.mark.parametrize(("prompt", "usual_s"), [("start", 3.0), ("end", 50.0), ("either", 50.0)])
def test_the_answer_to_a_move_is_waited_for_as_long_as_was_said_or_as_its_controller_takes(
    prompt: Any, usual_s: float
) -> None:
    link = Link("nowhere", Dialect(prompt_after_move=prompt, answer_s=3.0, motion_s=50.0))
    waited_s = []

    class Line:
        @asynccontextmanager
        async def turn(self, moves: bool) -> AsyncIterator[None]:
            yield

        async def ask(self, talk: Any, line: str, replies: Any, wait_s: float, **_: Any) -> None:
            if not line.startswith("DO SET"):
                waited_s.append(wait_s)

        def accept(self, answer: Any) -> None:
            """Whatever it is."""

    link._session = Line()  # type: ignore[assignment]

    async def moves() -> None:
        for straight in (False, True):
            await link.move(GOAL, straight=straight)
            await link.move(GOAL, 0.7, straight=straight)

    asyncio.run(moves())
    assert waited_s == [usual_s, 0.7] * 2
