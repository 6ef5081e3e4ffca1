"""Who holds the arm: stop, fail, abort, pause, step, dry, restart. The arm is stopped before anything is reported."""

import asyncio
import re
from functools import partial
from typing import Any

import numpy as np
import pytest

from daemon.arm.belief import BeliefSource
from daemon.arm.motion import MoveRefusedError, UnansweredError
from daemon.arm.operators import OperatorRefusedError, RefusedError
from daemon.events.codes import CauseCode, FaultCause
from daemon.events.pick_order import PickOrder
from daemon.pick.cycle import PickCycle
from daemon.pick.transitions import PickState
from tests.fakes.fake_cell import World, cameras_of, cycle_of, one_part
from tests.fakes.in_time import lived
from tests.fakes.waiting import until_so

LOST = FaultCause(CauseCode.CAMERA_LOST)


async def during(world: World, cycle: PickCycle, name: str, count: int, act):
    """Start a pick; at the count-th `name` of the world, run act in another task; give how the pick ended."""
    seen = 0
    acting = []

    def hook(what):
        nonlocal seen
        if what == name:
            seen += 1
            if seen == count:
                acting.append(asyncio.get_running_loop().create_task(act()))

    world.before = hook
    end = await cycle.pick()
    await asyncio.gather(*acting)
    return end


def moves_after_abort(world: World) -> list:
    names = [name for name, _ in world.wire]
    return [n for n in names[names.index("abort") + 1 :] if n != "abort"]


@pytest.mark.parametrize("moment", ["move", "moving", "moved", "where", "hand", "handed"])
def test_stop_at_any_moment_stops_the_arm_first_and_leaves_a_fault_standing(moment):
    world = one_part()
    cycle = cycle_of(world)
    end = lived(during(world, cycle, moment, 1, cycle.supervisor.stop))
    assert (end.outcome, end.why) == ("aborted", "stopped by the operator"), "a person's stop is no missed part"
    assert cycle.state == "fault"
    assert "stopped" in cycle.status()["fault"]
    assert not moves_after_abort(world)


def test_the_arm_is_told_to_stop_before_the_fault_is_logged():
    world = one_part()
    cycle = cycle_of(world)

    def fail(name):
        if name == "moving":
            raise OSError("the cable came out")
        if name == "abort":
            assert not world.said("fault")

    world.before = fail
    end = lived(cycle.pick())
    assert end.outcome == "fault"
    assert "the cable came out" in world.said("fault")[0]["text"]
    assert world.wire[-1][0] == "abort"


@pytest.mark.parametrize("moment", ["where", "move", "moving", "moved", "grab", "see", "hand", "handed"])
@pytest.mark.parametrize("count", [1, 2, 3])
def test_whatever_raises_ends_in_a_fault_with_the_arm_stopped_and_nothing_moves_until_resume(moment, count):
    world = one_part()
    cycle = cycle_of(world)
    seen = 0

    def fail(name):
        nonlocal seen
        seen += name == moment
        if name == moment and seen == count:
            raise RuntimeError("something broke")

    world.before = fail
    end = lived(cycle.pick())
    if seen < count:
        assert end.outcome == "picked"
        return
    assert end.outcome == "fault"
    assert world.wire[-1][0] == "abort"
    sent = len(world.wire)
    with pytest.raises(RefusedError, match="resume"):
        lived(cycle.pick())
    assert len(world.wire) == sent


@pytest.mark.parametrize("word", ["stop", "abort", "disable"])
def test_a_pick_that_is_stopped_as_it_is_being_stopped_for_a_fault_has_ended_with_that(word):
    """It had no end: no record had one, nobody was told of it or counted it, and `status` told of its target on."""
    world = one_part()
    cycle = cycle_of(world)
    stopping = []

    async def story():
        def fail(name):
            if name == "grab" and cycle.status()["target"] and not stopping:
                raise RuntimeError("something broke")
            if name == "abort" and not stopping:
                stopping.append(asyncio.ensure_future(getattr(cycle.supervisor, word)()))

        world.before = fail
        end = await cycle.pick()
        await asyncio.gather(*stopping)
        return end

    end = lived(story())
    assert (end.outcome, end.why) == ("fault", "internal error in facetd: RuntimeError: something broke")
    assert [record["outcome"] for record in world.said("cycle_end")] == ["fault"]
    assert (cycle.status()["target"], cycle.status()["failed"]) == (None, 1)
    assert not moves_after_abort(world)


