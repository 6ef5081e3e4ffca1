"""Who has the arm: one job at a time; the fault, then the stop, then the report."""

import asyncio
import gc
from collections.abc import Callable, Coroutine
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.arm.guard import Limits, MoveCommand
from daemon.arm.motion import Arrival, MoveRefusedError, NotAtTargetError
from daemon.arm.operators import JobEvent, OperatorRefusedError, RefusedError, operator_command
from daemon.arm.permission import Fault, Grant
from daemon.arm.robot import StopRefusedError
from daemon.arm.stopping import ABORT_S
from daemon.arm.supervisor import Supervisor
from daemon.errors import FacetdError
from daemon.events.codes import BY_OPERATOR, CauseCode, FaultCause
from tests.fakes.fake_cell import HEAD_DOWN, World, build
from tests.fakes.in_time import lived
from tests.fakes.waiting import until_so

NEAR = frames.perturb(HEAD_DOWN, np.array([30.0, 0, 0, 0, 0, 0]))

CAMERAS = FaultCause(CauseCode.CAMERA_LOST)


class Heard(list):
    """What the supervisor said came over the job, and what was on the wire by then."""


def supervised(enabled: bool = True) -> tuple[World, Supervisor, Heard]:
    world, heard = World(np.random.default_rng(0)), Heard()
    supervisor = Supervisor(build(world), Limits(), Arrival(), lambda what: heard.append((what, len(world.wire))))
    if enabled:
        supervisor.enable()
    return world, supervisor, heard


async def travelling(supervisor: Supervisor) -> None:
    """Back and forth until somebody stops it."""
    await supervisor.mover.wait_until_at_rest()
    for _ in range(100):
        for pose in (NEAR, HEAD_DOWN):
            await supervisor.mover.travel(pose, "to and fro", lambda _: 50.0)


async def interrupted(world: World, supervisor: Supervisor, act, name: str = "moving", count: int = 2):
    """Start travelling; at the count-th `name` run act in another task; give what the job ended in."""
    acting, seen = [], 0

    def hook(what: str) -> None:
        nonlocal seen
        seen += what == name
        if what == name and seen == count:
            acting.append(asyncio.get_running_loop().create_task(act()))

    world.before = hook
    try:
        await supervisor.run("travel", travelling(supervisor))
    except Exception as error:
        await asyncio.gather(*acting)
        return error
    raise AssertionError("nothing stopped it")


def waits_for(event: asyncio.Event) -> Callable[[], Coroutine[Any, Any, None]]:
    async def waits() -> None:
        await event.wait()

    return waits


STOPS = [
    (lambda s: s.stop("by hand"), "stopped by hand", JobEvent.STOP),
    (lambda s: s.fail("cameras", "no pair", CAMERAS), "cameras: no pair", JobEvent.ERROR),
    (lambda s: s.abort(), None, JobEvent.ABORT),
    (lambda s: s.disable(), None, JobEvent.ABORT),
    (lambda s: s.close(), None, JobEvent.ABORT),
]


@pytest.mark.parametrize(("act", "fault", "what"), STOPS)
def test_every_stop_ends_the_job_with_an_abort_as_the_last_word_and_then_says_what_it_was(act, fault, what):
    world, supervisor, heard = supervised()
    error = lived(interrupted(world, supervisor, lambda: act(supervisor)))
    assert isinstance(error, RefusedError)
    assert supervisor.fault_text == fault
    assert world.wire[-1][0] == "abort"
    assert heard == [(what, len(world.wire))]
    assert not supervisor.busy
    assert [r["text"] for r in world.said("fault")] == ([] if fault is None else [fault])


@pytest.mark.parametrize(("act", "fault", "what"), STOPS[:2])
def test_the_fault_stands_and_the_place_is_forgotten_before_the_arm_is_told_to_stop(act, fault, what):
    world, supervisor, _ = supervised()
    standing = []
    lived(supervisor.mover.wait_until_at_rest())

    def hook(name: str) -> None:
        if name == "abort":
            standing.append((supervisor.fault_text, supervisor.mover.belief.resting_reading, len(world.said("fault"))))

    world.before = hook
    lived(act(supervisor))
    assert standing == [(fault, None, 0)], "the fault, then the stop, then the report"


def test_a_burst_of_stops_is_told_once_for_each_who_stopped_and_a_later_one_again():
    """Six hundred from two frontends were six hundred faults at every frontend and in the log."""
    world, supervisor, _ = supervised()

    async def burst() -> None:
        await asyncio.gather(*(supervisor.stop(f"by {who}") for who in ("ann", "bob") * 100))
        await supervisor.stop("by ann")

    lived(burst())
    assert [record["text"] for record in world.said("fault")] == ["stopped by ann", "stopped by bob", "stopped by ann"]
    assert [name for name, _ in world.wire] == ["abort"] * 2


def test_an_arm_that_is_being_stopped_is_told_no_further_move():
    world, supervisor, _ = supervised()

    async def slow_abort():
        world.wire.append(("abort", None))
        for _ in range(20):
            await asyncio.sleep(0)

    supervisor.mover.cell.robot.stop_motion = slow_abort
    lived(interrupted(world, supervisor, supervisor.stop))
    names = [name for name, _ in world.wire]
    assert names[names.index("abort") :] == ["abort"]


def test_an_error_in_a_job_that_moves_stops_the_arm_and_one_in_a_job_that_only_looks_does_not():
    for moves in (True, False):
        world, supervisor, heard = supervised()

        async def broken() -> None:
            raise OSError("the cable came out")

        with pytest.raises(OSError, match="cable"):
            lived(supervisor.run("work", broken(), moves))
        assert (supervisor.fault_text == "the cable came out") is moves
        assert [name for name, _ in world.wire] == ["abort"] * moves
        assert [what for what, _ in heard] == [JobEvent.ERROR] * moves


def test_a_refusal_in_a_job_is_no_fault():
    world, supervisor, heard = supervised(enabled=False)
    with pytest.raises(MoveRefusedError):
        lived(supervisor.run("travel", travelling(supervisor)))
    assert (supervisor.fault_text, world.wire, heard) == (None, [], [])


def test_an_abort_that_is_not_answered_is_a_fault_that_sends_to_the_emergency_stop():
    world, supervisor, heard = supervised()

    def dead(name: str) -> None:
        if name == "abort":
            raise OSError("no answer")

    world.before = dead
    lived(supervisor.abort())
    assert "press the emergency stop" in supervisor.fault_text
    assert [what for what, _ in heard] == [JobEvent.ERROR]


