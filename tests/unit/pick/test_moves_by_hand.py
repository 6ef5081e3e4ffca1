"""What people have the arm do between picks: named positions, small moves, a look where it stands."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import numpy as np
import pytest

from daemon import frames
from daemon.arm import MoveRefusedError, RefusedError
from daemon.arrays import Array
from daemon.events.outcomes import Outcome
from daemon.events.pick_order import PickOrder
from daemon.pick.cycle import LATEST
from daemon.pick.outcome import CycleEnd
from daemon.pick.settings import Settings
from tests.fakes.fake_cell import ON_HAND, build, cycle_of, one_part


def test_a_small_move_goes_straight_and_near_from_where_the_arm_rests_and_says_where_to() -> None:
    world = one_part()
    cycle, before = cycle_of(world), world.at.copy()
    asked: list[Array] = []

    def raised(at: Array) -> Array:
        asked.append(at.copy())
        return frames.perturb(at, np.array([0.0, 0.0, 12.0, 0.0, 0.0, 0.0]))

    target = asyncio.run(cycle.jog(raised, "jog z 12"))
    np.testing.assert_array_equal(asked, [before])
    np.testing.assert_allclose(target[:3, 3] - before[:3, 3], [0.0, 0.0, 12.0], atol=1e-9)
    (move,) = world.said("move")
    assert (move["purpose"], move["how"], move["speed_pct"]) == ("jog z 12", "straight", Settings().near_pct)
    np.testing.assert_array_equal(asyncio.run(cycle.wait_until_at_rest()), world.at)
    assert asyncio.run(cycle.where()).world_from_tool.tolist() == world.at.tolist()


def test_an_arm_that_is_not_enabled_makes_no_small_move_and_says_where_it_is_all_the_same() -> None:
    world = one_part()
    cycle = cycle_of(world)
    asyncio.run(cycle.supervisor.disable())
    with pytest.raises(MoveRefusedError, match="not_enabled"):
        asyncio.run(cycle.jog(lambda at: at, "jog"))
    np.testing.assert_array_equal(asyncio.run(cycle.wait_until_at_rest()), world.at)


def test_each_named_position_is_gone_to_at_travel_speed_and_another_is_refused_with_those_there_are() -> None:
    world = one_part()
    settings = Settings(surveys=Settings().surveys[:1] * 2)
    cycle = cycle_of(world, settings)
    assert list(cycle.positions()) == ["home", "bin", "survey", "survey2"]
    np.testing.assert_allclose(cycle.positions()["survey"], settings.surveys[0].pose(ON_HAND))
    asyncio.run(cycle.go("home"))
    np.testing.assert_allclose(world.at, settings.home.pose(), atol=0.5)
    assert {move["speed_pct"] for move in world.said("move")} == {settings.travel_pct}
    with pytest.raises(RefusedError, match="no position 'nowhere'; there are home, bin, survey, survey2"):
        asyncio.run(cycle.go("nowhere"))


def test_other_settings_and_another_calibration_are_those_of_the_next_job() -> None:
    world = one_part()
    cycle = cycle_of(world)
    slower, other = replace(Settings(), near_pct=3.0), build(world)
    cycle.refit(other, slower)
    assert (cycle.cell, cycle.settings) == (other, slower)
    assert cycle.supervisor.mover.cell is other


def test_what_is_left_takes_as_long_as_each_of_the_last_parts_that_were_brought_took() -> None:
    cycle = cycle_of(one_part())
    assert cycle.status()["left_s"] is None
    end = CycleEnd(1, Outcome.PICKED, "cube", "", 1, 10.0, None, None, None, (), None, brought=True)
    for seconds in range(1, 2 * LATEST + 1):
        cycle.ends.append(replace(end, seconds=float(seconds)))
        cycle.ends.append(replace(end, outcome=Outcome.MISSED, brought=False, seconds=500.0))
    cycle.pick_order = PickOrder(3)
    assert cycle.status()["left_s"] == 3 * (1.75 * LATEST + 0.5)
    cycle.pick_order = PickOrder(None)
    assert cycle.status()["left_s"] is None


def test_with_one_camera_a_gripper_low_amid_the_parts_goes_aside_for_no_look() -> None:
    world = one_part()
    cycle = cycle_of(world)
    object.__setattr__(cycle.cell, "alone", "left")
    world.at = world.at.copy()
    world.at[:3, 3] = 480.0, 0.0, -270.0
    with pytest.raises(RefusedError, match="low over the table: raise it first, for example `jog z 50`"):
        asyncio.run(cycle.look())
    assert not world.said("move")


def test_named_positions_of_several_surveys_are_numbered_and_those_of_home_and_bin_are_the_settings() -> None:
    settings = Settings(surveys=Settings().surveys[:1] * 3)
    positions = cycle_of(one_part(), settings).positions()
    assert list(positions) == ["home", "bin", "survey", "survey2", "survey3"]
    np.testing.assert_allclose(positions["home"], settings.home.pose())
    np.testing.assert_allclose(positions["bin"], settings.bin.pose())


def test_going_down_is_one_job_over_the_place_and_then_straight_and_slowly_down_to_it() -> None:
    world = one_part()
    cycle = cycle_of(world)
    over, down = world.at.copy(), world.at.copy()
    over[:3, 3] += (30.0, 0.0, 0.0)
    down[:3, 3] += (30.0, 0.0, -40.0)
    asyncio.run(cycle.go_down(over, down, "touch"))
    settings = cycle.settings
    moves = [(move["purpose"], move["how"], move["speed_pct"]) for move in world.said("move")]
    assert moves == [("touch, over it", "joint", settings.travel_pct), ("touch", "straight", settings.near_pct)]
    np.testing.assert_allclose(world.at, down, atol=0.5)