def test_an_abort_that_is_not_answered_either_sends_the_operator_to_the_emergency_stop():
    world = one_part()
    cycle = cycle_of(world)

    def fail(name):
        if name in ("moving", "abort"):
            raise OSError("no answer")

    world.before = fail
    lived(cycle.pick())
    assert "emergency stop" in cycle.status()["fault"]
    assert cycle.state == "fault"


def test_a_move_that_ends_elsewhere_is_a_fault():
    world = one_part()
    cycle = cycle_of(world)
    robot = cycle.cell.robot
    honest = robot.move

    async def short(command, starts, timeout_s, then=None):
        reading = await honest(command, starts, timeout_s, then)
        reading.world_from_tool[0, 3] += 2.0
        return reading

    robot.move = short
    end = lived(cycle.pick())
    assert end.outcome == "fault"
    assert "WHERE is 2.00 mm" in end.why


def test_after_resume_the_next_pick_goes_and_nothing_went_by_itself():
    world = one_part()
    cycle = cycle_of(world)
    lived(during(world, cycle, "moving", 2, cycle.supervisor.stop))
    world.before = lambda name: None
    sent = len(world.wire)
    cycle.supervisor.resume()
    assert (cycle.state, len(world.wire)) == ("idle", sent)
    assert lived(cycle.pick()).outcome == "picked"


def test_abort_gives_the_pick_up_without_a_fault():
    world = one_part()
    cycle = cycle_of(world)
    end = lived(during(world, cycle, "moving", 2, cycle.supervisor.abort))
    assert (end.outcome, cycle.state, cycle.status()["fault"]) == ("aborted", "idle", None)
    assert not moves_after_abort(world)


def test_a_fault_that_was_aborted_meanwhile_still_stands_and_is_cleared_by_one_resume():
    cycle = cycle_of(one_part())

    async def story():
        await cycle.supervisor.stop()
        await cycle.supervisor.abort()
        before = cycle.state, cycle.status()["fault"]
        cycle.supervisor.resume()
        return before, (cycle.state, cycle.status()["fault"])

    before, after = lived(story())
    assert before == ("fault", "stopped by the operator")
    assert after == ("idle", None)


def test_disable_in_mid_pick_stops_the_arm_and_a_device_that_fails_leaves_its_code():
    world = one_part()
    cycle = cycle_of(world)
    assert lived(during(world, cycle, "moving", 2, cycle.supervisor.disable)).outcome == "aborted"
    world = one_part()
    cycle = cycle_of(world)
    lived(during(world, cycle, "moving", 2, lambda: cycle.supervisor.fail("camera_lost", "left camera is gone", LOST)))
    assert cycle.status()["fault"] == "camera_lost: left camera is gone"


def test_pause_holds_before_the_next_move_and_resume_goes_on():
    world = one_part()
    cycle = cycle_of(world)

    async def story():
        world.before = lambda name: cycle.supervisor.hold.pause() if name == "moving" else None
        task = asyncio.create_task(cycle.pick())
        await until_so(lambda: cycle.state == "paused")
        world.before, sent = lambda _: None, len(world.wire)
        await asyncio.sleep(60.0)
        assert len(world.wire) == sent > 0
        cycle.supervisor.resume()
        return await task

    assert lived(story()).outcome == "picked"
    assert [r["to"] for r in world.said("state")].count("paused") == 1