def test_one_job_at_a_time_and_nothing_is_switched_under_it():
    _, supervisor, _ = supervised()

    async def by_somebody(act, *values) -> None:
        act(*values)

    async def story() -> None:
        free = asyncio.Event()
        task = asyncio.create_task(supervisor.run("wait", free.wait()))
        await asyncio.sleep(0)
        assert supervisor.status()["doing"] == "wait"
        for refused in (
            supervisor.run("other", asyncio.sleep(0)),
            by_somebody(supervisor.dry, True),
            by_somebody(supervisor.refit, supervisor.mover.cell, Limits(), Arrival()),
        ):
            with pytest.raises(RefusedError, match="busy: wait"):
                await refused
        free.set()
        await task
        assert supervisor.status()["doing"] is None

    lived(story())


def test_resume_clears_a_fault_and_waits_until_the_arm_is_stopped():
    world, supervisor, heard = supervised()
    lived(supervisor.stop())
    with pytest.raises(RefusedError, match="`resume`"):
        supervisor.refuse_unless_permitted()
    supervisor.resume()
    supervisor.refuse_unless_permitted()
    assert [what for what, _ in heard] == [JobEvent.STOP, JobEvent.RESUME]

    def early() -> None:
        with pytest.raises(RefusedError, match="still stopping the arm"):
            supervisor.resume()

    async def stop_and_resume() -> None:
        stopping = asyncio.create_task(supervisor.stop())
        await asyncio.sleep(0)
        early()
        await stopping

    lived(interrupted(world, supervisor, stop_and_resume))
    supervisor.resume()


def test_a_pause_is_told_when_a_move_meets_it_and_its_end_when_it_goes_on():
    world, supervisor, heard = supervised()

    async def story() -> None:
        supervisor.hold.pause()
        assert not heard
        task = asyncio.create_task(supervisor.run("travel", travelling(supervisor)))
        while not heard:
            await asyncio.sleep(0)
        assert not world.wire
        supervisor.resume()
        while len(world.wire) < 3:
            await asyncio.sleep(0)
        await supervisor.abort()
        with pytest.raises(RefusedError):
            await task

    lived(story())
    assert [what for what, _ in heard] == [JobEvent.PAUSE, JobEvent.RESUME, JobEvent.ABORT]


def test_a_no_to_a_pending_move_leaves_it_unsent_and_no_fault():
    world, supervisor, _ = supervised()

    async def story() -> None:
        supervisor.hold.step(True)
        with pytest.raises(RefusedError, match="no move is waiting"):
            supervisor.hold.confirm()
        task = asyncio.create_task(supervisor.run("travel", travelling(supervisor)))
        while supervisor.status()["pending"] is None:
            await asyncio.sleep(0)
        supervisor.hold.refuse()
        with pytest.raises(OperatorRefusedError, match="to and fro: joint move to"):
            await task

    lived(story())
    assert (world.wire, supervisor.fault_text) == ([], None)


def test_neither_step_on_nor_step_off_is_a_yes_to_the_move_that_waits():
    """`step off` at one frontend sent the move about which somebody was being asked at another."""
    world, supervisor, _ = supervised()

    async def story() -> None:
        supervisor.hold.step(True)
        task = asyncio.create_task(supervisor.run("travel", travelling(supervisor)))
        while supervisor.status()["pending"] is None:
            await asyncio.sleep(0)
        for on in (True, False):
            supervisor.hold.step(on)
            for _ in range(20):
                await asyncio.sleep(0)
            assert not world.wire
        supervisor.hold.confirm()
        while not world.wire:
            await asyncio.sleep(0)
        await supervisor.abort()
        with pytest.raises(RefusedError):
            await task

    lived(story())


def test_a_pause_holds_also_the_move_that_waited_for_a_yes_when_it_was_said():
    """Somebody was told that the arm holds before its next move, and the yes of another sent it off."""
    world, supervisor, heard = supervised()

    async def story() -> None:
        supervisor.hold.step(True)
        task = asyncio.create_task(supervisor.run("travel", travelling(supervisor)))
        await until_so(lambda: supervisor.status()["pending"] is not None)
        supervisor.hold.pause()
        supervisor.hold.confirm()
        await until_so(lambda: bool(heard))
        assert (world.wire, supervisor.status()["pending"]) == ([], None)
        supervisor.resume()
        await until_so(lambda: bool(world.wire))
        await supervisor.abort()
        with pytest.raises(RefusedError):
            await task

    lived(asyncio.wait_for(story(), 10.0))
    assert [what for what, _ in heard] == [JobEvent.PAUSE, JobEvent.RESUME, JobEvent.ABORT]


def test_a_word_from_before_a_stop_begins_nothing_that_moves_and_what_a_job_leaves_behind_is_no_word():
    _, supervisor, _ = supervised()
    left: list[asyncio.Task[str]] = []

    async def work(what: str = "done") -> str:
        return what

    async def leaving() -> None:
        left.append(asyncio.create_task(later()))

    async def later() -> str:
        await asyncio.sleep(0.1)
        return await supervisor.run("go on", work("went on"))

    async def story() -> None:
        with operator_command("pick", supervisor.stops):
            await supervisor.run("pick", leaving())
            await supervisor.abort()
            with pytest.raises(RefusedError, match="somebody stopped the arm meanwhile; type `pick` again"):
                await supervisor.run("pick", work())
            assert await supervisor.run("look", work("seen"), moves=False) == "seen"
        assert await supervisor.run("pick", work()) == "done"
        assert await left[0] == "went on"

    lived(story())


class OthersTypeError(FacetdError):
    """As the driver has it."""

    code = "other_terminal"


@pytest.mark.parametrize(
    ("enabled", "error", "faults"),
    [(True, OthersTypeError, True), (True, FacetdError, False), (False, OthersTypeError, False)],
)
def test_others_on_the_line_of_an_arm_that_may_move_are_a_fault_whoever_hears_of_them(enabled, error, faults):
    """`where` alone was told of them, and the arm was disabled without a word to anybody else."""
    _, supervisor, _ = supervised()
    if not enabled:
        supervisor.permission.withdraw()

    async def where() -> None:
        raise error("typed")

    with pytest.raises(FacetdError, match="typed"):
        lived(supervisor.run("where", where(), moves=False))
    assert (supervisor.fault_text is not None) is faults


def test_others_are_a_fault_though_only_the_question_whether_the_arm_rests_heard_of_them():
    """Control-C asks it; it was answered by a stop, and nobody was told that somebody else types on the line."""
    world, supervisor, _ = supervised()

    async def at_rest() -> bool:
        raise OthersTypeError("typed")

    supervisor.mover.cell.robot.at_rest = at_rest
    assert not lived(supervisor.at_rest())
    assert supervisor.fault_text == "typed"
    assert [record["code"] for record in world.said("fault")] == ["other_terminal"]


