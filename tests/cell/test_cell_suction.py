"""End to end on the simulated cell with a suction cup: a block with a bore is picked, and a sensor that lies is asked
about."""

import asyncio
from pathlib import Path

import pytest

from drivers.simcell.truth import Works
from tests.fakes.holed import holed_pair
from tests.fakes.suction_cell import VALVES, Drawn, picked, suction_rig, with_valves

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


def test_a_cup_at_outputs_of_the_controller_picks_and_blows_off_and_no_hand_valve_is_typed(tmp_path: Path):
    end, lies, here = picked(2, bored(), truth=with_valves(tmp_path), valves=VALVES)
    assert (end.outcome, lies) == ("picked", "bin"), end.why
    typed = [str(entry) for entry in here.log.wire if "DO SIGNAL" in str(entry) or "DO OPENI" in str(entry)]
    assert not any("OPENI" in line or "CLOSEI" in line for line in typed)
    switched = [(record["name"], record["on"]) for record in here.log.said("signal") if record["name"] != "vacuum"]
    assert switched[-4:] == [("blow", False), ("valve", False), ("blow", True), ("blow", False)]
    assert ("valve", True) in switched


def test_without_its_blow_off_the_part_sticks_to_the_lip_and_that_is_told(tmp_path: Path):
    """Of the simulated cell: the output is there for something."""
    valves = {"valve": VALVES["valve"]}
    end, lies, _ = picked(2, bored(), truth=with_valves(tmp_path), valves=valves)
    assert (end.outcome, lies) == ("released", "hand"), end.why
    assert "still shows in the gripper" in end.why


@pytest.mark.parametrize("valve", ["stuck off", "stuck on"])
def test_a_valve_that_sticks_is_told_and_no_pick_counts(tmp_path: Path, valve: Works):
    end, lies, _ = picked(2, bored(), valve=valve, truth=with_valves(tmp_path), valves=VALVES)
    assert end.outcome != "picked"
    assert lies == ("table" if valve == "stuck off" else "hand"), end.why