def test_stop_while_paused_is_heard():
    world = one_part()
    cycle = cycle_of(world)

    async def story():
        cycle.supervisor.hold.pause()
        task = asyncio.create_task(cycle.pick())
        await until_so(lambda: cycle.state == "paused")
        await cycle.supervisor.stop()
        return await task

    assert lived(story()).outcome == "aborted"
    assert [name for name, _ in world.wire] == ["abort"]


def test_in_step_mode_each_move_is_told_and_waits_for_a_yes():
    world = one_part()
    cycle = cycle_of(world)

    async def story():
        cycle.supervisor.hold.step(True)
        task = asyncio.create_task(cycle.pick())
        told = []
        while not task.done():
            await asyncio.sleep(0.001)
            pending = cycle.status()["pending"]
            if pending is not None:
                told.append(pending)
                assert len(world.wire) == len(told) - 1
                cycle.supervisor.hold.confirm()
                await asyncio.sleep(0)
        return await task, told

    end, told = lived(story())
    assert end.outcome == "picked"
    assert told[0].startswith("bin, to open the gripper first: joint move to ")
    assert told[told.index("open the gripper") + 1].startswith("survey 1: joint move to ")
    assert len(told) == len(world.wire)
    gripper = ["open the gripper", "close the gripper", "open the gripper"]
    assert [text for text in told if text.endswith("the gripper")] == gripper


def test_a_move_that_nobody_confirms_while_its_look_is_valid_is_asked_about_again_after_a_new_look():
    """A careful person's late yes was refused as stale, and the part left alone as out of reach."""
    world = one_part()
    cycle = cycle_of(world)

    async def story():
        hold = cycle.supervisor.hold
        hold.step(True)
        task = asyncio.create_task(cycle.pick())
        late = []
        while not task.done():
            await asyncio.sleep(0.001)
            waiting = hold.waiting
            if waiting is None or waiting.answer.done():
                continue
            if "its look is valid for" in waiting.text and len(late) < 4:
                late.append(waiting.text)
                world.now_s += 20.0
                await until_so(partial(lambda before: hold.waiting is not before, waiting))
                assert isinstance(waiting.answer.exception(), UnansweredError)
            else:
                hold.confirm()
        return await task, late

    end, late = lived(story())
    assert all(re.search(r"; its look is valid for (19|20) s$", text) for text in late), late
    assert [r["code"] for r in world.said("decision")].count("looked_again") == len(late) == 4
    assert [r["rule"] for r in world.said("refusal")] == ["not_confirmed"] * 4
    assert (end.outcome, end.skipped) == ("picked", ())


def test_a_no_in_step_mode_gives_the_pick_up_before_the_move():
    world = one_part()
    cycle = cycle_of(world)

    async def story():
        cycle.supervisor.hold.step(True)
        task = asyncio.create_task(cycle.pick())
        await until_so(lambda: cycle.status()["pending"] is not None)
        cycle.supervisor.hold.refuse()
        return await task

    assert lived(story()).outcome == "aborted"
    assert not [name for name, _ in world.wire if name == "move"]


def test_no_to_a_move_asked_for_by_hand_is_no_fault():
    world = one_part()
    cycle = cycle_of(world)

    async def story():
        cycle.supervisor.hold.step(True)
        task = asyncio.create_task(cycle.go("home"))
        await until_so(lambda: cycle.status()["pending"] is not None)
        cycle.supervisor.hold.refuse()
        with pytest.raises(OperatorRefusedError):
            await task

    lived(story())
    assert cycle.status()["fault"] is None


def test_dry_does_everything_but_the_bytes():
    world = one_part()
    cycle = cycle_of(world)
    cycle.supervisor.dry(True)
    end = lived(cycle.pick())
    assert end.outcome == "dry"
    assert not world.wire
    assert world.said("move")
    assert not any(r["sent"] for r in world.said("move"))