def test_others_are_a_fault_though_what_heard_of_them_was_being_stopped():
    world, supervisor, _ = supervised()

    async def where() -> None:
        try:
            await asyncio.sleep(60.0)
        except asyncio.CancelledError:
            raise OthersTypeError("typed") from None

    async def story() -> None:
        job = asyncio.create_task(supervisor.run("where", where(), moves=False))
        await until_so(lambda: supervisor.busy)
        await supervisor.abort()
        with pytest.raises(OthersTypeError):
            await job

    lived(story())
    assert supervisor.fault_text == "typed"
    assert [record["code"] for record in world.said("fault")] == ["other_terminal"]


def test_what_was_held_after_a_resume_was_decided_on_stays_held_and_the_fault_goes_all_the_same():
    _, supervisor, _ = supervised()
    supervisor.latch("stopped by bob")
    supervisor.hold.pause()
    decided = supervisor.hold.pauses
    supervisor.hold.pause()
    supervisor.resume(None, decided)
    assert (supervisor.fault_text, supervisor.hold.paused) == (None, True)
    supervisor.resume(None, supervisor.hold.pauses)
    assert not supervisor.hold.paused


def test_what_is_to_hold_for_all_of_a_job_is_changed_between_jobs_alone():
    _, supervisor, _ = supervised()
    supervisor.refuse_during_job("this")

    async def story() -> None:
        task = asyncio.create_task(supervisor.run("wait", asyncio.sleep(0.05)))
        await asyncio.sleep(0.0)
        with pytest.raises(RefusedError, match="busy: wait; this only when that has ended: wait, or `abort`"):
            supervisor.refuse_during_job("this")
        await task

    lived(story())


async def endless(world: World) -> None:
    """A foreign motion: CAL, or a line typed at the monitor."""
    world.wire.append(("foreign", None))
    await asyncio.sleep(60.0)


@pytest.mark.parametrize("way", ["not enabled", "fault", "dry"])
def test_what_an_operator_tells_the_controller_himself_is_refused_where_the_arm_may_not_move(way):
    world, supervisor, _ = supervised(enabled=way != "not enabled")
    if way == "fault":
        supervisor.latch("stopped")
    supervisor.dry(way == "dry")
    supervisor.hold.step(True)
    with pytest.raises(RefusedError):
        lived(asyncio.wait_for(supervisor.run_typed_line("CAL", lambda: endless(world)), 1.0))
    assert world.wire == []


@pytest.mark.parametrize(("act", "fault", "what"), STOPS)
def test_every_stop_ends_what_an_operator_told_the_controller_and_status_shows_it_until_then(act, fault, what):
    world, supervisor, _ = supervised()

    async def story() -> None:
        task = asyncio.create_task(supervisor.run_typed_line("CAL", lambda: endless(world)))
        while not world.wire:
            await asyncio.sleep(0)
        assert supervisor.status()["doing"] == "CAL"
        await act(supervisor)
        with pytest.raises(RefusedError):
            await task

    lived(story())
    assert [name for name, _ in world.wire] == ["foreign", "abort"]
    assert supervisor.fault_text == fault


def test_what_an_operator_tells_the_controller_is_held_and_confirmed_like_a_move_and_asked_for_again_after():
    world, supervisor, _ = supervised()

    async def story() -> None:
        supervisor.hold.pause()
        supervisor.hold.step(True)
        task = asyncio.create_task(supervisor.run_typed_line("CAL", lambda: endless(world)))
        await asyncio.sleep(0.01)
        supervisor.resume()
        while supervisor.status()["pending"] is None:
            await asyncio.sleep(0)
        assert supervisor.status()["pending"] == "CAL"
        supervisor.mover.cell.robot.permission.stop_tests = 0  # the line was opened anew
        supervisor.hold.confirm()
        with pytest.raises(RefusedError, match="not enabled"):
            await task

    lived(story())
    assert world.wire == []


def test_an_error_in_what_an_operator_told_the_controller_stops_the_arm():
    world, supervisor, _ = supervised()

    async def broken() -> None:
        raise OSError("*Envelope error*")

    with pytest.raises(OSError, match="Envelope"):
        lived(supervisor.run_typed_line("CAL", broken))
    assert [name for name, _ in world.wire] == ["abort"]
    assert "Envelope" in str(supervisor.fault_text)


@pytest.mark.parametrize("way", ["stop", "conversation", "motion"])
def test_after_a_stop_and_after_words_of_others_nobody_knows_where_the_arm_is_and_how_the_hand_stands(way):
    _, supervisor, _ = supervised()
    mover = supervisor.mover

    async def story() -> None:
        await mover.wait_until_at_rest()
        await mover.set_gripper(closed=False)
        assert (mover.belief.resting_reading is None, mover.belief.closed.value) == (False, False)
        if way == "stop":
            await supervisor.stop()
        elif way == "conversation":
            await supervisor.converse("monitor", lambda: asyncio.sleep(0), moves=False)
        else:
            await supervisor.run_typed_line("DO READY", lambda: asyncio.sleep(0))

    lived(story())
    assert (mover.belief.resting_reading, mover.next_start, mover.belief.closed) == (None, None, None)


@pytest.mark.parametrize("way", ["pause", "step"])
def test_a_move_that_was_held_is_given_up_where_the_arm_was_moved_meanwhile(way):
    """While it waits, somebody drives the arm elsewhere by its pendant: what was one step is now farther than one, and
    what was straight down is now aslant."""
    world, supervisor, heard = supervised()
    mover = supervisor.mover

    async def story() -> None:
        await mover.wait_until_at_rest()
        supervisor.hold.step(way == "step")
        if way == "pause":
            supervisor.hold.pause()
        task = asyncio.create_task(supervisor.run("go", mover.go(MoveCommand(NEAR, False, 50.0, "a test"))))
        while not heard and supervisor.status()["pending"] is None:
            await asyncio.sleep(0)
        world.at = frames.perturb(HEAD_DOWN, np.array([-430.0, 0, 0, 0, 0, 0]))
        supervisor.resume()
        if way == "step":
            supervisor.hold.confirm()
        with pytest.raises(NotAtTargetError, match="somebody else moved the arm"):
            await task

    lived(story())
    assert [name for name, _ in world.wire] == ["abort"]


@pytest.mark.parametrize("work", ["move", "hand"])
def test_a_pause_said_while_it_is_asked_where_the_arm_is_after_a_wait_holds_what_waited(work):
    """It was told to hold, and the move was sent half a second later: WHERE takes its time on the line."""
    world, supervisor, _ = supervised()
    mover = supervisor.mover

    async def story() -> None:
        await mover.wait_until_at_rest()
        supervisor.hold.pause()
        what = mover.go(MoveCommand(NEAR, False, 50.0, "a test")) if work == "move" else mover.set_gripper(closed=True)
        task = asyncio.create_task(supervisor.run("go", what))
        await asyncio.sleep(0.01)
        world.before = lambda name: supervisor.hold.pause() if name == "where" else None
        supervisor.resume()
        await asyncio.sleep(0.05)
        assert world.wire == []
        world.before = lambda _: None
        supervisor.resume()
        await task

    lived(story())
    assert [name for name, _ in world.wire] == [work]


