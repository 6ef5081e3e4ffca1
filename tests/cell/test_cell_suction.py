"""End to end on the simulated cell with a suction cup: a block with a bore is picked, and a sensor that lies is asked
about."""

import asyncio

import pytest

from tests.fakes.holed import holed_pair
from tests.fakes.suction_cell import Drawn, picked, suction_rig

pytestmark = pytest.mark.slow


def bored() -> Drawn:
    made = holed_pair("place", 2)[1]
    return Drawn(made.label, made.drawing, made.shape)


def test_a_block_with_a_bore_is_picked_by_suction_beside_the_bore_and_a_lie_of_the_switch_stops_the_arm():
    end, lies, here = picked(2, bored())
    assert (end.outcome, lies) == ("picked", "bin"), end.why
    assert not here.cell.world.strikes
    assert [record["held"] for record in here.log.said("sensor")] == [True, True, True, False]
    end, lies, here = picked(2, bored(), "stuck off")
    assert (end.outcome, lies) == ("fault", "hand"), end.why
    assert here.log.said("cycle_end")[-1]["code"] == "sensor_disagrees"


def test_the_vacuum_switch_follows_a_hand_on_the_cup_so_that_its_input_can_be_found():
    """`signal find vacuum` asks to switch it; no `switch` had an effect, and nothing could be picked."""

    async def story() -> list[str]:
        async with suction_rig(2, [bored()]) as here:
            printed = []
            for high in (False, True, False):
                here.cell.switch_input(1011, high)
                printed.append(await here.robot.ask_input("LISTR SIG(1011)"))
            return printed

    off, on, off_again = asyncio.run(story())
    assert off == off_again != on