def test_a_dry_pick_with_a_full_hand_puts_nothing_down_and_says_so():
    """It said `placed`, and took the hand for empty: the next pick let the part fall where it opened its hand."""
    world = one_part()
    cycle = cycle_of(world)
    world.held = "pyramid"
    cycle.holding(True)
    cycle.supervisor.dry(True)
    end = lived(cycle.pick())
    assert (end.outcome, cycle.status()["holding"], world.wire) == ("dry", True, [])
    cycle.supervisor.dry(False)
    assert lived(cycle.pick()).outcome == "emptied"
    assert world.binned == ["pyramid"]


def test_a_second_job_is_refused_while_one_runs_and_says_which():
    world = one_part()
    cycle = cycle_of(world)

    async def story():
        task = asyncio.create_task(cycle.pick())
        await asyncio.sleep(0)
        with pytest.raises(RefusedError, match="busy: pick"):
            await cycle.look()
        with pytest.raises(RefusedError, match="busy: pick"):
            cycle.supervisor.dry(True)
        return await task

    assert lived(story()).outcome == "picked"


def test_a_pick_goes_on_when_the_one_who_asked_goes_away():
    world = one_part()
    cycle = cycle_of(world)

    async def story():
        asker = asyncio.create_task(cycle.pick())
        await asyncio.sleep(0.01)
        asker.cancel()
        await asyncio.gather(asker, return_exceptions=True)
        await until_so(lambda: cycle.status()["doing"] is None)

    lived(story())
    assert world.binned == ["cube"]


def test_a_restart_in_mid_cycle_comes_back_in_fault_and_asks_about_the_gripper():
    world = one_part()
    cycle = cycle_of(world)
    cycle.recover("retreat", closed=True)
    with pytest.raises(RefusedError, match="resume"):
        lived(cycle.pick())
    cycle.supervisor.resume()
    with pytest.raises(RefusedError, match="holding"):
        lived(cycle.pick())
    assert not world.wire
    cycle.holding(True)
    world.held = "pyramid"
    end = lived(cycle.pick())
    assert (end.outcome, world.binned) == ("emptied", ["pyramid"])
    assert lived(cycle.pick()).outcome == "picked"


def test_a_stop_with_the_hand_around_a_part_asks_about_the_gripper():
    world = one_part()
    cycle = cycle_of(world)
    lived(during(world, cycle, "handed", 2, cycle.supervisor.stop))
    assert cycle.status()["holding"] is None


@pytest.mark.parametrize("moment", ["hand", "handed"])
def test_a_stop_while_the_gripper_lets_go_above_the_bin_asks_about_the_gripper(moment):
    world = one_part()
    cycle, stops = cycle_of(world), []

    def stop(what):
        if what == moment and cycle.state is PickState.BIN and not stops:
            stops.append(asyncio.get_running_loop().create_task(cycle.supervisor.stop()))

    async def story():
        world.before = stop
        end = await cycle.pick()
        await asyncio.gather(*stops)
        return end

    assert lived(story()).outcome == "aborted"
    assert stops
    assert cycle.status()["holding"] is None


@pytest.mark.parametrize(
    ("said", "first"), [("", "bin, to"), ("no", "bin, to"), ("open", "survey 1"), ("yes", "bin"), ("dry", "bin, to")]
)
def test_that_a_hand_is_empty_which_this_daemon_never_opened_is_a_word_and_it_opens_over_the_bin(said, first):
    """A state folder that is new, or from a backup, and a `holding no` of before a restart say that it is empty; where
    a part was in it all the same, it fell on the table from where the first approach began."""
    world = one_part()
    cycle = cycle_of(world)

    async def story():
        if said in ("yes", "no"):
            cycle.holding(said == "yes")
        if said == "open":
            await cycle.set_gripper(False)
        if said == "dry":
            cycle.supervisor.mover.dry = True
            await cycle.pick()
            cycle.supervisor.mover.dry = False
        begun = len(world.records)
        return [await cycle.pick(), await cycle.pick()], begun

    ends, begun = lived(story())
    assert [end.outcome for end in ends] == (["emptied", "picked"] if said == "yes" else ["picked", "empty"])
    moves = [r for r in world.records[begun:] if r["kind"] == "move"]
    assert moves[0]["purpose"].startswith(first)
    over = sum(move["purpose"].startswith("bin, to") for move in moves)
    assert over in ((2, 3) if first == "bin, to" else (0,)), "there and down, once"