def test_in_a_dry_run_a_move_that_was_held_goes_on_from_where_the_arm_would_be():
    world, supervisor, _ = supervised()
    supervisor.dry(True)
    asked = []
    world.before = asked.append

    async def story() -> None:
        supervisor.hold.step(True)
        task = asyncio.create_task(supervisor.run("travel", travelling(supervisor)))
        for _ in range(3):
            while supervisor.status()["pending"] is None:
                await asyncio.sleep(0)
            supervisor.hold.confirm()
            await asyncio.sleep(0)
        assert asked == ["where"], "before the first, and never again"
        await supervisor.abort()
        with pytest.raises(RefusedError):
            await task

    lived(story())
    assert world.said("move")
    assert not world.said("refusal")


@pytest.mark.parametrize("busy", [True, False])
def test_neither_resume_nor_enable_is_heard_while_the_answer_to_a_stop_is_awaited(busy):
    world, supervisor, _ = supervised()
    answered = asyncio.Event()

    async def slow_abort() -> None:
        world.wire.append(("abort", None))
        await answered.wait()

    supervisor.mover.cell.robot.stop_motion = slow_abort

    async def story() -> None:
        job = asyncio.create_task(supervisor.run_typed_line("CAL", lambda: endless(world))) if busy else None
        await asyncio.sleep(0.01)
        stopping = asyncio.create_task(supervisor.stop("by ann"))
        await asyncio.sleep(0.01)
        for word in (supervisor.resume, supervisor.enable):
            with pytest.raises(RefusedError, match="still stopping the arm"):
                word()
        assert supervisor.fault_text == "stopped by ann"
        assert not stopping.done()
        answered.set()
        await stopping
        if job is not None:
            await asyncio.wait({job})
            assert isinstance(job.exception(), RefusedError)

    lived(story())
    assert supervisor.fault_text == "stopped by ann"
    supervisor.resume()


def test_an_enable_that_races_a_disable_ends_disabled():
    world, supervisor, _ = supervised()
    refused = []

    async def race() -> None:
        disabling = asyncio.create_task(supervisor.disable())
        while not disabling.done():
            await asyncio.sleep(0)
            if not disabling.done():
                try:
                    supervisor.enable()
                except RefusedError as error:
                    refused.append(error)
        await disabling

    async def slow_abort() -> None:
        world.wire.append(("abort", None))
        for _ in range(20):
            await asyncio.sleep(0)

    supervisor.mover.cell.robot.stop_motion = slow_abort
    lived(interrupted(world, supervisor, race))
    assert refused
    assert not supervisor.permission.enabled


def test_a_stop_that_came_while_somebody_was_asked_about_an_older_fault_stands():
    _, supervisor, _ = supervised()
    lived(supervisor.stop("by ann"))
    seen = supervisor.stops
    lived(supervisor.stop("by ann"))
    with pytest.raises(RefusedError, match="somebody stopped the arm meanwhile"):
        supervisor.resume(seen)
    assert supervisor.fault_text == "stopped by ann"


class Unheard(Heard):
    """Nobody who is told of anything can hear it."""

    def append(self, _) -> None:
        raise OSError("nobody is there")


def no_log(*_, **__) -> None:
    raise OSError(28, "No space left on device")


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """The alarm and the next round come at once."""
    monkeypatch.setattr("daemon.arm.stopping.ABORT_S", 0.05)
    monkeypatch.setattr("daemon.arm.stopping.AGAIN_S", 0.01)


def failing_aborts(world: World, error: Exception, count: int) -> list[str]:
    """The first `count` rounds of a stop fail; every round as it is told."""
    told: list[str] = []

    def hook(name: str) -> None:
        if name == "abort":
            told.append(name)
            if len(told) <= count:
                raise error

    world.before = hook
    return told


@pytest.mark.parametrize("error", [OSError("no answer"), StopRefusedError("the controller does not take the word")])
def test_the_arm_is_told_to_stop_until_it_was_seen_at_rest_and_the_alarm_sounds_meanwhile(soon, error):
    world, supervisor, heard = supervised()
    told = failing_aborts(world, error, 12)

    async def story() -> None:
        alarm = await supervisor.stop("by ann")
        assert alarm is not None
        assert "stopped by ann; NOT CONFIRMED: " in alarm
        assert str(error) in alarm
        assert "press the emergency stop" in alarm
        assert supervisor.permission.stopping
        assert "press the emergency stop" in str(supervisor.fault_text)
        for word in (supervisor.resume, supervisor.enable):
            with pytest.raises(RefusedError, match="press the emergency stop"):
                word()
        again = await supervisor.stop("by bob")
        assert again is not None
        await until_so(lambda: not supervisor.permission.stopping)
        assert "press the emergency stop" in str(supervisor.fault_text), "it stands until resume"
        supervisor.resume()
        assert await supervisor.stop("by cat") is None
        assert supervisor.fault_text == "stopped by cat", "an alarm that is over keeps no later fault from standing"
        supervisor.resume()

    lived(story())
    assert len(told) == 14
    assert [fault["text"] for fault in world.said("fault")][1:] == ["stopped by cat"], "the alarm, once"
    assert len(world.said("rest")) == 1
    both = [JobEvent.ERROR, JobEvent.RESUME, JobEvent.STOP, JobEvent.RESUME]
    assert [what for what, _ in heard] == both


def test_an_arm_that_is_not_seen_at_rest_is_told_to_stop_eight_times_before_the_alarm():
    world, supervisor, _ = supervised()
    told = failing_aborts(world, OSError("no answer"), 100)

    async def story() -> None:
        began_s = asyncio.get_running_loop().time()
        await supervisor.stop()
        assert asyncio.get_running_loop().time() - began_s == pytest.approx(ABORT_S, abs=0.1)

    lived(story())
    assert 8 <= len(told) <= 9


def test_a_refused_stop_is_told_at_once_and_not_after_the_time_that_a_lost_one_has():
    world, supervisor, _ = supervised()
    failing_aborts(world, StopRefusedError("no such word"), 1)

    async def story() -> None:
        began = asyncio.get_running_loop().time()
        assert await supervisor.stop() is not None
        assert asyncio.get_running_loop().time() - began < 0.3

    lived(story())


