"""A cell whose cameras are fixed over the table, from the first look to the bin."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.calibration.board import Board
from daemon.calibration.file import load_calibration
from daemon.calibration.session import CalibrationSession, solve_hand_eye, verify, view_tour
from daemon.cli.demo import PARTS
from daemon.config import load_config
from daemon.pick.cycle import PickCycle
from daemon.pick.settings import ToolPosition
from drivers.simcell.truth import load_truth
from tests.fakes.simulated_cell import FIXED, rig

pytestmark = pytest.mark.slow
BOARD = Board(9, 6, 16.0)


def test_it_picks_four_parts_each_by_one_look_and_the_arm_touches_nothing(model: Any) -> None:
    """The motion monitor of the cell, which knows where its cameras hang, finds nothing (see rig)."""

    async def story() -> Any:
        async with rig(seed=23, model=model, file=FIXED, time_scale=40.0) as here:
            here.cell.scatter(PARTS)
            ends = await here.cycle.auto()
            errors = [here.grasp_error(end) for end in ends[-2:-1]]
            return ends, errors, [here.lies(label) for label in PARTS], here.log.said("look"), out_of_view(here.cycle)

    ends, errors, lie, looks, home = asyncio.run(story())
    assert lie == ["bin"] * 4
    assert [end.outcome for end in ends[:-1]].count("missed") == 0
    assert {end.stops for end in ends if end.label is not None} == {1}
    assert max(mm for mm, _ in errors) < 2.0
    assert all(np.allclose(look["where"], home, atol=0.5) for look in looks)


def out_of_view(cycle: PickCycle) -> Any:
    return cycle.settings.home.pose()


def test_a_person_s_look_waits_until_the_arm_is_out_of_the_view(model: Any) -> None:
    async def story() -> Any:
        async with rig(seed=24, model=model, file=FIXED, time_scale=40.0) as here:
            here.cell.scatter(PARTS[:1])
            await here.cycle.go("bin")
            with pytest.raises(Exception, match="in the fixed cameras' view: `go home` first"):
                await here.cycle.look()
            await here.cycle.go("home")
            return await here.cycle.look()

    assert [part.recognition.label for part in asyncio.run(story()).scene.parts] == ["cube"]


@pytest.mark.long
def test_a_board_in_the_gripper_says_where_the_cameras_are_and_how_well_the_arm_knows_its_place() -> None:
    believed = load_calibration(load_config(FIXED, simulated=True).calibration)
    assert believed.world_from_cyclopean is not None
    by_ruler = frames.perturb(believed.world_from_cyclopean, np.array([6.0, -5.0, 7.0, 0.01, -0.008, 0.01]))
    rough, true = replace(believed, world_from_cyclopean=by_ruler), load_truth(FIXED.parent / "simcell.yaml")

    async def story() -> Any:
        async with rig(seed=25, file=FIXED, time_scale=40.0) as here:
            here.cell.hold_board()
            await here.cycle.move_to(ToolPosition((430.0, 0.0, -110.0), tilt_deg=5.0).pose(), "board in view")
            cycle = here.cycle
            start = cycle.supervisor.mover.wait_until_at_rest, cycle.settings.settling, BOARD, rough, True
            views = await view_tour(CalibrationSession(cycle.supervisor, *start), 9, silence, 100.0)
            return views, cycle.belief.holds_part, [piece.name for piece in cycle.belief.capsules]

    views, holds, load = asyncio.run(story())
    assert holds
    assert set(load) == {"the board in the gripper"}
    after, result = solve_hand_eye(views, BOARD, rough)
    assert after.world_from_cyclopean is not None
    off = frames.difference(after.world_from_cyclopean, np.array(true.world_from_cyclopean))
    at_board = off[:3] + np.cross(off[3:], result.about_mm - after.world_from_cyclopean[:3, 3])
    assert np.linalg.norm(at_board) < 1.0, "the arm itself is half a millimetre off where it says it is"
    assert result.arm.mm < 0.4
    assert verify(views, BOARD, after).passed


async def silence(_: str) -> None:
    """Nobody listens."""