def test_what_a_hand_holds_that_has_closed_is_not_known_until_it_was_looked_at():
    """`status` said that it was empty, all the way up with the part in it."""
    world = one_part()
    cycle = cycle_of(world)
    said = []

    def note(name):
        if name in ("handed", "moved"):
            said.append((world.closed, cycle.state, cycle.status()["holding"]))

    world.before = note
    assert lived(cycle.pick()).outcome == "picked"
    assert {holding for closed, state, holding in said if closed and state != "bin"} == {None}
    assert {holding for closed, _, holding in said if not closed} == {False, None}, "not while it opens either"


def test_closing_the_daemon_stops_the_arm_and_ends_its_task():
    world = one_part()
    cycle = cycle_of(world)
    assert lived(during(world, cycle, "moving", 2, cycle.supervisor.close)).outcome == "aborted"
    assert world.wire[-1][0] == "abort"


def test_an_unknown_place_is_refused_with_the_places_there_are():
    cycle = cycle_of(one_part())
    with pytest.raises(RefusedError, match="home, bin, survey"):
        lived(cycle.go("moon"))


def test_a_look_waits_until_the_images_agree_and_the_settling_time_is_logged():
    world = one_part()
    cycle = cycle_of(world)
    cameras_of(cycle.cell).shaking = 3
    look = lived(cycle.look())
    assert look.taken.settled_s > 0.05
    said = world.said("look")[0]
    assert said["seconds"]["settled"] == look.taken.settled_s
    assert 0 < said["seconds"]["from_light"] == look.from_light_s <= look.seconds - look.taken.settled_s + 1e-9
    assert said["health"]["skew_ms"] == 0.0


def test_images_that_never_agree_are_told_and_are_no_look():
    world = one_part()
    cycle = cycle_of(world)
    cameras_of(cycle.cell).shaking = 10_000
    with pytest.raises(Exception, match="still change"):
        lived(cycle.look())
    assert not world.said("look")


def test_a_look_needs_no_enable_and_moves_nothing():
    world = one_part()
    cycle = cycle_of(world)
    lived(cycle.supervisor.disable())
    world.wire.clear()
    assert [p.recognition.label for p in lived(cycle.look()).scene.parts] == ["cube"]
    assert not world.wire


@pytest.mark.parametrize("job", ["look", "go", "pick"])
def test_nothing_is_reckoned_from_a_single_where(job):
    """But that the arm is still above the bin, where its gripper is to open."""
    world = one_part()
    cycle = cycle_of(world)
    where = cycle.cell.robot.where

    async def one_where():
        above_the_bin = np.allclose(world.at, cycle.settings.bin.pose(), atol=0.1)
        assert above_the_bin, "of a moving arm it would be a place on the way"
        return await where()

    cycle.cell.robot.where = one_where
    jobs: dict[str, Any] = {"look": cycle.look, "go": lambda: cycle.go("home"), "pick": cycle.pick}
    lived(jobs[job]())
    assert cycle.status()["fault"] is None


def test_a_look_at_an_arm_that_goes_on_moving_is_refused():
    world = one_part()
    cycle = cycle_of(world)

    async def moving():
        raise OSError("not at rest within 5 s")

    cycle.cell.robot.wait_until_at_rest = moving
    with pytest.raises(OSError, match="not at rest"):
        lived(cycle.look())
    assert not world.said("look")


@pytest.mark.parametrize("closed", [True, False])
def test_a_hand_stopped_in_its_motion_is_one_of_which_nobody_knows_whether_it_holds_a_part(closed):
    """It had closed, and the next way was guarded as if it were empty."""
    world = World(np.random.default_rng(0))
    cycle = cycle_of(world)
    stopping = []

    async def hand(closed: bool) -> None:
        stopping.append(asyncio.create_task(cycle.supervisor.stop()))
        await asyncio.sleep(60.0)

    cycle.beliefs.learn(BeliefSource.COMMANDED, holding=False if closed else None)
    cycle.cell.robot.set_gripper = hand

    async def story():
        with pytest.raises(RefusedError):
            await cycle.set_gripper(closed)
        await asyncio.gather(*stopping)

    lived(story())
    assert cycle.belief.holds_part is None