def test_nothing_moves_while_a_stop_that_leaves_no_fault_is_under_way():
    world, supervisor, _ = supervised()
    answered = asyncio.Event()
    supervisor.mover.cell.robot.stop_motion = waits_for(answered)

    async def story() -> None:
        await supervisor.mover.wait_until_at_rest()
        stopping = asyncio.create_task(supervisor.abort())
        await asyncio.sleep(0.01)
        await supervisor.mover.wait_until_at_rest()
        with pytest.raises(MoveRefusedError, match="being stopped"):
            await supervisor.mover.go(MoveCommand(NEAR, False, 50.0, "a test"))
        with pytest.raises(MoveRefusedError, match="being stopped"):
            await supervisor.mover.set_gripper(closed=True)
        with pytest.raises(RefusedError, match="being stopped"):
            await supervisor.run_typed_line("CAL", lambda: endless(world))
        with pytest.raises(RefusedError, match="busy: being stopped"):
            await supervisor.run("travel", travelling(supervisor))
        answered.set()
        assert await stopping is None
        assert supervisor.fault_text is None
        await supervisor.mover.wait_until_at_rest()
        await supervisor.mover.go(MoveCommand(NEAR, False, 50.0, "a test"))

    lived(story())
    assert [name for name, _ in world.wire] == ["move"]


@pytest.mark.parametrize(("act", "fault", "what"), STOPS)
def test_a_stop_is_a_stop_though_everybody_who_is_told_of_it_fails(act, fault, what):
    world = World(np.random.default_rng(0))
    supervisor = Supervisor(build(world), Limits(), Arrival(), Unheard().append)
    supervisor.enable()

    async def unheard() -> None:
        world.record = no_log
        await act(supervisor)

    assert isinstance(lived(interrupted(world, supervisor, unheard)), RefusedError)
    assert world.wire[-1][0] == "abort"
    assert supervisor.fault_text == fault


@pytest.mark.parametrize("voids", ["stop", "disable", "abort"])
def test_an_enable_that_was_asked_for_before_a_stop_or_a_disable_is_void(voids):
    _, supervisor, _ = supervised(enabled=False)

    async def story() -> None:
        asked = supervisor.stops
        await getattr(supervisor, voids)()
        with pytest.raises(RefusedError, match="type `enable` again"):
            supervisor.enable(asked)
        assert not supervisor.permission.enabled
        supervisor.enable(supervisor.stops)
        assert supervisor.permission.enabled

    lived(story())


def test_nothing_moves_without_a_stop_that_was_seen_to_work_since_the_line_was_opened():
    world, supervisor, _ = supervised(enabled=False)
    robot = supervisor.mover.cell.robot
    robot.permission.stop_tests = 0

    async def story() -> None:
        with pytest.raises(RefusedError, match="the stop was not tested"):
            supervisor.enable()
        await supervisor.test_stop()
        supervisor.enable()
        await supervisor.mover.wait_until_at_rest()
        await supervisor.mover.go(MoveCommand(NEAR, False, 50.0, "a test"))
        robot.permission.stop_tests = 0  # as after the line was opened anew
        with pytest.raises(MoveRefusedError, match="not_enabled"):
            await supervisor.mover.go(MoveCommand(HEAD_DOWN, False, 50.0, "a test"))
        with pytest.raises(RefusedError, match="`enable`"):
            await supervisor.run_typed_line("CAL", lambda: endless(world))

    lived(story())
    assert [name for name, _ in world.wire] == ["move"]


def test_a_line_that_was_opened_anew_takes_the_enable_away_and_no_stop_gives_it_back():
    _, supervisor, _ = supervised()

    async def story() -> None:
        await supervisor.mover.wait_until_at_rest()
        asked = supervisor.stops
        supervisor.line_opened_anew()
        assert (supervisor.permission.enabled, supervisor.mover.belief.resting_reading) == (False, None)
        with pytest.raises(RefusedError, match="type `enable` again"):
            supervisor.enable(asked)
        await supervisor.stop()
        supervisor.resume()
        assert not supervisor.permission.enabled

    lived(story())


def test_a_stop_that_is_seen_to_work_gives_no_leave_back():
    world, supervisor, _ = supervised()
    robot = supervisor.mover.cell.robot
    robot.permission.stop_tests = 0  # the controller was switched off and on

    def hook(_: str) -> None:
        robot.permission.stop_tests = 2

    world.before = hook
    lived(supervisor.stop())
    supervisor.resume()
    assert not supervisor.permission.enabled


def test_an_arm_enabled_by_hand_only_takes_what_an_operator_tells_the_controller_and_no_move_of_ours():
    world, supervisor, _ = supervised(enabled=False)
    supervisor.enable(grant=Grant.TYPED_LINES)

    async def story() -> None:
        await supervisor.mover.wait_until_at_rest()
        with pytest.raises(MoveRefusedError, match="not_enabled"):
            await supervisor.mover.go(MoveCommand(NEAR, False, 50.0, "a test"))
        with pytest.raises(RefusedError, match="no hand_eye"):
            supervisor.refuse_unless_permitted()
        task = asyncio.create_task(supervisor.run_typed_line("CAL", lambda: endless(world)))
        await until_so(lambda: world.wire)
        await supervisor.disable()
        with pytest.raises(RefusedError):
            await task

    lived(story())
    assert [name for name, _ in world.wire] == ["foreign", "abort"]
    assert not supervisor.permission.typed_lines_only


def test_what_is_told_by_hand_waits_for_a_yes_of_its_own():
    world, supervisor, _ = supervised()

    async def story() -> None:
        task = asyncio.create_task(supervisor.run_typed_line("DO READY", lambda: endless(world), ask=True))
        await until_so(lambda: supervisor.status()["pending"] == "DO READY")
        supervisor.hold.step(False)  # moves no longer wait: this is none of them
        await asyncio.sleep(0.01)
        assert supervisor.status()["pending"] == "DO READY"
        supervisor.hold.refuse()
        with pytest.raises(OperatorRefusedError):
            await task

    lived(story())
    assert world.wire == []


def test_an_arm_counts_as_at_rest_by_its_own_word_only():
    _, supervisor, _ = supervised()
    robot = supervisor.mover.cell.robot

    async def moving() -> bool:
        return False

    async def deaf() -> bool:
        raise OSError("no answer")

    async def slow() -> bool:
        await asyncio.sleep(1.5)
        return True

    async def silent() -> bool:
        await asyncio.sleep(60.0)
        return True

    async def story() -> None:
        assert await supervisor.at_rest()
        robot.at_rest = slow
        assert await supervisor.at_rest(), "two WHERE take more than a second where the line is slow"
        for word in (moving, deaf, silent):
            robot.at_rest = word
            assert not await supervisor.at_rest()

    lived(story())


