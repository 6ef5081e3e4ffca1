"""A path of several moves: each is judged, timed and asked for from where it really begins, not from where the first
did."""

import asyncio

import numpy as np
import pytest

from daemon import frames
from daemon.arm.hold import PauseAndStep
from daemon.arm.motion import MovedByOthersError, MoveRefusedError
from daemon.arm.permission import MotionPermission
from tests.fakes.fake_cell import HEAD_DOWN, World
from tests.fakes.in_time import lived
from tests.unit.arm.test_motion import NEAR, mover_in


def turned_by(degrees: float) -> np.ndarray:
    """Head down as at the start, turned about the gripper's axis."""
    return HEAD_DOWN @ frames.rigid(frames.rotation_from_vector(np.array([0.0, 0.0, np.radians(degrees)])), np.zeros(3))


def test_who_asks_whether_the_arm_is_still_there_hears_it_from_the_controller():
    """What is believed of the place says nothing of a pendant that moved it since."""
    world = World(np.random.default_rng(0))
    mover = mover_in(world)
    asyncio.run(mover.still_there("looks disagree"))
    world.at = NEAR
    with pytest.raises(MovedByOthersError, match="looks disagree"):
        asyncio.run(mover.still_there("looks disagree"))
    assert mover.belief.resting_reading is None


def test_an_arm_that_hangs_in_a_short_move_is_given_up_after_the_time_of_that_move(monkeypatch):
    mover = mover_in(World(np.random.default_rng(0)))
    granted_s, move = [], mover.cell.robot.move

    async def listening(command, starts, timeout_s, then):
        granted_s.append(timeout_s)
        return await move(command, starts, timeout_s, then)

    monkeypatch.setattr(mover.cell.robot, "move", listening)
    asyncio.run(mover.travel(NEAR, "near", lambda _: 100.0, straight=True))
    assert mover.arrival.slack_s < granted_s[0] < mover.arrival.slack_s + 2.0 < mover.arrival.timeout_s / 2


def test_a_way_to_a_part_gets_slower_leg_by_leg():
    """Its last leg's speed for all would be a crawl, its first one's for all too fast beside the part."""
    world = World(np.random.default_rng(0))
    mover = mover_in(world, max_step_mm=50.0)
    far = frames.perturb(HEAD_DOWN, np.array([120.0, 0, 0, 0, 0, 0]))
    asyncio.run(mover.travel(far, "far", lambda pose: float(10.0 + far[0, 3] - pose[0, 3]), straight=True))
    assert [r["speed_pct"] for r in world.said("move")] == pytest.approx([90.0, 50.0, 10.0])


def test_a_wrist_that_would_be_wound_up_past_its_limit_on_the_way_is_found_out_before():
    """From here the last place is reached the other way round; from the place before it, it is not."""
    mover = mover_in(World(np.random.default_rng(0)))
    way = [turned_by(turn) for turn in (95.0, 190.0, 285.0)]
    mover.check_through(way[:2])
    with pytest.raises(MoveRefusedError, match="no_way"):
        mover.check_through(way)


def test_while_a_move_waits_for_the_end_of_a_pause_nothing_may_be_sent():
    """Also what asks only the permit, as the controller's line does before its last byte."""

    async def story() -> None:
        permission = MotionPermission()
        hold = PauseAndStep(permission, lambda _: None)
        hold.pause("ann")
        waits = asyncio.ensure_future(hold.wait("a move"))
        await asyncio.sleep(1.0)
        assert permission.must_wait
        hold.end_pause()
        await waits
        assert not permission.must_wait

    lived(story())