@pytest.mark.parametrize(("closed", "full"), [(False, True), (True, False)])
@pytest.mark.parametrize("why", ["dry", "fault"])
def test_a_hand_that_was_told_nothing_holds_what_it_held(closed, full, why):
    """In a dry run `hand open` had the part in it forgotten."""
    world = World(np.random.default_rng(0))
    cycle = cycle_of(world)
    cycle.beliefs.learn(BeliefSource.COMMANDED, holding=full)
    if why == "dry":
        cycle.supervisor.dry(True)
        lived(cycle.set_gripper(closed))
    else:
        cycle.supervisor.latch("stopped")
        with pytest.raises(MoveRefusedError):
            lived(cycle.set_gripper(closed))
    assert (cycle.belief.holds_part, world.wire) == (full, [])


@pytest.mark.parametrize("act", ["stop", "abort"])
def test_a_stop_in_the_last_part_of_an_auto_that_looks_again_waits_for_no_further_look(act):
    """The wait for parts began after the stop: until it was over, an hour at most, nobody was told of the stop, and
    no `resume` was heard."""
    world = one_part()
    cycle = cycle_of(world)

    async def story():
        async def end_it():
            cycle.auto_off()
            await asyncio.wait_for(getattr(cycle.supervisor, act)(), 1.0)
            assert not cycle.supervisor.permission.stopping

        acting = []

        def act_once(name):
            if name == "moving" and not acting:
                acting.append(asyncio.create_task(end_it()))

        world.before = act_once
        (end,) = await cycle.auto(PickOrder(every_s=3600.0))
        await asyncio.gather(*acting)
        return end

    assert lived(asyncio.wait_for(story(), 5.0)).outcome == "aborted"
    assert cycle.pick_order is None


@pytest.mark.parametrize(("purpose", "closes"), [("grasp", True), ("bin", False)])
def test_a_pause_on_the_way_to_the_part_or_to_the_bin_holds_the_hand_as_well(purpose, closes):
    """The arm came to rest there, and the fingers closed, or let go, before anybody said `resume`."""
    world = one_part()
    cycle = cycle_of(world)
    cycle.holding(False)

    async def story():
        def pause(name):
            if name == "moving" and world.said("move")[-1]["purpose"] == purpose:
                cycle.supervisor.hold.pause()

        world.before = pause
        picking = asyncio.create_task(cycle.pick())
        while ("hand", closes) not in world.wire[3:]:
            await until_so(lambda: cycle.state == "paused")
            told = len(world.wire)
            await asyncio.sleep(0.05)
            assert (len(world.wire), world.wire[-1][0]) == (told, "move")
            cycle.supervisor.resume()
            await until_so(partial(lambda before: len(world.wire) != before, told))
        return await picking

    assert lived(asyncio.wait_for(story(), 60.0)).outcome == "picked"


def test_in_step_mode_the_hand_waits_for_a_yes_and_a_no_leaves_it_and_what_is_known_of_it_as_it_was():
    world = one_part()
    cycle = cycle_of(world)

    async def story():
        cycle.supervisor.hold.step(True)
        closing = asyncio.create_task(cycle.set_gripper(closed=True))
        while cycle.status()["pending"] is None:
            await asyncio.sleep(0)
        assert (cycle.status()["pending"], world.wire) == ("close the gripper", [])
        cycle.supervisor.hold.refuse()
        with pytest.raises(OperatorRefusedError):
            await closing

    lived(asyncio.wait_for(story(), 10.0))
    assert (world.wire, cycle.belief.holds_part) == ([], False)