def test_what_the_controller_says_counts_as_long_as_it_is_asked_whether_the_arm_is_at_rest():
    _, supervisor, _ = supervised()
    counted = []

    async def slow() -> bool:
        for _ in range(3):
            counted.append(supervisor.rest_reports)
            supervisor.permission.heard += 1
        return True

    async def story() -> None:
        supervisor.permission.heard = 40
        assert supervisor.rest_reports == 0
        supervisor.mover.cell.robot.at_rest = slow
        assert await supervisor.at_rest()

    lived(story())
    assert counted == [0, 1, 2]
    assert supervisor.rest_reports == 0


def test_an_arm_at_work_or_being_stopped_is_not_asked_whether_it_rests():
    """It would be answered when the work is done, and whoever asks waits for a word of comfort until then."""
    world, supervisor, _ = supervised()
    asked = []

    async def at_rest() -> bool:
        asked.append(supervisor.busy)
        return True

    async def slow_abort() -> None:
        await asyncio.sleep(0.05)

    supervisor.mover.cell.robot.at_rest, supervisor.mover.cell.robot.stop_motion = at_rest, slow_abort

    async def story() -> None:
        task = asyncio.create_task(supervisor.run("travel", endless(world)))
        await until_so(lambda: supervisor.busy)
        assert not await supervisor.at_rest()
        stopping = asyncio.create_task(supervisor.stop())
        await until_so(lambda: supervisor.permission.stopping)
        assert not await supervisor.at_rest()
        await stopping
        with pytest.raises(RefusedError):
            await task
        assert await supervisor.at_rest()

    lived(story())
    assert asked == [False]


def test_who_asks_whether_the_arm_rests_while_it_is_being_asked_waits_for_the_same_word():
    """Control-C held down on an arm at rest had so many questions on the line that the last were answered by a stop."""
    _, supervisor, _ = supervised()
    asked, words = [], [True, False]

    async def at_rest() -> bool:
        asked.append(True)
        await asyncio.sleep(0.3)
        return words.pop(0)

    supervisor.mover.cell.robot.at_rest = at_rest

    async def story() -> None:
        assert await asyncio.gather(*(supervisor.at_rest() for _ in range(60))) == [True] * 60
        assert not await supervisor.at_rest()

    lived(story())
    assert len(asked) == 2


@pytest.mark.parametrize("begins", ["a job", "a stop"])
def test_what_begins_while_the_arm_is_asked_whether_it_rests_counts_against_it(begins):
    world, supervisor, _ = supervised()
    tasks = []

    async def at_rest() -> bool:
        tasks.append(
            asyncio.create_task(supervisor.run("foreign", endless(world)) if begins == "a job" else supervisor.stop())
        )
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        return True

    async def slow_abort() -> None:
        await asyncio.sleep(0.05)

    supervisor.mover.cell.robot.at_rest, supervisor.mover.cell.robot.stop_motion = at_rest, slow_abort

    async def story() -> None:
        assert not await supervisor.at_rest()
        await supervisor.stop()
        await asyncio.gather(*tasks, return_exceptions=True)

    lived(story())


def test_an_error_of_a_job_that_nobody_waits_for_any_more_is_nobodys_unhandled_error():
    _, supervisor, _ = supervised()
    unhandled = []

    async def broken() -> None:
        await asyncio.sleep(0.01)
        raise OSError("the cable came out")

    async def story() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda _, context: unhandled.append(context))
        asker = asyncio.create_task(supervisor.run("look", broken(), moves=False))
        await asyncio.sleep(0)
        asker.cancel()
        await until_so(lambda: not supervisor.busy)
        asker = asyncio.create_task(supervisor.run("look", broken(), moves=False))
        await asyncio.sleep(0)
        await supervisor.abort()
        await asyncio.gather(asker, return_exceptions=True)
        del asker
        gc.collect()
        await asyncio.sleep(0)

    lived(story())
    assert unhandled == []


def test_it_is_paused_from_pause_to_resume():
    _, supervisor, _ = supervised()
    said = [supervisor.hold.paused]
    for word in (supervisor.hold.pause, supervisor.resume):
        word()
        said.append(supervisor.hold.paused)
    assert said == [False, True, False]


def test_a_stop_is_tried_once_while_a_line_is_open_and_one_that_is_not_taken_is_no_fault():
    world, supervisor, heard = supervised(enabled=False)
    robot, tried = supervisor.mover.cell.robot, []

    async def test_stop() -> None:
        tried.append(True)
        raise StopRefusedError("the controller does not take the word HALT")

    robot.permission.stop_tests, robot.test_stop = 0, test_stop

    async def story() -> None:
        with pytest.raises(StopRefusedError, match="HALT"):
            await supervisor.test_stop()
        robot.permission.stop_tests = 2
        await supervisor.test_stop()

    lived(story())
    assert len(tried) == 1
    assert (supervisor.fault_text, world.wire, list(heard)) == (None, [], [])


def test_an_error_in_a_job_replaces_no_fault_that_stands_already():
    world, supervisor, _ = supervised()

    async def broken() -> None:
        supervisor.latch("cameras: no pair")
        raise OSError("the cable came out")

    with pytest.raises(OSError, match="cable"):
        lived(supervisor.run("work", broken()))
    assert supervisor.fault_text == "cameras: no pair"
    assert (world.wire, world.said("fault")) == ([], [])


def test_a_stop_whose_telling_was_ended_with_the_daemon_is_not_called_confirmed():
    world, supervisor, _ = supervised()
    failing_aborts(world, OSError("no answer"), 100)

    async def story() -> None:
        stopping = asyncio.create_task(supervisor.stop("by ann"))
        (sending,) = await until_so(lambda: [task for task in asyncio.all_tasks() if task.get_name() == "stop"])
        sending.cancel()
        assert "NOT CONFIRMED: the daemon has ended: press the emergency stop" in str(await stopping)

    lived(story())


def test_the_end_waits_for_rest_beyond_the_alarm(soon):
    world, supervisor, _ = supervised()
    told = failing_aborts(world, OSError("no answer"), 12)

    async def story() -> None:
        await supervisor.close()
        assert supervisor.permission.stopping
        await supervisor.wait_for_stop_end()

    lived(story())
    assert len(told) == 13


@pytest.mark.parametrize("let", [Grant.ALL, Grant.TYPED_LINES, None])
def test_an_arm_that_may_move_is_told_to_stop_when_it_is_disabled_though_no_job_of_ours_has_it(let):
    """A program that an operator started at the controller goes on without any job of ours."""
    world, supervisor, _ = supervised(enabled=False)
    if let is not None:
        supervisor.enable(grant=let)
    lived(supervisor.disable())
    assert [name for name, _ in world.wire] == ([] if let is None else ["abort"])
    assert not supervisor.permission.enabled