def no_one_says_yes_to(purpose: str):
    """A story in step mode: yes to every move but the one home."""

    async def story(world: World, cycle: PickCycle):
        hold = cycle.supervisor.hold
        hold.step(True)
        task = asyncio.create_task(cycle.pick())
        while not task.done():
            await asyncio.sleep(0.001)
            waiting = hold.waiting
            if waiting is not None and not waiting.answer.done():
                (hold.refuse if waiting.text.startswith(purpose) else hold.confirm)()
        return await task

    return story


def on_the_way_home(act):
    """A story in which act is asked for once the arm moves home."""

    async def story(world: World, cycle: PickCycle):
        acting = []

        def hook(what):
            if what == "move" and cycle.state is PickState.HOME and not acting:
                acting.append(asyncio.get_running_loop().create_task(getattr(cycle.supervisor, act)()))

        world.before = hook
        end = await cycle.pick()
        await asyncio.gather(*acting)
        return end

    return story


async def out_of_reach(world: World, cycle: PickCycle):
    """A story in which the arm cannot reach home."""
    world.unreached = cycle.settings.home.pose()[:3, 3]
    return await cycle.pick()


@pytest.mark.parametrize(
    ("story", "code", "fault", "there"),
    [
        (no_one_says_yes_to("home"), "operator_no", None, True),
        (no_one_says_yes_to("home"), "operator_no", None, False),
        (on_the_way_home("stop"), "operator_stop", "stopped", True),
        (on_the_way_home("stop"), "operator_stop", "stopped", False),
        (on_the_way_home("abort"), "operator_abort", None, True),
        (out_of_reach, "out_of_reach", "cannot reach", True),
    ],
)
def test_what_stops_the_arm_on_the_way_home_leaves_the_pick_its_outcome(story, code, fault, there):
    """The part was in the bin, and the pick `aborted` and counted nowhere."""
    world = one_part()
    cycle = cycle_of(world)
    if not there:
        world.lying.clear()
    end = lived(story(world, cycle))
    status, (record,) = cycle.status(), world.said("cycle_end")
    assert (end.outcome, end.brought) == (("picked", True) if there else ("empty", False)), end.why
    assert end.ended_by is not None
    assert "; then " in end.why
    assert (record["outcome"], record["stopped"], record["code"]) == (end.outcome, code, None)
    assert (status["picked"], status["tried"], status["aborted"]) == (there, there, 0)
    assert (fault or "") in (status["fault"] or ""), "what followed stands as a fault of its own"
    assert (status["fault"] is None) is (fault is None)


def test_a_part_let_go_over_the_bin_before_a_fault_is_released_and_auto_has_one_less_to_bring():
    """No look had said yet that the gripper is empty: nobody confirmed the part, and nobody is to pick it again."""
    world = one_part()
    world.put("pyramid", 520, 100, 0.4)
    cycle = cycle_of(world)

    def torn(what):
        if what == "grab" and world.binned:
            raise OSError(5, "the camera is gone")

    world.before = torn
    (end,) = lived(cycle.auto(PickOrder(2)))
    assert (end.outcome, end.brought, end.ended_by) == ("released", True, "error"), end.why
    assert cycle.pick_order == PickOrder(1), "what is left can be resumed"
    assert world.said("auto")[-1]["count"] == 1, "and after a restart as well"
    assert (cycle.status()["released"], cycle.status()["failed"]) == (1, 0)


def test_the_last_part_of_an_auto_in_the_bin_leaves_nothing_to_resume_though_the_way_home_is_stopped():
    world = one_part()
    cycle = cycle_of(world)

    async def story():
        acting = []

        def hook(what):
            if what == "move" and cycle.state is PickState.HOME and not acting:
                acting.append(asyncio.get_running_loop().create_task(cycle.supervisor.stop()))

        world.before = hook
        ends = await cycle.auto(PickOrder(1))
        await asyncio.gather(*acting)
        return ends

    (end,) = lived(story())
    assert (end.outcome, end.ended_by) == ("picked", "stop")
    assert cycle.pick_order is None