def test_a_move_that_waits_for_a_yes_is_told_to_a_tenth_of_a_millimetre():
    _, supervisor, _ = supervised()
    target = frames.perturb(HEAD_DOWN, np.array([30.26, 0.04, -7.0, 0, 0, 0]))

    async def story() -> None:
        supervisor.hold.step(True)
        task = asyncio.create_task(supervisor.run("travel", travel(target)))
        await until_so(lambda: supervisor.status()["pending"] is not None)
        pending = supervisor.status()["pending"]
        assert pending.startswith(
            "there: joint move to x 450.3 y 0 z 53 mm at 50 %, from here x +30 y +0 z -7 mm and 0"
        )
        supervisor.hold.refuse()
        with pytest.raises(OperatorRefusedError):
            await task

    async def travel(pose) -> None:
        await supervisor.mover.wait_until_at_rest()
        await supervisor.mover.travel(pose, "there", lambda _: 50.0)

    lived(story())


def test_an_arm_that_fails_to_say_whether_it_rests_once_nobody_waits_any_more_is_nobodys_unhandled_error():
    _, supervisor, _ = supervised()
    unhandled = []

    async def late() -> bool:
        await asyncio.sleep(10.0)
        raise OSError("the cable came out")

    async def story() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda _, context: unhandled.append(context))
        supervisor.mover.cell.robot.at_rest = late
        assert not await supervisor.at_rest()
        await asyncio.sleep(20.0)
        supervisor._rest_query = None
        gc.collect()

    lived(story())
    assert not unhandled


def test_an_enable_asked_for_before_the_line_was_opened_anew_is_void():
    _, supervisor, _ = supervised(enabled=False)
    asked = supervisor.stops
    supervisor.line_opened_anew()
    with pytest.raises(RefusedError, match="type `enable` again"):
        supervisor.enable(asked)


@pytest.mark.parametrize("enabled", [True, False])
def test_a_daemon_that_ends_takes_no_enable_for_a_move_any_more(enabled):
    """Its frontends are open a moment longer than the arm is stopped."""
    world, supervisor, _ = supervised(enabled)

    async def story() -> None:
        await supervisor.close()
        with pytest.raises(RefusedError, match="shutting down"):
            supervisor.enable()
        await supervisor.mover.wait_until_at_rest()
        with pytest.raises(MoveRefusedError, match="not_enabled"):
            await supervisor.mover.travel(NEAR, "late", lambda _: 20.0)
        with pytest.raises(RefusedError, match="`enable`"):
            supervisor.refuse_unless_permitted()

    lived(story())
    assert "move" not in [name for name, _ in world.wire]


def test_who_asks_to_move_while_the_arm_is_being_stopped_is_told_so():
    _, supervisor, _ = supervised()
    answered = asyncio.Event()
    supervisor.mover.cell.robot.stop_motion = waits_for(answered)

    async def story() -> None:
        stopping = asyncio.create_task(supervisor.abort())
        await asyncio.sleep(0.01)
        for typed in (False, True):
            with pytest.raises(RefusedError, match=r"being stopped .*: try again when it is at rest"):
                supervisor.refuse_unless_permitted(typed)
        answered.set()
        await stopping
        supervisor.refuse_unless_permitted()

    lived(story())


def test_other_limits_and_another_cell_hold_from_the_next_move_on():
    world, supervisor, _ = supervised()
    other, arrival = replace(build(world), robot=supervisor.mover.cell.robot), Arrival(timeout_s=7.0)
    supervisor.refit(other, Limits(max_speed_pct=10.0), arrival)
    assert (supervisor.mover.cell, supervisor.mover.arrival) == (other, arrival)

    async def one_move() -> None:
        await supervisor.mover.wait_until_at_rest()
        await supervisor.mover.travel(NEAR, "there", lambda _: 50.0)

    lived(supervisor.run("travel", one_move()))
    assert [move["speed_pct"] for move in world.said("move")] == [10.0]


def test_where_the_arm_was_asked_while_a_fault_stood_it_need_not_be_any_more_after_resume():
    """Between the two its pendant may have moved it."""
    _, supervisor, _ = supervised()

    async def story() -> None:
        await supervisor.stop()
        await supervisor.mover.wait_until_at_rest()
        assert supervisor.mover.next_start is not None
        supervisor.resume()

    lived(story())
    assert supervisor.mover.next_start is None


def test_who_goes_away_while_his_job_runs_is_gone_and_the_job_goes_on():
    _, supervisor, _ = supervised()

    async def story() -> None:
        begun, goes_on, ended = asyncio.Event(), asyncio.Event(), asyncio.Event()

        async def work() -> None:
            begun.set()
            await goes_on.wait()
            ended.set()

        asking = asyncio.create_task(supervisor.run("look", work(), moves=False))
        await begun.wait()
        asking.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asking
        assert supervisor.busy
        goes_on.set()
        await ended.wait()

    lived(story())


@pytest.mark.parametrize(
    ("act", "why", "code"),
    [
        (lambda s: s.abort(), "aborted by the operator", "operator_stop"),
        (lambda s: s.stop("by hand"), "stopped by hand", "operator_stop"),
        (lambda s: s.fail("cameras", "no pair", CAMERAS), "cameras: no pair", "camera_lost"),
    ],
)
def test_a_stop_that_was_not_confirmed_is_told_with_what_it_was_for(act, why, code):
    world, supervisor, _ = supervised()
    failing_aborts(world, StopRefusedError("no such word"), 1)

    async def story() -> None:
        await act(supervisor)
        await supervisor.wait_for_stop_end()

    lived(story())
    assert supervisor.fault_text == f"{why}; NOT CONFIRMED: no such word: press the emergency stop"
    assert {fault["code"] for fault in world.said("fault")} == {code}


def test_a_stop_said_while_a_fault_stands_does_not_take_its_place():
    """Whoever came to say `resume` was told of a stop, and nothing of the drift that had ended the auto before it."""
    world, supervisor, _ = supervised()
    lived(supervisor.fail("calibration", "the right camera has turned", FaultCause(CauseCode.CAMERA_KNOCKED)))
    for who in ("ann", "bob", "bob"):
        lived(supervisor.stop(f"by {who}"))
    assert supervisor.permission.fault == Fault(
        "calibration: the right camera has turned; then stopped by bob",
        (FaultCause(CauseCode.CAMERA_KNOCKED), BY_OPERATOR),
    )
    assert [record["text"] for record in world.said("fault")] == [
        "calibration: the right camera has turned", "stopped by ann", "stopped by bob", "stopped by bob",
    ]  # fmt: skip


def test_a_fault_that_takes_the_place_of_an_alarm_keeps_that_a_person_stopped_the_arm():
    world, supervisor, _ = supervised()
    failing_aborts(world, StopRefusedError("no such word"), 1)
    lost = FaultCause(CauseCode.CAMERA_LOST)

    async def story() -> None:
        await supervisor.stop("by ann")
        await supervisor.wait_for_stop_end()
        await supervisor.fail("cameras", "no pair", lost)

    lived(story())
    assert supervisor.permission.fault == Fault("cameras: no pair", (lost, BY_OPERATOR))


def test_every_stop_ends_when_the_job_has_ended_and_until_then_it_is_under_way():
    """The second as the first: what a job does on its end belongs to it."""
    _, supervisor, _ = supervised()

    async def slow_to_end() -> None:
        try:
            await asyncio.sleep(60.0)
        finally:
            await asyncio.sleep(0.05)

    async def story() -> None:
        for _ in range(2):
            job = asyncio.create_task(supervisor.run("look", slow_to_end()))
            await asyncio.sleep(0.01)
            stopping = asyncio.create_task(supervisor.abort())
            await asyncio.sleep(0.03)
            assert supervisor.permission.stopping
            assert "being stopped (aborted by the operator)" in supervisor.permission.refusal().text
            await stopping
            assert not supervisor.busy
            assert not supervisor.permission.stopping
            with pytest.raises(RefusedError, match="look: aborted by the operator"):
                await job

    lived(story())


def test_a_stop_that_is_never_answered_at_all_sounds_the_alarm_with_that():
    _, supervisor, _ = supervised()
    supervisor.mover.cell.robot.stop_motion = waits_for(asyncio.Event())

    alarm = lived(supervisor.stop("by hand"))
    assert alarm is not None
    assert alarm.startswith("stopped by hand; NOT CONFIRMED: no answer: press the emergency stop")


def test_a_stop_that_was_confirmed_in_time_sounds_no_alarm_later():
    _, supervisor, heard = supervised()

    async def story() -> None:
        assert await supervisor.stop("by hand") is None
        await asyncio.sleep(3 * ABORT_S)

    lived(story())
    assert supervisor.fault_text == "stopped by hand"
    assert [what for what, _ in heard] == [JobEvent.STOP]


@pytest.mark.parametrize(("error", "told"), [(OSError("the line is dead"), "the line is dead"), (OSError(), "OSError")])
def test_why_a_stop_could_not_be_confirmed_is_told_with_the_alarm(error, told):
    world, supervisor, _ = supervised()
    failing_aborts(world, error, 100)

    alarm = lived(supervisor.stop("by hand"))
    assert alarm is not None
    assert f"NOT CONFIRMED: {told}: press" in alarm


def test_a_fault_is_recorded_by_the_code_of_its_cause():
    world, supervisor, _ = supervised()
    lived(supervisor.fail("cameras", "no pair: none came", CAMERAS))
    assert [(fault["code"], fault["text"]) for fault in world.said("fault")] == [
        ("camera_lost", "cameras: no pair: none came")
    ]


def test_who_fails_when_told_of_a_stop_is_told_to_the_loop():
    told = []

    def fails(_: JobEvent) -> None:
        raise OSError("the journal is gone")

    supervisor = Supervisor(build(World(np.random.default_rng(0))), Limits(), Arrival(), fails)

    async def story() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda _, context: told.append(context))
        assert await supervisor.stop() is None

    lived(story())
    assert [str(context["exception"]) for context in told] == ["the journal is gone"]


@pytest.mark.parametrize("way", ["abort", "disable"])
def test_what_a_job_that_is_ended_makes_of_its_end_is_no_fault(way):
    """The controller's terminal, ended by an `abort`, which leaves no fault, left `Preempted: aborted`."""
    world, supervisor, _ = supervised()

    async def terminal() -> None:
        try:
            await endless(world)
        finally:
            raise OSError("aborted")

    async def story() -> None:
        task = asyncio.create_task(supervisor.converse("monitor", terminal, moves=True))
        await until_so(lambda: bool(world.wire))
        assert await getattr(supervisor, way)() is None
        with pytest.raises(OSError, match="aborted"):
            await task

    lived(asyncio.wait_for(story(), 10.0))
    assert supervisor.fault_text is None
    assert [name for name, _ in world.wire] == ["foreign", "abort"], "told once"


@pytest.mark.parametrize(
    ("act", "held"),
    [
        (lambda s: None, False),
        (lambda s: s.hold.pause(), True),
        (lambda s: (s.hold.pause(), s.resume()), True),  # it is asked again, and goes then
        (lambda s: s.hold.step(True), True),
        (lambda s: s.hold.step(False), False),
        (lambda s: s.latch("cameras: gone"), True),
        (lambda s: s.line_opened_anew(), True),
    ],
)
def test_what_the_gate_has_let_go_is_held_back_by_what_is_said_until_its_last_byte_leaves(act, held):
    world, supervisor, _ = supervised()
    asked = []

    def hook(what: str) -> None:
        if what == "move":
            act(supervisor)
            asked.append(supervisor.mover.cell.robot.permission.withheld)

    async def story() -> None:
        await supervisor.mover.wait_until_at_rest()
        supervisor.hold.pause()
        supervisor.resume()
        await supervisor.mover.go(MoveCommand(NEAR, True, 50.0, "over"))

    world.before = hook
    lived(supervisor.run("go", story()))
    assert asked == [held]


@pytest.mark.parametrize("opened_anew", [False, True])
def test_what_is_at_rest_at_last_is_told_as_the_arm_that_was_stopped_only_on_the_line_that_it_was_on(opened_anew):
    """Behind an adapter that was plugged in again there may be another arm."""
    world, supervisor, _ = supervised()
    answers = asyncio.Event()
    supervisor.mover.cell.robot.stop_motion = waits_for(answers)

    async def story() -> None:
        alarm = await supervisor.stop("by hand")
        assert "NOT CONFIRMED" in str(alarm)
        if opened_anew:
            supervisor.line_opened_anew()
        answers.set()
        await supervisor.wait_for_stop_end()

    lived(story())
    (told,) = world.said("rest")
    assert (told["text"] == "the arm is now at rest: the stop is confirmed") is not opened_anew
    assert ("the serial line was reopened after the alarm" in told["text"]) is opened_anew


def test_how_long_a_stop_may_take_is_told_once_the_controller_has_answered_it_and_until_it_is_over():
    world, supervisor, _ = supervised()
    told = []

    def hook(name: str) -> None:
        if name == "abort":
            told.append(supervisor.awaits_confirmation_s)
            supervisor.permission.stop_answered += 1
            told.append(supervisor.awaits_confirmation_s)

    world.before = hook
    assert supervisor.awaits_confirmation_s is None
    lived(supervisor.stop("by hand"))
    assert told == [None, ABORT_S]
    assert supervisor.awaits_confirmation_s is None
